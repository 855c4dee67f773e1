"""Lagged columns that never cross a run."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from numbers import Real
from typing import Any

import numpy as np
from sklearn.base import BaseEstimator, TransformerMixin
from sklearn.utils._openmp_helpers import _openmp_effective_n_threads
from sklearn.utils.validation import _check_feature_names_in, check_is_fitted

from sksurrogate._checks import checked, is_checked_frame
from sksurrogate._lags import lag_terms
from sksurrogate.exceptions import DataError
from sksurrogate.features._kept_run import kept_run
from sksurrogate.runs import Runs, resolve_runs

#: Rows that are written at a time, and numbers of a lag matrix from which threads share the work.
_LAG_ROWS, _SHARED_NUMBERS = 65_536, 4_000_000


def lag_columns(values: np.ndarray, columns: Sequence[tuple[int, int]]) -> np.ndarray:
    """Lagged columns of one run: ``out[t, i] = values[t - lag_i, column_i]``; before the first row its value.

    ``values`` (n_samples, n_columns).
    """
    out = np.empty((len(values), len(columns)), order="F")
    _shift(values, columns, np.zeros(1, int), values[:1], out)
    return out


def _edges(first_rows: np.ndarray, fill: str | float) -> np.ndarray:
    """What stands before each run, (n_runs, n_columns)."""
    if fill == "edge":
        return first_rows
    return np.full(first_rows.shape, np.nan if fill == "nan" else fill, dtype=float)


class _Rows:
    """Rows at which runs start; a slice where the runs are of one length."""

    def __init__(self, at: np.ndarray):
        self.at, self.first = at, int(at[0]) if len(at) else 0
        self.step = int(at[1] - at[0]) if len(at) > 1 and np.all(np.diff(at) == at[1] - at[0]) else 0

    def rest(self) -> _Rows:
        """All but the first one."""
        return _Rows(self.at[1:])

    def before(self, k: int) -> slice | np.ndarray:
        """The rows k earlier."""
        return slice(self.first - k, int(self.at[-1]) - k + 1, self.step) if self.step else self.at - k


def _shift(
    values: np.ndarray, columns: Sequence[tuple[int, int]], starts: np.ndarray, edges: np.ndarray, out: np.ndarray
) -> None:
    """``out[t, i] = values[t - lag_i, column_i]``, or the edge of t's run before its start.

    In blocks of rows that stay in the cache, each written once, in as many threads as OpenMP has. From lag to lag a block
    moves on by one row, and only the rows at which runs start are new: they take the edge.
    """
    n = len(values)
    wanted: dict[int, list[tuple[int, int]]] = {}
    for place, (column, lag) in enumerate(columns):
        wanted.setdefault(column, []).append((lag, place))

    def block(task: tuple[int, int]) -> None:
        column, first = task
        pairs = sorted(wanted[column])
        longest, last = pairs[-1][0], min(first + _LAG_ROWS, n)
        begin = max(first - longest, 0)
        near = np.empty(longest + last - first)  # row t is at t - first + longest - lag
        near[longest - first + begin :] = values[begin:last, column]
        inside = slice(*np.searchsorted(starts, [begin, last]))
        fresh, edge, k = _Rows(starts[inside] - first + longest), edges[inside, column].copy(), 0
        for lag, place in pairs:
            while k < lag and len(edge):
                k += 1
                if fresh.first < k:
                    fresh, edge = fresh.rest(), edge[1:]
                near[fresh.before(k)] = edge
            out[first:last, place] = near[longest - lag : longest - lag + last - first]

    tasks = [(column, first) for column in wanted for first in range(0, n, _LAG_ROWS)]
    threads = _openmp_effective_n_threads() if out.size > _SHARED_NUMBERS else 1
    if threads == 1:
        for task in tasks:
            block(task)
        return
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(block, tasks))


def _whole(runs: Runs) -> np.ndarray:
    """X of all runs; no copy where they are the rows of one array."""
    n, m = runs.n_samples, runs[0].X.shape[1]
    base = runs[0].X.base
    if len(runs) == 1 and len(runs[0]) == n:
        return runs[0].X
    if isinstance(base, np.ndarray) and base.shape == (n, m) and all(run.X.base is base for run in runs):
        return base  # resolve_runs cuts the runs out of one array, at their rows
    out = np.full((n, m), np.nan)
    for run in runs:
        out[run.start : run.stop] = run.X
    return out


def _write_lags(runs: Runs, columns: Sequence[tuple[int, int]], fill: str | float, out: np.ndarray) -> None:
    """Lagged columns of all runs, each number written once; rows that belong to no run are nan."""
    ordered = sorted(runs, key=lambda run: run.start)
    starts = np.array([run.start for run in ordered])
    whole = _whole(runs)
    _shift(whole, columns, starts, _edges(whole[starts], fill), out)
    if sum(map(len, runs)) < runs.n_samples:
        outside = np.ones(runs.n_samples, bool)
        for run in runs:
            outside[run.start : run.stop] = False
        out[outside, : len(columns)] = np.nan


class LagEmbedding(TransformerMixin, BaseEstimator):
    """Columns of X and their past, within each run.

    Parameters
    ----------
    lags : int, list of int, or dict of column -> int or list, default=1
        An int n means 0, 1, ..., n. A dict (by name for frames, else by position) leaves out columns it does not name.
    run : None, column name, int or "index"
        Where X says which run a row belongs to; ``groups`` wins.
    fill : "edge", "nan" or float, default="edge"
        Value where a run has no past yet.
    keep_run : bool, default=False
        Whether the run column is handed on as the last column (its values must be numbers).

    Attributes
    ----------
    columns_ : list of (int, int)
        Column of X (run column left out) and lag of every feature.
    max_lag_ : int
    n_features_in_ : int

    References
    ----------
    Lie, *Surrogate and Hybrid Models for Control*, SIMS 60 (2019), section 2.6, Eq. (7).

    Examples
    --------
    >>> from sksurrogate.features import LagEmbedding
    >>> LagEmbedding(lags=[0, 1]).fit_transform([[1.0], [2.0], [5.0]], groups=[0, 0, 1])
    array([[1., 1.],
           [2., 1.],
           [5., 5.]])
    """

    __metadata_request__fit = {"groups": True}
    __metadata_request__transform = {"groups": True}

    def __init__(self, lags: Any = 1, *, run: Any = None, fill: str | float = "edge", keep_run: bool = False):
        self.lags = lags
        self.run = run
        self.fill = fill
        self.keep_run = keep_run

    def fit(self, X: Any, y: Any = None, groups: Any = None) -> LagEmbedding:
        """Learn the columns and their lags.

        Parameters
        ----------
        X : array-like (n_samples, n_columns)
        y : ignored
        groups : array-like (n_samples,), optional

        Returns
        -------
        self
        """
        number = isinstance(self.fill, Real) and not isinstance(self.fill, bool)
        if not number and not (isinstance(self.fill, str) and self.fill in ("edge", "nan")):
            raise DataError(f'fill={self.fill!r} must be "edge", "nan" or a number.')
        runs = self._resolve(X, groups, reset=True)
        names = runs.input_names or tuple(f"x{j}" for j in range(runs[0].X.shape[1]))
        self.columns_ = lag_terms(self.lags, names)
        if not self.columns_:
            raise DataError(f"lags={self.lags!r} asks for no column at all: name at least one lag.")
        self.max_lag_ = max(k for _, k in self.columns_)
        self._names = names
        return self

    def transform(self, X: Any, groups: Any = None) -> np.ndarray:
        """Lagged columns; as many rows as X.

        Parameters
        ----------
        X : array-like (n_samples, n_columns)
        groups : array-like (n_samples,), optional

        Returns
        -------
        ndarray (n_samples, n_features_out)
        """
        check_is_fitted(self, "columns_")
        runs = self._resolve(X, groups, reset=False)
        out = np.empty((runs.n_samples, len(self.columns_) + self._keeps), order="F")
        _write_lags(runs, self.columns_, self.fill, out)
        if self._keeps:
            out[:, -1] = kept_run(runs)
        return out

    def fit_transform(self, X: Any, y: Any = None, groups: Any = None) -> np.ndarray:
        """Fit, then transform the same data."""
        return self.fit(X, y, groups=groups).transform(X, groups=groups)

    def complete(self, X: Any, groups: Any = None) -> np.ndarray:
        """Mask of the rows whose whole past was measured, bool (n_samples,)."""
        check_is_fitted(self, "columns_")
        runs = self._resolve(X, groups, reset=False)
        out = np.zeros(runs.n_samples, bool)
        for run in runs:
            out[run.start + self.max_lag_ : run.stop] = True
        return out

    def get_feature_names_out(self, input_features: Any = None) -> np.ndarray:
        """Names such as ``u_lag2``."""
        check_is_fitted(self, "columns_")
        names = list(self._names)
        if input_features is not None or not hasattr(self, "feature_names_in_"):
            given = [str(name) for name in _check_feature_names_in(self, input_features)]
            names = given if len(given) == len(names) else names
        out = [f"{names[j]}_lag{k}" for j, k in self.columns_]
        return np.asarray([*out, str(self.run)] if self._keeps else out, dtype=object)

    @property
    def _keeps(self) -> bool:
        return bool(self.keep_run) and self.run is not None

    def _resolve(self, X: Any, groups: Any, reset: bool) -> Any:
        """Checks that scikit-learn asks for, then runs."""
        if not is_checked_frame(self, X, reset):
            X = checked(self, X, reset=reset, ensure_all_finite=False, dtype="numeric")
        return resolve_runs(X, groups=groups, run=self.run)
