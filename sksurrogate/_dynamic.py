"""What all models of runs share: checks of the data, the start of a run, divergence, the score of the free run."""

from __future__ import annotations

import warnings
from abc import ABC, abstractmethod
from collections.abc import Sequence
from numbers import Integral
from typing import Any

import numpy as np
from sklearn.base import RegressorMixin
from sklearn.metrics import r2_score
from sklearn.preprocessing import StandardScaler
from sklearn.utils.validation import check_is_fitted

from sksurrogate._checks import checked, is_checked_frame
from sksurrogate._domain import DOUBTFUL, Domain
from sksurrogate.exceptions import DataError, SimulationDiverged
from sksurrogate.runs import Run, Runs, resolve_runs

#: A free run that scores better has not met the end of a run.
GOOD_SCORE = 0.95
#: A jump is larger than this many deviations of the output and this many median errors of the one-step prediction, which misses
#: at least this share of it; more jumps than this share of the rows are the signal itself.
LEAST_JUMP, MANY_ERRORS, MISSED_SHARE, MOST_JUMPS = 0.3, 30.0, 0.5, 0.05
#: A free run further than this many spreads from the training mean has diverged.
DIVERGED_RUN = 1e6


def lengthened(values: np.ndarray, n: int) -> np.ndarray:
    """n rows, the last repeated where there are fewer."""
    return values[np.minimum(np.arange(n), len(values) - 1)]


def unfollowed_jumps(y: np.ndarray, one_step: np.ndarray) -> np.ndarray:
    """Rows where an output jumps and its one-step prediction does not: a new run begins there.

    ``y, one_step`` (n_samples, n_outputs): one-step predictions are nan where there is no history.

    >>> t = np.arange(200)
    >>> y = np.where(t < 100, np.sin(0.1 * t), 3 + np.sin(0.1 * t))[:, None]
    >>> unfollowed_jumps(y, np.vstack([[[np.nan]], y[:-1] + 0.01]))
    array([100])
    """
    error = np.abs(y - one_step)[1:]
    jump = np.abs(np.diff(y, axis=0))
    with np.errstate(invalid="ignore"):
        typical = np.nanmedian(error, axis=0) if np.isfinite(error).any() else np.full(y.shape[1], np.inf)
        large = (jump > LEAST_JUMP * y.std(axis=0)) & (error > MANY_ERRORS * typical) & (error > MISSED_SHARE * jump)
    rows = 1 + np.flatnonzero(large.any(axis=1))
    return rows if len(rows) <= MOST_JUMPS * len(y) else rows[:0]


class FreeRunMixin(RegressorMixin, ABC):
    """What regressors whose ``predict(X, y0, groups)`` is a free run have in common.

    The regressor has ``run`` and :meth:`_ahead`, and after ``fit`` ``n_initial_``, ``y_is_1d_``, ``y_mean_``, ``y_spread_``, ``data_range_``
    (2, n_inputs + n_outputs), lows and highs of the training data, and ``left_region_`` (labels of the training runs whose free run leaves it).
    """

    __metadata_request__fit = {"groups": True}
    __metadata_request__predict = {"groups": True, "y0": True}
    __metadata_request__score = {"groups": True}
    _integrates = False  # whether uneven sampling is fine
    run: Any
    init: Any
    n_initial_: int
    y_is_1d_: bool
    y_mean_: np.ndarray
    y_spread_: np.ndarray
    data_range_: np.ndarray
    left_region_: list[Any]

    def __sklearn_tags__(self) -> Any:
        tags = super().__sklearn_tags__()
        tags.target_tags.multi_output = True
        tags.regressor_tags.poor_score = True  # a free run of unordered rows has nothing to follow
        return tags

    def score(self, X: Any, y: Any, sample_weight: Any = None, groups: Any = None) -> float:
        """R2 of the free run from the first rows of every run, those rows left out.

        Parameters
        ----------
        X : array-like (n_samples, n_inputs)
        y : array-like (n_samples,) or (n_samples, n_outputs)
        sample_weight : array-like (n_samples,), optional
        groups : array-like (n_samples,), optional

        Returns
        -------
        float
        """
        check_is_fitted(self, "n_initial_")
        n = self.n_initial_
        runs = self._resolve(X, y, groups, min_rows=n + 1)
        first = np.stack([run.y[:n] for run in runs])
        predicted = self.predict(X, y0=first, groups=groups).reshape(runs.n_samples, -1)  # type: ignore[attr-defined]
        truth = runs.stack([run.y for run in runs])
        keep = np.zeros(runs.n_samples, bool)
        for run in runs:
            keep[run.start + n : run.stop] = True
        weight = None if sample_weight is None else np.asarray(sample_weight)[keep]
        found = float(r2_score(truth[keep], predicted[keep], sample_weight=weight))
        if groups is None and self.run is None and len(runs) == 1 and found < GOOD_SCORE:
            self._warn_of_runs(X, y, truth)
        return found

    def _warn_of_runs(self, X: Any, y: Any, truth: np.ndarray) -> None:
        """Say so where one record looks like several runs: outputs jump, and the model's own next step does not."""
        one_step = np.asarray(self.predict_one_step(X, y), dtype=float).reshape(truth.shape)
        rows = unfollowed_jumps(truth, one_step)
        if len(rows):
            listed = ", ".join(map(str, rows[:5])) + (" and more" if len(rows) > 5 else "")
            warnings.warn(
                f"y jumps at row {listed}, and the one-step prediction does not follow: X and y seem to hold "
                f"{len(rows) + 1} runs. Pass groups= (or the constructor's run=); the score without it is that of one long run.",
                UserWarning,
                stacklevel=3,
            )

    def predict_one_step(self, X: Any, y: Any, groups: Any = None) -> np.ndarray:
        """Row t from measured outputs up to t-1: ``predict_ahead`` with ``k=1``; rows without that history are nan.

        Parameters
        ----------
        X : array-like (n_samples, n_inputs)
        y : array-like (n_samples,) or (n_samples, n_outputs)
        groups : array-like (n_samples,), optional

        Returns
        -------
        ndarray, shape of y
        """
        return self.predict_ahead(X, y, 1, groups=groups)

    def predict_ahead(self, X: Any, y: Any, k: int, groups: Any = None) -> np.ndarray:
        """Row t from the ``n_initial_`` measured outputs up to t-k and inputs up to t; rows without that history are nan.

        Parameters
        ----------
        X : array-like (n_samples, n_inputs)
        y : array-like (n_samples,) or (n_samples, n_outputs)
        k : int
            Steps ahead.
        groups : array-like (n_samples,), optional

        Returns
        -------
        ndarray, shape of y

        Raises
        ------
        SimulationDiverged
            The prediction became infinite or nan or went far beyond the training outputs.
        """
        check_is_fitted(self, "n_initial_")
        if not isinstance(k, Integral) or k < 1:
            raise ValueError(f"k={k!r} must be an int, at least 1 step ahead.")
        runs, history = self._resolve(X, y, groups), self.n_initial_ + int(k)
        parts = [np.full(run.y.shape, np.nan) for run in runs]
        for r, part in enumerate(parts):
            if len(part) >= history:
                part[history - 1 :] = self._ahead(runs, r, history)
        return self._shaped(runs, parts)

    @abstractmethod
    def _ahead(self, runs: Runs, r: int, history: int) -> np.ndarray:
        """Last rows of the free runs of ``history`` samples that begin at every row of run r, (n_windows, n_outputs)."""

    def validity(self, X: Any, y0: Any = None, groups: Any = None) -> np.ndarray:
        """How far the free run is to be trusted: 1 while inputs and outputs stay within the training data's ranges.

        Parameters
        ----------
        X : array-like (n_samples, n_inputs)
        y0, groups
            As for ``predict``.

        Returns
        -------
        ndarray (n_samples,)
            Down to 0 from where a run leaves the ranges, by half of a range or so; it stays there, for a free run remembers.
        """
        check_is_fitted(self, "data_range_")
        predicted = np.asarray(self.predict(X, y0=y0, groups=groups))  # type: ignore[attr-defined]
        runs = self._resolve(X, None, groups)
        found = runs.unstack(predicted.reshape(runs.n_samples, -1))
        region = Domain(self.data_range_[0], self.data_range_[1], np.inf)
        return runs.stack([1.0 - region.doubt(np.hstack([run.X, y])) for run, y in zip(runs, found)])

    def _watch_training_runs(self, runs: Sequence[Run], free: Sequence[np.ndarray], remedy: str) -> None:
        """Set ``left_region_``; warn where free runs of training data leave the range of the outputs, and say the way out."""
        low, high = self.data_range_[:, -len(self.y_mean_) :]
        outputs = Domain(low, high, np.inf)
        with np.errstate(all="ignore"):
            far = [~(outputs.distance(np.asarray(part)) <= DOUBTFUL) for part in free]
        left = [(run, int(np.argmax(rows))) for run, rows in zip(runs, far) if rows.any()]
        self.left_region_ = [run.label for run, _ in left]
        if left:
            run, row = left[0]
            name = "the training run" if run.label is None else f"run {run.label!r}"
            warnings.warn(
                f"the free runs of {len(left)} of {len(free)} training runs leave the range of the training outputs by more than "
                f"half of it (first: {name}, row {row}); predictions will as well. {remedy}",
                UserWarning,
                stacklevel=4,
            )

    def _resolve(self, X: Any, y: Any, groups: Any, *, reset: bool = False, min_rows: int = 1) -> Runs:
        """Checks that scikit-learn asks for, then runs."""
        if y is None and reset:
            raise ValueError(f"{type(self).__name__} requires y to be passed, but the target y is None.")
        if isinstance(X, (list, tuple)) and len(X) and np.ndim(X[0]) == 2:
            raise DataError(
                f"X is a list of {len(X)} runs: stack them, X, y, groups = stack_runs(X, y), and hand over groups."
            )
        plain = y is None and type(X) is np.ndarray and X.dtype == float
        if (plain and X.shape[1:] == (getattr(self, "_width", 0),)) or is_checked_frame(self, X, reset):
            pass  # all that scikit-learn would look at; resolve_runs looks at the values
        elif y is None or groups is not None:
            X = checked(self, X, reset=reset, ensure_all_finite=groups is None, dtype="numeric")
        else:
            X, y = checked(self, X, y, reset=reset, multi_output=True, y_numeric=True)
        runs = resolve_runs(
            X, y, groups=groups, run=self.run, time=getattr(self, "time", None), dt=getattr(self, "dt", None),
            allow_uneven=self._integrates, min_rows=min_rows,
        )  # fmt: skip
        known = getattr(self, "y_mean_", None)
        if not reset and y is not None and known is not None and runs[0].y.shape[1] != len(known):
            raise DataError(f"y has {runs[0].y.shape[1]} columns; the model was fitted to {len(known)} outputs.")
        if reset:
            self._width = 0 if hasattr(self, "feature_names_in_") else self.n_features_in_
            outputs = runs[0].y if len(runs) == 1 else np.concatenate([run.y for run in runs])
            self.y_is_1d_ = runs.y_is_1d
            scaling = StandardScaler().fit(outputs)
            self.y_mean_, self.y_spread_ = scaling.mean_, scaling.scale_
            ends = [np.stack([end(np.hstack([run.X, run.y]), axis=0) for run in runs]) for end in (np.min, np.max)]
            self.data_range_ = np.stack([ends[0].min(axis=0), ends[1].max(axis=0)])
        return runs

    def _start_rows(self, y0: Any, runs: Runs) -> np.ndarray:
        """First rows of every run: ``y0`` or else ``init``, where this is "mean" the mean of the training outputs."""
        if y0 is not None or not isinstance(self.init, str):
            return self._first_rows(self.init, runs, "init") if y0 is None else self._first_rows(y0, runs)
        n, o = self.n_initial_, len(self.y_mean_)
        if self.init != "mean":
            raise ValueError(f'init={self.init!r} must be "mean" or an array ({n}, {o}).')
        return np.broadcast_to(self.y_mean_, (len(runs), n, o))

    def _first_rows(self, y0: Any, runs: Runs, name: str = "y0") -> np.ndarray:
        """Outputs at the first rows of every run, (n_runs, n_initial, n_outputs)."""
        n, o = self.n_initial_, len(self.y_mean_)
        if isinstance(y0, str):
            raise DataError(
                f"{name}={y0!r}: expected the outputs at the first rows, an array ({n}, {o}); a word is for the constructor, init={y0!r}."
            )
        given = np.asarray(y0, dtype=float)
        if o == 1 and given.shape in ((n,), (len(runs), n)):
            given = given[..., None]
        if given.ndim == 2:
            given = np.repeat(given[None], len(runs), axis=0)
        if given.shape != (len(runs), n, o):
            raise DataError(
                f"{name} has shape {np.shape(y0)}, expected ({n}, {o}) or ({len(runs)}, {n}, {o}): the outputs at the "
                f"first {n} rows of each run."
            )
        if not np.isfinite(given).all():
            run, row, column = np.argwhere(~np.isfinite(given))[0]
            raise DataError(
                f"{name} is not finite at row {row}, output {column} of run {run}: a free run needs all {n} first rows. "
                "Interpolate them first (sksurrogate.features.Interpolator), or start the run later."
            )
        return given

    def _refuse_far(self, runs: Runs, parts: Sequence[np.ndarray], remedy: str) -> None:
        """A free run that left the training outputs far behind is an error."""
        bad = []
        for run, part in zip(runs, parts):
            with np.errstate(invalid="ignore"):
                near = np.abs(part - self.y_mean_) <= DIVERGED_RUN * (self.y_spread_ + np.abs(self.y_mean_))
            rows = np.flatnonzero(~near.all(axis=1))
            if len(rows):
                bad.append((run, int(rows[0])))
        if bad:
            run, row = bad[0]
            name = 0 if run.label is None else run.label
            raise SimulationDiverged(
                f"the free run diverged: run {name!r}, step {row}; {len(bad)} of {len(runs)} runs in all. {remedy}",
                run=run.label,
                row=row,
                time=float(run.t[row]),
            )

    def _shaped(self, runs: Runs, parts: Sequence[np.ndarray]) -> np.ndarray:
        stacked = runs.stack(parts)
        return stacked[:, 0] if self.y_is_1d_ else stacked
