"""Records with faults of their own: four plants, ten kinds of fault, each with and without an unmodelled effect.

The plants are integrated here, with another integrator and step than the package's.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from sksurrogate.physics import ODESimulator

__all__ = ["FAULTS", "PLANTS", "RecordCase", "make_case"]

#: Runs of a record, and rows of a run.
RUNS, ROWS = 5, 240
FAULTS = (
    "nothing", "spikes", "dropouts", "stuck", "shift", "offset", "gain", "hum", "input_noise", "late_inputs", "hold",
)  # fmt: skip


@dataclass(frozen=True)
class Plant:
    """A nominal plant, and the effect that the real one has beside it.

    Attributes
    ----------
    rhs : callable (t, x, u, p)
    missing : callable (t, x, u, p) -> tuple
        What the real plant adds to dx/dt.
    effect : str
        Name of the catalogue.
    also : tuple of str
        Other right names: twins of it on these data.
    """

    rhs: Callable[..., Any]
    missing: Callable[..., Any]
    effect: str
    also: tuple[str, ...]
    states: tuple[str, ...]
    outputs: tuple[str, ...]
    params: dict[str, float]
    dt: float
    amplitude: float
    level: float
    x0: tuple[float, ...]


PLANTS = {
    "cart": Plant(
        lambda t, x, u, p: (x[1], (u[0] - p["k"] * x[0] - p["c"] * x[1]) / p["m"]),
        lambda t, x, u, p: (0.0 * x[0], -0.45 * np.tanh(x[1] / 1e-3)),
        "coulomb_friction",
        ("asymmetric_friction", "stribeck_friction", "lugre_friction"),
        ("position", "velocity"),
        ("position",),
        {"m": 1.0, "k": 6.0, "c": 0.6},
        0.05,
        4.0,
        0.0,
        (0.0, 0.0),
    ),
    "tanks": Plant(
        lambda t, x, u, p: (
            u[0] / p["a"] - p["q"] * np.sqrt(np.maximum(x[0], 1e-6)),
            p["q"] * np.sqrt(np.maximum(x[0], 1e-6)) - p["r"] * np.sqrt(np.maximum(x[1], 1e-6)),
        ),
        lambda t, x, u, p: (0.0 * x[0], -0.12 * x[1]),
        "linear_loss",
        ("sqrt_leak", "power_law"),
        ("upper", "lower"),
        ("upper", "lower"),
        {"a": 1.0, "q": 0.5, "r": 0.45},
        0.2,
        0.5,
        0.7,
        (1.0, 1.0),
    ),
    "motor": Plant(
        lambda t, x, u, p: (
            (u[0] - p["R"] * x[0] - p["K"] * x[1]) / p["L"],
            (p["K"] * x[0] - p["b"] * x[1]) / p["J"],
        ),
        lambda t, x, u, p: (0.0 * x[0], -0.02 * x[1] * np.abs(x[1])),
        "quadratic_drag",
        ("power_law", "cubic_stiffness"),
        ("current", "speed"),
        ("current", "speed"),
        {"R": 1.0, "L": 0.2, "K": 0.5, "b": 0.05, "J": 0.05},
        0.02,
        6.0,
        0.0,
        (0.0, 0.0),
    ),
    "oven": Plant(
        lambda t, x, u, p: (p["g"] * u[0] - p["h"] * (x[0] - x[1]), p["w"] * (x[0] - x[1]) - p["l"] * x[1]),
        lambda t, x, u, p: (0.0 * x[0], -0.02 * x[1] ** 2),
        "quadratic_loss",
        ("quadratic_drag", "power_law"),
        ("coil", "air"),
        ("air",),
        {"g": 1.0, "h": 0.5, "w": 0.3, "l": 0.1},
        0.5,
        1.0,
        1.2,
        (1.0, 1.0),
    ),
}


@dataclass(frozen=True)
class RecordCase:
    """A record, its simulator, and what is wrong with it.

    Attributes
    ----------
    name : str
    simulator : ODESimulator
    U, Y : ndarray
    groups : ndarray of int
    fault : str
        One of :data:`FAULTS`.
    effect : str or None
    also : tuple of str
    """

    name: str
    simulator: ODESimulator
    U: np.ndarray
    Y: np.ndarray
    groups: np.ndarray
    fault: str
    effect: str | None
    also: tuple[str, ...]


def _measured(plant: Plant, U: np.ndarray, x0: np.ndarray, effect: bool, joined: bool) -> np.ndarray:
    """States (n_samples, n_states) of the real plant: classical Runge-Kutta, ten steps a sample, inputs held or joined."""
    steps, x, out = 10, np.array(x0, dtype=float), []

    def slope(x: np.ndarray, u: np.ndarray) -> np.ndarray:
        rate = np.array(plant.rhs(0.0, x, u, plant.params), dtype=float)
        return rate + np.array(plant.missing(0.0, x, u, plant.params), dtype=float) if effect else rate

    h = plant.dt / steps
    for u, later in zip(U, np.vstack([U[1:], U[-1:]])):
        out.append(x)
        for k in range(steps):
            first, middle, last = (u + joined * (k + part) / steps * (later - u) for part in (0.0, 0.5, 1.0))
            a = slope(x, first)
            b = slope(x + 0.5 * h * a, middle)
            c = slope(x + 0.5 * h * b, middle)
            d = slope(x + h * c, last)
            x = x + h / 6.0 * (a + 2 * b + 2 * c + d)
    return np.array(out)


def _spoil(fault: str, Y: list[np.ndarray], U: list[np.ndarray], rng: Any, spread: np.ndarray, sd: np.ndarray) -> None:
    """Put a fault into the recorded runs, in their place; the last output where one is concerned."""
    j = Y[0].shape[1] - 1
    n = len(Y[0])
    if fault == "spikes":
        for y in Y:
            rows = rng.choice(np.arange(3, n - 3), n // 50, replace=False)
            y[rows, j] += rng.choice([-1, 1], len(rows)) * rng.uniform(8, 50, len(rows)) * sd[j]
    elif fault == "dropouts":
        for y in Y[1:4]:
            for a in rng.choice(np.arange(5, n - 12), 3, replace=False):
                y[a : a + int(rng.integers(1, 7)), j] = y[:, j].min() - 0.5 * spread[j]
    elif fault == "stuck":
        a = int(rng.integers(40, 140))
        Y[2][a : a + 45, j] = Y[2][a, j]
    elif fault == "shift":
        k = int(rng.integers(3, 7))
        Y[1][:] = np.vstack([np.repeat(Y[1][:1], k, axis=0), Y[1][:-k]])
    elif fault == "offset":
        for y, b in zip(Y, rng.permutation([-0.3, 0.25, 0.1, -0.15, 0.35])):
            y[:, j] += b * spread[j]
    elif fault == "gain":
        for y, g in zip(Y, rng.permutation([-0.12, 0.1, 0.05, -0.07, 0.15])):
            y[:, j] *= 1.0 + g
    elif fault == "hum":
        w = rng.uniform(0.8, 2.2)
        for y in Y:
            y[:, j] += 0.15 * spread[j] * np.sin(w * np.arange(n) + rng.uniform(0, 2 * np.pi))
    elif fault == "input_noise":
        size = 0.35 * float(np.std(np.concatenate(U)))
        for u in U:
            u[:, 0] += size * rng.normal(size=n)
    elif fault == "late_inputs":
        for u in U:
            u[1:] = u[:-1].copy()


def make_case(name: str, fault: str, with_effect: bool, seed: int = 0) -> RecordCase:
    """One record.

    Parameters
    ----------
    name : str
        Of :data:`PLANTS`.
    fault : str
        Of :data:`FAULTS`.
    with_effect : bool
        Whether the real plant has its effect.
    seed : int, default=0

    Returns
    -------
    RecordCase
    """
    plant = PLANTS[name]
    rng = np.random.default_rng([seed, sorted(PLANTS).index(name), FAULTS.index(fault), int(with_effect)])
    held = 12
    U = [
        plant.level + plant.amplitude * np.repeat(rng.uniform(-1, 1, ROWS // held), held)[:, None] for _ in range(RUNS)
    ]
    if fault == "hold":  # a signal that moves all the time
        rows = np.arange(ROWS)
        U = [np.interp(rows, rows[::held], u[::held, 0])[:, None] for u in U]
    X = [_measured(plant, u, np.array(plant.x0), with_effect, fault == "hold") for u in U]
    seen = [plant.states.index(output) for output in plant.outputs]
    Y = [x[:, seen] for x in X]
    spread = np.std(np.concatenate(Y), axis=0)
    sd = 0.01 * spread
    Y = [y + sd * rng.normal(size=y.shape) for y in Y]
    U = [u.copy() for u in U]
    _spoil(fault, Y, U, rng, spread, sd)
    simulator = ODESimulator(
        plant.rhs,
        states=list(plant.states),
        inputs=["u"],
        outputs=list(plant.outputs),
        params=plant.params,
        dt=plant.dt,
        x0=list(plant.x0),
    )
    groups = np.repeat(np.arange(RUNS), ROWS)
    effect = plant.effect if with_effect else None
    title = f"{name}/{fault}/{'effect' if with_effect else 'alone'}"
    return RecordCase(title, simulator, np.vstack(U), np.vstack(Y), groups, fault, effect, plant.also)
