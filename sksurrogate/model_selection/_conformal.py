"""Intervals of free runs, calibrated over runs that the model has not seen."""

from __future__ import annotations

from numbers import Real
from typing import Any

import numpy as np
from sklearn.base import BaseEstimator, MetaEstimatorMixin, _fit_context, clone
from sklearn.utils import check_random_state
from sklearn.utils._param_validation import HasMethods, Interval, StrOptions
from sklearn.utils.validation import check_is_fitted

from sksurrogate.exceptions import RunError
from sksurrogate.runs import Runs, resolve_runs


class ConformalFreeRun(MetaEstimatorMixin, BaseEstimator):
    """Free run with an interval that holds for a new run, by conformal calibration over runs.

    Runs are exchangeable, rows of a run are not. So the model is fitted on some runs, and the errors of its free run on the other
    runs, one number for each run, give the width of the interval.

    Parameters
    ----------
    estimator : regressor with ``fit(X, y, groups)``, ``predict(X, y0, groups)`` and ``n_initial_``
        Wrapped in ``FrozenEstimator`` it stays as it is and all runs calibrate.
    coverage : float, default=0.9
    kind : {"run", "row"}, default="run"
        "run": a new run lies in the interval as a whole with that probability. "row": each row does, taken alone.
    calibration : float, default=0.5
        Share of the runs that calibrate.
    random_state : int, RandomState or None

    Attributes
    ----------
    estimator_ : fitted estimator
    width_ : ndarray (n_steps, n_outputs)
        Half width by the number of steps since the start of the run.
    calibration_runs_ : list
        Labels of the runs that calibrated.

    Notes
    -----
    With n calibration runs the probability is at least ``coverage`` and at most ``coverage + 1 / (n + 1)``, if new
    runs come from where these came from and are no longer. Steps beyond the longest calibration run have no bound:
    their width is inf.

    References
    ----------
    Lei, G'Sell, Rinaldo, Tibshirani, Wasserman, *Distribution-free predictive inference for regression*, JASA 113 (2018).

    Examples
    --------
    >>> from sklearn.linear_model import LinearRegression
    >>> from sksurrogate.compose import RecursivePredictor
    >>> from sksurrogate.datasets import make_reactor_runs
    >>> from sksurrogate.model_selection import ConformalFreeRun
    >>> X, y, groups = make_reactor_runs(30, 60, u_range=(0.1, 0.15), noise=0.1, random_state=0)
    >>> model = ConformalFreeRun(RecursivePredictor(LinearRegression(), 2, 2), random_state=0).fit(X, y, groups=groups)
    >>> low, high = model.predict_interval(X[:60], y0=y[:2])
    >>> low.shape
    (60,)
    """

    __metadata_request__fit = {"groups": True}
    __metadata_request__predict = {"groups": True, "y0": True}

    _parameter_constraints: dict = {
        "estimator": [HasMethods(["fit", "predict"])],
        "coverage": [Interval(Real, 0, 1, closed="neither")],
        "kind": [StrOptions({"run", "row"})],
        "calibration": [Interval(Real, 0, 1, closed="neither")],
        "random_state": ["random_state"],
    }

    def __init__(
        self,
        estimator: Any,
        *,
        coverage: float = 0.9,
        kind: str = "run",
        calibration: float = 0.5,
        random_state: Any = None,
    ):
        self.estimator = estimator
        self.coverage = coverage
        self.kind = kind
        self.calibration = calibration
        self.random_state = random_state

    @_fit_context(prefer_skip_nested_validation=False)
    def fit(self, X: Any, y: Any, groups: Any = None) -> ConformalFreeRun:
        """Fit on some runs, calibrate on the others.

        Parameters
        ----------
        X : array-like (n_samples, n_inputs)
        y : array-like (n_samples,) or (n_samples, n_outputs)
        groups : array-like (n_samples,), optional

        Returns
        -------
        self

        Raises
        ------
        RunError
            Too few runs: n calibration runs can promise no more than ``n / (n + 1)``.
        """
        run = getattr(self.estimator, "run", None)
        runs = resolve_runs(X, y, groups=groups, run=run)
        frozen = type(self.estimator).__name__ == "FrozenEstimator"
        count = len(runs) if frozen else int(np.floor(self.calibration * len(runs)))
        rank = int(np.ceil((count + 1) * self.coverage - 1e-9))
        if rank > count or (count == len(runs) and not frozen):
            least = int(np.ceil(self.coverage / (1 - self.coverage) - 1e-9))
            raise RunError(
                f"{len(runs)} runs of which {count} calibrate: coverage={self.coverage} needs {least} calibration runs; "
                "give more runs, cut long ones with cut_runs, raise calibration or lower coverage."
            )
        order = check_random_state(self.random_state).permutation(len(runs))
        chosen = {int(r) for r in order[:count]}
        rows = [np.arange(one.start, one.stop) for one in runs]
        labels = np.full(runs.n_samples, -1)
        for r, part in enumerate(rows):
            labels[part] = r
        self.y_is_1d_ = runs.y_is_1d
        self.estimator_ = clone(self.estimator)
        learn = np.sort(np.concatenate([rows[r] for r in range(len(runs)) if r not in chosen] or [np.empty(0, int)]))
        if not frozen:
            self.estimator_.fit(_take(X, learn), _take(y, learn), groups=labels[learn])
        test = np.sort(np.concatenate([rows[r] for r in sorted(chosen)]))
        errors = self._errors(_take(X, test), _take(y, test), labels[test])
        # the scale by step comes from runs that do not calibrate, so that those stay exchangeable with new ones
        if frozen:
            scale = np.ones((max(map(len, errors)), len(runs[0].y[0]))) * np.concatenate([one.y for one in runs]).std(
                axis=0
            )
        else:
            scale = _scale(self._errors(_take(X, learn), _take(y, learn), labels[learn]), errors)
        self.width_ = _widths(errors, scale, rank, self.coverage, self.kind)
        self.calibration_runs_ = [runs[r].label for r in sorted(chosen)]
        return self

    def predict(self, X: Any, y0: Any = None, groups: Any = None) -> np.ndarray:
        """Free run of the fitted model.

        Parameters
        ----------
        X : array-like (n_samples, n_inputs)
        y0 : array-like (n_initial, n_outputs) or (n_runs, n_initial, n_outputs), optional
        groups : array-like (n_samples,), optional

        Returns
        -------
        ndarray, shape of y
        """
        check_is_fitted(self, "width_")
        return self.estimator_.predict(X, y0=y0, groups=groups)

    def predict_interval(self, X: Any, y0: Any, groups: Any = None) -> tuple[np.ndarray, np.ndarray]:
        """Low and high end of the interval; it has no width at the first rows, which are given.

        Parameters
        ----------
        X : array-like (n_samples, n_inputs)
        y0 : array-like (n_initial, n_outputs) or (n_runs, n_initial, n_outputs)
            The calibration started from measured first rows, so the interval does too.
        groups : array-like (n_samples,), optional

        Returns
        -------
        low, high : ndarray, shape of y
        """
        found = np.asarray(self.predict(X, y0=y0, groups=groups))
        runs = resolve_runs(X, groups=groups, run=getattr(self.estimator_, "run", None))
        width: np.ndarray = np.full((runs.n_samples, self.width_.shape[1]), np.nan)
        for run in runs:
            n = min(len(run), len(self.width_))
            width[run.start : run.start + n] = self.width_[:n]
            width[run.start + n : run.stop] = np.inf
        half = width.reshape(found.shape)
        return found - half, found + half

    def _errors(self, X: Any, y: Any, labels: np.ndarray) -> list[np.ndarray]:
        """Free-run errors of every run, nan at the first rows."""
        n = self.estimator_.n_initial_
        runs: Runs = resolve_runs(X, y, groups=labels, run=getattr(self.estimator_, "run", None), min_rows=n + 1)
        first = np.stack([one.y[:n] for one in runs])
        free = np.asarray(self.estimator_.predict(X, y0=first, groups=labels)).reshape(runs.n_samples, -1)
        out = []
        for one in runs:
            error = np.abs(one.y - free[one.start : one.stop])
            error[:n] = np.nan
            out.append(error)
        return out


def _take(values: Any, rows: np.ndarray) -> Any:
    return values.iloc[rows] if hasattr(values, "iloc") else np.asarray(values)[rows]


def _scale(errors: list[np.ndarray], calibrating: list[np.ndarray]) -> np.ndarray:
    """Root mean square error by step, smoothed over a tenth of the run (in short ones over a step and its neighbours).

    It is as long as the longest calibration run.
    """
    n = max(len(error) for error in calibrating)
    total, count = np.zeros((n, errors[0].shape[1])), np.zeros(n)
    for error in errors:
        known = np.isfinite(error[:n])
        total[: len(known)] += np.where(known, error[:n], 0.0) ** 2
        count[: len(known)] += known[:, 0]
    window = np.ones(max(3, n // 10))
    smooth = np.stack([np.convolve(column, window, mode="same") for column in total.T], axis=1)
    counts = np.convolve(count, window, mode="same")[:, None]
    overall = np.sqrt(total.sum(axis=0) / max(count.sum(), 1.0))
    scale = np.where(counts > 0, np.sqrt(smooth / np.maximum(counts, 1e-12)), overall)
    return np.where(overall > 0.0, np.maximum(scale, 0.1 * overall), 1.0)


def _widths(errors: list[np.ndarray], scale: np.ndarray, rank: int, coverage: float, kind: str) -> np.ndarray:
    """Half width by step and output; 0 at the first rows."""
    first = min(int(np.isnan(error[:, 0]).sum()) for error in errors)
    if kind == "run":
        scores = np.sort([np.nanmax(error / scale[: len(error)]) for error in errors])
        width = scores[rank - 1] * scale
    else:
        width = np.full(scale.shape, np.inf)
        for t in range(first, len(scale)):
            for j in range(scale.shape[1]):
                there = np.sort([error[t, j] for error in errors if len(error) > t])
                at = int(np.ceil((len(there) + 1) * coverage - 1e-9))
                if at <= len(there):
                    width[t, j] = there[at - 1]
    width[:first] = 0.0
    return width
