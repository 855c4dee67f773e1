"""Principal component regression."""

from __future__ import annotations

from numbers import Integral
from typing import Any

import numpy as np
from scipy import linalg
from sklearn.utils._param_validation import Interval, RealNotInt, StrOptions

from sksurrogate.kernels.gram import CONDITION_LIMIT, EPSILON, triangle
from sksurrogate.linear._base import BaseBlockedRegressor, Blocks, warn_ill_conditioned


class PCRRegressor(BaseBlockedRegressor):
    """Least squares on the leading principal components of the features, with the practical rank r.

    The singular value decomposition of the centred features is cut after r terms,
    ``theta = sum_{i <= r} v_i (v_i^T Phi^T Y) / sigma_i^2``. It is found from the Gram matrix, gathered in blocks, and
    from a QR of the data (blocks again) where the components asked for need it. For partial least squares take
    :class:`sklearn.cross_decomposition.PLSRegression`.

    Parameters
    ----------
    n_components : None, int, float or "gcv", default=None
        The practical rank r. None: all components above rounding, which is the minimum-norm least squares solution. An
        int above that number means all. A float in (0, 1): as many as explain this share of the variance of the
        features. "gcv": the number of least generalised cross-validation error.
    scale : bool, default=False
        Whether features are divided by their standard deviation first.
    features : transformer, optional
        Makes the features from X, block by block as they are needed; never all in memory.
    block_size : int, optional
        Rows per block; the default makes blocks of 8 MiB.
    solver : {"auto", "gram", "qr"}, default="auto"
        "gram" goes over the data once; "qr" does not square the condition number; "auto" changes from "gram" to "qr"
        where components are asked for that the Gram matrix cannot tell from rounding.

    Attributes
    ----------
    coef_ : ndarray (n_features,) or (n_outputs, n_features)
    intercept_ : float or ndarray (n_outputs,)
    n_components_ : int
    components_ : ndarray (n_kept, n_features)
        Of the (scaled) features.
    explained_variance_ : ndarray (n_kept,)
    explained_variance_ratio_ : ndarray (n_kept,)
    gcv_scores_ : ndarray (rank + 1,)
        Error for 0, 1, ... components.
    scale_ : ndarray (n_features,)
    features_ : transformer or None
    moments_ : Moments
        Mean and scatter of features and outputs.
    solver_ : {"gram", "qr"}
    n_features_in_ : int

    References
    ----------
    Lie, *Surrogate and Hybrid Models for Control*, SIMS 60 (2019), section 2.3.

    Examples
    --------
    >>> import numpy as np
    >>> from sksurrogate.linear import PCRRegressor
    >>> t = np.linspace(-1, 1, 20)
    >>> X = np.c_[t, t, t**2]
    >>> PCRRegressor(n_components=1).fit(X, 3 * t).coef_[:2].round(6)
    array([1.5, 1.5])
    """

    _parameter_constraints: dict = {
        **BaseBlockedRegressor._parameter_constraints,
        "n_components": [
            None,
            Interval(Integral, 1, None, closed="left"),
            Interval(RealNotInt, 0, 1, closed="neither"),
            StrOptions({"gcv"}),
        ],
        "scale": ["boolean"],
    }

    def __init__(
        self,
        n_components: int | float | str | None = None,
        *,
        scale: bool = False,
        features: Any = None,
        block_size: int | None = None,
        solver: str = "auto",
    ):
        self.n_components = n_components
        self.scale = scale
        self.features = features
        self.block_size = block_size
        self.solver = solver

    def _solve(self, blocks: Blocks | None) -> tuple[np.ndarray, np.ndarray]:
        moments = self.moments_
        p = self._n_features
        variance = np.diag(moments.scatter)[:p] / moments.weight
        # a constant column leaves rounding behind, which must not be scaled up
        constant = self._constant()
        scale = np.sqrt(variance) if self.scale else np.ones(p)
        scale = np.where(constant, 1.0, scale)
        rounding = self._rounding() / scale
        self.solver_ = self._route(blocks)
        if self.solver_ == "gram":
            S = np.where(np.outer(~constant, ~constant), moments.scatter[:p, :p], 0.0) / np.outer(scale, scale)
            values, V = linalg.eigh(S)
            values, V = values[::-1], V[:, ::-1]
            loads = V.T @ (moments.scatter[:p, p:] / scale[:, None])
            rank = _rank(values, V, 10 * max(p, 10) * EPSILON, rounding)
            r = self._choose(values, loads, rank)
            asks_all = self.n_components is None or (isinstance(self.n_components, Integral) and r < self.n_components)
            blurred = r > 0 and values[r - 1] < 100 * CONDITION_LIMIT**-2 * values[0]
            if self.solver == "auto" and blocks is not None and (blurred or (asks_all and rank < p)):
                self.solver_ = "qr"
            elif blurred:
                warn_ill_conditioned(blocks is not None)
        if self.solver_ == "qr":
            assert blocks is not None
            R = triangle(blocks(), moments.mean)[1:, 1:]
            R = R if len(R) else np.zeros((1, R.shape[1]))  # a single row has no scatter
            factor = np.where(constant, 0.0, R[:, :p]) / scale
            U, s, Vt = linalg.svd(factor, full_matrices=False)
            values, V, loads = s**2, Vt.T, s[:, None] * (U.T @ R[:, p:])
            rank = _rank(values, V, (10 * max(p, np.sqrt(moments.n_rows)) * EPSILON) ** 2, rounding)
            r = self._choose(values, loads, rank)
        total = max(float(values.sum()), np.finfo(float).tiny)
        self.n_components_, self.scale_ = r, scale
        self.components_ = V[:, :r].T.copy()
        self.explained_variance_ = values[:r] / moments.weight
        self.explained_variance_ratio_ = values[:r] / total
        coef = (V[:, :r] @ (loads[:r] / values[:r, None])) / scale[:, None]
        return coef, moments.mean[p:] - moments.mean[:p] @ coef

    def _choose(self, values: np.ndarray, loads: np.ndarray, rank: int) -> int:
        """Number of components, and the generalised cross-validation error of each number."""
        moments, p = self.moments_, self._n_features
        gains = np.sum(loads[:rank] ** 2, axis=1) / values[:rank]
        total = float(np.trace(moments.scatter[p:, p:]))
        # below this a residual is rounding, and would choose the rank by chance
        rss = np.maximum(total - np.concatenate([[0.0], np.cumsum(gains)]), 1e-12 * total)
        free = moments.weight - 1 - np.arange(rank + 1)
        self.gcv_scores_ = np.full(rank + 1, np.inf)
        ok = free > 1e-6 * moments.weight
        self.gcv_scores_[ok] = moments.weight * rss[ok] / free[ok] ** 2
        wanted = self.n_components
        if wanted is None:
            return rank
        if wanted == "gcv":
            return int(np.argmin(self.gcv_scores_))
        if isinstance(wanted, Integral):
            return min(int(wanted), rank)
        share = np.cumsum(values[:rank]) / max(float(values[:rank].sum()), np.finfo(float).tiny)
        return min(int(np.searchsorted(share, float(wanted))) + 1, rank)


def _rank(values: np.ndarray, V: np.ndarray, cut: float, rounding: np.ndarray) -> int:
    """Leading eigenvalues above rounding, that of the solver and that of the data."""
    if values[0] <= 0:
        return 0
    alive = (values > cut * values[0]) & (values > np.sum((rounding[:, None] * V) ** 2, axis=0))
    return len(alive) if alive.all() else int(np.argmin(alive))
