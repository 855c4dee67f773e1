"""What makes dry friction dry: it is no less at rest than in motion."""

from __future__ import annotations

import numpy as np

__all__ = ["grows_with_speed", "slow_enough"]

#: Friction at rest below this share of that in motion is not a dry friction: where the data given it, that of true ones was found
#: at 1.2 times and more, that of frictions in the place of other laws mostly at 0 to 0.2.
AT_REST = 0.5
#: Mean weight of the friction at rest along a path, below which springy bristles hide it: a fit may leave it anywhere. A
#: velocity of 0.4 of the RMS speed has this weight; what imitates a loss needs a larger one.
REST_WEIGHT_SEEN = 0.25


def grows_with_speed(level: float, static_level: float) -> bool:
    """Whether a friction grows with the speed, as losses do and dry friction does not.

    Examples
    --------
    >>> grows_with_speed(1.0, 1.5), grows_with_speed(1.0, 0.9), grows_with_speed(1.0, 0.1)
    (False, False, True)
    """
    return static_level < AT_REST * level


def slow_enough(v: np.ndarray, velocity: float) -> bool:
    """Whether a path shows the friction at rest through springy bristles.

    Examples
    --------
    >>> v = np.linspace(-1.0, 1.0, 101)
    >>> slow_enough(v, 0.8), slow_enough(v, 0.05)
    (True, False)
    """
    weight = np.exp(-np.minimum((v / max(velocity, 1e-300)) ** 2, 700.0))
    return bool(np.mean(weight) > REST_WEIGHT_SEEN)
