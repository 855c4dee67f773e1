"""A hybrid model: an imperfect simulator plus a learned correction."""

from __future__ import annotations

from collections.abc import Sequence
from numbers import Integral, Real
from typing import Any

import numpy as np
from sklearn.base import BaseEstimator, RegressorMixin, _fit_context, clone
from sklearn.metrics import r2_score
from sklearn.utils._param_validation import Interval, StrOptions
from sklearn.utils.validation import check_is_fitted

from sksurrogate._checks import checked, is_checked_frame
from sksurrogate._columns import by_name
from sksurrogate._domain import Domain
from sksurrogate._dynamic import lengthened
from sksurrogate.compose._correction_report import reach
from sksurrogate.compose._hybrid_forms import CorrectionSettings, chosen_form
from sksurrogate.compose._hybrid_graph import hybrid_graph, hybrid_state
from sksurrogate.compose._hybrid_output import Free
from sksurrogate.exceptions import SimulationDiverged
from sksurrogate.export import Graph, to_casadi, to_onnx
from sksurrogate.physics._simulator import describe
from sksurrogate.runs import Runs, resolve_runs


class HybridRegressor(RegressorMixin, BaseEstimator):
    """Free run of a simulator plus a learned correction, as far as left-out runs support it.

    ``y_h[t] = y_s[t] + f(d[t-1], ..., d[t-n], u[t], ..., u[t-n])`` with ``d = y_h - y_s`` the correction's own past
    (the equation at the end of section 4.4 of the paper); y_s is the simulator's free run.

    Parameters
    ----------
    simulator : object with ``simulate(U, x0=None, t=None)``, estimator with ``simulator_``, or None
        A :class:`CalibratedSimulator` is fitted first. None: no physics, the surrogate alone.
    residual : regressor, optional
        Learns the correction from (n_samples, n_lags * n_outputs + (n_lags + 1) * n_inputs + n_outputs) features: past
        deviations, inputs, and the simulator's own output. Default for "output": the mean of five small tanh nets with
        a linear part, trained through the free run, judged on runs left out; for "static" and "series": ridge on
        polynomials, chosen on runs left out.
        For "dynamics" and "input": features are the states (measured or not) and inputs ("input": the inputs alone), the
        target is the term; transformers with a linear model are fitted through the free run, any other regressor to the
        term that a smoother finds along the runs. Of the linear model ``fit_intercept`` is kept, its own penalty gives way to
        ``shrinkage``; ``positive=True``, ``constraints`` and models of few terms are refused. Default: a linear and a smooth
        part; smoothness, size and the noise of the outputs follow from the evidence.
    form : {"output", "static", "series", "dynamics", "input", "auto"}, default="output"
        "output": past deviations are features, as in the paper. "static": only inputs (with their lags) and the
        simulator's output are. "series": as "static", but ``residual`` learns y itself in place of the deviation.
        "dynamics": a term of states and inputs is added to dx/dt (or the next states of a step). "input": a term of the
        inputs is added to them. "dynamics" and "input" need a simulator with ``rhs`` or ``step``. "auto" tries three forms: the one of
        "input" and "dynamics" with the larger evidence (where the simulator allows them), "static", "output". It takes the
        first in this order whose gain on left-out runs is within one standard error of the best, and of which these runs
        support at least the best one's share.
    loss : {"one_step", "shooting"}, optional
        Whether the correction is fitted one step ahead or through its own free run ("shooting": residuals whose slopes
        are known; a DataError says so for others). Default: "shooting" for the default residual and, inside the
        plant, for transformers with a linear model, else "one_step".
    n_lags : int, default=5
        Past deviations and inputs.
    states : list of str, optional
        With "dynamics": the states whose derivative is corrected; by default all whose balance is not an identity such
        as ``dq/dt = v``.
    shrinkage : float, default=1e-2
        Penalty with which the nets of the default residual begin (every second one a hundred times as strong) until the
        evidence sets it; penalty of a linear model inside the plant: how much evidence a correction needs.
    fade : float or "evidence", default="evidence"
        Share of the range of a feature in the training data by which it may leave it before the correction fades and
        the physics is left alone; ``inf``: never. "evidence": as far as two left-out runs (blocks) have gone beyond
        the others, between 0.1 and 1; as far as one has, where the correction halves the error of every left-out run
        (block); 1 where it removes nine tenths of the squared error of every one.
    warm_start : bool, default=False
        Whether ``fit`` goes on from the correction of the last call (default residual).
    random_state : int, RandomState or None, default=0
    run : None, column name, int or "index"
        Where X says which run a row belongs to; ``groups`` wins.

    Attributes
    ----------
    simulator_ : simulator or None
    residual_ : fitted regressor
        With "dynamics" and "input" it predicts the term within the data, in units of what it is added to; that of the
        default gives the term's functions when it is called.
    form_ : str
        The form, chosen with "auto".
    n_initial_ : int
        Rows of ``y0`` that ``predict`` takes.
    free_run_rmse_ : float
        On the training runs.
    shrinkage_ : ndarray (n_outputs,)
        Share of the correction that left-out runs support and that is kept: 1 is the whole correction, 0 the simulator alone.
        It maximises the lower 95 % limit (over blocks of rows) of the gain over the simulator. One number for all outputs with
        "dynamics" and "input".
    report_ : CorrectionReport
        The same with the errors of simulator, whole correction and kept share on left-out runs; ``print`` gives a sentence.
    left_out_rmse_ : ndarray (n_outputs,)
        Error on left-out runs (every third run; with one or two runs, one of eight blocks), the base of ``return_std``; it costs
        three to eight more fits. Without a simulator the default residual is tested on the training runs, because the spread
        of its nets shows what they do not know.
    region_ : Domain
        Ranges of inputs and outputs in the training data.
    n_features_in_ : int

    Notes
    -----
    Time: about a second for 8 runs of 150 samples; long records are thinned to a few thousand rows for the nets.

    References
    ----------
    Lie, *Surrogate and Hybrid Models for Control*, SIMS 60 (2019), section 4.4 and Figure 8.

    Examples
    --------
    >>> from sksurrogate.compose import HybridRegressor
    >>> from sksurrogate.datasets import linear_reactor, make_reactor_runs
    >>> X, y, groups = make_reactor_runs(8, 150, random_state=0)
    >>> hybrid = HybridRegressor(linear_reactor()).fit(X, y, groups=groups)
    >>> hybrid.score(X, y, groups=groups) > 0.99
    True
    """

    __metadata_request__fit = {"groups": True}
    __metadata_request__partial_fit = {"groups": True}
    __metadata_request__predict = {"groups": True, "y0": True, "return_std": True}
    __metadata_request__score = {"groups": True}

    _parameter_constraints = {
        "simulator": "no_validation",
        "residual": "no_validation",
        "form": [StrOptions({"output", "static", "series", "dynamics", "input", "auto"})],
        "loss": [StrOptions({"one_step", "shooting"}), None],
        "states": ["array-like", None],
        "n_lags": [Interval(Integral, 1, None, closed="left")],
        "shrinkage": [Interval(Real, 0, None, closed="left")],
        "fade": [Interval(Real, 0, None, closed="both"), StrOptions({"evidence"})],
        "warm_start": ["boolean"],
        "random_state": ["random_state"],
        "run": "no_validation",
    }

    def __init__(
        self,
        simulator: Any,
        residual: Any = None,
        form: str = "output",
        *,
        loss: str | None = None,
        n_lags: int = 5,
        states: Sequence[str] | None = None,
        shrinkage: float = 1e-2,
        fade: float | str = "evidence",
        warm_start: bool = False,
        random_state: Any = 0,
        run: Any = None,
    ):
        self.simulator = simulator
        self.residual = residual
        self.form = form
        self.loss = loss
        self.n_lags = n_lags
        self.states = states
        self.shrinkage = shrinkage
        self.fade = fade
        self.warm_start = warm_start
        self.random_state = random_state
        self.run = run

    def __sklearn_tags__(self) -> Any:
        tags = super().__sklearn_tags__()
        tags.target_tags.multi_output = True
        tags.regressor_tags.poor_score = True  # a free run of unordered rows has nothing to follow
        return tags

    @_fit_context(prefer_skip_nested_validation=False)
    def fit(self, X: Any, y: Any, groups: Any = None) -> HybridRegressor:
        """Fit the correction to these runs; those of earlier calls are forgotten.

        Parameters
        ----------
        X : array-like (n_samples, n_inputs)
        y : array-like (n_samples,) or (n_samples, n_outputs)
        groups : array-like (n_samples,), optional

        Returns
        -------
        self
        """
        before = getattr(self, "correction_", None) if self.warm_start else None
        if y is None:
            raise ValueError("HybridRegressor requires y to be passed, but the target y is None.")
        runs = self._resolve(X, y, groups, reset=before is None, min_rows=self.n_lags + 2)
        return self._fit_runs(runs, [run.X for run in runs], [run.y for run in runs], before)

    @_fit_context(prefer_skip_nested_validation=False)
    def partial_fit(self, X: Any, y: Any, groups: Any = None) -> HybridRegressor:
        """Go on with more runs: those of ``fit`` and of calls after it are kept, and the correction starts from the last one.

        Parameters
        ----------
        X : array-like (n_samples, n_inputs)
        y : array-like (n_samples,) or (n_samples, n_outputs)
        groups : array-like (n_samples,), optional
            A label that an earlier call used is another run.

        Returns
        -------
        self
        """
        before = getattr(self, "correction_", None)
        runs = self._resolve(X, y, groups, reset=before is None, min_rows=self.n_lags + 2)
        old_inputs, old_measured = getattr(self, "_seen", ([], []))
        inputs = [*old_inputs, *(run.X for run in runs)]
        measured = [*old_measured, *(run.y for run in runs)]
        return self._fit_runs(runs, inputs, measured, before)

    def predict(
        self, X: Any, y0: Any = None, groups: Any = None, return_std: bool = False
    ) -> np.ndarray | tuple[np.ndarray, np.ndarray]:
        """Free run.

        Parameters
        ----------
        X : array-like (n_samples, n_inputs)
        y0 : array-like (n_lags, n_outputs) or (n_runs, n_lags, n_outputs), optional
            Outputs at the first rows of each run; without it the correction starts from no deviation.
        groups : array-like (n_samples,), optional
        return_std : bool, default=False
            Whether a standard deviation comes along: ``left_out_rmse_``, the spread of the nets, and, as far as the
            correction has faded or the run has left the range of inputs and outputs in the data, the size of the gap
            itself.

        Returns
        -------
        ndarray (n_samples,) or (n_samples, n_outputs)
            The first ``n_lags`` rows of each run are ``y0`` where it is given.
        std : ndarray of the same shape, with ``return_std``

        Raises
        ------
        SimulationDiverged
            The free run became infinite or nan.
        """
        runs, free, first = self._free(X, y0, groups, return_std)
        for run, part in zip(runs, free.y):
            if not np.all(np.isfinite(part)):
                row = int(np.flatnonzero(~np.isfinite(part).all(axis=1))[0])
                raise SimulationDiverged(
                    f"the hybrid's free run became infinite or nan: run {run.label!r}, row {row}. Use more training runs, "
                    "a larger penalty in residual, or fewer lags.",
                    run=run.label,
                    row=row,
                )
        mean = self._shaped(runs, free.y)
        if not return_std:
            return mean
        parts = []
        for run, y, f, spread, weight in zip(runs, free.y, first, free.spread, free.weight):
            outside = self.region_.doubt(np.hstack([run.X, y]))
            lost = np.maximum(1.0 - weight, outside)[:, None] * self.correction_.reach
            part = np.sqrt(self.left_out_rmse_**2 + spread**2 + lost**2)
            part[: 0 if f is None else len(f)] = 0.0
            parts.append(part)
        return mean, self._shaped(runs, parts)

    def validity(self, X: Any, y0: Any = None, groups: Any = None) -> np.ndarray:
        """Weight of the correction along the free run, (n_samples,): 1 within the data's region, 0 far outside."""
        runs, free, _ = self._free(X, y0, groups, False)
        return runs.stack(free.weight)

    def predict_one_step(self, X: Any, y: Any, groups: Any = None) -> np.ndarray:
        """One step ahead from measured outputs; the first ``n_lags`` rows of each run are nan."""
        check_is_fitted(self, "correction_")
        runs = self._resolve(X, y, groups)
        return self._shaped(runs, self.correction_.one_step([run.X for run in runs], [run.y for run in runs]))

    def score(self, X: Any, y: Any, sample_weight: Any = None, groups: Any = None) -> float:
        """R2 of the free run from the first rows of every run, those rows left out."""
        check_is_fitted(self, "correction_")
        runs = self._resolve(X, y, groups)
        first = np.stack([lengthened(run.y, self.n_initial_) for run in runs])
        predicted = np.asarray(self.predict(X, y0=first, groups=groups)).reshape(runs.n_samples, -1)
        keep = np.zeros(runs.n_samples, bool)
        for run in runs:
            keep[min(run.start + self.n_initial_, run.stop - 1) : run.stop] = True
        truth = runs.stack([run.y for run in runs])
        weight = None if sample_weight is None else np.asarray(sample_weight)[keep]
        return float(r2_score(truth[keep], predicted[keep], sample_weight=weight))

    # ---- out of the house -------------------------------------------------------------------------------------------
    def to_graph(self, n_sub: int | None = None) -> Graph:
        """``x_next, y = f(x, u)`` in plain numpy with exact Jacobians.

        Parameters
        ----------
        n_sub : int, optional
            Substeps of a right-hand side a sample; None: as many as ``predict`` takes ("dynamics", "input"), or as the
            simulator took on the training runs.
        """
        check_is_fitted(self, "correction_")
        return hybrid_graph(self.correction_, self.n_features_in_ - (self.run not in (None, "index")), n_sub)

    def graph_state(self, X: Any, y0: Any = None, n_sub: int | None = None) -> np.ndarray:
        """State of :meth:`to_graph` of one run: before its first row, or behind the rows of ``y0``."""
        check_is_fitted(self, "correction_")
        runs = self._resolve(X, None, None)
        return hybrid_state(self.correction_, runs[0].X, self._initial(y0, runs)[0], n_sub)

    def to_casadi(self, name: str = "hybrid", n_sub: int | None = None) -> Any:
        """The same as ``casadi.Function``; see :func:`sksurrogate.export.to_casadi`."""
        return to_casadi(self.to_graph(n_sub), name)

    def to_onnx(self, path: Any = None, n_sub: int | None = None) -> Any:
        """The same as an ONNX model; see :func:`sksurrogate.export.to_onnx`."""
        return to_onnx(self.to_graph(n_sub), path)

    # ---- parts ------------------------------------------------------------------------------------------------------
    def _resolve(self, X: Any, y: Any, groups: Any, *, reset: bool = False, min_rows: int = 1) -> Runs:
        """Checks that scikit-learn asks for, then runs."""
        X = by_name(X, getattr(self.simulator, "inputs", None), self.run, warn=reset)
        y = by_name(y, getattr(self.simulator, "outputs", None), warn=reset)
        fewest = 0 if getattr(self.simulator, "inputs", None) == [] else 1
        is_frame = is_checked_frame(self, X, reset)
        if not is_frame and (y is None or groups is not None):
            X = checked(self, X, reset=reset, ensure_all_finite=False, dtype="numeric", ensure_min_features=fewest)
        elif not is_frame:
            try:
                X, y = checked(self, X, y, reset=reset, multi_output=True, y_numeric=True, ensure_min_features=fewest)
            except ValueError as error:
                if "NaN" in str(error) or "infinity" in str(error):
                    resolve_runs(X, y, run=self.run)  # names the row
                raise
        runs = resolve_runs(
            X, y, groups=groups, run=self.run, dt=getattr(self.simulator, "dt", None), min_rows=min_rows
        )
        if self.simulator is not None and callable(getattr(self.simulator, "simulate", None)):
            columns = {"n_inputs": runs[0].X.shape[1]}
            if y is not None:
                columns["n_outputs"] = runs[0].y.shape[1]
            describe(self.simulator, **columns)  # refuses other columns than the simulator has
        return runs

    def _fit_runs(self, runs: Runs, inputs: list, measured: list, before: Any) -> HybridRegressor:
        self.y_is_1d_ = runs.y_is_1d
        self.simulator_ = self._calibrated(inputs, measured)
        self.region_ = Domain.of(np.hstack([np.concatenate(inputs), np.concatenate(measured)]), reach(self.fade))
        names = runs.output_names or getattr(self.simulator_, "outputs", None)
        names = names or [f"output {j}" for j in range(measured[0].shape[1])]
        wanted = CorrectionSettings(
            self.residual, self.loss, self.n_lags, self.states, self.fade, self.shrinkage, self.random_state
        )
        start = before, getattr(self, "form_", None)
        found = chosen_form(self.form, wanted, self.simulator_, inputs, measured, names, start)
        self.form_, self.correction_, self.report_ = found
        self.residual_, self.shrinkage_ = self.correction_.fitted, self.report_.shrinkage
        self.n_initial_ = self.correction_.n_lags
        self.free_run_rmse_ = float(np.sqrt(np.mean(self.correction_.rmse**2)))
        self.left_out_rmse_ = np.fmax(self.report_.rmse, self.correction_.rmse)
        self._seen = (inputs, measured)  # partial_fit goes on from these runs
        return self

    def _calibrated(self, inputs: Sequence[np.ndarray], measured: Sequence[np.ndarray]) -> Any:
        """The simulator; an estimator of one is fitted first."""
        if self.simulator is None or callable(getattr(self.simulator, "simulate", None)):
            return self.simulator
        if not callable(getattr(self.simulator, "fit", None)):
            return self.simulator
        groups = np.repeat(np.arange(len(inputs)), [len(U) for U in inputs])
        y = np.concatenate(measured)
        fitted = clone(self.simulator).fit(np.concatenate(inputs), y if y.shape[1] > 1 else y[:, 0], groups=groups)
        return fitted.simulator_

    def _free(self, X: Any, y0: Any, groups: Any, spread: bool) -> tuple[Runs, Free, list]:
        """Runs, their free runs, and the rows these start from."""
        check_is_fitted(self, "correction_")
        runs = self._resolve(X, None, groups)
        first = self._initial(y0, runs)
        return runs, self.correction_.run([run.X for run in runs], first, spread), first

    def _initial(self, y0: Any, runs: Runs) -> list[np.ndarray | None]:
        """First rows of every run."""
        if y0 is None:
            return [None] * len(runs)
        given = np.asarray(y0, dtype=float)
        if given.ndim == 1:
            given = given[:, None]
        if given.ndim == 2:
            given = np.repeat(given[None], len(runs), axis=0)
        n, o = self.n_initial_, self.correction_.n_outputs
        short = given.ndim == 3 and given.shape[1] < min(n, max(len(run) for run in runs))
        if given.ndim != 3 or len(given) != len(runs) or given.shape[2] != o or short:
            raise ValueError(
                f"y0 has shape {np.shape(y0)}, expected ({n}, n_outputs) or ({len(runs)}, {n}, n_outputs): "
                f"the first rows of each run, n_outputs = {o}."
            )
        if not np.isfinite(given).all():
            run, row, column = np.argwhere(~np.isfinite(given))[0]
            raise ValueError(
                f"y0 is not finite at row {row}, output {column} of run {run}: interpolate it first "
                "(sksurrogate.features.Interpolator), or start the run later."
            )
        return [g[: len(run)] for g, run in zip(given, runs)]

    def _shaped(self, runs: Runs, parts: list[np.ndarray]) -> np.ndarray:
        stacked = runs.stack(parts)
        return stacked[:, 0] if self.y_is_1d_ else stacked
