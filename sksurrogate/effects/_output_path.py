"""One output of a model between the samples: what a sensor with a memory follows."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np

from sksurrogate.effects._parts import SensorPath
from sksurrogate.kernels.sampling import slopes_so_far


class Outputs(Protocol):
    """A model with its parameters filled in."""

    a: Any
    record: Any
    shown: Any  #: (n_inputs, n_columns | 1, n_samples): inputs at the samples

    @property
    def held_before(self) -> np.ndarray:
        """The same just before the samples."""

    def derivative(self, t: Any, x: Any, u: Any) -> np.ndarray:
        """dx/dt with the effects."""

    def true_outputs(self, t: Any, x: Any, u: Any) -> np.ndarray:
        """What the sensors measure."""


def output_path(bound: Outputs, x: np.ndarray, y: np.ndarray, place: int) -> SensorPath:
    """Output ``place``: values and slopes, before and after the input moves.

    Slopes are those of the right-hand side; without one, those of the rows so far.

    ``x`` (n_states, n_columns, n_samples).
    ``y`` (n_outputs, n_columns, n_samples): outputs along x.
    """
    record, plant, first, before = bound.record, bound.a.plant, bound.shown, bound.held_before
    moves, end = not np.array_equal(before, first), None
    if moves and plant.output_states is None:
        end = bound.true_outputs(record.t, x, before)[place]
        end[:, record.starts] = y[place][:, record.starts]
    if plant.access == "step":
        slopes = slopes_so_far(y[place], y[place] if end is None else end, record.dt, record.starts)
        return SensorPath(y[place], *slopes, end)
    right = _slope(bound, x, first, place)
    if not moves:
        return SensorPath(y[place], right, right)
    left = _slope(bound, x, before, place).copy()
    left[:, record.starts] = right[:, record.starts]
    return SensorPath(y[place], right, left, end)


def _slope(bound: Outputs, x: np.ndarray, u: np.ndarray, place: int) -> np.ndarray:
    """Time derivative of an output: that of its state, or a difference along the flow."""
    a, t = bound.a, bound.record.t
    dx = bound.derivative(t, x, u)
    if a.plant.output_states is not None:
        return dx[a.plant.output_states[place]]
    eps = 1e-6 * bound.record.dt
    ahead, now = bound.true_outputs(t + eps, x + eps * dx, u), bound.true_outputs(t, x, u)
    return np.asarray((ahead[place] - now[place]) / eps)
