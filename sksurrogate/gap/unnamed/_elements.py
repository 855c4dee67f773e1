"""Elements: terms of a right-hand side that one parameter scales and that move several balances at once, as a spring between two masses."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sksurrogate.kernels.record import Record
from sksurrogate.physics._model import PlantModel

#: Relative step of a parameter, and the share of its slopes that may point another way.
PARAMETER_STEP, OTHER_WAY = 1e-4, 1e-4


class Element(NamedTuple):
    """What a parameter scales: ``dx/dt = ... + p * flow * direction``."""

    parameter: str
    direction: np.ndarray  #: (n_states,): share of every balance in its flow, of length 1
    flow: np.ndarray  #: (n_samples,): the signal of the element along a path, per unit of the parameter


def elements_along(model: PlantModel, record: Record, x: np.ndarray) -> list[Element]:
    """Elements of a right-hand side along a path of its states (n_states, n_samples).

    A parameter scales an element where its slopes ``df/dp`` keep one direction. One that moves a single balance is left out:
    there laws of all signals are looked for anyway.
    """
    plant, found = model.plant, []
    if plant.access != "rhs":
        return []
    at = record.t, x[:, None], record.u[:, None]
    with np.errstate(all="ignore"):
        rate = model.derivative(*at)[:, 0]
        for name, value in plant.params.items():
            step = PARAMETER_STEP * (abs(value) or 1.0)
            slope = (model.derivative(*at, {name: np.array([[value + step]])})[:, 0] - rate) / step
            one = _element(name, slope)
            found += [] if one is None else [one]
    return found


def element_of(name: str, model: PlantModel, record: Record, x: np.ndarray) -> Element | None:
    """That of a parameter; None where it scales no element."""
    return next((one for one in elements_along(model, record, x) if one.parameter == name), None)


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
