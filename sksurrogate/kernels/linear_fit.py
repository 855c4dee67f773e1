"""Linear least squares that end on any numbers: LAPACK may not return from a matrix that holds nan."""

from __future__ import annotations

import numpy as np


def linear_least_squares(A: np.ndarray, b: np.ndarray, rcond: float | None = None) -> np.ndarray:
    """The shortest x of those with the smallest ``|A x - b|``.

    ``A`` (m, n), ``b`` (m,) or (m, k).
    ``rcond``: singular values below this share of the largest count as 0; by default the machine precision times the
        larger of m, n.
    Raises LinAlgError: A or b is not finite.

    >>> linear_least_squares(np.array([[1.0, 0.0], [0.0, 2.0], [0.0, 0.0]]), np.array([1.0, 2.0, 5.0]))
    array([1., 1.])
    >>> linear_least_squares(np.array([[np.nan]]), np.array([1.0]))
    Traceback (most recent call last):
    ...
    numpy.linalg.LinAlgError: least squares of numbers that are not finite
    """
    if not (np.isfinite(A).all() and np.isfinite(b).all()):
        raise np.linalg.LinAlgError("least squares of numbers that are not finite")
    return np.asarray(np.linalg.lstsq(A, b, rcond=rcond)[0])
