"""Elements: terms of a right-hand side that one parameter scales and that move several balances at once, as a spring between two masses."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from sksurrogate.kernels.linear_fit import linear_least_squares
from sksurrogate.kernels.record import Record
from sksurrogate.physics._model import PlantModel

#: Relative step of a parameter, and the share of its slopes that may point another way.
PARAMETER_STEP, OTHER_WAY = 1e-4, 1e-4


class Element(NamedTuple):
    """What a parameter scales: ``dx/dt = ... + p * flow * direction``."""

    parameter: str
    direction: np.ndarray  #: (n_states,): what a unit of the flow does to every balance
    #: (n_samples,): signal of the element along a path; of a sum of states and inputs in the size of the first, as ``a - c``
    flow: np.ndarray


def elements_along(model: PlantModel, record: Record, x: np.ndarray, parameters: Iterable[str]) -> list[Element]:
    """Elements that some parameters scale in a right-hand side, along a path of its states (n_states, n_samples).

    A parameter scales an element where its slopes ``df/dp`` keep one direction. One that moves a single balance is left out:
    there laws of all signals are looked for anyway.
    """
    plant, found = model.plant, []
    if plant.access != "rhs":
        return []
    at = record.t, x[:, None], record.u[:, None]
    with np.errstate(all="ignore"):
        rate = model.derivative(*at)[:, 0]
        for name in parameters:
            value = plant.params[name]
            step = PARAMETER_STEP * (abs(value) or 1.0)
            slope = (model.derivative(*at, {name: np.array([[value + step]])})[:, 0] - rate) / step
            one = _element(name, slope)
            found += [] if one is None else [_in_natural_size(one, np.concatenate([x, record.u]))]
    return found


def _element(name: str, slope: np.ndarray) -> Element | None:
    """Of one parameter, from its slopes (n_states, n_samples); None where they turn, or move one balance."""
    size = np.sqrt(np.mean(slope**2, axis=1))
    if not np.isfinite(slope).all() or np.sum(size > OTHER_WAY * size.max(initial=0.0)) < 2:
        return None
    U, s, _ = np.linalg.svd(slope / np.where(size > 0, size, 1.0)[:, None], full_matrices=False)
    if s[1] > OTHER_WAY * s[0]:
        return None
    direction = U[:, 0] * size
    direction /= np.linalg.norm(direction)
    return Element(name, direction, direction @ slope)


def _in_natural_size(one: Element, signals: np.ndarray) -> Element:
    """With the flow in the size of a signal, where it is a sum of signals (n_signals, n_samples) and a constant."""
    columns = np.vstack([signals, np.ones(signals.shape[1])])
    size = np.maximum(np.abs(columns).max(axis=1), 1e-300)
    factors = linear_least_squares((columns / size[:, None]).T, one.flow, rcond=1e-10) / size
    share = np.abs(factors[:-1]) * size[:-1]
    largest = factors[np.argmax(share >= 0.5 * share.max())]  # the first of those that matter
    if largest == 0 or np.std(one.flow - factors @ columns) > OTHER_WAY * np.std(one.flow):
        return one
    return one._replace(direction=one.direction * largest, flow=one.flow / largest)
