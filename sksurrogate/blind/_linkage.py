"""A two-link arm as differential equations, with friction in one of its joints: laws at ports without MuJoCo."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from sksurrogate.blind._robots import EFFECT_SIZES, MOVED
from sksurrogate.physics import ODESimulator

#: Steps in a sample of the real arm; kinks of its frictions over the size of the speeds.
LINKAGE_SUBSTEPS, SHARP = 24, 2e-3
#: Kind -> names at the torque of the joint that are right answers.
LINKAGE_ANSWERS: dict[str, tuple[str, ...]] = {
    "coulomb": ("coulomb_friction",),
    "viscous": ("linear_loss",),
    "stribeck": ("stribeck_friction",),
    "drag": ("quadratic_drag",),
    "load": ("load_friction", "coulomb_friction", "stribeck_friction", "lugre_friction", "asymmetric_friction"),
}


def arm_rates(t: Any, x: Any, u: Any, p: Mapping[str, Any]) -> Any:
    """Equations of motion of two uniform links, angles from the vertical, the second one relative to the first."""
    q1, q2, v1, v2 = x
    m1, m2, l1, l2, g = p["m1"], p["m2"], p["l1"], p["l2"], p["g"]
    i2, couple = m2 * l2**2 / 3.0, 0.5 * m2 * l1 * l2
    cos, sin = np.cos(q2), np.sin(q2)
    a = m1 * l1**2 / 3.0 + m2 * l1**2 + i2 + 2.0 * couple * cos
    b = i2 + couple * cos
    tip = 0.5 * m2 * g * l2 * np.sin(q1 + q2)
    r1 = u[0] + couple * sin * (2.0 * v1 * v2 + v2**2) - (0.5 * m1 + m2) * g * l1 * np.sin(q1) - tip - p["d1"] * v1
    r2 = u[1] - couple * sin * v1**2 - tip - p["d2"] * v2
    d = a * i2 - b * b
    return v1, v2, (i2 * r1 - b * r2) / d, (a * r2 - b * r1) / d


def _friction(kind: str, v: Any, u: Any, size: Any, unit: float, dice: np.ndarray) -> Any:
    """Torque of the friction."""
    if kind == "viscous":
        return -size * unit * v / 2.0
    if kind == "drag":
        return -size * unit * v * np.abs(v) / 4.0
    level = size * unit
    if kind == "stribeck":
        level = level * (1.0 + (0.5 + dice[0]) * np.exp(-((v / (0.2 + 0.6 * dice[1])) ** 2)))
    elif kind == "load":
        level = size * (0.4 * unit + np.abs(u))
    return -level * np.tanh(v / SHARP)


def _march(p: Mapping[str, float], dt: float, U: np.ndarray, X0: np.ndarray, acting: Any = None) -> np.ndarray:
    """Angles (n_runs, n_samples, 2) by Runge-Kutta, all runs at once."""
    x, h, out = X0.T.copy(), dt / LINKAGE_SUBSTEPS, np.empty((len(U), U.shape[1], 2))

    def rates(z: np.ndarray, u: np.ndarray) -> np.ndarray:
        if acting is not None:
            j, force = acting
            u = u.copy()
            u[j] = u[j] + force(z[2 + j], u[j])
        return np.array(arm_rates(0.0, z, u, p))

    for k in range(U.shape[1]):
        out[:, k] = x[:2].T
        u = U[:, k].T
        for _ in range(LINKAGE_SUBSTEPS):
            k1 = rates(x, u)
            k2 = rates(x + h / 2 * k1, u)
            k3 = rates(x + h / 2 * k2, u)
            x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + rates(x + h * k3, u))
    return out


def linkage_case(rng: np.random.Generator, kind: str | None) -> dict[str, Any] | None:
    """An arm with friction in one joint that makes a gap of 8 to 40 times the noise; None where it cannot.

    ``kind``: one of :data:`LINKAGE_ANSWERS`; None: nothing.
    """
    p = {
        "m1": rng.uniform(0.5, 2), "m2": rng.uniform(0.3, 1.2), "l1": rng.uniform(0.25, 0.5), "l2": rng.uniform(0.2, 0.45),
        "g": 9.81 if rng.random() < 0.6 else 0.0,
    }  # fmt: skip
    inertia = np.array(
        [p["m1"] * p["l1"] ** 2 / 3 + p["m2"] * (p["l1"] + 0.5 * p["l2"]) ** 2, p["m2"] * p["l2"] ** 2 / 3]
    )
    p |= {"d1": float(inertia[0] * rng.uniform(0.5, 2)), "d2": float(inertia[1] * rng.uniform(0.5, 2))}
    dt, n_runs, n = float(rng.choice([0.01, 0.02])), int(rng.integers(4, 8)), int(rng.integers(120, 220))
    size, hold = inertia * rng.uniform(6, 14, 2) + 0.2 * p["g"] * inertia, int(rng.integers(10, 30))
    U = size * np.repeat(rng.uniform(-1, 1, (n_runs + 2, n // hold + 1, 2)), hold, axis=1)[:, :n]
    X0, joint, dice = rng.normal(size=(n_runs + 2, 4)) * 0.3, int(rng.integers(2)), rng.random(3)
    nominal = _march(p, dt, U, X0)
    noise = float(np.exp(rng.uniform(np.log(1e-3), np.log(8e-3)))) * np.std(nominal[:n_runs], axis=(0, 1))

    def real(sizes: np.ndarray, few: int) -> np.ndarray:
        each, times = np.repeat(sizes, few), len(sizes)
        unit = 8.0 * inertia[joint]
        acting = joint, lambda v, u: _friction(str(kind), v, u, each, unit, dice)
        y = _march(p, dt, np.tile(U[:few], (times, 1, 1)), np.tile(X0[:few], (times, 1)), acting)
        return y.reshape(times, few, *y.shape[1:])

    def over(y: np.ndarray) -> float:
        error = (y - nominal[: len(y)]) / noise
        return float(np.sqrt(np.mean(error**2))) if np.isfinite(error).all() else np.inf

    clean, moved, gap, chosen = nominal, nominal, 0.0, 0.0
    if kind is not None:
        target = float(np.exp(rng.uniform(np.log(8.0), np.log(40.0))))
        found = [over(y) for y in real(EFFECT_SIZES, 2)]
        able = [k for k, value in enumerate(found) if 6.0 <= value <= 80.0]
        if not able:
            return None
        chosen = float(EFFECT_SIZES[min(able, key=lambda i: abs(np.log(found[i] / target)))])
        clean, moved = real(chosen * np.array([1.0, 1.0 + MOVED]), len(U))
        gap = over(clean[:n_runs])
    if not np.isfinite(clean).all() or (kind is not None and not gap >= 5.0):
        return None
    names = {"states": ["q1", "q2", "v1", "v2"], "inputs": ["t1", "t2"], "outputs": ["q1", "q2"]}
    simulator = ODESimulator(arm_rates, **names, params={k: float(v) for k, v in p.items()}, dt=dt)  # type: ignore[arg-type]
    return {
        "simulator": simulator, "joint": joint, "size": chosen, "U": U[:n_runs], "X0": X0[:n_runs], "U_test": U[n_runs:],
        "X0_test": X0[n_runs:], "clean": clean[:n_runs], "test": clean[n_runs:], "moved": moved, "noise": noise, "gap": gap,
    }  # fmt: skip
