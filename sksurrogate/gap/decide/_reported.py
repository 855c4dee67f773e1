"""Parameters of a named effect and their intervals, in the ranges in which they are reported (phases, signs)."""

from __future__ import annotations

import numpy as np

from sksurrogate.effects._effect import BaseEffect

__all__ = ["reported"]


def reported(
    effect: BaseEffect, theta: np.ndarray, low: np.ndarray, high: np.ndarray
) -> tuple[dict[str, float], dict[str, tuple[float, float]]]:
    """Values and intervals by name: an interval is mirrored or shifted as its value is.

    Examples
    --------
    >>> from sksurrogate.effects._disturbance import PeriodicDisturbance
    >>> theta, low, high = np.array([[-2.0, 5.0, 0.0], [-2.2, 4.9, -0.1], [-1.9, 5.2, 0.1]])
    >>> params, intervals = reported(PeriodicDisturbance("speed"), theta, low, high)
    >>> params["amplitude"], intervals["amplitude"]
    (2.0, (1.9, 2.2))
    >>> round(params["phase"], 3), [round(end, 3) for end in intervals["phase"]]
    (3.142, [3.042, 3.242])
    """
    params, intervals = {}, {}
    turned = effect.canonical(tuple(float(value) for value in theta))
    for parameter, raw, value, a, b in zip(effect.parameters, theta, turned, low, high):
        params[parameter.name] = float(value)
        ends = (-b, -a) if value == -raw != 0 else (a + (value - raw), b + (value - raw))
        intervals[parameter.name] = float(ends[0]), float(ends[1])
    return params, intervals
