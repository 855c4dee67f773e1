"""Lag models of runs: one-step or free-run fit, free-run prediction."""

from __future__ import annotations

from collections.abc import Sequence
from numbers import Integral, Real
from typing import Any

import numpy as np
from sklearn.base import BaseEstimator, _fit_context
from sklearn.utils._param_validation import HasMethods, Interval, StrOptions
from sklearn.utils.validation import check_is_fitted

from sksurrogate._dynamic import DIVERGED_RUN, FreeRunMixin, lengthened
from sksurrogate._lags import lag_list
from sksurrogate.compose._evidence_fit import Posterior
from sksurrogate.compose._lagged import (
    REPORTED,
    STAYS,
    diverged,
    divergence,
    fitted,
    lag_rows,
    name_features,
    stacked,
    takes_rows,
)
from sksurrogate.compose._linear_lags import fit_linear_lags
from sksurrogate.compose._network import agrees, describe_network
from sksurrogate.compose._shooting import ShootingMixin
from sksurrogate.compose._stability import StabilityReport, growth_along
from sksurrogate.exceptions import DataError, RunError
from sksurrogate.kernels.net import LagNet
from sksurrogate.kernels.rollout import free_run, march
from sksurrogate.kernels.rows import LagRows
from sksurrogate.runs import Run, Runs

#: Rows in a block of one-step predictions.
PREDICTION_ROWS = 65536


class RecursivePredictor(ShootingMixin, FreeRunMixin, BaseEstimator):
    """``y[t] = f(y[t-1], ..., y[t-ny], u[t], ..., u[t-nu])`` around any regressor f.

    Parameters
    ----------
    estimator : regressor
        Learns f; features are past outputs (lag by lag), then inputs (column by column).
    input_lags : int, list of int, or dict of column -> int or list, default=1
        An int n means 0, 1, ..., n; ``[1]`` keeps the current input out. A dict (by name for frames, else by position)
        leaves out columns it does not name.
    output_lags : int or list of int, default=1
        An int n means 1, ..., n.
    loss : {"one_step", "shooting"}, default="one_step"
        Prediction error, or the error of the free run (simulation error) by Levenberg-Marquardt with exact sensitivities,
        for a network after Adam. Shooting needs a network, of which only the shape is used, or a linear model, also behind
        features in a pipeline (see Notes). Of a linear model ``fit_intercept`` is kept, its own penalty gives way to ``alpha``,
        and what cannot be kept (``positive=True``, ``constraints``, few terms of many) is refused.
    horizon : int, optional
        Steps of a free run in the shooting loss before it starts again from measured outputs; None: whole runs.
    init : {"mean", "steady"} or array (n_initial, n_outputs), default="mean"
        First rows where ``predict`` gets no ``y0``: mean of the training outputs, or the model's rest at the first input.
    alpha : float, "evidence", "auto" or None, default="evidence"
        Penalty of the shooting loss ``sum e^2 + alpha * sum w^2``, with errors, features and so weights in units of the
        training data's standard deviation. "evidence": penalty and noise by MacKay's evidence along the fit, which begins at the
        one-step fit and under a strong penalty; it refuses models that diverge from other initial states (see Notes).
        None: 0.1 for networks and features, 0 for linear models. "auto" (networks): the largest within one standard
        error of the best on halves of the runs left out; some 20 fits.
    stability : float, default=0
        Weight of a second term of the shooting loss: free runs that begin one standard deviation off must be back on the data
        in the second half of the run (or horizon), so that the model forgets its initial rows.
    n_starts : int, default=2
        Starts of the shooting fit of a network; after some steps the best goes on.
    random_state : int, RandomState or None
        Of the starts.
    run : None, column name, int or "index"
        Where X says which run a row belongs to; ``groups`` wins.

    Attributes
    ----------
    estimator_ : fitted regressor
    n_initial_ : int
        Rows of ``y0``: the longest lag.
    one_step_rmse_, free_run_rmse_ : float
        On the training runs; the second, on at most 65 536 rows of them, is inf where a run diverges.
    left_region_ : list
        Labels of the training runs whose free run leaves the range of the outputs by more than half of it (a warning says so).
    shooting_loss_, alpha_ : float
        With ``loss="shooting"``: the loss and the penalty.
    noise_ : ndarray (n_outputs,)
        With ``alpha="evidence"`` (networks, linear models): standard deviation of the residual of the free runs, units of y.
    compiled_ : bool
        Whether the regressor is run as plain arrays (see Notes).
    feature_names_ : list of str
        Names of the regressor's features, such as ``y_lag1`` and ``u_lag0``.
    n_features_in_ : int

    Notes
    -----
    ``MLPRegressor``, ``FNNRegressor`` and linear models (all that have ``coef_`` and ``intercept_``, ``PCRRegressor``
    too), also behind scalers or ``PCA`` in a pipeline or with a scaled target, are run as plain arrays: long runs in
    pieces at once, many runs at once, short ones as plain numbers. Any other regressor is called once a step for all
    runs together. Equal one-step errors hide free-run errors of very different size: select on ``score`` or
    ``free_run_rmse_``.

    With ``alpha="evidence"`` unstable fits are refused: their runs from other starts (other runs' rows, the ends of the range,
    rough rows) leave the region, grow or stay apart, while those of a strongly penalised fit do not. Training runs begin at
    measured rows, noise included, as ``predict`` does. With free starts the model would not learn to tolerate noise in its lags.

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

    _parameter_constraints: dict = {
        "estimator": [HasMethods(["fit", "predict"])],
        "input_lags": [Interval(Integral, 0, None, closed="left"), "array-like", dict],
        "output_lags": [Interval(Integral, 0, None, closed="left"), "array-like"],
        "loss": [StrOptions({"one_step", "shooting"})],
        "horizon": [Interval(Integral, 1, None, closed="left"), None],
        "init": [StrOptions({"mean", "steady"}), "array-like"],
        "alpha": [Interval(Real, 0, None, closed="left"), StrOptions({"auto", "evidence"}), None],
        "stability": [Interval(Real, 0, None, closed="left")],
        "n_starts": [Interval(Integral, 1, None, closed="left")],
        "random_state": ["random_state"],
        "run": [None, str, Integral],
    }

    def __init__(
        self,
        estimator: Any,
        input_lags: Any = 1,
        output_lags: Any = 1,
        *,
        loss: str = "one_step",
        horizon: int | None = None,
        init: Any = "mean",
        alpha: float | str | None = "evidence",
        stability: float = 0.0,
        n_starts: int = 2,
        random_state: Any = None,
        run: Any = None,
    ):
        self.estimator = estimator
        self.input_lags = input_lags
        self.output_lags = output_lags
        self.loss = loss
        self.horizon = horizon
        self.init = init
        self.alpha = alpha
        self.stability = stability
        self.n_starts = n_starts
        self.random_state = random_state
        self.run = run

    @_fit_context(prefer_skip_nested_validation=False)
    def fit(self, X: Any, y: Any, groups: Any = None) -> RecursivePredictor:
        """Fit f one step ahead or, with ``loss="shooting"``, on the free run.

        Parameters
        ----------
        X : array-like (n_samples, n_inputs)
        y : array-like (n_samples,) or (n_samples, n_outputs)
        groups : array-like (n_samples,), optional

        Returns
        -------
        self
        """
        self.output_lags_ = lag_list(self.output_lags, 1, "output_lags")
        if not self.output_lags_:
            raise DataError(f"output_lags={self.output_lags!r}: at least one past output is needed to run freely.")
        runs = self._resolve(X, y, groups, reset=True)
        self.input_terms_, self.feature_names_ = name_features(runs, self.output_lags_, self.input_lags)
        n = self.n_initial_ = max([*self.output_lags_, *(lag for _, lag in self.input_terms_)])
        short = next((run for run in runs if len(run) <= n), None)
        if short is not None:
            label = "the data have" if short.label is None else f"run {short.label!r} has"
            raise RunError(
                f"{label} {len(short)} rows (n_samples={len(short)}), but the longest lag {n} needs {n + 1}: give longer "
                "runs or lower input_lags or output_lags."
            )
        self._posterior: Posterior | None = None
        wanted = self.loss == "one_step"
        quick = fit_linear_lags(self.estimator, runs, self.output_lags_, self.input_terms_, n) if wanted else None
        if quick is not None:
            (self.estimator_, squares), self.compiled_ = quick, True
        else:
            squares = self._fit_rows(runs)
        n_targets = sum(len(run) - n for run in runs) * len(self.y_mean_)
        self.one_step_rmse_ = float(np.sqrt(squares / n_targets))
        self.free_run_rmse_ = self._free_run_error(runs)
        return self

    def predict(self, X: Any, y0: Any = None, groups: Any = None, return_std: bool = False) -> Any:
        """Free run.

        Parameters
        ----------
        X : array-like (n_samples, n_inputs)
        y0 : array-like (n_initial, n_outputs) or (n_runs, n_initial, n_outputs), optional
            Outputs at the first rows of each run; without it ``init`` decides. With more rows for each run than
            ``n_initial_`` it begins where it comes nearest to all of them; nan then counts as not measured.
        groups : array-like (n_samples,), optional
        return_std : bool, default=False
            Also the standard deviation of a new measurement; after ``loss="shooting"`` with ``alpha="evidence"``.

        Returns
        -------
        ndarray (n_samples,) or (n_samples, n_outputs)
            The first rows are those of ``y0``; with ``return_std`` a pair of arrays.

        Raises
        ------
        SimulationDiverged
            The free run became infinite or nan or went far beyond the training outputs.
        """
        check_is_fitted(self, "estimator_")
        runs = self._resolve(X, None, groups)
        inputs = [run.X for run in runs]
        rows = self._more_rows(y0, runs)
        if rows is None:
            out, bad = self._run_free(inputs, self._initial(y0, runs))
        else:
            out, bad = self._run_free(inputs, self._start_from(runs, rows))
            for part, given in zip(out, rows[:, : self.n_initial_]):
                part[: self.n_initial_] = np.where(np.isfinite(given), given, part[: self.n_initial_])
        if bad:
            raise divergence(runs, bad)
        if not return_std:
            return self._shaped(runs, out)
        return self._shaped(runs, out), self._shaped(runs, self._deviation(inputs, list(out)))

    def _ahead(self, runs: Runs, r: int, history: int) -> np.ndarray:
        run, n = runs[r], self.n_initial_
        count, out = len(run) - history + 1, []
        for start in range(0, count, PREDICTION_ROWS):
            begins = np.arange(start, min(start + PREDICTION_ROWS, count))[:, None]
            found = self._roll(run.X[begins + np.arange(history)], run.y[begins + np.arange(n)])
            bad = diverged(found, [history] * len(found), n, self.y_mean_, self.y_spread_)
            if bad:
                raise divergence(runs, [(r, start + bad[0][0] + bad[0][1])])
            out.append(found[:, -1])
        return np.concatenate(out)

    def embed(self, X: Any, y: Any, groups: Any = None) -> tuple[np.ndarray, np.ndarray]:
        """The regression of section 2.6, Eq. (7): rows with whole history, run after run.

        Parameters
        ----------
        X : array-like (n_samples, n_inputs)
        y : array-like (n_samples,) or (n_samples, n_outputs)
        groups : array-like (n_samples,), optional

        Returns
        -------
        Phi : ndarray (n_rows, n_features)
            Columns are ``feature_names_``; the first row of a run is that of target ``y[n_initial_]``.
        target : ndarray (n_rows,) or (n_rows, n_outputs)
        """
        check_is_fitted(self, "estimator_")
        rows, target = self._rows(self._resolve(X, y, groups))
        return rows[:], target

    def stability_report(self, X: Any, y0: Any = None, groups: Any = None) -> StabilityReport:
        """How disturbances of the outputs grow or fade along the free runs.

        Parameters
        ----------
        X : array-like (n_samples, n_inputs)
        y0 : array-like, optional
            As for :meth:`predict`.
        groups : array-like (n_samples,), optional

        Returns
        -------
        StabilityReport
        """
        predicted = self.predict(X, y0=y0, groups=groups).reshape(len(X), -1)
        runs = self._resolve(X, None, groups)
        shaped = [Run(run.label, run.start, run.stop, run.X, predicted[run.start : run.stop], run.t) for run in runs]
        parts, labels = [self._rows([run])[0][:] for run in shaped], [run.label for run in runs]
        return growth_along(self._step, parts, labels, self.output_lags_, len(self.y_mean_))

    def _fit_rows(self, runs: Runs) -> float:
        """Fit on the rows of the lag matrix, or on free runs; the sum of squared one-step errors."""
        rows, target = self._rows(runs)
        if self.loss == "one_step":
            self.estimator_ = fitted(self.estimator, rows if takes_rows(self.estimator, rows) else rows[:], target)
        else:
            self._shoot(runs, rows[:], target)
        self.compiled_ = self._compiles(rows)
        target = target.reshape(len(target), -1)
        blocks = (slice(k, k + PREDICTION_ROWS) for k in range(0, len(rows), PREDICTION_ROWS))
        return sum(float(((self._step(rows[block]) - target[block]) ** 2).sum()) for block in blocks)

    def _free_run_error(self, runs: Runs) -> float:
        """RMSE of free runs over the first training rows, inf where one diverges; a warning where they leave."""
        n, left, inputs, outputs = self.n_initial_, REPORTED, [], []
        for run in runs:
            if left <= n:
                break
            inputs.append(run.X[:left])
            outputs.append(run.y[:left])
            left -= len(run)
        free, bad = self._run_free(inputs, [y[:n] for y in outputs])
        self._watch_training_runs(list(runs)[: len(outputs)], free, STAYS)
        if bad:
            return float("inf")
        return float(np.sqrt(np.mean(np.concatenate([f[n:] - y[n:] for f, y in zip(free, outputs)]) ** 2)))

    def _rows(self, runs: Sequence[Run]) -> tuple[LagRows, np.ndarray]:
        return lag_rows(runs, self.output_lags_, self.input_terms_, self.n_initial_)

    def _step(self, phi: np.ndarray) -> np.ndarray:
        """One step of the fitted regressor, (n_rows, n_outputs)."""
        return np.asarray(self.estimator_.predict(phi)).reshape(len(phi), -1)

    def _compiles(self, Phi: np.ndarray | LagRows) -> bool:
        """Whether the regressor is the network that it looks like."""
        net = describe_network(self.estimator_)
        return net is not None and agrees(net, self.estimator_, Phi)

    def _lag_net(self) -> LagNet | None:
        """The fitted model for the kernels."""
        net = describe_network(self.estimator_)
        if net is None:
            return None
        return LagNet(net, tuple(self.output_lags_), tuple(self.input_terms_), len(self.y_mean_))

    def _roll(self, U: np.ndarray, first: np.ndarray) -> np.ndarray:
        """Free runs of equal length, (n_runs, n_steps, n_outputs)."""
        model = self._lag_net() if self.compiled_ else None
        if model is None:
            far = DIVERGED_RUN * (self.y_spread_ + np.abs(self.y_mean_))  # no predict is asked beyond
            limits = self.y_mean_ - far, self.y_mean_ + far
            return march(self._step, U, first, self.output_lags_, self.input_terms_, limits)
        return free_run(model, U, first)

    def _run_free(self, inputs: Sequence[np.ndarray], first: Any) -> tuple[Any, list[tuple[int, int]]]:
        """Free runs of any lengths, and (run, step) of those that diverged."""
        lengths = [len(U) for U in inputs]
        longest = max(lengths)
        same = min(lengths) == longest
        U = stacked(inputs) if same else np.stack([lengthened(U, longest) for U in inputs])
        n = min(self.n_initial_, longest)
        found = self._roll(U, np.stack([f[:n] for f in first]))
        bad = diverged(found, lengths, self.n_initial_, self.y_mean_, self.y_spread_)
        return (found if same else [part[:length] for part, length in zip(found, lengths)]), bad

    def _initial(self, y0: Any, runs: Runs) -> Any:
        """First rows of every run, (n_initial, n_outputs) each."""
        if y0 is not None or not (isinstance(self.init, str) and self.init == "steady"):
            return self._start_rows(y0, runs)
        n = self.n_initial_
        rest = [np.repeat(self.y_mean_[None], n, axis=0) for _ in runs]
        settled, bad = self._run_free([np.repeat(run.X[:1], 500 + n, axis=0) for run in runs], rest)
        lost = {r for r, _ in bad}
        return [rest[r] if r in lost else np.repeat(s[-1:], n, axis=0) for r, s in enumerate(settled)]

    def _shaped(self, runs: Runs, parts: Any) -> np.ndarray:
        """Rows of all runs, in the shape of y."""
        whole = isinstance(parts, np.ndarray) and parts.shape[0] * parts.shape[1] == runs.n_samples
        stacked = parts.reshape(runs.n_samples, -1) if whole else runs.stack(parts)
        return stacked[:, 0] if self.y_is_1d_ else stacked
