"""The Stribeck curve: friction falls from a level at rest to a level in motion."""

from __future__ import annotations

from typing import Any

import numpy as np

from sksurrogate.effects._smooth import TINY

#: Friction at rest over friction in motion, at least. Below it a difference of either level would show no effect of the other.
LEAST_RATIO = 1.02


def stribeck_curve(v: Any, level: Any, static_level: Any, velocity: Any) -> Any:
    """``level + (static_level - level) exp(-(v/velocity)^2)``; a ``static_level`` below ``level`` counts as ``level``.

    >>> float(stribeck_curve(0.0, 1.0, 3.0, 0.1))
    3.0
    """
    ratio = np.minimum(np.abs(v) / np.maximum(velocity, TINY), 30.0)
    return level + np.maximum(static_level - level, 0.0) * np.exp(-ratio * ratio)


def larger_at_rest(level: float, static_level: float) -> float:
    """The level at rest, or the least above that in motion: below, a fit would have no slope to return by."""
    return max(static_level, LEAST_RATIO * level)
