"""A linear recursion over time whose states cannot pass limits: by a loop over samples, all runs and columns at once."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np


def limited_recursion(
    A: np.ndarray, b: np.ndarray, starts: np.ndarray, limit: Callable[[np.ndarray, np.ndarray], np.ndarray]
) -> np.ndarray:
    """Solve ``s[k+1] = limit(A[k] s[k] + b[k+1])``, ``s = limit(b)`` at the first row of each run.

    ``A`` (n_states, n_states, n_samples): ``A[:, :, k]`` leads from row k to row k + 1.
    ``b`` (n_states, n_columns, n_samples).
    ``starts`` int (n_runs,): first row of every run.
    ``limit`` (s, rows) -> ndarray: states (n_states, n_columns, n_rows) at some rows, brought within their limits.
    Returns (n_states, n_columns, n_samples).

    >>> A, b = np.ones((1, 1, 4)), np.ones((1, 1, 4))
    >>> limited_recursion(A, b, np.array([0]), lambda s, rows: np.minimum(s, 2.5))
    array([[[1. , 2. , 2.5, 2.5]]])
    """
    out = np.empty(b.shape)
    lengths = np.diff(np.r_[starts, b.shape[2]])
    s = limit(b[:, :, starts], starts)
    out[:, :, starts] = s
    for k in range(1, int(lengths.max())):
        alive = lengths > k
        rows = starts[alive] + k
        s = np.einsum("ijr,jcr->icr", A[:, :, rows - 1], s if len(rows) == s.shape[2] else out[:, :, rows - 1])
        s = limit(s + b[:, :, rows], rows)
        out[:, :, rows] = s
    return out
