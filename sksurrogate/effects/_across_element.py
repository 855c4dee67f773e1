"""Parameters of elements: a spring between two bodies, a wall between two rooms, a pipe between two tanks."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sksurrogate.effects._structure import points_about, rates_at, with_rates
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._simulator import Plant

#: Relative change of a parameter, and of a signal over its size, from which slopes are taken.
PARAMETER_PUSH, SIGNAL_PUSH = 1e-3, 1e-2
#: Every so many of the random points are looked at: calls of a simulator may be dear, and few points tell equal slopes.
EVERY = 3
#: A slope below this share of the largest of its rate is none.
NO_SLOPE = 1e-4


class Across(NamedTuple):
    """What a parameter scales acts across an element: from nothing else than these signals follows what it changes in the rates."""

    #: Two whose difference alone counts, as of positions at both ends of a spring; one that is such a difference, as a twist
    signals: tuple[str, ...]
    proportional: bool  #: Whether it changes them in proportion to the difference


def across_element(plant: Plant, parameter: str) -> Across | None:
    """The difference across the element that a parameter scales; None where what it changes in the rates depends on more, or on nothing.

    >>> from sksurrogate.physics import ODESimulator
    >>> from sksurrogate.physics._simulator import describe
    >>> room = ODESimulator(lambda t, x, u, p: [(u[1] - p["UA"] * (x[0] - u[0])) / p["C"]], states=["T"], inputs=["Ta", "heat"],
    ...                     outputs=["T"], params={"UA": 2.0, "C": 50.0}, dt=1.0)
    >>> [across_element(describe(room), name) for name in ("UA", "C")]
    [Across(signals=('T', 'Ta'), proportional=True), None]
    """
    names = (*plant.states, *plant.inputs)
    slope = _slopes(with_rates(PlantModel(plant)), parameter) if plant.access in ("rhs", "step") else None
    if slope is None:
        return None
    none = NO_SLOPE * np.max(np.abs(slope), axis=(0, 2))[:, None]
    moved = [i for i, one in enumerate(slope) if np.any(np.abs(one) > none)]
    opposed = len(moved) == 2 and np.all(np.abs(slope[moved].sum(axis=0)) <= none)
    if len(moved) != 1 and not opposed:
        return None
    return Across(tuple(names[i] for i in moved), bool(np.all(np.ptp(slope[moved[0]], axis=1)[:, None] <= none)))


def _slopes(model: PlantModel, parameter: str) -> np.ndarray | None:
    """Slopes in every signal of the slope of the rates in a parameter, (n_signals, n_states, n_points); None where some are not finite."""
    t, x, u = (some[..., ::EVERY] for some in points_about(model))
    signals, n = np.concatenate([x, u]), len(x)
    step = SIGNAL_PUSH * np.maximum(np.max(np.abs(signals), axis=1), 1e-12)
    pushes = np.diag(step)[:, :, None]
    columns = np.concatenate([signals[:, None] + pushes, signals[:, None] - pushes], axis=1)
    value = float(model.plant.params[parameter])

    def rates(p: float) -> np.ndarray:
        return rates_at(model, t, columns[:n], columns[n:], {parameter: np.full(columns.shape[1:], p)})

    with np.errstate(all="ignore"):
        column = rates(value * (1 + PARAMETER_PUSH)) - rates(value * (1 - PARAMETER_PUSH))
        slope = (column[:, : len(signals)] - column[:, len(signals) :]).transpose(1, 0, 2) / step[:, None, None]
    return slope if np.isfinite(slope).all() and slope.size else None
