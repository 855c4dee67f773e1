"""Least squares from second moments: features come in blocks, are used once and are gone.

Every linear fit of the package needs of the data only the mean and the scatter of ``z = [phi(x), y]``
(:class:`Moments`), at most its triangular factor (:func:`triangle`) where squaring the condition number would cost the
solution. Both are gathered block by block, so that a million rows of features never stand in memory at once.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy import linalg, sparse
from scipy.linalg import lapack

#: Above this condition number of the (column-scaled) features, the Gram has lost the solution: eps * 1e14 = 1e-2.
CONDITION_LIMIT = 1e7
EPSILON = float(np.finfo(float).eps)
#: Below this share of non-zeros the product of sparse blocks is quicker than that of dense ones.
_SPARSE_BELOW = 0.1
#: Numbers in a piece of dense rows that stays in the cache: 2 MiB.
_CACHED_NUMBERS = 2**18
#: Rows of one QR: with the factor so far they stay in the cache.
_QR_ROWS = 1024


@dataclass(eq=False)
class Moments:
    """Weighted mean and scatter of rows, gathered block by block (Chan, Golub and LeVeque 1983).

    >>> import numpy as np
    >>> Z = np.arange(6.0).reshape(3, 2)
    >>> m = Moments.zeros(2).add(Z[:1]).add(Z[1:])
    >>> m.mean, m.scatter
    (array([2., 3.]), array([[8., 8.], [8., 8.]]))
    """

    n_rows: int  #: Rows of positive weight
    weight: float  #: Sum of the weights
    mean: np.ndarray  #: (n_columns,)
    scatter: np.ndarray  #: (n_columns, n_columns): sum of ``w (z - mean)(z - mean)^T``
    _buffer: Any = field(default=None, repr=False)

    @classmethod
    def zeros(cls, n_columns: int) -> Moments:
        """Moments of no rows."""
        return cls(0, 0.0, np.zeros(n_columns), np.zeros((n_columns, n_columns)))

    def add(self, block: Any, targets: np.ndarray | None = None, weights: np.ndarray | None = None) -> Moments:
        """Take in rows.

        ``block`` ndarray or CSR matrix (n_samples, n_features).
        ``targets`` (n_samples, n_outputs): further columns, to the right of ``block``.
        ``weights`` (n_samples,): not negative; a weight of 2 counts as the row twice.
        """
        n, p = block.shape
        total = float(n) if weights is None else float(weights.sum())
        if total == 0:
            return self
        if hasattr(block, "toarray"):
            if block.nnz < _SPARSE_BELOW * n * p:
                return self._merge(*_sparse_moments(block, targets, weights))
            if self._add_sparse(block.tocsr(), targets, weights, total):
                return self
            block = block.toarray()
        Z = self._room(n)
        Z[:, :p] = block
        if targets is not None:
            Z[:, p:] = targets
        count = n if weights is None else int(np.count_nonzero(weights))
        root = np.ones(n) if weights is None else np.sqrt(weights)
        mean = root**2 @ Z / total
        Z -= mean
        if weights is not None:
            Z *= root[:, None]
        # what rounding left of the mean, so that a constant column leaves nothing behind
        left = root @ Z / total
        return self._merge(count, total, mean + left, Z.T @ Z - total * np.outer(left, left))

    def _add_sparse(self, block: Any, targets: np.ndarray | None, weights: np.ndarray | None, total: float) -> bool:
        """Take in compressed rows, in pieces that stay in the cache; False if a column is all but constant."""
        n, p = block.shape
        width = len(self.mean)
        root = np.ones(n) if weights is None else np.sqrt(weights)
        shift = np.zeros(width)
        if targets is not None:
            shift[p:] = root**2 @ targets / total
        scatter, sums = np.zeros((width, width)), np.zeros(width)
        step = max(1, _CACHED_NUMBERS // width)
        for a in range(0, n, step):
            b = min(a + step, n)
            Z = self._room(b - a)
            _write_csr(block, a, b, Z)
            if targets is not None:
                Z[:, p:] = targets[a:b] - shift[p:]
            if weights is not None:
                Z *= root[a:b, None]
            scatter += Z.T @ Z
            sums += root[a:b] @ Z
        count = n if weights is None else int(np.count_nonzero(weights))
        return self.add_sums(count, total, shift, sums, scatter)

    def add_sums(self, count: int, total: float, shift: np.ndarray, sums: np.ndarray, scatter: np.ndarray) -> bool:
        """Take in sums and products of rows of mostly zeros, from which ``shift`` was taken off; False if a column is all but constant."""
        left = sums / total
        # rows of mostly zeros: the mean may come off afterwards, it takes no more than a digit
        if np.any(total * left**2 > 0.9 * np.diag(scatter)):
            return False
        self._merge(count, total, left + shift, scatter - total * np.outer(left, left))
        return True

    def _room(self, n: int) -> np.ndarray:
        """Working memory of n rows."""
        if self._buffer is None or len(self._buffer) < n:
            self._buffer = np.empty((n, len(self.mean)))
        return self._buffer[:n]

    def _merge(self, n_rows: int, weight: float, mean: np.ndarray, scatter: np.ndarray) -> Moments:
        """Join two sets of rows: the scatter grows by that between their means."""
        if weight <= 0:
            return self
        total = self.weight + weight
        step = mean - self.mean
        self.scatter += scatter
        self.scatter += np.outer(step, step) * (self.weight * weight / total)
        self.mean += step * (weight / total)
        self.weight = total
        self.n_rows += n_rows
        return self

    def merge(self, other: Moments) -> Moments:
        """Take in the rows of other moments."""
        return self._merge(other.n_rows, other.weight, other.mean, other.scatter)

    def select(self, columns: Sequence[int] | np.ndarray) -> Moments:
        """Moments of some of the columns, in the order given."""
        index = np.asarray(columns)
        return Moments(self.n_rows, self.weight, self.mean[index], self.scatter[np.ix_(index, index)])

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_buffer": None}

    def release(self) -> Moments:
        """Let go of the working memory."""
        self._buffer = None
        return self


def _write_csr(block: Any, a: int, b: int, out: np.ndarray) -> None:
    """Write rows a to b of compressed rows into the leading columns of ``out``, which is contiguous; the rest is zero."""
    first, last = block.indptr[a], block.indptr[b]
    parts = block.data[first:last], block.indices[first:last], block.indptr[a : b + 1] - first
    # the same rows with as many columns as out has: scipy clears it and writes them in C, straight into place
    sparse.csr_array(parts, shape=out.shape).toarray(out=out)


def _sparse_moments(block: Any, targets: np.ndarray | None, weights: np.ndarray | None) -> tuple:
    """Count, weight, mean and scatter of a block with few non-zeros."""
    Z = block.tocsr() if targets is None else sparse.hstack([block, sparse.csr_array(targets)], format="csr")
    w = np.ones(Z.shape[0]) if weights is None else weights
    total = float(w.sum())
    if total == 0:
        return 0, 0.0, np.zeros(Z.shape[1]), np.zeros((Z.shape[1],) * 2)
    mean = np.asarray(Z.T @ w).ravel() / total
    scaled = sparse.csr_array(Z.multiply(np.sqrt(w)[:, None]))
    scatter = (scaled.T @ scaled).toarray() - total * np.outer(mean, mean)
    return int(np.count_nonzero(w)), total, mean, scatter


def triangle(
    blocks: Iterable[tuple[Any, np.ndarray, np.ndarray | None]], centre: np.ndarray | None = None
) -> np.ndarray:
    """Triangular factor R of ``sqrt(w) [1, Phi, Y]`` over all blocks, by QR from block to block.

    Its first column belongs to the constant; ``R[1:, 1:]`` is the factor of the centred data.

    ``blocks`` iterable of (block, targets, weights or None).
    ``centre`` (n_features + n_outputs,): taken off features and targets first.
    Returns (n_rows, 1 + n_features + n_outputs): square, or as many rows as the data where these are fewer.
    """
    R: np.ndarray | None = None
    for block, targets, weights in blocks:
        n, p = block.shape
        width = 1 + p + targets.shape[1]
        R = np.zeros((0, width)) if R is None else R
        rows = np.empty((n, width - 1))
        if hasattr(block, "toarray"):
            _write_csr(block.tocsr(), 0, n, rows)
        else:
            rows[:, :p] = block
        rows[:, p:] = targets
        if centre is not None:
            rows -= centre
        for a in range(0, n, _QR_ROWS):
            piece = rows[a : a + _QR_ROWS]
            Z = np.empty((len(R) + len(piece), width), order="F")
            Z[: len(R)] = R
            Z[len(R) :, 0], Z[len(R) :, 1:] = 1.0, piece
            if weights is not None:
                Z[len(R) :] *= np.sqrt(weights[a : a + _QR_ROWS])[:, None]
            R = np.triu(lapack.dgeqrf(Z, lwork=64 * width, overwrite_a=True)[0][: min(Z.shape)])
    assert R is not None
    return R


@dataclass(frozen=True, eq=False)
class Quadratic:
    """The loss ``theta^T H theta - 2 theta^T g + c`` of each output."""

    H: np.ndarray  #: (n_params, n_params)
    g: np.ndarray  #: (n_params, n_outputs)
    c: np.ndarray  #: (n_outputs,)

    def plus(self, rows: np.ndarray, targets: np.ndarray, weight: float = 1.0) -> Quadratic:
        """Add ``weight * |rows theta - targets|^2``."""
        return Quadratic(
            self.H + weight * (rows.T @ rows),
            self.g + weight * (rows.T @ targets),
            self.c + weight * np.sum(targets**2, axis=0),
        )

    def loss(self, theta: np.ndarray) -> np.ndarray:
        """Loss of each output, not below zero."""
        value = np.sum(theta * (self.H @ theta - 2 * self.g), axis=0) + self.c
        return np.maximum(value, 0.0)


def solve_normal(H: np.ndarray, g: np.ndarray) -> tuple[np.ndarray, float, bool]:
    """Minimum-norm solution of the normal equations ``H theta = g`` (paper, Eq. 5).

    Columns are scaled to unit diagonal first, so that units do not count as bad condition. A Cholesky factor where H
    allows it; else eigenvectors, those of vanishing eigenvalue left out, and the null space projected out in the units
    given.

    Returns ``theta`` (n_params, n_outputs).
    Returns ``condition``: of the scaled features (square root of that of H); infinite where a null space was left out.
    Returns ``doubtful``: whether eigenvalues lie between "certain" and "rounding": H has lost digits that a QR route
        would keep.
    """
    d = np.sqrt(np.maximum(np.diag(H), 0.0))
    keep = d > 0
    theta = np.zeros_like(g)
    if not keep.any():
        return theta, np.inf, False
    d = d[keep]
    S = H[np.ix_(keep, keep)] / np.outer(d, d)
    b = g[keep] / d[:, None]
    L, info = lapack.dpotrf(S, lower=True)
    if info == 0:
        rcond = lapack.dpocon(L, float(np.abs(S).sum(axis=0).max()), uplo="L")[0]
        if rcond > CONDITION_LIMIT**-2:
            theta[keep] = linalg.cho_solve((L, True), b) / d[:, None]
            return theta, float(rcond**-0.5), False
    values, V = linalg.eigh(S)
    noise = 10 * max(len(values), 10) * EPSILON * values[-1]
    alive = values > noise
    doubtful = bool(np.any(values[alive] < CONDITION_LIMIT**-2 * values[-1] * 100))
    scaled = V[:, alive] @ ((V[:, alive].T @ b) / values[alive][:, None])
    theta[keep] = _within(scaled / d[:, None], V[:, alive] * d[:, None])
    condition = np.inf if not alive.all() else float(np.sqrt(values[-1] / values[0]))
    return theta, condition, doubtful


def factor_normal(H: np.ndarray, g: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rows A, B with ``A^T A = H`` and ``A^T B = g``; directions of vanishing eigenvalue are left out."""
    d = np.sqrt(np.maximum(np.diag(H), 0.0))
    d = np.where(d > 0, d, 1.0)
    values, V = linalg.eigh(H / np.outer(d, d))
    alive = values > 10 * max(len(values), 10) * EPSILON * values[-1]
    root = np.sqrt(values[alive])[:, None]
    return root * V[:, alive].T * d, (V[:, alive].T @ (g / d[:, None])) / root


def solve_rows(
    A: np.ndarray, B: np.ndarray, n_rows: int | None = None, rounding: np.ndarray | None = None
) -> tuple[np.ndarray, float]:
    """Minimum-norm least squares ``min |A theta - B|`` by singular values of the column-scaled A.

    ``A`` (n_rows, n_params): the features or their triangular factor.
    ``B`` (n_rows, n_outputs).
    ``n_rows``: rows that a triangular factor stands for: sets what counts as rounding.
    ``rounding`` (n_params,): norm of the error that each column of A carries already (large offsets that were taken
        off). Directions that are no longer than that are left out.
    Returns ``theta`` (n_params, n_outputs), ``condition``.
    """
    d = np.linalg.norm(A, axis=0)
    keep = d > 0
    theta = np.zeros((A.shape[1], B.shape[1]))
    if not keep.any():
        return theta, np.inf
    d = d[keep]
    U, s, Vt = linalg.svd(A[:, keep] / d, full_matrices=False)
    alive = s > 10 * max(len(d), np.sqrt(n_rows or len(A))) * EPSILON * s[0]
    if rounding is not None:
        alive &= s > np.linalg.norm(Vt * (rounding[keep] / d), axis=1)
    V = Vt[alive].T
    theta[keep] = _within(V @ ((U[:, alive].T @ B) / s[alive, None]) / d[:, None], V * d[:, None])
    return theta, float(s[0] / s[-1]) if len(s) == len(d) and alive.all() else np.inf


def _within(theta: np.ndarray, row_space: np.ndarray) -> np.ndarray:
    """Of all solutions the shortest: the one within the row space of the features."""
    if row_space.shape[1] == len(theta):
        return theta
    Q = linalg.qr(row_space, mode="economic")[0]
    return Q @ (Q.T @ theta)


def gcv_path(data: Quadratic, penalty: Quadratic, alphas: np.ndarray, weight: float) -> tuple[np.ndarray, np.ndarray]:
    """Generalised cross-validation of ``data + alpha * penalty`` for all alphas from one factorisation.

    Both forms are made diagonal at once: in coordinates where ``H_data = 1 - mu`` and ``H_penalty = mu``, every alpha
    costs one division a coordinate. ``GCV = N |Y - Y_hat|^2 / (N - df)^2``, summed over outputs.

    ``alphas`` (n_alphas,).
    ``weight``: N, the sum of the weights.
    Returns ``scores`` (n_alphas,): infinite where no degree of freedom is left.
    Returns ``dof`` (n_alphas,).

    See Golub, Heath and Wahba, Technometrics 21 (1979).
    """
    scale = max(float(np.trace(data.H)), EPSILON) / max(float(np.trace(penalty.H)), EPSILON)
    total = data.H + scale * penalty.H
    values, V = linalg.eigh(total)
    V = V[:, values > 10 * len(values) * EPSILON * values[-1]] if values[-1] > 0 else V[:, :0]
    V = V / np.sqrt(np.einsum("ij,ij->j", V, total @ V))
    mu, U = linalg.eigh(scale * (V.T @ penalty.H @ V))
    mu = np.clip(mu, 0.0, 1.0)
    T = V @ U
    b, q = T.T @ data.g, scale * (T.T @ penalty.g)
    a = np.asarray(alphas, float)[:, None] / scale
    denominator = np.maximum((1 - mu) + a * mu, EPSILON)
    theta = (b + a[:, :, None] * q) / denominator[:, :, None]
    rss = data.c - np.sum(theta * (2 * b - (1 - mu)[:, None] * theta), axis=1)
    dof = np.sum((1 - mu) / denominator, axis=1)
    free = weight - dof
    # below this a residual is rounding, and would choose alpha by chance
    loss = np.maximum(rss, 1e-12 * data.c).sum(axis=1)
    scores = np.full(len(a), np.inf)
    # within a whisker of interpolation the quotient is rounding over rounding
    ok = free > 1e-6 * weight
    scores[ok] = weight * loss[ok] / free[ok] ** 2
    return scores, dof
