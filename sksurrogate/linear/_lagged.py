"""Linear lag models of long records."""

from __future__ import annotations

from typing import Any

import numpy as np
from sklearn.base import BaseEstimator, MultiOutputMixin, RegressorMixin, clone
from sklearn.utils.validation import check_is_fitted

from sksurrogate._checks import checked, is_checked_frame
from sksurrogate._lags import lag_terms
from sksurrogate.exceptions import DataError, RunError
from sksurrogate.kernels.gram import Moments
from sksurrogate.kernels.lag_moments import lag_moments
from sksurrogate.linear._base import BaseBlockedRegressor
from sksurrogate.linear._regressor import PenalizedRegressor
from sksurrogate.runs import Runs, resolve_runs


class LaggedLinearRegressor(MultiOutputMixin, RegressorMixin, BaseEstimator):
    """Linear regression on columns of X and their past within each run, without the lag matrix.

    ``y(t) = sum_i theta_i x_{j_i}(t - k_i) + intercept``, the same as
    ``make_pipeline(LagEmbedding(lags), estimator)`` on the rows whose whole past was measured. The second moments of the
    lagged columns follow from those of lag 0 by shift recursion, so that time and memory hardly grow with the lags. With
    past outputs among the columns of X (lags from 1) this is an ARX model one step ahead.

    Parameters
    ----------
    lags : int, list of int, or dict of column -> int or list, default=1
        An int n means 0, 1, ..., n. A dict (by name for frames, else by position) leaves out columns it does not name.
    run : None, column name, int or "index"
        Where X says which run a row belongs to; ``groups`` wins.
    estimator : PenalizedRegressor or PCRRegressor, optional
        Fitted to the moments; None: :class:`PenalizedRegressor` without penalties, least squares.
    missing : {"error", "drop"}, default="error"
        What nan in X or y means: an error, or rows that are left out of the fit, together with as many after them as the
        longest lag; predictions from such windows are nan.

    Attributes
    ----------
    coef_ : ndarray (n_features,) or (n_outputs, n_features)
        In the order of ``columns_``.
    intercept_ : float or ndarray (n_outputs,)
    columns_ : list of (int, int)
        Column of X (run column left out) and lag of every feature.
    estimator_ : fitted estimator
        Takes lagged rows.
    max_lag_ : int
    n_features_in_ : int

    See Also
    --------
    sksurrogate.features.LagEmbedding : The lag matrix, for any estimator.
    sksurrogate.compose.RecursivePredictor : Free runs.

    References
    ----------
    Lie, *Surrogate and Hybrid Models for Control*, SIMS 60 (2019), section 2.6.

    Examples
    --------
    >>> import numpy as np
    >>> from sksurrogate.linear import LaggedLinearRegressor
    >>> u = np.array([0.0, 1.0, 3.0, 2.0, 5.0])
    >>> y = 2 * u - np.r_[0.0, u[:-1]]
    >>> LaggedLinearRegressor(lags=1).fit(u[:, None], y).coef_.round(6)
    array([ 2., -1.])
    """

    __metadata_request__fit = {"groups": True}
    __metadata_request__partial_fit = {"groups": True}
    __metadata_request__predict = {"groups": True}
    __metadata_request__score = {"groups": True}

    def __init__(
        self,
        lags: Any = 1,
        *,
        run: Any = None,
        estimator: BaseBlockedRegressor | None = None,
        missing: str = "error",
    ):
        self.lags = lags
        self.run = run
        self.estimator = estimator
        self.missing = missing

    def fit(self, X: Any, y: Any, groups: Any = None) -> LaggedLinearRegressor:
        """Fit to the rows whose whole past was measured.

        Parameters
        ----------
        X : array-like (n_samples, n_columns)
        y : array-like (n_samples,) or (n_samples, n_outputs)
        groups : array-like (n_samples,), optional

        Returns
        -------
        self
        """
        runs = self._resolve(X, y, groups, reset=True)
        names = runs.input_names or tuple(f"x{j}" for j in range(runs[0].X.shape[1]))
        self.columns_ = lag_terms(self.lags, names)
        if not self.columns_:
            raise DataError(f"lags={self.lags!r} asks for no column at all: name at least one lag.")
        self.max_lag_ = max(k for _, k in self.columns_)
        self.feature_names_ = [f"{names[j]}_lag{k}" for j, k in self.columns_]
        return self._solve(runs, self._moments(runs))

    def partial_fit(self, X: Any, y: Any, groups: Any = None) -> LaggedLinearRegressor:
        """Take in further whole runs: the same coefficients as one fit of all runs, to rounding.

        Parameters
        ----------
        X : array-like (n_samples, n_columns)
        y : array-like (n_samples,) or (n_samples, n_outputs)
        groups : array-like (n_samples,), optional

        Returns
        -------
        self
        """
        if not hasattr(self, "estimator_"):
            return self.fit(X, y, groups=groups)
        runs = self._resolve(X, y, groups)
        moments = self._moments(runs)
        if len(moments.mean) != len(self.estimator_.moments_.mean):
            before = len(self.estimator_.moments_.mean) - len(self.columns_)
            raise DataError(f"y has {runs[0].y.shape[1]} outputs, but the runs before had {before}.")
        return self._solve(runs, moments.merge(self.estimator_.moments_))

    def _moments(self, runs: Runs) -> Moments:
        """Mean and scatter of the lagged columns and the outputs."""
        used = sorted({j for j, _ in self.columns_})
        columns = used if len(used) < runs[0].X.shape[1] else slice(None)
        tables, targets = [run.X[:, columns] for run in runs], [run.y for run in runs]
        if self.missing == "drop":
            tables, targets = _whole_stretches(tables, targets)
        longest = max(map(len, tables), default=0)
        if longest <= self.max_lag_:
            stretch = "stretch without nan" if self.missing == "drop" else "run"
            raise RunError(
                f"the longest {stretch} has {longest} rows (n_samples={runs.n_samples} in all), but the longest lag "
                f"{self.max_lag_} needs {self.max_lag_ + 1}: give longer runs or lower lags."
            )
        moments = lag_moments(tables, self.max_lag_, targets)
        target = (self.max_lag_ + 1) * len(used)
        place = [k * len(used) + used.index(j) for j, k in self.columns_]
        return moments.select([*place, *range(target, len(moments.mean))])

    def _solve(self, runs: Runs, moments: Moments) -> LaggedLinearRegressor:
        """Fit the estimator to the moments."""
        estimator = PenalizedRegressor() if self.estimator is None else self.estimator
        if not hasattr(estimator, "fit_moments"):
            raise DataError(
                f"estimator={estimator!r} cannot be fitted from moments: take PenalizedRegressor or PCRRegressor, or "
                "make_pipeline(LagEmbedding(lags), estimator)."
            )
        self.estimator_ = clone(estimator).fit_moments(moments, None if runs.y_is_1d else runs[0].y.shape[1])
        self.coef_, self.intercept_ = self.estimator_.coef_, self.estimator_.intercept_
        return self

    def predict(self, X: Any, groups: Any = None) -> np.ndarray:
        """Predict; rows before the first one of a run count as equal to it.

        Parameters
        ----------
        X : array-like (n_samples, n_columns)
        groups : array-like (n_samples,), optional

        Returns
        -------
        ndarray (n_samples,) or (n_samples, n_outputs)
            nan in rows that belong to no run.
        """
        check_is_fitted(self, "coef_")
        runs = self._resolve(X, None, groups, predicting=True)
        coef = np.atleast_2d(self.coef_)
        out = runs.stack([self._filtered(run.X, coef) for run in runs])
        return out[:, 0] if self.coef_.ndim == 1 else out

    def jacobian(self, X: Any, groups: Any = None) -> np.ndarray:
        """Slopes of the prediction by the lagged columns: the coefficients, the same in every row.

        Parameters
        ----------
        X : array-like (n_samples, n_columns)
        groups : array-like (n_samples,), optional

        Returns
        -------
        ndarray (n_samples, n_features) or (n_samples, n_outputs, n_features)
            In the order of ``columns_``.
        """
        check_is_fitted(self, "coef_")
        return np.repeat(self.coef_[None], self._resolve(X, None, groups, predicting=True).n_samples, axis=0)

    def score(self, X: Any, y: Any, groups: Any = None) -> float:
        """Coefficient of determination of :meth:`predict`."""
        from sklearn.metrics import r2_score

        predicted = self.predict(X, groups=groups)
        measured = np.asarray(y, dtype=float)
        known = np.isfinite(np.column_stack([predicted, measured] if self.missing == "drop" else [predicted])).all(
            axis=1
        )
        return float(r2_score(measured[known], predicted[known]))

    def _filtered(self, values: np.ndarray, coef: np.ndarray) -> np.ndarray:
        """One run through one finite impulse response a column and output."""
        out = np.empty((len(values), len(coef)))
        out[:] = self.intercept_
        for j in {column for column, _ in self.columns_}:
            padded = np.concatenate([np.full(self.max_lag_, values[0, j]), values[:, j]])
            for k in range(len(coef)):
                response = np.zeros(self.max_lag_ + 1)
                for value, (column, lag) in zip(coef[k], self.columns_):
                    response[lag] += value * (column == j)
                out[:, k] += np.convolve(padded, response, mode="valid")
        return out

    def _resolve(self, X: Any, y: Any, groups: Any, reset: bool = False, predicting: bool = False) -> Runs:
        """Checks that scikit-learn asks for, then runs."""
        if not predicting and y is None:
            raise DataError(f"{type(self).__name__} requires y to be passed, but the target y is None.")
        if self.missing not in ("error", "drop"):
            raise DataError(f'missing={self.missing!r} must be "error" or "drop".')
        drop = self.missing == "drop"
        if is_checked_frame(self, X, reset):
            return resolve_runs(X, y, groups=groups, run=self.run, allow_nan=drop)
        checks = {"reset": reset, "ensure_all_finite": groups is None, "dtype": "numeric"}
        if drop:
            X = checked(self, X, **{**checks, "ensure_all_finite": "allow-nan" if groups is None else False})
            return resolve_runs(X, y, groups=groups, run=self.run, allow_nan=True)
        if y is None:
            X = checked(self, X, **checks)
        else:
            X, y = checked(self, X, y, multi_output=True, y_numeric=True, **checks)
        return resolve_runs(X, y, groups=groups, run=self.run)


def _whole_stretches(tables: list[np.ndarray], targets: list[np.ndarray]) -> tuple[list, list]:
    """The pieces of every run without nan."""
    out: tuple[list, list] = ([], [])
    for x, y in zip(tables, targets):
        whole = np.isfinite(x).all(axis=1) & np.isfinite(y).all(axis=1)
        edges = np.flatnonzero(np.diff(np.r_[0, whole.astype(int), 0]))
        for a, b in edges.reshape(-1, 2):
            out[0].append(x[a:b])
            out[1].append(y[a:b])
    return out
