"""Levenberg-Marquardt steps that follow the bend of a narrow valley: geodesic acceleration.

A step ``v`` is straight, the valley is not: along ``theta + s v`` the errors are ``e + s J v + s^2/2 e''``. The correction ``a``
solves the system of the step again, with ``J' e''`` in place of ``J' e``, and the path is ``v + a / 2``. It costs one
evaluation of the errors and no slopes. M. K. Transtrum, J. P. Sethna, *Improvements to the Levenberg-Marquardt algorithm
for nonlinear least-squares minimization*, arXiv:1201.5885, 2012.
"""

from __future__ import annotations

import numpy as np

#: Part of the step at which the bend is measured: a smaller one drowns in rounding, a larger one holds third orders.
PROBE = 0.1
#: Twice the correction over the step, above which the two no longer describe the path (Transtrum and Sethna's value).
CORRECTION_OVER_STEP = 0.75


def second_order(e: np.ndarray, probed: np.ndarray, straight: np.ndarray) -> np.ndarray:
    """``e''``, the second derivative of the errors along a step.

    ``e``: errors where the step begins.
    ``probed``: errors at :data:`PROBE` of the step.
    ``straight``: ``J v``, what the slopes promise for the whole step.

    >>> v = 2.0  # errors x^2 at x = 1: their second derivative along v is 2 v^2
    >>> second_order(np.array([1.0]), np.array([(1.0 + PROBE * v) ** 2]), np.array([2.0 * v])).round(9)
    array([8.])
    """
    with np.errstate(over="ignore", invalid="ignore"):  # of errors that ran away
        return 2.0 / PROBE * ((probed - e) / PROBE - straight)


def bent(step: np.ndarray, correction: np.ndarray, size: np.ndarray) -> np.ndarray:
    """The step with half its correction; the step alone where the correction is too large for it.

    ``step, correction`` (n_theta,).
    ``size`` (n_theta,): the diagonal that both are measured with.

    >>> bent(np.array([1.0, 0.0]), np.array([0.0, 0.2]), np.ones(2))
    array([1. , 0.1])
    """
    small = 2.0 * np.sqrt(correction @ (size * correction)) <= CORRECTION_OVER_STEP * np.sqrt(step @ (size * step))
    return step + 0.5 * correction if small else step
