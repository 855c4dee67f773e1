"""Lag models of runs: one-step or free-run fit, free-run prediction."""

from __future__ import annotations

from typing import Any

import numpy as np
from sklearn.base import BaseEstimator, RegressorMixin, clone
from sklearn.metrics import r2_score
from sklearn.utils.validation import _check_feature_names, _check_n_features, check_is_fitted, validate_data

from sksurrogate.compose._network import describe_network, write_network
from sksurrogate.exceptions import DataError, SimulationDiverged
from sksurrogate.features._lag import lag_columns, lag_list
from sksurrogate.kernels.rollout import fit_free_run, free_run, march
from sksurrogate.runs import Run, Runs, resolve_runs

__all__ = ["RecursivePredictor"]

#: A free run further than this many spreads from the training mean has diverged.
FAR = 1e6


class RecursivePredictor(RegressorMixin, BaseEstimator):
    """``y[t] = f(y[t-1], ..., y[t-ny], u[t], ..., u[t-nu])`` around any regressor f.

    Parameters
    ----------
    estimator : regressor
        Learns f; features are past outputs (lag by lag), then inputs (column by column).
    input_lags : int or list of int, default=1
        An int n means 0, 1, ..., n; ``[1]`` keeps the current input out.
    output_lags : int or list of int, default=1
        An int n means 1, ..., n.
    loss : {"one_step", "shooting"}, default="one_step"
        Prediction error, or the error of the free run (simulation error) by Levenberg-Marquardt with exact
        sensitivities, begun at the one-step fit. Shooting needs a network or linear model (see Notes).
    horizon : int, optional
        Steps of a free run in the shooting loss before it starts again from measured outputs; None: whole runs.
    init : {"mean", "steady"} or array (n_initial, n_outputs), default="mean"
        First rows where ``predict`` gets no ``y0``: mean of the training outputs, or the model's rest at the first input.
    run : None, column name, int or "index"
        Where X says which run a row belongs to; ``groups`` wins.

    Attributes
    ----------
    estimator_ : fitted regressor
    n_initial_ : int
        Rows of ``y0``: the longest lag.
    one_step_rmse_, free_run_rmse_ : float
        On the training runs; the second is inf where a training run diverges.
    n_features_in_ : int

    Notes
    -----
    ``MLPRegressor``, ``LinearRegression`` and ``Ridge``, also behind a ``StandardScaler``, are run as plain arrays: a few
    long runs by Newton over time, many runs abreast. Any other regressor is called once a step for all runs together.
    The penalty ``alpha`` of the estimator is kept in the shooting loss. A network's shooting fit can end in a poor minimum:
    compare ``free_run_rmse_`` over a few values of its ``random_state``.

    References
    ----------
    Lie, *Surrogate and Hybrid Models for Control*, SIMS 60 (2019), section 2.6, Eq. (7), and section 4.3.

    Examples
    --------
    >>> from sklearn.linear_model import LinearRegression
    >>> from sksurrogate.compose import RecursivePredictor
    >>> from sksurrogate.datasets import make_reactor_runs
    >>> X, y, groups = make_reactor_runs(4, 100, y0_range=(4.0, 6.0), u_range=(0.1, 0.15), random_state=0)
    >>> model = RecursivePredictor(LinearRegression(), input_lags=2, output_lags=2).fit(X, y, groups=groups)
    >>> model.predict(X, groups=groups).shape
    (400,)
    """

    __metadata_request__fit = {"groups": True}
    __metadata_request__predict = {"groups": True, "y0": True}
    __metadata_request__score = {"groups": True}

    def __init__(
        self,
        estimator: Any,
        input_lags: Any = 1,
        output_lags: Any = 1,
        *,
        loss: str = "one_step",
        horizon: int | None = None,
        init: Any = "mean",
        run: Any = None,
    ):
        self.estimator = estimator
        self.input_lags = input_lags
        self.output_lags = output_lags
        self.loss = loss
        self.horizon = horizon
        self.init = init
        self.run = run

    def __sklearn_tags__(self) -> Any:
        tags = super().__sklearn_tags__()
        tags.target_tags.multi_output = True
        tags.regressor_tags.poor_score = True  # a free run of unordered rows has nothing to follow
        return tags

    def fit(self, X: Any, y: Any, groups: Any = None) -> RecursivePredictor:
        """Fit f one step ahead, then, with ``loss="shooting"``, on the free run.

        Parameters
        ----------
        X : array-like (n_samples, n_inputs)
        y : array-like (n_samples,) or (n_samples, n_outputs)
        groups : array-like (n_samples,), optional

        Returns
        -------
        self
        """
        if self.loss not in ("one_step", "shooting"):
            raise ValueError(f'loss={self.loss!r} must be "one_step" or "shooting".')
        if self.horizon is not None and self.horizon < 1:
            raise ValueError(f"horizon={self.horizon!r} must be a positive number of steps, or None for whole runs.")
        self.output_lags_ = lag_list(self.output_lags, 1, "output_lags")
        self.input_lags_ = lag_list(self.input_lags, 0, "input_lags")
        if not self.output_lags_:
            raise ValueError(f"output_lags={self.output_lags!r}: at least one past output is needed to run freely.")
        self.n_initial_ = max([*self.output_lags_, *self.input_lags_])
        if y is None:
            raise ValueError("RecursivePredictor requires y to be passed, but the target y is None.")
        runs = self._resolve(X, y, groups, reset=True, min_rows=self.n_initial_ + 1)
        self.y_is_1d_ = runs.y_is_1d
        outputs = np.concatenate([run.y for run in runs])
        self.y_mean_, self.y_spread_ = outputs.mean(axis=0), outputs.std(axis=0) + 1e-12
        n = self.n_initial_
        Phi = np.concatenate([self._features(run)[n:] for run in runs])
        target = np.concatenate([run.y[n:] for run in runs])
        self.estimator_ = clone(self.estimator).fit(Phi, target if target.shape[1] > 1 else target[:, 0])
        if self.loss == "shooting":
            self._shoot(runs)
        error = self._step(Phi) - target
        self.one_step_rmse_ = float(np.sqrt(np.mean(error**2)))
        free, bad = self._run_free([run.X for run in runs], [run.y[:n] for run in runs])
        errors = np.concatenate([f[n:] - run.y[n:] for f, run in zip(free, runs)])
        self.free_run_rmse_ = float("inf") if bad else float(np.sqrt(np.mean(errors**2)))
        return self

    def predict(self, X: Any, y0: Any = None, groups: Any = None) -> np.ndarray:
        """Free run.

        Parameters
        ----------
        X : array-like (n_samples, n_inputs)
        y0 : array-like (n_initial, n_outputs) or (n_runs, n_initial, n_outputs), optional
            Outputs at the first rows of each run; without it ``init`` decides.
        groups : array-like (n_samples,), optional

        Returns
        -------
        ndarray (n_samples,) or (n_samples, n_outputs)

        Raises
        ------
        SimulationDiverged
            The free run left the finite numbers or went far beyond the training outputs.
        """
        check_is_fitted(self, "estimator_")
        runs = self._resolve(X, None, groups)
        out, bad = self._run_free([run.X for run in runs], self._initial(y0, runs))
        if bad:
            which, row = bad[0]
            label = runs[which].label
            raise SimulationDiverged(
                f"the free run diverged: run {which if label is None else label!r}, step {row}; {len(bad)} of {len(runs)} "
                'runs in all. Fit with loss="shooting", give more lags or training runs, or a larger penalty.',
                run=label,
                row=row,
                time=float(runs[which].t[row]),
            )
        return self._shaped(runs, out)

    def predict_one_step(self, X: Any, y: Any, groups: Any = None) -> np.ndarray:
        """Row t from measured outputs up to t-1; rows without that history are nan.

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
        """Row t from measured outputs up to t-k and inputs up to t; rows without that history are nan.

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
        """
        check_is_fitted(self, "estimator_")
        if k < 1:
            raise ValueError(f"k={k!r} must be at least 1 step ahead.")
        runs = self._resolve(X, y, groups)
        n, parts = self.n_initial_, []
        for run in runs:
            part = np.full(run.y.shape, np.nan)
            count = len(run) - n - k + 1
            if count > 0:
                known = self._known(run.X)[n:]
                windows = np.stack([known[j : j + count] for j in range(k)])
                first = np.stack([run.y[j : j + count] for j in range(n)])
                padded = np.concatenate([np.zeros((n, *windows.shape[1:])), windows])
                part[n + k - 1 :] = self._roll(padded, first)[-1]
            parts.append(part)
        return self._shaped(runs, parts)

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
        check_is_fitted(self, "estimator_")
        n = self.n_initial_
        runs = self._resolve(X, y, groups, min_rows=n + 1)
        first = np.stack([run.y[:n] for run in runs])
        predicted = self.predict(X, y0=first, groups=groups).reshape(runs.n_samples, -1)
        truth = runs.stack([run.y for run in runs])
        keep = np.zeros(runs.n_samples, bool)
        for run in runs:
            keep[run.start + n : run.stop] = True
        weight = None if sample_weight is None else np.asarray(sample_weight)[keep]
        return float(r2_score(truth[keep], predicted[keep], sample_weight=weight))

    # ---- parts ------------------------------------------------------------------------------------------------------
    def _resolve(self, X: Any, y: Any, groups: Any, *, reset: bool = False, min_rows: int = 1) -> Runs:
        """Checks that scikit-learn asks for, then runs."""
        if hasattr(X, "columns"):
            _check_feature_names(self, X, reset=reset)
            _check_n_features(self, X, reset=reset)
        elif y is None or groups is not None:
            X = validate_data(self, X, reset=reset, ensure_all_finite=groups is None, dtype="numeric")
        else:
            X, y = validate_data(self, X, y, reset=reset, multi_output=True, y_numeric=True)
        return resolve_runs(X, y, groups=groups, run=self.run, min_rows=min_rows)

    def _known(self, U: np.ndarray) -> np.ndarray:
        """Input features of one run, (n_samples, n_inputs * n_lags)."""
        return lag_columns(U, [(j, k) for j in range(U.shape[1]) for k in self.input_lags_])

    def _features(self, run: Run) -> np.ndarray:
        """All features of one run from measured outputs."""
        assert run.y is not None
        past = lag_columns(run.y, [(j, k) for k in self.output_lags_ for j in range(run.y.shape[1])])
        return np.concatenate([past, self._known(run.X)], axis=1)

    def _step(self, phi: np.ndarray) -> np.ndarray:
        """One step of the fitted regressor, (n_rows, n_outputs)."""
        return np.asarray(self.estimator_.predict(phi)).reshape(len(phi), -1)

    def _roll(self, known: np.ndarray, first: np.ndarray) -> np.ndarray:
        """Free runs of equal length, time first."""
        net = describe_network(self.estimator_)
        if net is None:
            return march(self._step, known, first, self.output_lags_)
        return free_run(net, known, first, self.output_lags_)

    def _run_free(self, inputs: list[np.ndarray], first: list[np.ndarray]) -> tuple[list, list[tuple[int, int]]]:
        """Free runs of any lengths, and (run, step) of those that diverged."""
        n = self.n_initial_
        longest = max(len(U) for U in inputs)
        known = np.stack([_lengthened(self._known(U), longest) for U in inputs], axis=1)
        starts = np.stack([_lengthened(f, n) for f in first], axis=1)
        found = self._roll(known, starts)
        out, bad = [], []
        for r, U in enumerate(inputs):
            part = found[: len(U), r]
            with np.errstate(invalid="ignore"):
                far = ~(np.abs(part - self.y_mean_) <= FAR * (self.y_spread_ + np.abs(self.y_mean_)))
            rows = np.flatnonzero(far[n:].any(axis=1))
            if len(rows):
                bad.append((r, n + int(rows[0])))
            out.append(part)
        return out, bad

    def _shoot(self, runs: Runs) -> None:
        """Levenberg-Marquardt on free runs of growing length, begun at the one-step fit."""
        net = describe_network(self.estimator_)
        if net is None:
            raise DataError(
                f'loss="shooting" needs slopes of the estimator, and {type(self.estimator_).__name__} gives none: use '
                'MLPRegressor, LinearRegression or Ridge (also behind StandardScaler), or loss="one_step".'
            )
        alpha = float(getattr(getattr(self.estimator_, "steps", [(0, self.estimator_)])[-1][1], "alpha", 0.0))
        longest = max(len(run) for run in runs) - self.n_initial_
        whole = longest if self.horizon is None else min(self.horizon, longest)
        # growing horizons: a free run over a whole record from a poor start has no useful slope
        stages = [h for h in (4, 8, 12, 16, 24, 32, 48, 64, 96, 128, 256) if h < whole] + [whole]
        costs = []
        for horizon in stages:
            known, target = self._segments(runs, horizon)
            net, cost = fit_free_run(
                net, known, target, self.n_initial_, self.output_lags_, alpha, max_iter=200 if horizon == whole else 60
            )
            costs.append(cost)
        self.shooting_cost_ = costs[-1]
        write_network(self.estimator_, net)

    def _segments(self, runs: Runs, horizon: int) -> tuple[np.ndarray, np.ndarray]:
        """Runs cut into pieces of ``horizon`` steps after their first rows; nan where a piece is shorter."""
        n, known, target = self.n_initial_, [], []
        for run in runs:
            features = self._known(run.X)
            for start in range(n, len(run), horizon):
                rows = slice(start - n, start + horizon)
                known.append(_lengthened(features[rows], n + horizon))
                y = np.full((n + horizon, run.y.shape[1]), np.nan)
                y[: len(run.y[rows])] = run.y[rows]
                target.append(y)
        return np.stack(known, axis=1), np.stack(target, axis=1)

    def _initial(self, y0: Any, runs: Runs) -> list[np.ndarray]:
        """First rows of every run, (n_initial, n_outputs) each."""
        n, o = self.n_initial_, len(self.y_mean_)
        if y0 is None and isinstance(self.init, str):
            if self.init not in ("mean", "steady"):
                raise ValueError(f'init={self.init!r} must be "mean", "steady" or an array ({n}, {o}).')
            rest = [np.repeat(self.y_mean_[None], n, axis=0) for _ in runs]
            if self.init == "mean":
                return rest
            settled, bad = self._run_free([np.repeat(run.X[:1], 500 + n, axis=0) for run in runs], rest)
            lost = {r for r, _ in bad}
            return [rest[r] if r in lost else np.repeat(s[-1:], n, axis=0) for r, s in enumerate(settled)]
        name = "init" if y0 is None else "y0"
        given = np.asarray(self.init if y0 is None else y0, dtype=float)
        if given.ndim == 1 and o == 1:
            given = given[:, None]
        if given.ndim == 2:
            given = np.repeat(given[None], len(runs), axis=0)
        if given.shape != (len(runs), n, o):
            raise DataError(
                f"{name} has shape {np.shape(self.init if y0 is None else y0)}, expected ({n}, {o}) or "
                f"({len(runs)}, {n}, {o}): the outputs at the first {n} rows of each run."
            )
        return list(given)

    def _shaped(self, runs: Runs, parts: list[np.ndarray]) -> np.ndarray:
        stacked = runs.stack(parts)
        return stacked[:, 0] if self.y_is_1d_ else stacked


def _lengthened(values: np.ndarray, n: int) -> np.ndarray:
    """n rows, the last repeated where there are fewer."""
    return values[np.minimum(np.arange(n), len(values) - 1)]
