"""The check on a simulator of the user's own."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from sksurrogate.blind._plants import Drive, PlantSpec
from sksurrogate.exceptions import SimulatorError
from sksurrogate.physics._simulator import describe
from sksurrogate.runs import resolve_runs


class Copied:
    """A right-hand side that may write into what it is handed."""

    def __init__(self, rhs: Callable[..., Any]):
        self.rhs = rhs

    def __call__(self, t: Any, x: Any, u: Any, p: Mapping[str, Any]) -> Any:
        own = {name: value.copy() if isinstance(value, np.ndarray) else value for name, value in p.items()}
        return self.rhs(t, np.array(x), np.array(u), own)


class Looped:
    """A right-hand side for one column, asked column by column."""

    def __init__(self, rhs: Callable[..., Any]):
        self.rhs = rhs

    def __call__(self, t: Any, x: np.ndarray, u: np.ndarray, p: Mapping[str, Any]) -> np.ndarray:
        if np.ndim(x[0]) == 0:
            return np.array(self.rhs(t, x, u, p), dtype=float)
        width = x.shape[1]
        columns = [
            self.rhs(t, x[:, c], u[:, c], {k: float(np.broadcast_to(v, (width,))[c]) for k, v in p.items()})
            for c in range(width)
        ]
        return np.array(columns, dtype=float).T


def plant_of(
    simulator: Any, *, X: Any = None, groups: Any = None, input_ranges: Any = None, x0_spread: Any = None
) -> tuple[PlantSpec, list[np.ndarray] | None]:
    """A plant of the check from a simulator, and its recorded inputs.

    ``X, groups``: recorded inputs.
    ``input_ranges`` dict of (low, high): feasible range of each input, where there is no record.
    ``x0_spread`` (n_states,).
    Returns ``plant``, ``runs``.
    Raises SimulatorError where the simulator has no right-hand side, or it is not known how its inputs may move.
    """
    known = describe(simulator)
    if known.access != "rhs":
        raise SimulatorError(
            f"simulator={simulator!r} gives no rhs(t, x, u, p): the check makes plants by adding effects to its "
            "right-hand side. Wrap the equations in ODESimulator."
        )
    runs = None
    if X is not None:
        runs = [np.asarray(run.X, dtype=float) for run in resolve_runs(X, None, groups=groups, dt=known.dt)]
        every = np.concatenate(runs)
        ranges = {name: (float(c.min()), float(c.max())) for name, c in zip(known.inputs, every.T)}
    elif input_ranges is not None:
        ranges = dict(input_ranges)
    else:
        raise SimulatorError("X: give recorded inputs (X=, groups=), or input_ranges={name: (low, high)}.")
    missing = [name for name in known.inputs if name not in ranges]
    if missing:
        raise SimulatorError(f"input_ranges: {missing[0]!r} is missing; inputs are {list(known.inputs)}.")
    drives = tuple(Drive(n, 0.5 * (a + b), 0.4 * (b - a), a, b) for n, (a, b) in ((n, ranges[n]) for n in known.inputs))
    spread = np.zeros(len(known.states)) if x0_spread is None else np.asarray(x0_spread, dtype=float)
    if spread.shape != (len(known.states),):
        raise SimulatorError(
            f"x0_spread has {spread.size} values, expected one for each of states={list(known.states)}."
        )
    rhs, output = _side_by_side(Copied(simulator.rhs), known), getattr(simulator, "output", None)
    positive = bool(len(known.x0) and np.all(known.x0 > 0) and np.all(known.x0 - np.abs(spread) > 0))
    plant = PlantSpec(
        "yours", "yours", rhs, known.states, drives, known.outputs, dict(known.params), known.dt,
        tuple(known.x0 if len(known.x0) else np.zeros(len(known.states))), tuple(spread), known.outputs,
        _kinematic(rhs, known), positive, False, Copied(output) if callable(output) else None, known.hold,
    )  # fmt: skip
    return plant, runs


def _try(rhs: Callable[..., Any], known: Any, width: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """States, inputs and derivatives at random points, (·, width)."""
    rng = np.random.default_rng(seed)
    start = known.x0 if len(known.x0) else np.zeros(len(known.states))
    x = start[:, None] + 0.1 * np.maximum(np.abs(start), 1.0)[:, None] * rng.normal(size=(len(known.states), width))
    u = np.abs(rng.normal(size=(len(known.inputs), width)))
    with np.errstate(all="ignore"):
        found = rhs(0.0, x, u, dict(known.params))
    return x, u, np.stack([np.broadcast_to(np.asarray(d, dtype=float), (width,)) for d in found])


def _side_by_side(rhs: Callable[..., Any], known: Any) -> Callable[..., Any]:
    """The right-hand side itself where it takes columns, else one that loops."""
    try:
        _, _, together = _try(rhs, known, 5)
        _, _, alone = _try(Looped(rhs), known, 5)
        if np.allclose(together, alone, rtol=1e-9, atol=1e-12, equal_nan=True):
            return rhs
    except (TypeError, ValueError, IndexError):
        return Looped(rhs)
    return Looped(rhs)


def _kinematic(rhs: Callable[..., Any], known: Any) -> dict[str, str]:
    """Positions whose derivative is another state."""
    x, _, dx = _try(rhs, known, 12, seed=1)
    return {
        a: b
        for i, a in enumerate(known.states)
        for j, b in enumerate(known.states)
        if i != j and np.allclose(dx[i], x[j], rtol=1e-12, atol=1e-14)
    }
