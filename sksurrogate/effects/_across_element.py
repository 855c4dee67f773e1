"""Parameters of elements: a spring between two bodies, a wall between two rooms, a pipe between two tanks."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from sksurrogate.effects._structure import points_about, rates_at, with_rates
from sksurrogate.effects._variable import across
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._simulator import Plant

#: Relative change of a parameter, and of a signal over its size, from which slopes are taken.
PARAMETER_PUSH, SIGNAL_PUSH = 1e-3, 1e-2
#: A slope below this share of the largest of its rate is none.
NO_SLOPE = 1e-4


def differences_across(plant: Plant, parameter: str) -> tuple[str, ...]:
    """The difference on which alone depends what a parameter changes in the rates, its size and its square; empty where there is none.

    What flows through an element depends on the difference across it: where the parameter is not constant, that is what it depends on
    first.

    >>> from sksurrogate.physics import ODESimulator
    >>> from sksurrogate.physics._simulator import describe
    >>> room = ODESimulator(lambda t, x, u, p: [(u[1] - p["UA"] * (x[0] - u[0])) / p["C"]], states=["T"], inputs=["Ta", "heat"],
    ...                     outputs=["T"], params={"UA": 2.0, "C": 50.0}, dt=1.0)
    >>> [differences_across(describe(room), name) for name in ("UA", "C")]
    [('abs(T - Ta)', '(T - Ta)^2'), ()]
    """
    names = (*plant.states, *plant.inputs)
    slope = _slopes(with_rates(PlantModel(plant)), parameter) if plant.access in ("rhs", "step") else None
    if slope is None:
        return ()
    size = np.max(np.abs(slope), axis=(0, 2), keepdims=True)
    moved = [i for i, one in enumerate(slope) if np.any(np.abs(one) > NO_SLOPE * size[0])]
    for i, j in combinations(moved, 2):
        if len(moved) == 2 and np.all(np.abs(slope[i] + slope[j]) <= NO_SLOPE * size[0]):
            return across(names[i], names[j])
    return ()


def _slopes(model: PlantModel, parameter: str) -> np.ndarray | None:
    """Slopes in every signal of the slope of the rates in a parameter, (n_signals, n_states, n_points); None where some are not finite."""
    t, x, u = points_about(model)
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
