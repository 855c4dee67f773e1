"""Linear recursions and smoothing problems over time as banded systems: no Python loop over samples.

Stacked runs lie one behind the other on one time axis of ``n_samples`` rows; ``starts`` holds the first row of every
run, and nothing couples across it. Rows of the banded systems are ordered time, state.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg.lapack import dpbtrf, dpbtrs, dtbtrs

#: Samples whose solutions are squared at once: more, of hundreds of columns, would leave the processor's cache.
SAMPLES_SQUARED_AT_ONCE = 16


def recursion_band(A: np.ndarray, starts: np.ndarray) -> np.ndarray:
    """Band of the unit lower triangular matrix of ``s[k+1] - A[k] s[k] = b[k+1]``.

    ``A`` (n_states, n_states, n_samples): ``A[:, :, k]`` leads from row k to row k + 1; the last row of every run is
        not used.
    ``starts`` int (n_runs,).
    Returns ndarray (2 n_states, n_samples * n_states), Fortran order.
    """
    n, _, n_samples = A.shape
    band = np.zeros((n_samples, n, 2 * n))  # its transpose is Fortran ordered
    ends = np.r_[starts[1:], n_samples] - 1
    for i in range(n):
        for j in range(n):
            band[:, j, n + i - j] = -A[i, j]
            band[ends, j, n + i - j] = 0.0
    band[:, :, 0] = 1.0
    return band.reshape(n_samples * n, 2 * n).T


def a_sample_later(change: np.ndarray, starts: np.ndarray) -> np.ndarray:
    """Changes of the next states (..., n_samples) at the sample in which these are, never from one run into the next.

    >>> a_sample_later(np.array([1.0, 2.0, 3.0, 4.0]), np.array([0, 2]))
    array([0., 1., 0., 3.])
    """
    out = np.zeros_like(change)
    out[..., 1:] = change[..., :-1]
    out[..., starts] = 0.0
    return out


def solve_recursion(band: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Solve ``s[k+1] - A[k] s[k] = b[k+1]``, ``s = b`` at the first row of each run.

    ``band`` (2 n_states, n_samples * n_states): from :func:`recursion_band`.
    ``b`` (n_states, n_columns, n_samples).
    Returns (n_states, n_columns, n_samples).

    >>> A = np.full((1, 1, 3), 0.5)
    >>> solve_recursion(recursion_band(A, np.array([0])), np.array([[[1.0, 0.0, 0.0]]]))
    array([[[1.  , 0.5 , 0.25]]])
    """
    n, n_columns, n_samples = b.shape
    # a copy, to be solved in place
    columns = np.array(b.transpose(1, 2, 0), order="C").reshape(n_columns, n_samples * n)
    solution, info = dtbtrs(band, columns.T, uplo="L", diag="U", overwrite_b=1)
    if info != 0:
        raise FloatingPointError(f"dtbtrs: argument {-info} is illegal")
    return np.ascontiguousarray(solution.T.reshape(n_columns, n_samples, n).transpose(2, 0, 1))


def solve_adjoint(band: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Solve the transposed recursion, ``m[k] - A[k]' m[k+1] = c[k]``: what a change of ``b[k]`` does to ``sum c s``.

    ``band`` (2 n_states, n_samples * n_states): from :func:`recursion_band`.
    ``c`` (n_states, n_samples).
    Returns (n_states, n_samples).

    >>> A = np.full((1, 1, 3), 0.5)
    >>> solve_adjoint(recursion_band(A, np.array([0])), np.array([[0.0, 0.0, 1.0]]))
    array([[0.25, 0.5 , 1.  ]])
    """
    solution, info = dtbtrs(band, np.asfortranarray(c.T.reshape(-1, 1)), uplo="L", trans="T", diag="U")
    if info != 0:
        raise FloatingPointError(f"dtbtrs: argument {-info} is illegal")
    return solution.reshape(c.shape[::-1]).T


def first_order_scan(factor: float, b: np.ndarray, starts: np.ndarray) -> np.ndarray:
    """``w[k] = factor * w[k-1] + b[k]`` along the last axis, ``w = b`` at the first row of each run.

    >>> first_order_scan(0.5, np.array([1.0, 0.0, 0.0]), np.array([0]))
    array([1.  , 0.5 , 0.25])
    """
    n_samples = b.shape[-1]
    band = np.empty((n_samples, 2))
    band[:, 0] = 1.0
    band[:, 1] = -factor
    band[np.r_[starts[1:], n_samples] - 1, 1] = 0.0
    rows = np.asfortranarray(b.reshape(-1, n_samples).T)
    solution, _ = dtbtrs(band.T, rows, uplo="L", diag="U")
    return np.ascontiguousarray(solution.T).reshape(b.shape)


def block_steps(factor: np.ndarray, H: np.ndarray) -> np.ndarray:
    """``s[k] = step[k] [s[k-1], b[k]]`` solves ``L s = H b`` with the lower band L of a block tridiagonal matrix.

    ``factor`` (width, n_samples * n): lower band as LAPACK keeps it; row and column of an entry lie in the same sample
        or in neighbours.
    ``H`` (n_samples, n, m).
    Returns (n_samples, n, n + m).
    """
    n_samples, n, _ = H.shape
    band = factor.T.reshape(n_samples, n, -1)
    own, before = np.zeros((n_samples, n, n)), np.zeros((n_samples, n, n))
    for j in range(n):
        inside = min(n - j, band.shape[2])
        own[:, j : j + inside, j] = band[:, j, :inside]
        beyond = min(band.shape[2] - inside, n)
        before[1:, :beyond, j] = band[:-1, j, inside : inside + beyond]
    inverse = np.linalg.inv(own)
    return np.concatenate([-(inverse @ before), inverse @ H], axis=2)


def solve_blocks(step: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Solve the recursion of :func:`block_steps`, for hundreds of columns.

    LAPACK walks through the band once for every column; here every sample is one small product for all of them.

    ``step`` (n_samples, n, n + m), ``b`` (n_samples, m, n_columns).
    Returns (n_samples, n, n_columns).

    >>> factor = np.array([[2.0, 4.0], [1.0, 0.0]])  # of [[2, 0], [1, 4]]
    >>> solve_blocks(block_steps(factor, np.ones((2, 1, 1))), np.array([[[2.0]], [[5.0]]])).ravel()
    array([1., 1.])
    """
    out = np.empty((*step.shape[:2], b.shape[2]))
    _walk(step, b, out, np.zeros((step.shape[2], b.shape[2])))
    return out


def solved_squares(step: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Sums of squares of what :func:`solve_blocks` gives, column by column, (n_columns,): none of it is kept.

    >>> factor = np.array([[2.0, 4.0], [1.0, 0.0]])
    >>> float(solved_squares(block_steps(factor, np.ones((2, 1, 1))), np.array([[[2.0]], [[5.0]]]))[0])
    2.0
    """
    n_samples, n, _ = step.shape
    total, some = np.zeros(b.shape[2]), np.empty((SAMPLES_SQUARED_AT_ONCE, n, b.shape[2]))
    both = np.zeros((step.shape[2], b.shape[2]))
    for a in range(0, n_samples, SAMPLES_SQUARED_AT_ONCE):
        out = some[: n_samples - a]
        _walk(step[a : a + SAMPLES_SQUARED_AT_ONCE], b[a : a + SAMPLES_SQUARED_AT_ONCE], out, both)
        total += np.einsum("tik,tik->k", out, out)
    return total


def _walk(step: np.ndarray, b: np.ndarray, out: np.ndarray, both: np.ndarray) -> None:
    """The recursion of :func:`block_steps`; ``both`` holds the last solution above the right-hand side."""
    n = step.shape[1]
    for k in range(len(step)):
        both[n:] = b[k]
        np.matmul(step[k], both, out=out[k])
        both[:n] = out[k]


class BlockTridiagonal:
    """Cholesky factor of a symmetric positive definite block tridiagonal matrix over time.

    ``diagonal`` (n_samples, n, n).
    ``lower`` (n_samples, n, n): block that couples row k + 1 to row k (``lower[k] = M[k+1, k]``); zero at the end of a
        run.
    Raises numpy.linalg.LinAlgError where the matrix is not positive definite.
    """

    def __init__(self, diagonal: np.ndarray, lower: np.ndarray):
        n_samples, n, _ = diagonal.shape
        band = np.zeros((n_samples, n, 2 * n))
        for i in range(n):
            for j in range(n):
                if i >= j:
                    band[:, j, i - j] = diagonal[:, i, j]
                band[:, j, n + i - j] += lower[:, i, j]
        self._shape = (n_samples, n)
        self._factor, info = dpbtrf(band.reshape(n_samples * n, 2 * n).T, lower=1, overwrite_ab=1)
        if info != 0:
            raise np.linalg.LinAlgError("the block tridiagonal matrix is not positive definite")

    def solve(self, b: np.ndarray) -> np.ndarray:
        """Solve for right-hand sides ``b`` (n_columns, n_samples, n)."""
        n_samples, n = self._shape
        columns = np.asfortranarray(b.reshape(-1, n_samples * n).T)
        solution, _ = dpbtrs(self._factor, columns, lower=1)
        return solution.T.reshape(-1, n_samples, n)
