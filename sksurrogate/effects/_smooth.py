"""Kinks over a finite width: a width of 0 gives the kink itself."""

from __future__ import annotations

from typing import Any

import numpy as np

#: Floor under roots and powers, whose slope at 0 is infinite.
TINY = 1e-12
#: Exponents up to which a power is bent straight: nearer to 1 it is as straight as makes no difference.
MOST_BENT = 0.99
#: Size of a variable over the width of its kinks, where no width was fitted.
KINK_SHARPNESS = 500.0
#: Least width of a clip that is smoothed, over its scale: narrower ones are as ``tanh`` to 1e-7.
NEARLY_TANH = 5e-4
#: What takes less than this share of a sample is not seen.
WITHIN_SAMPLE = 0.2


def sign(v: Any, width: float) -> Any:
    """``sign(v)``, as ``tanh(v / width)``.

    >>> sign(np.array([-2.0, 0.0, 2.0]), 0.0)
    array([-1.,  0.,  1.])
    """
    return np.tanh(v / width) if np.ndim(width) or width > 0 else np.sign(v)


def clip(v: Any, limit: Any, corner: float) -> Any:
    """``clip(v, -c, c)`` with a bend: from a ``corner`` of 0 to ``c tanh(v / c)`` at 1; the slope at 0 is 1.

    Its slope is that of the clip, smoothed by a logistic curve, over its own at 0.

    >>> clip(np.array([0.5, 1.0, 9.0]), 1.0, 0.0), clip(np.array([0.5, 1.0, 9.0]), 1.0, 0.2).round(3)
    (array([0.5, 1. , 1. ]), array([0.498, 0.914, 1.   ]))
    >>> bool(np.allclose(clip(np.linspace(-9.0, 9.0, 19), 2.0, 1.0), 2.0 * np.tanh(np.linspace(-9.0, 9.0, 19) / 2.0)))
    True
    """
    if corner <= 0 or np.any(np.isinf(limit)):
        return np.clip(v, -limit, limit)
    half = max(1.0 / corner - 1.0, NEARLY_TANH)  # half of the width of the clip over the scale of the logistic curve
    z = v / positive(limit * (np.tanh(half) / half))
    return limit / (2.0 * half) * (_log_cosh(z + half) - _log_cosh(z - half))


def _log_cosh(z: Any) -> Any:
    """``log(2 cosh(z))``."""
    return np.abs(z) + np.log(1.0 + np.exp(-2.0 * np.abs(z)))


def stable(width: float, jump: Any, h: float) -> Any:
    """Width over which a jump in dv/dt at ``v = 0`` is smoothed: its slope times a step ``h`` stays below 2.

    Steeper than that an explicit step chatters about 0, and slopes of the free run mean nothing.

    >>> stable(0.01, np.array([0.1, 10.0]), 0.1)
    array([0.01, 0.5 ])
    """
    return np.maximum(width, 0.5 * h * jump)


def power(v: Any, exponent: Any, width: Any = 0.0) -> Any:
    """``sign(v) |v|^exponent``, a straight line through 0 where ``|v|`` is below the width.

    >>> power(np.array([-4.0, 0.0, 1.0, 4.0]), 0.5, 1e-3)
    array([-2.,  0.,  1.,  2.])
    """
    size, edge = np.abs(v), positive(width)
    return np.sign(v) * np.maximum(size, edge) ** exponent * np.minimum(size / edge, 1.0)


def stable_power(coefficient: Any, exponent: Any, h: float) -> Any:
    """Width of the straight line of ``c sign(v) |v|^m`` with ``m < 1``: its slope times a step ``h`` is 2 there.

    >>> stable_power(10.0, np.array([0.0, 0.5, 1.5]), 0.1)
    array([0.5 , 0.25, 0.  ])
    """
    below = np.minimum(exponent, MOST_BENT)
    with np.errstate(divide="ignore"):
        return np.where(np.asarray(exponent) < 1.0, (0.5 * h * np.asarray(coefficient)) ** (1.0 / (1.0 - below)), 0.0)


def magnitude(v: Any, width: float) -> Any:
    """``abs(v)``, as ``v tanh(v / width)``."""
    return v * np.tanh(v / width) if width > 0 else np.abs(v)


def positive(v: Any) -> Any:
    """``max(v, 0)`` for roots and powers."""
    return np.maximum(v, TINY)


def follow(rate: Any) -> Any:
    """Factor on dz/dt that keeps ``rate`` (decay of z a step) below 2, within what an explicit step can follow.

    Where z rests does not change; a decay of half a step's length or slower changes by a thousandth at most.

    >>> (follow(np.array([0.1, 1e6])) * np.array([0.1, 1e6])).round(4)
    array([0.1, 2. ])
    """
    square = (0.5 * rate) ** 2
    return 1.0 / np.sqrt(np.sqrt(1.0 + square * square))  # roots take a quarter of the time of powers


def after(t: Any, start: Any, width: float) -> Any:
    """1 after ``start``, 0 before, as the integral of a hat of half width ``width``.

    With ``width`` equal to the integrator's step, sums over the step grid reproduce the integral of the jump and its
    first moment wherever it lies within a step (hats sum to one and reproduce straight lines), and results depend
    smoothly on ``start``.

    >>> after(np.array([-1.0, -0.5, 0.0, 0.5, 1.0]), 0.0, 1.0)
    array([0.   , 0.125, 0.5  , 0.875, 1.   ])
    >>> after(np.array([-0.5, 0.0, 0.5]), 0.0, 0.0)
    array([0., 1., 1.])
    """
    if width <= 0:
        return np.where(t >= start, 1.0, 0.0)
    z = np.clip((t - start) / width, -1.0, 1.0)
    return np.where(z < 0, 0.5 * (1 + z) ** 2, 1 - 0.5 * (1 - z) ** 2)
