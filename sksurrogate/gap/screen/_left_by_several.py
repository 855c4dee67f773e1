"""What several columns of the screen leave together, chosen one after the other: no set of names does much better to first order."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

#: A column of which less than this share of its power lies beyond those chosen says nothing of its own.
NOTHING_OF_ITS_OWN = 1e-4


def left_by_several(
    total: float, g: np.ndarray, h: np.ndarray, row: Callable[[int], np.ndarray], most: int
) -> np.ndarray:
    """Squares that a residual leaves beside the best 0, 1, ... ``most`` columns, each chosen after the others (orthogonal matching pursuit).

    ``total``: square of the residual.
    ``g, h`` (n_columns,): products of the residual and every column, and the squares of the columns.
    ``row`` (k): products of column k and every column.
    Returns (1 + most,): never rises.

    >>> A = np.array([[1.0, 0.0], [1.0, 1.0]])  # two columns of two samples
    >>> r = np.array([3.0, 1.0])
    >>> left_by_several(r @ r, A @ r, np.sum(A**2, axis=1), lambda k: A @ A[k], 2).round(9)
    array([10.,  1.,  0.])
    """
    with np.errstate(all="ignore"):
        known = np.isfinite(g) & np.isfinite(h) & (h > 0.0)
        g, least = np.where(known, g, 0.0), np.where(known, NOTHING_OF_ITS_OWN * h, np.inf)
        h, out = np.where(known, h, 0.0), [total]
        pivots: list[np.ndarray] = []
        for _ in range(most):
            gain = np.where(h > least, g**2 / np.maximum(h, 1e-300), 0.0)
            k = int(np.argmax(gain)) if len(gain) else 0
            if not len(gain) or not gain[k] > 0.0:
                out.append(out[-1])
                continue
            pivot = np.where(known, row(k), 0.0)
            for before in pivots:
                pivot = pivot - before[k] * before
            pivot /= np.sqrt(h[k])
            g, h = g - g[k] / np.sqrt(h[k]) * pivot, h - pivot**2
            h[k] = 0.0
            pivots.append(pivot)
            out.append(max(out[-1] - float(gain[k]), 0.0))
    return np.array(out)
