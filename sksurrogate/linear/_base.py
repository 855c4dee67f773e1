"""What the linear fits share: checks of the data, features block by block, moments, prediction."""

from __future__ import annotations

import warnings
from abc import abstractmethod
from collections.abc import Callable, Iterator
from numbers import Integral
from typing import Any, Self

import numpy as np
from scipy import sparse
from scipy.linalg import LinAlgWarning
from sklearn.base import BaseEstimator, MultiOutputMixin, RegressorMixin, _fit_context, clone
from sklearn.utils import get_tags
from sklearn.utils._param_validation import HasMethods, Interval, StrOptions
from sklearn.utils.parallel import _get_threadpool_controller
from sklearn.utils.validation import _check_sample_weight, check_is_fitted, has_fit_parameter

from sksurrogate._checks import checked
from sksurrogate._tables import unmasked
from sksurrogate.exceptions import DataError, SurrogateError
from sksurrogate.export._jacobian import chained_slopes
from sksurrogate.kernels.gram import Moments
from sksurrogate.kernels.rows import RowSource

#: Makes an iterator over (features, targets, weights or None).
Blocks = Callable[[], Iterator[tuple[Any, np.ndarray, np.ndarray | None]]]

#: Numbers in a block of features: 8 MiB.
_BLOCK_NUMBERS = 2**20
#: Features up to which one BLAS thread is used: a second one only waits, and long where the machine is shared.
_ONE_THREAD = 128


def warn_ill_conditioned(kept_data: bool) -> None:
    """Say that the Gram has lost digits."""
    way_out = (
        'solver="auto" or "qr" goes over the data again without squaring the condition number'
        if kept_data
        else 'fit all data at once (solver="qr"), or add a penalty such as Ridge()'
    )
    warnings.warn(
        "The features are nearly dependent (condition number above 1e7) and their Gram matrix has lost the directions "
        f"in question: they are treated as a null space. {way_out[0].upper()}{way_out[1:]}.",
        LinAlgWarning,
        stacklevel=2,
    )


class BaseBlockedRegressor(MultiOutputMixin, RegressorMixin, BaseEstimator):
    """Base of regressors that see the data once, in blocks, through their moments."""

    _parameter_constraints: dict = {
        "features": [HasMethods(["fit", "transform"]), None],
        "block_size": [Interval(Integral, 1, None, closed="left"), None],
        "solver": [StrOptions({"auto", "gram", "qr"})],
    }

    features: Any
    block_size: int | None
    solver: str
    _flat: bool
    _n_outputs: int
    _low: np.ndarray
    _high: np.ndarray

    @abstractmethod
    def _solve(self, blocks: Blocks | None) -> tuple[np.ndarray, np.ndarray]:
        """Coefficients (n_features, n_outputs) and intercept (n_outputs,) from ``moments_``, or from the blocks again."""

    @_fit_context(prefer_skip_nested_validation=True)
    def fit(self, X: Any, y: Any, sample_weight: Any = None) -> Self:
        """Fit.

        Parameters
        ----------
        X : array-like or sparse matrix (n_samples, n_inputs)
        y : array-like (n_samples,) or (n_samples, n_outputs)
        sample_weight : array-like (n_samples,), optional
            A weight of 2 counts as the row twice.

        Returns
        -------
        self
        """
        X, Y, weights = self._border(X, y, sample_weight, reset=True)
        self._begin(X, Y, weights)
        if self._asks_range():
            self._low, self._high = _range(X)
        return self._finish(X, Y, weights, lambda: self._blocks(X, Y, weights))

    @_fit_context(prefer_skip_nested_validation=True)
    def partial_fit(self, X: Any, y: Any, sample_weight: Any = None) -> Self:
        """Take in further rows: the same coefficients as one fit of all rows, to rounding.

        The data are not kept, so that there is no way back to them where the features are nearly dependent: a warning
        says so. ``features`` is fitted on the first rows only.

        Parameters
        ----------
        X : array-like or sparse matrix (n_samples, n_inputs)
        y : array-like (n_samples,) or (n_samples, n_outputs)
        sample_weight : array-like (n_samples,), optional

        Returns
        -------
        self
        """
        first = not hasattr(self, "moments_")
        before = None if first else (self._flat, self._n_outputs)
        X, Y, weights = self._border(X, y, sample_weight, reset=first)
        if first:
            self._begin(X, Y, weights)
        elif before is not None and before[1] != self._n_outputs:
            self._flat, self._n_outputs = before
            raise DataError(f"y has {Y.shape[1]} outputs, but the rows before had {before[1]}.")
        low, high = _range(X)
        self._low, self._high = np.fmin(self._low, low), np.fmax(self._high, high)
        return self._finish(X, Y, weights, None)

    def fit_moments(self, moments: Moments, n_outputs: int | None = None) -> Self:
        """Fit from second moments that were gathered elsewhere (without the way back to the data).

        Parameters
        ----------
        moments : Moments
            Of features and outputs, the outputs last.
        n_outputs : int, optional
            None: one output, and y counts as 1-D.

        Returns
        -------
        self
        """
        self._validate_params()
        if self.features is not None:
            raise DataError("features must be None where moments are given: they are those of the features already.")
        self.moments_, self.features_ = moments, None
        self._flat, self._n_outputs = n_outputs is None, n_outputs or 1
        self.n_features_in_ = self._n_features
        self._low, self._high = np.full((2, self.n_features_in_), np.nan)
        return self._store(None)

    def predict(self, X: Any) -> np.ndarray:
        """Predict.

        Parameters
        ----------
        X : array-like or sparse matrix (n_samples, n_inputs)

        Returns
        -------
        ndarray (n_samples,) or (n_samples, n_outputs)
        """
        check_is_fitted(self, "coef_")
        X = checked(self, X, accept_sparse=self._accepts, dtype=np.float64, reset=False)
        coef = self.coef_.T
        parts = [self._phi(X[rows]) @ coef for rows in self._slices(X.shape[0])]
        return np.concatenate(parts) + self.intercept_

    def jacobian(self, X: Any) -> np.ndarray:
        """Derivative of the prediction by the inputs.

        Without ``features`` these are the coefficients, the same in every row. With them, their slopes are exact where
        they have a ``jacobian`` or are scalers, PCA or polynomials of scikit-learn, or pipelines of these; other
        transformers are differenced.

        Parameters
        ----------
        X : array-like (n_samples, n_inputs)

        Returns
        -------
        ndarray (n_samples, n_inputs) or (n_samples, n_outputs, n_inputs)
        """
        check_is_fitted(self, "coef_")
        X = checked(self, X, accept_sparse=self._accepts, dtype=np.float64, reset=False)
        if self.features_ is None:
            return np.repeat(self.coef_[None], X.shape[0], axis=0)
        coef = np.atleast_2d(self.coef_)
        blocks = [np.einsum("npj,qp->nqj", self._gradient(X[rows]), coef) for rows in self._slices(X.shape[0])]
        out = np.concatenate(blocks)
        return out[:, 0] if self.coef_.ndim == 1 else out

    def _border(self, X: Any, y: Any, sample_weight: Any, reset: bool) -> tuple[Any, np.ndarray, np.ndarray | None]:
        """Checked X, y as a table, weights."""
        X, y = checked(
            self, X, y, accept_sparse=self._accepts, dtype=np.float64, multi_output=True, y_numeric=True, reset=reset
        )
        self._flat = y.ndim == 1
        self._n_outputs = 1 if self._flat else y.shape[1]
        X = X[:] if self.features is not None and isinstance(X, RowSource) else X  # they may look at all rows
        Y = np.asarray(y, dtype=float).reshape(len(y), -1)
        if sample_weight is None:
            return X, Y, None
        weights = _check_sample_weight(unmasked(sample_weight), X, dtype=np.float64, ensure_non_negative=True)
        if not weights.any():
            raise DataError("sample_weight is zero in every row: at least one row must count.")
        # a weight of zero is as good as no row, to features that look at the data too
        counts = weights > 0
        return (X, Y, weights) if counts.all() else (X[counts], Y[counts], weights[counts])

    def _begin(self, X: Any, Y: np.ndarray, weights: np.ndarray | None) -> None:
        """Fit the features; nothing seen yet."""
        self.features_ = None
        if self.features is not None:
            weighs = weights is not None and has_fit_parameter(self.features, "sample_weight")
            extra = {"sample_weight": weights} if weighs else {}
            self.features_ = clone(self.features).fit(X, Y[:, 0] if self._flat else Y, **extra)
        self.moments_ = Moments.zeros(int(self._phi(X[:1]).shape[1]) + self._n_outputs)
        self._low, self._high = np.full((2, X.shape[1]), np.nan)

    def _finish(self, X: Any, Y: np.ndarray, weights: np.ndarray | None, blocks: Blocks | None) -> Self:
        """Gather the moments, solve, store."""
        gather = getattr(self.features_, "add_moments", None)
        few = len(self.moments_.mean) <= _ONE_THREAD
        with _get_threadpool_controller().limit(limits=1 if few else None, user_api="blas"):
            if gather is None or not gather(self.moments_, X, Y, weights):
                for block, targets, w in self._blocks(X, Y, weights):
                    self.moments_.add(block, targets, w)
            self.moments_.release()
            return self._store(blocks)

    def _store(self, blocks: Blocks | None) -> Self:
        """Solve."""
        coef, intercept = self._solve(blocks)
        self.coef_ = coef[:, 0] if self._flat else coef.T.copy()
        self.intercept_ = float(intercept[0]) if self._flat else intercept
        return self

    def _rounding(self) -> np.ndarray:
        """Norm of the error of each centred feature: its offset was stored to a few units in the last place."""
        m = self.moments_
        return 4 * np.finfo(float).eps * np.abs(m.mean[: self._n_features]) * np.sqrt(m.weight)

    def _constant(self) -> np.ndarray:
        """Features that are constant to rounding: they have no say beside an intercept."""
        return np.diag(self.moments_.scatter)[: self._n_features] <= (3 * self._rounding()) ** 2

    def _route(self, blocks: Blocks | None, regular: bool = False) -> str:
        """Where to begin: not with the Gram matrix where fewer rows than features make it singular for sure."""
        if blocks is None or self.solver == "gram":
            return "gram"
        few = not regular and self.moments_.n_rows < self._n_features
        return "qr" if self.solver == "qr" or few else "gram"

    def _asks_range(self) -> bool:
        """Whether something will be differenced within the range of the data."""
        return self.features_ is not None and not hasattr(self.features_, "jacobian")

    def _phi(self, X: Any) -> Any:
        """Features of some rows, dense or sparse."""
        if self.features_ is None:
            return X
        out = self.features_.transform(X)
        return out if sparse.issparse(out) else np.asarray(out, dtype=float)

    @property
    def _accepts(self) -> str | bool:
        """Sparse formats of X."""
        return "csr" if get_tags(self).input_tags.sparse else False

    @property
    def _n_features(self) -> int:
        return len(self.moments_.mean) - self._n_outputs

    def _slices(self, n_rows: int) -> Iterator[slice]:
        """Blocks of rows."""
        size = self.block_size or int(np.clip(_BLOCK_NUMBERS // len(self.moments_.mean), 64, 16384))
        for start in range(0, n_rows, size):
            yield slice(start, min(start + size, n_rows))

    def _blocks(self, X: Any, Y: np.ndarray, weights: np.ndarray | None) -> Iterator[tuple]:
        """Features, targets and weights of one block after the other."""
        for rows in self._slices(X.shape[0]):
            yield self._phi(X[rows]), Y[rows], None if weights is None else weights[rows]

    def _dense_phi(self, X: np.ndarray) -> np.ndarray:
        out = self._phi(X)
        return out.toarray() if sparse.issparse(out) else out

    def _gradient(self, X: Any) -> np.ndarray:
        """Derivative of the features by the inputs (n_samples, n_features, n_inputs)."""
        X = X.toarray() if sparse.issparse(X) else X
        n, m = X.shape
        if self.features_ is None:
            return np.broadcast_to(np.eye(m), (n, m, m))
        try:
            return chained_slopes(self.features_, X, transforms=True)
        except (SurrogateError, AttributeError):
            pass  # a transformer whose slopes are not known: differences
        step = 1e-5 * np.where(self._high > self._low, self._high - self._low, 1.0)
        # inside the range of the data, where no extrapolation rule can interfere
        left = np.clip(X - step, self._low, np.maximum(self._high - 2 * step, self._low))
        out = np.empty((n, self._n_features, m))
        for j in range(m):
            a, b = X.copy(), X.copy()
            a[:, j], b[:, j] = left[:, j], left[:, j] + 2 * step[j]
            out[:, :, j] = (self._dense_phi(b) - self._dense_phi(a)) / (2 * step[j])
        return out

    def __sklearn_tags__(self) -> Any:
        tags = super().__sklearn_tags__()
        tags.input_tags.sparse = self.features is None or get_tags(self.features).input_tags.sparse
        return tags


def _range(X: Any) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest value of each column."""
    if sparse.issparse(X):
        return X.min(axis=0).toarray().ravel(), X.max(axis=0).toarray().ravel()
    if X.shape[1] > 16:
        return X.min(axis=0), X.max(axis=0)
    # numpy reduces narrow rows slowly, single columns quickly
    return np.array([column.min() for column in X.T]), np.array([column.max() for column in X.T])
