"""What moves what in a plant, seen at random points: states that are integrals of others, and what a force at a port moves."""

from __future__ import annotations

import weakref
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sksurrogate.exceptions import SimulatorError
from sksurrogate.physics._model import PlantModel

#: Random points at which a plant is seen.
N_POINTS = 12
#: Push at a port, in its unit: rates are in proportion to it or nearly so, and rounding stays far below what it moves.
PORT_PUSH = 1e-3
#: A rate that moves by less than this share of its own size, a unit push, is not moved.
NOT_MOVED = 1e-9
#: Change of a gain from point to point, over its size, below which it counts as constant: an implicit step leaves such changes.
CONSTANT = 1e-3
#: What a solver smears over a step is corrected up to this share; a step in which the plant moves by more is left as it is.
SMEARED, WITHIN_STEP = 1e-3, 0.7
#: How much further from the initial state the points are, too, at which a step is seen: where inputs move a light body fast, its speed
#: is seen at high speeds only.
FURTHER = (1.0, 10.0, 100.0)
#: Least share of |cosine| from which two columns of gains are the same column but for a factor.
PARALLEL = 1.0 - 1e-6
#: Gains of the models that were asked for them.
_KNOWN: weakref.WeakKeyDictionary[PlantModel, np.ndarray] = weakref.WeakKeyDictionary()


@dataclass(frozen=True, eq=False)
class Structure:
    """What the random points show."""

    #: Kinematic states; the state that each is the integral of, None where it is only declared as one
    speed_of: dict[str, str | None]
    #: (n_states, n_ports, n_points): change of the rate of every state by a unit of what enters at a port; nan where
    #: the plant has no rate
    gain: np.ndarray
    moved: np.ndarray  #: bool (n_states, n_ports): whether it moves at all; never a kinematic state
    constant: np.ndarray  #: bool (n_states, n_ports): whether the gain is the same at all points

    def is_a_balance(self, port: int) -> bool:
        """Whether what enters at a port enters one balance, and always in proportion: a law there is one of that balance."""
        rows = np.flatnonzero(self.moved[:, port])
        return len(rows) == 1 and bool(self.constant[rows[0], port])

    def parallel(self, one: int, other: int) -> bool:
        """Whether two ports move the states alike, but for one factor: a law at one is a law at the other."""
        a, b = (np.nan_to_num(self.gain[:, k] * self.moved[:, [k]]).ravel() for k in (one, other))
        size = float(np.linalg.norm(a) * np.linalg.norm(b))
        return size > 0 and abs(float(a @ b)) > PARALLEL * size


def structure_of(model: PlantModel) -> Structure:
    """Look at a plant with a right-hand side or a step."""
    model = with_rates(model)
    plant = model.plant
    gain = rate_gains(model)
    at_once = _at_once(model, gain)
    speed_of = integrals(model)
    t, x, u = points_about(model)
    rate = np.max(np.abs(np.nan_to_num(rates_at(model, t, x, u))), axis=1, initial=0.0)
    kinematic = [plant.states.index(name) for name in speed_of]
    moved, constant = _moves(gain, rate, kinematic)
    found = Structure(speed_of, gain, moved, constant)
    if at_once is None:
        return found
    other = Structure(speed_of, at_once, *_moves(at_once, rate, kinematic, SMEARED))
    taken = [k for k in range(len(plant.ports)) if other.is_a_balance(k) and not found.is_a_balance(k)]
    gain, moved, constant = gain.copy(), moved.copy(), constant.copy()
    gain[:, taken], moved[:, taken], constant[:, taken] = (
        at_once[:, taken],
        other.moved[:, taken],
        other.constant[:, taken],
    )
    return Structure(speed_of, gain, moved, constant)


def _moves(
    gain: np.ndarray, rate: np.ndarray, kinematic: Sequence[int], least: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """Which states every port moves, by more than ``least`` of what it moves most, and which always alike."""
    with np.errstate(all="ignore"):
        size = np.max(np.nan_to_num(np.abs(gain)), axis=2, initial=0.0)
        spread = np.nanmax(gain, axis=2, initial=-np.inf) - np.nanmin(gain, axis=2, initial=np.inf)
    moved = size > np.maximum(NOT_MOVED * rate[:, None], 1e-300)
    moved &= size > least * np.max(size, axis=0, initial=0.0)
    moved[kinematic] = False
    return moved, moved & (spread <= CONSTANT * size)


def _at_once(model: PlantModel, gain: np.ndarray) -> np.ndarray | None:
    """Gains of the rates at the beginning of a step, where the step is that of a solver; None with a right-hand side.

    Within a step what enters has moved other states already. Where the plant is nearly linear over the step, the mean gain
    is ``(exp(A dt) - 1)/(A dt) b``; with J, the slope of the step less 1, ``b = log(1 + J)/J gain``.
    """
    plant = model.plant
    if plant.access != "step" or not gain.size:
        return None
    t, x, u = points_about(model)
    n = len(plant.states)
    pushes = PORT_PUSH * np.eye(n)[:, :, None]
    columns = np.concatenate([x[:, None] + pushes, x[:, None] - pushes], axis=1)
    entering = np.concatenate([u, np.zeros((len(plant.further_ports), N_POINTS))])
    held = np.broadcast_to(entering[:, None], (len(entering), 2 * n, N_POINTS))
    with np.errstate(all="ignore"):
        after = model.step(t, columns, held, plant.dt)
        J = (after[:, :n] - after[:, n:]).transpose(2, 0, 1) / (2 * PORT_PUSH) - np.eye(n)
    small = np.isfinite(J).all(axis=(1, 2)) & (np.max(np.abs(np.nan_to_num(J)).sum(axis=2), axis=1) < WITHIN_STEP)
    J = np.where(small[:, None, None], J, 0.0)
    square = J @ J
    mean = np.eye(n) + J / 2 - square / 12 + square @ J / 24 - 19.0 * square @ square / 720  # J / log(1 + J)
    return np.where(small, np.linalg.solve(mean, np.nan_to_num(gain).transpose(2, 0, 1)).transpose(1, 2, 0), np.nan)


def kinematic_states(model: PlantModel) -> tuple[str, ...]:
    """States whose balance is an identity ``dq/dt = v`` with another state, seen at random points or declared (``kinematic``).

    No effect can be missing there: a position changes with its speed, whatever else is wrong.
    """
    found = integrals(model)
    return tuple(name for name in model.plant.states if name in found)


def motions(model: PlantModel) -> dict[str, str]:
    """What states are in a motion: "speed" where another state is the integral of one, "position" where it is such an integral
    and no speed itself; other states are missing.
    """
    found = integrals(model)
    speeds = {speed for speed in found.values() if speed is not None}
    return {**dict.fromkeys(found, "position"), **dict.fromkeys(speeds, "speed")}


def rate_gains(model: PlantModel) -> np.ndarray:
    """Change of the rate of every state by a unit of what enters at every port, (n_states, n_ports, n_points).

    By differences, at random states; nan where the plant has no rate there, or gives trajectories only.
    """
    model = with_rates(model)
    plant = model.plant
    n, m = len(plant.states), len(plant.ports)
    if plant.access == "trajectory" or not m or not n:
        return np.zeros((n, m, N_POINTS))
    t, x, u = points_about(model)
    entering = np.concatenate([u, np.zeros((len(plant.further_ports), N_POINTS))])
    pushes = PORT_PUSH * np.eye(m)[:, :, None]
    columns = np.concatenate([entering[:, None] + pushes, entering[:, None] - pushes], axis=1)
    many = np.broadcast_to(x[:, None], (n, 2 * m, N_POINTS))
    rates = rates_at(model, t, many, columns)
    with np.errstate(all="ignore"):
        return (rates[:, :m] - rates[:, m:]) / (2 * PORT_PUSH)


def largest_gains(model: PlantModel) -> np.ndarray:
    """Largest size of :func:`rate_gains` over the points, (n_states, n_ports)."""
    return np.asarray(np.max(np.abs(_known_gains(model)), axis=2, initial=0.0))


def mean_gains(model: PlantModel) -> np.ndarray:
    """Mean of :func:`rate_gains` over the points, (n_states, n_ports)."""
    return np.asarray(np.mean(_known_gains(model), axis=2))


def _known_gains(model: PlantModel) -> np.ndarray:
    """:func:`rate_gains`, 0 where there are none; computed once for a model."""
    if model not in _KNOWN:
        _KNOWN[model] = np.nan_to_num(rate_gains(model))
    return _KNOWN[model]


def with_rates(model: PlantModel) -> PlantModel:
    """A model that shows rates themselves, where the simulator that steps has a right-hand side too."""
    plant = model.plant
    both = plant.access == "step" and callable(getattr(plant.simulator, "rhs", None))
    return PlantModel(replace(plant, access="rhs")) if both else model


def points_about(model: PlantModel) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, states and inputs about the initial state; half of the states not negative, as levels and concentrations are;
    inputs from the recorded range where it is known.
    """
    plant = model.plant
    n, random = len(plant.states), np.random.default_rng(0)
    size = np.maximum(np.abs(plant.x0), 1.0)[:, None]
    x = plant.x0[:, None] + size * random.normal(size=(n, N_POINTS))
    x[:, N_POINTS // 2 :] = np.abs(x[:, N_POINTS // 2 :])
    if plant.input_range is None:
        u = np.abs(random.normal(size=(len(plant.inputs), N_POINTS)))
    else:
        low, high = plant.input_range[:, :, None]
        u = low + (high - low) * random.uniform(size=(len(low), N_POINTS))
    return np.linspace(0.0, 10 * plant.dt, N_POINTS), x, u


def rates_at(
    model: PlantModel, t: np.ndarray, x: np.ndarray, u: np.ndarray, varied: Mapping[str, np.ndarray] | None = None
) -> np.ndarray:
    """dx/dt, or the mean rate over a step of a simulator that steps; ``varied``: values of parameters at the points."""
    with np.errstate(all="ignore"):
        if model.plant.access == "rhs":
            return model.derivative(t, x, u, varied)
        dt = model.plant.dt
        return (model.step(t, x, u, dt, varied) - x) / dt


def integrals(model: PlantModel) -> dict[str, str | None]:
    """Kinematic states and the state that each is the integral of.

    With a right-hand side the rate is the other state. A step may be taken anyhow: over a short one the mean rate is the
    other state; over a whole one it lies between that state before and after it, whatever the integrator.
    """
    plant = model.plant
    found: dict[str, str | None] = {}
    n = len(plant.states)
    if plant.access == "trajectory":
        return {}
    if n > 1:
        t, x, u = points_about(model)
        with np.errstate(all="ignore"):
            if plant.access == "rhs":
                same = _identical(model.derivative(t, x, u), x, 1e-12)
            else:
                short = 1e-4 * plant.dt
                same = _identical((model.step(t, x, u, short) - x) / short, x, 1e-2)
                for size in FURTHER:
                    far = plant.x0[:, None] + size * (x - plant.x0[:, None])
                    same |= _between(model.step(t, far, u, plant.dt), far, plant.dt)
        for i, j in zip(*np.nonzero(same & ~np.eye(n, dtype=bool))):
            found.setdefault(plant.states[int(i)], plant.states[int(j)])
    declared = tuple(getattr(plant.simulator, "kinematic", None) or ())
    unknown = [name for name in declared if name not in plant.states]
    if unknown:
        raise SimulatorError(
            f"kinematic={list(declared)}: {unknown[0]!r} is not a state; states are {list(plant.states)}."
        )
    return {name: found.get(name) for name in plant.states if name in found or name in declared}


def _identical(dx: np.ndarray, x: np.ndarray, tolerance: float) -> np.ndarray:
    """Whether the rate of state i is state j at every point, (n_states, n_states)."""
    return np.all(np.abs(dx[:, None] - x[None]) <= tolerance * np.maximum(np.abs(x[None]), 1e-3), axis=2)


def _between(after: np.ndarray, x: np.ndarray, dt: float) -> np.ndarray:
    """Whether the mean rate of state i lies between state j before and after a step, at every point, (n_states, n_states).

    Where state j moves by less than half of its spread over the points: else anything lies between.
    """
    rate, middle, reach = (after - x) / dt, 0.5 * (after + x), 0.5 * np.abs(after - x)
    slack = 1e-9 * np.maximum(np.abs(middle), 1e-3)
    within = np.all(np.abs(rate[:, None] - middle[None]) <= (reach + slack)[None], axis=2)
    return within & (np.max(reach, axis=1) < 0.25 * np.std(x, axis=1))[None]
