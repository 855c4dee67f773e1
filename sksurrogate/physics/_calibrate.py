"""Calibration: the named parameters of a simulator fitted to free runs with unknown initial states."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from numbers import Integral, Real
from typing import Any

import numpy as np
from sklearn.base import BaseEstimator, RegressorMixin, _fit_context, clone
from sklearn.exceptions import ConvergenceWarning, DataConversionWarning
from sklearn.metrics import r2_score
from sklearn.utils._param_validation import Interval
from sklearn.utils.validation import check_is_fitted, validate_data

from sksurrogate._checks import is_checked_frame
from sksurrogate._columns import by_name
from sksurrogate._stamps import with_rows_in_gaps
from sksurrogate._tables import no_inputs, without_nan
from sksurrogate.exceptions import DataError, SimulatorError
from sksurrogate.kernels.free_runs import free_run
from sksurrogate.kernels.heap import keep_freed_memory
from sksurrogate.kernels.linearised import linearise
from sksurrogate.kernels.record import Record
from sksurrogate.kernels.smoother import noise_of_differences
from sksurrogate.physics._asked import initial_states
from sksurrogate.physics._fit_model import FitModel
from sksurrogate.physics._free_parameters import FreeParameters
from sksurrogate.physics._intervals import Uncertainty, uncertainty_of
from sksurrogate.physics._lifted_fit import lifted_fit
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._not_finite import not_finite_along
from sksurrogate.physics._prior import weighed
from sksurrogate.physics._simulator import Plant, describe, simulated
from sksurrogate.runs import Run, Runs, resolve_runs

#: Parts of a direction that the data do not fix below which they are not told.
LEAST_PART = 1e-3
#: Runge-Kutta steps of a prediction from stamp to stamp, a sample.
STEPS_AT_STAMPS = 8


class CalibratedSimulator(RegressorMixin, BaseEstimator):
    """Fit parameters of a simulator through its free run (output error), initial states unknown or known.

    Parameters
    ----------
    simulator : simulator with a right-hand side or a step
        For instance :class:`ODESimulator` or :class:`StepSimulator`; never written.
    params : list of str, optional
        Names of the parameters to fit; all by default.
    bounds : dict of (low, high), optional
        By name; unbounded where a name is missing, and on a side that is None.
    priors : dict, optional
        Normal priors by name: a relative standard deviation about the simulator's value (``{"k": 0.05}``), or
        ``(mean, standard deviation)`` in the unit of the parameter. They are weighted against the data by the noise of the residual.
    fit_x0 : bool, default=True
        Whether the initial state of each run is unknown; else it is ``x0`` of ``fit``, or that of the simulator.
    confidence : float, default=0.9
        Of ``intervals_``, between 0 and 1.
    max_iter : int, default=50
        Iterations.
    run : None, column name, int or "index"
        Where X says which run a row belongs to; ``groups`` wins.
    time : column name or int, optional
        Column of X that holds the time of every row; by default rows are ``simulator.dt`` apart. Stamps may jitter and have gaps;
        a right-hand side is integrated from stamp to stamp.

    Attributes
    ----------
    simulator_ : simulator
        With the fitted parameters.
    params_ : dict of float
    intervals_ : dict of (low, high)
        Linearised, within the bounds; wider if the residual is correlated in time; infinite if the data do not fix the parameter.
    at_bound_ : dict of bool
        Whether a parameter ended at a bound. For the intervals of the others it is fixed there.
    identifiable_ : dict of bool
    unidentified_ : list of dict
        Combinations of relative changes (or of changes, for parameters at 0) that leave the outputs as they are.
    covariance_ : ndarray (n_params, n_params)
        Of the parameters; nan where the data do not fix all of them.
    x0_ : ndarray (n_runs, n_states)
        Initial states.
    noise_ : ndarray (n_outputs,)
        RMS of the residual.
    method_ : {"lifted", "single shooting"}
        The second is the fall-back, with a warning.
    n_iter_ : int
    converged_ : bool
    n_features_in_ : int

    References
    ----------
    Bock, *Numerical treatment of inverse problems in chemical reaction kinetics* (1981); Ljung, *System Identification*
    (1999), section 3.

    Examples
    --------
    >>> import numpy as np
    >>> from sksurrogate.physics import CalibratedSimulator, ODESimulator
    >>> def rhs(t, x, u, p):
    ...     return (u[0] - p["k"] * x[0],)
    >>> plant = ODESimulator(rhs, states=["x"], inputs=["u"], outputs=["x"], params={"k": 1.0}, dt=0.1)
    >>> U = np.sin(np.arange(100) / 5)[:, None]
    >>> y = plant.set_params(params__k=1.7).simulate(U, x0=[0.4])[:, 0]
    >>> fitted = CalibratedSimulator(plant.set_params(params__k=1.0), params=["k"]).fit(U, y)
    >>> round(fitted.params_["k"], 4)
    1.7
    """

    _parameter_constraints = {
        "fit_x0": ["boolean"],
        "confidence": [Interval(Real, 0, 1, closed="neither")],
        "max_iter": [Interval(Integral, 1, None, closed="left")],
    }

    __metadata_request__fit = {"groups": True, "x0": True}
    __metadata_request__predict = {"groups": True, "y0": True, "x0": True}
    __metadata_request__score = {"groups": True}

    def __init__(
        self,
        simulator: Any,
        params: Sequence[str] | None = None,
        *,
        bounds: Mapping[str, tuple[float, float]] | None = None,
        priors: Mapping[str, float | tuple[float, float]] | None = None,
        fit_x0: bool = True,
        confidence: float = 0.9,
        max_iter: int = 50,
        run: Any = None,
        time: str | int | None = None,
    ):
        self.simulator = simulator
        self.params = params
        self.bounds = bounds
        self.priors = priors
        self.fit_x0 = fit_x0
        self.confidence = confidence
        self.max_iter = max_iter
        self.run = run
        self.time = time

    @_fit_context(prefer_skip_nested_validation=False)
    def fit(self, X: Any, y: Any, groups: Any = None, x0: Any = None) -> CalibratedSimulator:
        """Fit.

        Parameters
        ----------
        X : array-like (n_samples, n_inputs)
        y : array-like (n_samples,) or (n_samples, n_outputs)
            Measured outputs; nan where an output was not measured (sensors at other rates, dropouts).
        groups : array-like (n_samples,), optional
        x0 : array-like (n_states,) or (n_runs, n_states), optional
            Known initial states (``fit_x0=False``), or where the fit starts.

        Returns
        -------
        self

        Raises
        ------
        SimulatorError
            The simulator gives trajectories only, or a name in ``params`` is unknown.
        DataError
            X or y do not keep the data convention; ``bounds`` or ``priors`` name what is not fitted, or hold no such numbers.
        """
        self._check_shape(y)
        runs = self._resolve(X, y, groups, reset=True)
        plant = describe(self.simulator, n_inputs=runs[0].X.shape[1], n_outputs=runs[0].y.shape[1], dt=runs.dt)
        free = FreeParameters.of(plant, self.params, self.bounds, self.priors)
        runs, uneven, first = self._from_stamp_to_stamp(runs, plant)
        record = Record.from_runs([r.X for r in runs], [r.y for r in runs], [r.t for r in runs], plant.dt, None, uneven)
        starts = initial_states(plant, x0, len(runs))
        keep_freed_memory()
        with np.errstate(all="ignore"):
            sd = noise_of_differences(record.y, record.starts, record.known, record.t)
            found = lifted_fit(
                PlantModel(plant),
                record,
                sd,
                free,
                starts,
                x0 is not None,
                max_steps=self.max_iter,
                fit_start=self.fit_x0,
            )
            if found.fit is None:
                place = not_finite_along(PlantModel(plant), record, [run.label for run in runs])
                raise SimulatorError(
                    f"no finite free run was found near params={free.started}: give starting values nearer "
                    f"to the plant (set_params(params__name=...)), bounds, or x0{': ' + place if place else '.'}"
                )
            for what in found.said:
                _warn(what)
            fit, prior = weighed(found.model, found.fit, sd, free.prior, free.unit, free.bounds, self.fit_x0)
            lin = fit.linearised or linearise(found.model, fit.theta, fit.x, free.unit)
        residual = record.residual(fit.y)
        if free.names and _worse_than_constant(record, residual, sd):
            _warn(
                "the fitted free run is much farther from y than the mean of y: give starting values nearer to the plant, bounds, or x0."
            )
        self.method_, self.n_iter_, self.converged_ = found.method, fit.n_iterations, fit.converged
        self.params_ = {name: float(value) for name, value in zip(free.names, fit.theta)}
        self.x0_ = fit.x[:, record.starts[first]].T.copy()
        self.noise_ = record.rms(residual)
        at_bound = free.at_bound(fit.theta)
        self.at_bound_ = {name: bool(flag) for name, flag in zip(free.names, at_bound)}
        J_x = lin.J_x if self.fit_x0 else lin.J_x[:, :0]
        held = prior.precision, record.known
        self._set_uncertainty(
            free,
            fit.theta,
            uncertainty_of(lin.J_theta, J_x, residual, sd, record.starts, free.unit, self.confidence, at_bound, *held),
        )
        self.simulator_ = clone(self.simulator).set_params(**{f"params__{k}": v for k, v in self.params_.items()})
        self.y_is_1d_ = runs.y_is_1d
        return self

    def _set_uncertainty(self, free: FreeParameters, theta: np.ndarray, found: Uncertainty) -> None:
        """Covariance, intervals, and what the data do not fix."""
        self.covariance_ = found.covariance
        ends = np.clip(theta - found.width, *free.bounds), np.clip(theta + found.width, *free.bounds)
        self.intervals_ = {name: (float(a), float(b)) for name, a, b in zip(free.names, *ends)}
        self.identifiable_ = {name: not bool(flag) for name, flag in zip(free.names, found.loose)}
        self.unidentified_ = [
            {name: float(v) for name, v in zip(free.names, row) if abs(v) > LEAST_PART}
            for row in _relative(found.null * free.unit, theta)
        ]

    def predict(self, X: Any, y0: Any = None, groups: Any = None, x0: Any = None) -> np.ndarray:
        """Free run with the fitted parameters.

        Parameters
        ----------
        X : array-like (n_samples, n_inputs)
        y0 : array-like (n_lags, n_outputs) or (n_runs, n_lags, n_outputs), optional
            Outputs at the first rows; measured states start at the first of them.
        groups : array-like (n_samples,), optional
        x0 : array-like (n_states,) or (n_runs, n_states), optional
            Initial states; win over y0. By default that of the simulator.

        Returns
        -------
        ndarray (n_samples,) or (n_samples, n_outputs)
        """
        check_is_fitted(self, "simulator_")
        runs = self._resolve(X, None, groups)
        plant = describe(self.simulator_)
        starts = initial_states(plant, x0, len(runs))
        if x0 is None and y0 is not None and plant.output_states is not None:
            first = np.asarray(y0, dtype=float).reshape(-1, 1) if np.ndim(y0) == 1 else np.asarray(y0, dtype=float)
            n = len(plant.output_states)
            if (
                first.ndim not in (2, 3)
                or first.shape[-1] != n
                or 0 in first.shape
                or (first.ndim == 3 and len(first) != len(runs))
            ):
                raise DataError(
                    f"y0 has shape {np.shape(y0)}, expected (n_lags, {n}) or ({len(runs)}, n_lags, {n}): the outputs at the "
                    "first rows of every run."
                )
            first = first[0] if first.ndim == 2 else first[:, 0]
            if not np.isfinite(first).all():
                raise DataError(
                    f"y0 is not finite in output {np.argwhere(~np.isfinite(first))[0][-1]} of its first row: a run starts there; "
                    "begin with a row that was measured, or give x0."
                )
            starts[:, list(plant.output_states)] = first
        stacked = runs.stack([self._simulated(run, start, plant) for run, start in zip(runs, starts)])
        return stacked[:, 0] if self.y_is_1d_ else stacked

    def _simulated(self, run: Run, start: np.ndarray, plant: Plant) -> np.ndarray:
        """Free run of one run; at its stamps where a time column is named."""
        if self.time is None or np.allclose(np.diff(run.t), plant.dt, rtol=1e-3, atol=0.0):
            return np.asarray(simulated(self.simulator_, run.X, start))
        still = np.zeros((len(run), len(plant.outputs)))
        one = Record.from_runs([run.X], [still], [run.t - run.t[0]], plant.dt, uneven=True)
        steps = np.diff(run.t)
        longest = max(1, math.ceil(float(np.max(steps)) / plant.dt))
        model = FitModel(PlantModel(plant), [], one, STEPS_AT_STAMPS * longest, np.ones(len(plant.states)))
        x = free_run(model, np.zeros(0), start[:, None])
        return model.bind(np.zeros((0, 1))).outputs(x[:, None])[:, 0].T

    def score(self, X: Any, y: Any, sample_weight: Any = None, groups: Any = None) -> float:
        """R2 of the free run; initial states are estimated from y with the parameters held."""
        check_is_fitted(self, "simulator_")
        runs = self._resolve(X, y, groups)
        held = replace_params(self, self.simulator_).fit(X, y, groups=groups)
        truth = runs.stack([np.asarray(run.y) for run in runs])
        predicted = self.predict(X, groups=groups, x0=held.x0_).reshape(truth.shape)
        weight = np.ones(len(truth)) if sample_weight is None else np.asarray(sample_weight)
        known = np.isfinite(truth)
        each = [r2_score(y[k], f[k], sample_weight=weight[k]) for y, f, k in zip(truth.T, predicted.T, known.T)]
        return float(np.mean(each))

    # ---- parts ------------------------------------------------------------------------------------------------------
    def _check_shape(self, y: Any) -> None:
        """Outputs there must be; of one output scikit-learn asks for one dimension."""
        if y is None:
            raise DataError(
                "CalibratedSimulator requires y to be passed, but the target y is None: y is missing, the measured outputs that "
                "the simulator is fitted to; give fit(X, y)."
            )
        if getattr(y, "shape", ())[1:] == (1,) and not self.__sklearn_tags__().target_tags.multi_output:
            warnings.warn(
                "A column-vector y was passed when a 1d array was expected: the simulator has one output, give y[:, 0].",
                DataConversionWarning,
                stacklevel=4,
            )

    def __sklearn_tags__(self) -> Any:
        tags = super().__sklearn_tags__()
        outputs = getattr(self.simulator, "outputs", None)
        tags.target_tags.multi_output = outputs is None or (not isinstance(outputs, str) and len(outputs) != 1)
        tags.target_tags.single_output = True
        tags.regressor_tags.poor_score = True  # a simulator has the form it has
        return tags

    def _resolve(self, X: Any, y: Any, groups: Any, *, reset: bool = False) -> Runs:
        """Checks that scikit-learn asks for, then runs."""
        inputs = getattr(self.simulator, "inputs", None)
        X = no_inputs(y, groups) if X is None and inputs is not None and not len(inputs) else X
        X = by_name(X, inputs, [name for name in (self.run, self.time) if name is not None] or None, warn=reset)
        y = by_name(y, getattr(self.simulator, "outputs", None), warn=reset)
        fewest = 0 if inputs is not None and len(inputs) == 0 else 1
        is_frame = is_checked_frame(self, X, reset)
        if not is_frame and (y is None or groups is not None):
            X = validate_data(
                self, X, reset=reset, ensure_all_finite=False, dtype="numeric", ensure_min_features=fewest
            )
        elif not is_frame:
            try:
                whole = without_nan(y)
                X, checked = validate_data(
                    self, X, whole, reset=reset, multi_output=True, y_numeric=True, ensure_min_features=fewest
                )
                y = checked if whole is y else y
            except ValueError as error:
                if "NaN" in str(error) or "infinity" in str(error):
                    # names the row
                    resolve_runs(X, y, run=self.run, time=self.time, allow_uneven=True, unmeasured=True)
                raise
        return resolve_runs(
            X,
            y,
            groups=groups,
            run=self.run,
            time=self.time,
            allow_uneven=True,
            dt=getattr(self.simulator, "dt", None),
            unmeasured=True,
            min_rows=2 if y is not None else 1,
        )

    def _from_stamp_to_stamp(self, runs: Runs, plant: Plant) -> tuple[Runs, bool, np.ndarray]:
        """The runs with rows in their gaps, whether rows are uneven, and which begin a run that was given."""
        if self.time is None:
            return runs, False, np.arange(len(runs))
        runs, uneven, first = with_rows_in_gaps(runs, plant.dt, plant.hold, self.time)
        if uneven and plant.access != "rhs":
            raise DataError(
                f"time={self.time!r}: sampling is uneven, and {type(self.simulator).__name__} has no right-hand side that could be "
                "integrated from stamp to stamp: resample to an even grid, or give the simulator rhs."
            )
        return runs, uneven, first


def _relative(changes: np.ndarray, theta: np.ndarray) -> np.ndarray:
    """Changes (n, k) of parameters in units of their values (of 1 for those at 0), each of length 1."""
    parts = changes / np.where(theta != 0, theta, 1.0)
    return parts / np.linalg.norm(parts, axis=1, keepdims=True)


def _warn(what: str) -> None:
    """A warning that points to the line that called ``fit``."""
    warnings.warn(what, ConvergenceWarning, stacklevel=4)


def _worse_than_constant(record: Record, residual: np.ndarray, sd: np.ndarray) -> bool:
    """Whether a free run leaves more than twice the squares that the mean of every output leaves."""
    constant = record.residual(np.repeat(record.level[:, None], record.n_samples, axis=1))
    return bool(np.sum((residual.T / sd) ** 2) > 2 * np.sum((constant.T / sd) ** 2))


def replace_params(estimator: CalibratedSimulator, simulator: Any) -> CalibratedSimulator:
    """The same estimator with no parameter free: only initial states are fitted."""
    return CalibratedSimulator(
        simulator, [], fit_x0=True, max_iter=estimator.max_iter, run=estimator.run, time=estimator.time
    )
