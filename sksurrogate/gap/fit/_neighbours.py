"""Which signals of a large plant are near a balance: the Jacobian along the data says what its rate sees.

In a row of n states every pair of a balance and a signal makes n^2 effects of every form, and products of signals n^3; few
of them are near.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from sksurrogate.effects._ports import places_of
from sksurrogate.effects._structure import NOT_MOVED, integrals
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._simulator import Plant

#: States near each state, itself included; empty: all are near each other.
Neighbours = Mapping[str, frozenset[str]]
#: Up to so many states all are near: a list of all pairs is short.
SMALL_PLANT = 6
#: Samples of the path at which it is seen what moves what, and the share of its range by which a state is moved.
SAMPLES_OF_PATH, MOVED_OF_RANGE = 64, 1e-3


def neighbours(model: PlantModel, t: np.ndarray, x: np.ndarray, u: np.ndarray) -> Neighbours:
    """States near each state: those that its rate sees along a path, and those whose rates see it.

    A position and its speed are one neighbour. Empty for small plants. In a step everything sees everything: of plants that step,
    the joints say what is near.

    ``t, x, u``: (n_samples,), (n_states, n_samples), (n_inputs, n_samples).
    """
    if len(model.plant.states) <= SMALL_PLANT:
        return {}
    if model.plant.access != "rhs":
        return of_joints(model.plant)
    states, rows = model.plant.states, np.unique(np.linspace(0, len(t) - 1, SAMPLES_OF_PATH).astype(int))
    n, reach = len(states), MOVED_OF_RANGE * np.maximum(np.ptp(x, axis=1), 1e-6)
    moved = x[:, None, rows] + np.concatenate([np.zeros((n, 1)), np.diag(reach)], axis=1)[:, :, None]
    given = np.broadcast_to(u[:, None, rows], (len(u), 1 + n, len(rows)))
    with np.errstate(all="ignore"):
        rates = model.derivative(np.broadcast_to(t[rows], moved.shape[1:]), moved, given)
    change = np.max(np.abs(np.nan_to_num(rates[:, 1:] - rates[:, :1])), axis=2)
    sees = change > NOT_MOVED * np.max(np.abs(np.nan_to_num(rates[:, 0])), axis=1)[:, None]
    sees |= sees.T | np.eye(n, dtype=bool)
    for position, speed in integrals(model).items():
        if speed is not None:
            both = [states.index(position), states.index(speed)]
            sees[:, both] = sees[:, both].any(axis=1, keepdims=True)
    return {name: frozenset(states[j] for j in np.flatnonzero(row)) for name, row in zip(states, sees)}


def of_joints(plant: Plant) -> Neighbours:
    """Speed and position of a joint are near each other, where forces at joints make the speeds: they drive the laws there.

    The inverse of a mass matrix makes every acceleration see all joints; a force in a joint is of this joint.
    """
    places = places_of(plant, plant.states)
    joints = [{v, *port.positions} for port in places.ports for v in port.speeds if v not in places.balances]
    return {name: frozenset(joint) for joint in joints for name in joint}


def is_near(near: Neighbours, place: str | None, signals: Sequence[str]) -> bool:
    """Whether all states among some signals are near the balance of a state; inputs are, and elsewhere all are.

    >>> near = {"a": frozenset("ab"), "b": frozenset("ab"), "c": frozenset("c")}
    >>> is_near(near, "a", ["b", "input"]), is_near(near, "a", ["b", "c"]), is_near({}, "a", ["c"])
    (True, False, True)
    """
    around = near.get(str(place))
    return around is None or all(name in around for name in signals if name in near)
