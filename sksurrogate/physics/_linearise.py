"""Steady state and linearisation of a simulator at a point."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import root

from sksurrogate.exceptions import SimulatorError, require
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._simulator import describe

#: Longest step of a central difference, in units of the point or of 1, and how many steps, each a tenth of the last, are compared.
LONGEST_STEP, DECADES = 6e-6, 12
#: A plant rests where the search converged, or where its rates are at most this share of the terms that make them up.
AT_REST = 1e-6


@dataclass(frozen=True, eq=False)
class Linearisation:
    """``dx/dt`` (or the next x) ``= f + A (x - x0) + B (u - u0)``, ``y = y0 + C (x - x0) + D (u - u0)``.

    Attributes
    ----------
    A, B, C, D : ndarray
    x0, u0, y0, f : ndarray
        The point; f is 0 at a steady state of a right-hand side.
    dt : float
        0 for a right-hand side (continuous time), the sample time for a step.
    states, inputs, outputs : tuple of str
        Names.

    Examples
    --------
    >>> from sksurrogate.datasets import make_reactor
    >>> from sksurrogate.physics import linearise, steady_state
    >>> reactor = make_reactor()
    >>> local = linearise(reactor, steady_state(reactor, [0.15]), [0.15])
    >>> local.A.shape, bool(local.A[0, 0] < 0)   # stable there
    ((1, 1), True)
    """

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    x0: np.ndarray
    u0: np.ndarray
    y0: np.ndarray
    f: np.ndarray
    dt: float
    states: tuple[str, ...] = ()
    inputs: tuple[str, ...] = ()
    outputs: tuple[str, ...] = ()

    def to_control(self) -> Any:
        """The deviation model as ``control.StateSpace`` with the names of the signals."""
        names = {"states": self.states, "inputs": self.inputs, "outputs": self.outputs}
        given = {key: [name.replace(".", "_") for name in value] for key, value in names.items() if value}
        return require("control", "control").ss(self.A, self.B, self.C, self.D, self.dt, **given)


def _point(simulator: Any, pade: int = 2) -> tuple[Any, PlantModel, Callable[..., np.ndarray]]:
    """Plant and model; and what adds the states of effects, at rest, to those of the simulator."""
    effects = callable(getattr(simulator, "small_signal", None))
    whole = simulator.small_signal(pade) if effects else simulator
    plant = describe(whole)
    if plant.access == "trajectory":
        raise SimulatorError(
            f"{type(simulator).__name__} gives trajectories only: a linearisation needs rhs or step, and states."
        )
    return plant, PlantModel(plant), whole.complete if effects else lambda x, u: x


def _value(plant: Any, model: PlantModel, x: np.ndarray, u: np.ndarray, t: float) -> np.ndarray:
    """dx/dt or the next states at columns of x and u."""
    times = np.full(x.shape[1], t)
    return model.derivative(times, x, u) if plant.access == "rhs" else model.step(times, x, u, plant.dt)


def _values(given: Any, argument: str, names: Sequence[str], what: str) -> np.ndarray:
    """One number for each name, where the simulator names them."""
    values = np.asarray(given, dtype=float).reshape(-1)
    if names and len(values) != len(names):
        raise SimulatorError(
            f"{argument} has {len(values)} values, expected {len(names)}: one for each of {what}={list(names)}."
        )
    return values


def slopes(function: Callable[[np.ndarray], np.ndarray], z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Slopes (n_values, n) by central differences at ``z`` (n,), and the values there.

    ``function``: columns (n, k) -> (n_values, k).

    Each slope has the step at which a tenth of it changes the slope least: nobody knows the sizes of the signals.

    >>> J, _ = slopes(lambda z: np.sin(z / 1e-9), np.array([0.3e-9]))
    >>> bool(np.isclose(J[0, 0] * 1e-9, np.cos(0.3), rtol=1e-6))
    True
    """
    n = len(z)
    width = LONGEST_STEP * np.maximum(np.abs(z), 1.0) * 0.1 ** np.arange(DECADES)[:, None]  # (n_widths, n)
    offsets = (width[:, :, None] * np.eye(n)).reshape(-1, n).T
    at = function(z[:, None] + np.concatenate([offsets, -offsets, np.zeros((n, 1))], axis=1))
    up, down = at[:, : offsets.shape[1]], at[:, offsets.shape[1] : -1]
    found = ((up - down) / (2 * width).ravel()).reshape(len(at), DECADES, n)
    first, second = found[:, :-1], found[:, 1:]
    size = np.maximum(np.abs(first), np.abs(second))
    rounding = np.finfo(float).eps * (np.abs(z) * size + np.abs(at[:, -1])[:, None, None]) / width[1:]
    with np.errstate(all="ignore"):
        doubt = np.where(size > 0, (np.abs(first - second) + rounding) / size, 1.0)
    best = np.argmin(np.where(np.isfinite(doubt), np.minimum(doubt, 1.0), 2.0), axis=1)  # among equals the longest
    return np.take_along_axis(found, best[:, None], axis=1)[:, 0], at[:, -1]


def linearise(simulator: Any, x0: Any, u0: Any, t: float = 0.0, *, pade: int = 2) -> Linearisation:
    """Linearise a simulator with a right-hand side or a step, by central differences of it.

    Parameters
    ----------
    simulator : simulator with ``rhs`` or ``step``
        An :class:`~sksurrogate.effects.AugmentedSimulator` has further states: those of laws, actuators and sensors with a
        memory.
    x0 : array-like (n_states,)
        States of the simulator, those of effects then being at rest; or all states.
    u0 : array-like (n_inputs,)
    t : float, default=0.0
    pade : int, default=2
        Order of Pade's approximation of a delay among the effects.

    Returns
    -------
    Linearisation

    Raises
    ------
    SimulatorError
        The simulator gives trajectories only, x0 or u0 has the wrong length, or an effect has no slope.

    Examples
    --------
    >>> from sksurrogate.datasets import make_reactor
    >>> from sksurrogate.physics import linearise, steady_state
    >>> x = steady_state(make_reactor(), [0.15], x0=[5.0])
    >>> linearise(make_reactor(), x, [0.15]).A.shape
    (1, 1)
    """
    plant, model, complete = _point(simulator, pade)
    u = _values(u0, "u0", plant.inputs, "inputs")
    own = plant.states if np.size(x0) != len(plant.x0) else plant.states[: len(plant.x0)]
    x = _values(x0, "x0", own, "states")
    x = complete(x, u) if len(x) == len(plant.x0) else x
    n, z = len(x), np.r_[x, u]
    J, f = slopes(lambda z: _value(plant, model, z[:n], z[n:], t), z)
    G, y = slopes(lambda z: np.asarray(model.output(np.full(z.shape[1], t), z[:n], z[n:])), z)
    dt = 0.0 if plant.access == "rhs" else plant.dt
    names = plant.states, plant.inputs, plant.outputs
    return Linearisation(J[:, :n], J[:, n:], G[:, :n], G[:, n:], x, u, y, f, dt, *names)


def steady_state(simulator: Any, u0: Any, x0: Any = None) -> np.ndarray:
    """States at which the model rests under a constant input.

    Parameters
    ----------
    simulator : simulator with ``rhs`` or ``step``
    u0 : array-like (n_inputs,)
    x0 : array-like (n_states,), optional
        Where the search starts; the simulator's initial state by default.

    Returns
    -------
    ndarray (n_states,)
        States of the simulator; those that effects add are at rest.

    Raises
    ------
    SimulatorError
        None was found from ``x0``.

    Examples
    --------
    >>> from sksurrogate.datasets import make_reactor
    >>> from sksurrogate.physics import steady_state
    >>> x = steady_state(make_reactor(), [0.15])
    >>> bool(abs(make_reactor().rhs(0.0, x, [0.15], make_reactor().params)[0]) < 1e-8)
    True
    """
    plant, model, complete = _point(simulator)
    u, n = _values(u0, "u0", plant.inputs, "inputs"), len(plant.x0)
    start = plant.x0 if x0 is None else _values(x0, "x0", plant.states[:n], "states")

    def moves(x: np.ndarray, u: np.ndarray) -> np.ndarray:
        value = _value(plant, model, complete(x, u)[:, None], u[:, None], 0.0)[:n, 0]
        return value if plant.access == "rhs" else value - x

    found = root(moves, start, args=(u,), tol=1e-12)
    point = np.r_[found.x, u]
    J, rate = slopes(lambda z: np.stack([moves(one[:n], one[n:]) for one in z.T], axis=1), point)
    terms = np.abs(J) @ np.abs(point) + np.abs(moves(start, u))  # what balances at rest, in the unit of each state
    if not (found.success or np.all(np.abs(rate) <= AT_REST * terms)):
        raise SimulatorError(
            f"no steady state was found from x0={start.tolist()} at u0={u.tolist()}: {found.message} Try another x0."
        )
    return found.x
