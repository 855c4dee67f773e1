"""Sparse least squares: thresholds with refit, and backward elimination judged by the evidence."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular
from scipy.special import gammaln

from sksurrogate.kernels.linear_fit import linear_least_squares

#: Ridge on columns of norm 1 that lets dependent columns be distinguished: its square is the rounding of doubles.
DEPENDENT_RIDGE = 1e-8
#: Share of the squares below which a residual is rounding: what the ridge leaves.
ROUNDED_RESIDUAL = 1e-14


@dataclass(frozen=True, eq=False)
class Elimination:
    """Nested sets of columns, each made from the one before by leaving out the column that is missed least."""

    order: np.ndarray  #: int (n_columns,): columns in the order in which they leave
    #: (n_columns + 1,): residual squares with 0, 1, ... columns: entry k belongs to the last k of ``order``.
    squares: np.ndarray

    def columns(self, k: int) -> np.ndarray:
        """The k columns that stay longest, sorted."""
        return np.sort(self.order[len(self.order) - k :])


def eliminate(A: np.ndarray, b: np.ndarray) -> Elimination:
    """Backward elimination of ``min |A x - b|^2``.

    Leaving out column j raises the squares by ``x_j^2 / ((A'A)^-1)_jj``; the least goes first, the others are refitted.

    ``A`` (n_rows, n_columns), ``b`` (n_rows,).

    See Boninsegna, Nueske, Clementi, *Sparse learning of stochastic dynamical equations*, J. Chem. Phys. 148 (2018).

    >>> import numpy as np
    >>> A = np.array([[1.0, 0.0, 1.0], [0.0, 1.0, 1.0], [1.0, 1.0, 0.0]])
    >>> eliminate(A, A @ [2.0, 0.0, 1.0]).columns(2)
    array([0, 2])
    """
    p, total = A.shape[1], float(b @ b)
    norms = np.sqrt(np.einsum("ij,ij->j", A, A))
    norms[norms == 0] = 1.0
    whole = np.vstack([A / norms, DEPENDENT_RIDGE * np.eye(p)])
    R = np.asarray(np.linalg.qr(np.column_stack([whole, np.append(b, np.zeros(p))]), mode="r"))
    left, order, squares = np.arange(p), [], []
    while len(left):
        k = len(left)
        squares.append(float(np.sum(R[k:, k] ** 2)))
        inverse = solve_triangular(R[:k, :k], np.eye(k))
        x = inverse @ R[:k, k]
        worst = int(np.argmin(x**2 / np.einsum("ij,ij->i", inverse, inverse)))
        order.append(left[worst])
        left = np.delete(left, worst)
        R = np.asarray(np.linalg.qr(np.delete(R, worst, axis=1), mode="r"))
    squares.append(total)
    return Elimination(np.array(order, dtype=int), np.maximum(squares[::-1], ROUNDED_RESIDUAL * total))


def log_evidence(squares: np.ndarray, n_rows: float, n_constants: int = 0) -> np.ndarray:
    """Log evidence of the best model with 0, 1, ... of p terms, up to a constant.

    ``-n/2 log(squares / n) - k/2 log n - log binom(p, k)``: Laplace's approximation with a prior worth one row, and
    subsets of one size sharing their prior probability. ``-inf`` for more parameters than half the rows.

    ``squares`` (n_columns + 1,).
    ``n_rows``: independent rows.
    ``n_constants``: parameters that every model has (the intercept).
    Returns (n_columns + 1,).

    See Chen, Chen, *Extended Bayesian information criteria*, Biometrika 95 (2008).
    """
    k = np.arange(len(squares))
    p = len(squares) - 1
    subsets = gammaln(p + 1) - gammaln(k + 1) - gammaln(p - k + 1)
    with np.errstate(divide="ignore"):
        fit = -0.5 * n_rows * np.log(squares / n_rows)
    found = fit - 0.5 * k * np.log(n_rows) - subsets
    return np.where((k > 0) & (k + n_constants > 0.5 * n_rows), -np.inf, found)


def refit(A: np.ndarray, b: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Least squares on some columns, 0 on the others, (n_columns,)."""
    x = np.zeros(A.shape[1])
    if len(columns):
        norms = np.sqrt(np.einsum("ij,ij->j", A[:, columns], A[:, columns]))
        norms[norms == 0] = 1.0
        x[columns] = linear_least_squares(A[:, columns] / norms, b) / norms
    return x


def threshold_refit(A: np.ndarray, b: np.ndarray, size: np.ndarray, threshold: float) -> np.ndarray:
    """Sequentially thresholded least squares: fit, leave out ``|x_j| * size_j < threshold``, fit again, until none goes.

    ``A`` (n_rows, n_columns), ``b`` (n_rows,).
    ``size`` (n_columns,): what a coefficient of 1 amounts to.
    Returns (n_columns,).

    See Brunton, Proctor, Kutz, *Discovering governing equations from data*, PNAS 113 (2016).

    >>> import numpy as np
    >>> threshold_refit(np.eye(3), np.array([2.0, 0.1, -1.0]), np.ones(3), 0.5)
    array([ 2.,  0., -1.])
    """
    columns = np.flatnonzero(size > 0)
    while True:
        x = refit(A, b, columns)
        kept = columns[np.abs(x[columns]) * size[columns] >= threshold]
        if len(kept) == len(columns):
            return x
        columns = kept
