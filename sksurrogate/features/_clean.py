"""Repair of columns within a run: the base, and missing values."""

from __future__ import annotations

from abc import ABC, abstractmethod
from numbers import Integral
from typing import Any

import numpy as np
from scipy.interpolate import PchipInterpolator
from sklearn.base import BaseEstimator, TransformerMixin, _fit_context
from sklearn.utils._param_validation import Interval, StrOptions
from sklearn.utils.validation import _check_feature_names_in, check_is_fitted

from sksurrogate._checks import checked, is_checked_frame
from sksurrogate.exceptions import DataError
from sksurrogate.features._kept_run import kept_run
from sksurrogate.runs import Runs, resolve_runs


def gap_lengths(missing: np.ndarray) -> np.ndarray:
    """Length of the gap that each row lies in, 0 outside gaps: int (n_samples,).

    >>> gap_lengths(np.array([False, True, True, False, True]))
    array([0, 2, 2, 0, 1])
    """
    edges = np.flatnonzero(np.diff(np.r_[0, missing.astype(int), 0]))
    out = np.zeros(len(missing), dtype=int)
    for a, b in edges.reshape(-1, 2):
        out[a:b] = b - a
    return out


def fill_gaps(x: np.ndarray, method: str = "linear", max_gap: int | None = None, ends: str = "nearest") -> np.ndarray:
    """Fill nan in one column of one run from the rows of that run; a column of nothing but nan stays so.

    >>> fill_gaps(np.array([1.0, np.nan, 3.0, np.nan]))
    array([1., 2., 3., 3.])
    """
    missing = np.isnan(x)
    known = np.flatnonzero(~missing)
    if len(known) == 0 or len(known) == len(x):
        return x
    rows = np.flatnonzero(missing)
    if method == "previous":
        filled = x[known[np.maximum(np.searchsorted(known, rows) - 1, 0)]]
    elif method == "pchip" and len(known) > 1:
        filled = PchipInterpolator(known, x[known])(np.clip(rows, known[0], known[-1]))
    else:
        filled = np.interp(rows, known, x[known])
    if ends == "nan":
        filled[(rows < known[0]) | (rows > known[-1])] = np.nan
    if max_gap is not None:
        filled[gap_lengths(missing)[rows] > max_gap] = np.nan
    out = x.copy()
    out[rows] = filled
    return out


class BaseCleaner(TransformerMixin, BaseEstimator, ABC):
    """Base of the transformers that mark values of a run and repair them; rows stay, columns stay."""

    __metadata_request__fit = {"groups": True}
    __metadata_request__transform = {"groups": True}

    run: Any
    keep_run: Any
    add_indicator: Any
    #: What an indicator column is called.
    _marked: str

    @abstractmethod
    def _learn(self, runs: Runs) -> None:
        """What ``fit`` keeps of the data."""

    @abstractmethod
    def _mask(self, values: np.ndarray) -> np.ndarray:
        """Which values of one run are marked."""

    @abstractmethod
    def _repair(self, values: np.ndarray, mask: np.ndarray) -> np.ndarray:
        """The values of one run with the marked ones repaired."""

    @_fit_context(prefer_skip_nested_validation=True)
    def fit(self, X: Any, y: Any = None, groups: Any = None) -> BaseCleaner:
        """Learn what is usual.

        Parameters
        ----------
        X : array-like (n_samples, n_columns)
            May hold nan.
        y : ignored
        groups : array-like (n_samples,), optional
            Run of each row; wins over ``run``.

        Returns
        -------
        self
        """
        runs = self._resolve(X, groups, reset=True)
        self._learn(runs)
        self._names = list(runs.input_names or [f"x{j}" for j in range(runs[0].X.shape[1])])
        return self

    def transform(self, X: Any, groups: Any = None) -> np.ndarray:
        """Repaired columns; as many rows as X.

        Parameters
        ----------
        X : array-like (n_samples, n_columns)
        groups : array-like (n_samples,), optional

        Returns
        -------
        ndarray (n_samples, n_columns)
            With ``add_indicator`` followed by one column of 0 and 1 for each, with ``keep_run`` by the run.
        """
        check_is_fitted(self, "_names")
        runs = self._resolve(X, groups, reset=False)
        masks = [self._mask(run.X) for run in runs]
        out = runs.stack([self._repair(run.X, mask) for run, mask in zip(runs, masks)])
        extra = [runs.stack([mask.astype(float) for mask in masks])] if self.add_indicator else []
        if self._keeps:
            extra.append(kept_run(runs)[:, None])
        return np.hstack([out, *extra]) if extra else out

    def fit_transform(self, X: Any, y: Any = None, groups: Any = None) -> np.ndarray:
        """Fit, then transform the same data."""
        return self.fit(X, y, groups=groups).transform(X, groups=groups)

    def mask(self, X: Any, groups: Any = None) -> np.ndarray:
        """Which values are marked.

        Parameters
        ----------
        X : array-like (n_samples, n_columns)
        groups : array-like (n_samples,), optional

        Returns
        -------
        ndarray of bool (n_samples, n_columns)
        """
        check_is_fitted(self, "_names")
        runs = self._resolve(X, groups, reset=False)
        out = np.zeros((runs.n_samples, runs[0].X.shape[1]), dtype=bool)
        for run in runs:
            out[run.start : run.stop] = self._mask(run.X)
        return out

    def get_feature_names_out(self, input_features: Any = None) -> np.ndarray:
        """Names of the columns; indicators read ``missing(u)`` or ``outlier(u)``.

        Parameters
        ----------
        input_features : array-like of str, optional

        Returns
        -------
        ndarray of str (n_features_out,)
        """
        check_is_fitted(self, "_names")
        names = list(self._names)
        if input_features is not None or not hasattr(self, "feature_names_in_"):
            given = [str(name) for name in _check_feature_names_in(self, input_features)]
            names = given if len(given) == len(names) else names
        marks = [f"{self._marked}({name})" for name in names] if self.add_indicator else []
        return np.asarray([*names, *marks, *([str(self.run)] if self._keeps else [])], dtype=object)

    def __sklearn_tags__(self) -> Any:
        tags = super().__sklearn_tags__()
        tags.input_tags.allow_nan = True
        return tags

    @property
    def _keeps(self) -> bool:
        return bool(self.keep_run) and self.run is not None

    def _resolve(self, X: Any, groups: Any, reset: bool) -> Runs:
        """Checks that scikit-learn asks for, then runs."""
        if not is_checked_frame(self, X, reset):
            X = checked(self, X, reset=reset, ensure_all_finite="allow-nan", dtype="numeric")
        runs = resolve_runs(X, groups=groups, run=self.run, allow_nan=True)
        for run in runs:
            if np.isinf(run.X).any():
                row, column = (int(i) for i in np.argwhere(np.isinf(run.X))[0])
                raise DataError(
                    f"Input X contains infinity: row {run.start + row}, column {column}. "
                    "Only NaN stands for a missing value: write X[np.isinf(X)] = np.nan first if that is what it means."
                )
        return runs


class Interpolator(BaseCleaner):
    """Fill missing values (nan) from the same run, never from another one.

    Parameters
    ----------
    method : {"linear", "previous", "pchip"}, default="linear"
        Straight line between the neighbours, the last value held, or a cubic that does not overshoot.
    max_gap : int or None, default=None
        Longest gap, in rows, that is filled; longer ones stay nan.
    ends : {"nearest", "nan"}, default="nearest"
        Before the first and after the last known value of a run: that value, or nan.
    add_indicator : bool, default=False
        Whether to append a column of 0 and 1 for each column that says what was missing.
    run : None, column name, int or "index", default=None
        Where X says which run a row belongs to; ``groups`` wins.
    keep_run : bool, default=False
        Whether the run column is handed on as the last column.

    Attributes
    ----------
    missing_ : ndarray (n_columns,)
        Share of missing values seen in ``fit``.
    n_features_in_ : int
    feature_names_in_ : ndarray of str
        Where X is a frame.

    Notes
    -----
    A column without a single value in a run stays nan there; rows that belong to no run (label -1) become nan.

    References
    ----------
    Lie, *Surrogate and Hybrid Models for Control*, SIMS 60 (2019), section 2.4.

    Examples
    --------
    >>> import numpy as np
    >>> from sksurrogate.features import Interpolator
    >>> Interpolator().fit_transform([[1.0], [np.nan], [3.0], [np.nan], [8.0]], groups=[0, 0, 0, 1, 1]).ravel()
    array([1., 2., 3., 8., 8.])
    """

    _marked = "missing"
    _parameter_constraints: dict = {
        "method": [StrOptions({"linear", "previous", "pchip"})],
        "max_gap": [None, Interval(Integral, 1, None, closed="left")],
        "ends": [StrOptions({"nearest", "nan"})],
        "add_indicator": ["boolean"],
        "run": [None, str, Integral],
        "keep_run": ["boolean"],
    }

    def __init__(
        self,
        method: str = "linear",
        *,
        max_gap: int | None = None,
        ends: str = "nearest",
        add_indicator: bool = False,
        run: Any = None,
        keep_run: bool = False,
    ):
        self.method = method
        self.max_gap = max_gap
        self.ends = ends
        self.add_indicator = add_indicator
        self.run = run
        self.keep_run = keep_run

    def _learn(self, runs: Runs) -> None:
        self.missing_ = np.isnan(np.concatenate([run.X for run in runs])).mean(axis=0)

    def _mask(self, values: np.ndarray) -> np.ndarray:
        return np.isnan(values)

    def _repair(self, values: np.ndarray, mask: np.ndarray) -> np.ndarray:
        return np.column_stack([fill_gaps(x, self.method, self.max_gap, self.ends) for x in values.T])
