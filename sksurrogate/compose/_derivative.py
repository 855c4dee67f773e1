"""Continuous-time models: (y, u) -> dy/dt, run freely through an integrator."""

from __future__ import annotations

import warnings
from numbers import Integral, Real
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from sklearn.base import BaseEstimator, _fit_context, clone
from sklearn.utils._param_validation import HasMethods, Interval, StrOptions
from sklearn.utils.validation import check_is_fitted

from sksurrogate._dynamic import FreeRunMixin, lengthened
from sksurrogate.compose._lagged import fitted
from sksurrogate.compose._long_runs import long_runs, watched
from sksurrogate.compose._network import agrees, describe_network
from sksurrogate.compose._weak import WeakForm
from sksurrogate.exceptions import DataError
from sksurrogate.export._agreement import is_affine
from sksurrogate.kernels.integrate import rk4
from sksurrogate.linear import SparseRegressor
from sksurrogate.linear._base import BaseBlockedRegressor
from sksurrogate.linear._equation import equation, named_terms
from sksurrogate.physics._free_run import LONG_RUN, hold_inputs
from sksurrogate.runs import Runs

#: Change of a training run, in standard deviations of the outputs, that one more halving of the substep may bring.
SUBSTEPS_SETTLED = 1e-3
#: Training rows whose free run is watched at most: the substeps that these ask for do for the others.
MOST_WATCHED = 10_000
#: Up to so many runs at once a step costs what one run costs: then many samples of them at a time are cheaper.
FEW_RUNS = 40
#: Rounds in which a regressor that is not linear in its parameters is fitted to corrected weak-form targets.
WEAK_FORM_ROUNDS = 4


class DerivativeRegressor(FreeRunMixin, BaseEstimator):
    """``dy/dt = f(y, u)`` around any regressor f.

    Parameters
    ----------
    estimator : regressor
        Learns f; features are the outputs, then the inputs.
    dt : float, default=1.0
        Sample time; not used with ``time``.
    hold : {"zoh", "foh"}, default="zoh"
        Inputs are held from sample to sample, or joined linearly.
    window : int, default=10
        Sample intervals of a test function where derivatives are not given: more for more noise, fewer for faster
        changes. 1 is the plain difference of neighbours.
    method : {"RK4", "LSODA", "Radau", "BDF", "RK45", "DOP853"}, default="RK4"
        Integrator of the free run; the others are scipy's and go run by run: "LSODA", "Radau" and "BDF" for
        stiff models.
    n_sub : int, optional
        Substeps of "RK4" in a sample; None: chosen in ``fit`` on the training runs.
    init : "mean" or array (1, n_outputs), default="mean"
        First row where ``predict`` gets no ``y0``: mean of the training outputs.
    run : None, column name, int or "index"
        Where X says which run a row belongs to; ``groups`` wins.
    time : column name or int, optional
        Column of X that holds the time; sampling may be uneven. It is not a feature.

    Attributes
    ----------
    estimator_ : fitted regressor
    n_initial_ : int
        1: the first row of a run is its whole past.
    n_sub_ : int
    free_run_rmse_ : float
        On the training runs; inf where one diverges. Of more than 10 000 rows on runs spread evenly over them, or on the first rows
        of one run, as ``n_sub_`` and ``left_region_``.
    left_region_ : list
        Labels of the training runs whose free run leaves the range of the outputs by more than half of it (a warning says so).
    output_names_, input_names_ : list of str
        Columns of the frames, else "y" and "u" (numbered where there are several).
    n_features_in_ : int

    Notes
    -----
    With ``dydt`` (measured, or a simulator's own: :func:`~sksurrogate.datasets.simulate_experiments`) f is an ordinary
    regression. Without, the weak form carries the derivative over to a test function, ``int phi f dt = -int phi' y dt``.
    A linear model, also behind transformers that make features of (y, u), is fitted to these integrals of its
    features at once. Any other regressor is fitted at the means of (y, u) under phi, a few times over, each time to
    the mean of dy/dt less what its own curvature within the window amounts to. All outputs must be states: a plant
    with more states than outputs asks for :class:`StateSpaceRegressor` or lags.

    References
    ----------
    Lie, *Surrogate and Hybrid Models for Control*, SIMS 60 (2019), sections 2.6 and 4.3, Figure 5. Messenger, Bortz,
    *Weak SINDy*, Multiscale Model. Simul. 19 (2021).

    Examples
    --------
    >>> from sklearn.linear_model import LinearRegression
    >>> from sklearn.pipeline import make_pipeline
    >>> from sklearn.preprocessing import PolynomialFeatures
    >>> from sksurrogate.compose import DerivativeRegressor
    >>> from sksurrogate.datasets import make_reactor_runs
    >>> X, y, groups = make_reactor_runs(8, 100, u_range=(0.1, 0.15), random_state=0)
    >>> model = DerivativeRegressor(make_pipeline(PolynomialFeatures(3), LinearRegression()), dt=0.02)
    >>> round(model.fit(X, y, groups=groups).score(X, y, groups=groups), 2)
    1.0
    """

    _integrates = True
    _is_network = False
    __metadata_request__fit = {"dydt": True}

    _parameter_constraints: dict = {
        "estimator": [HasMethods(["fit", "predict"])],
        "dt": [Interval(Real, 0, None, closed="neither")],
        "hold": [StrOptions({"zoh", "foh"})],
        "window": [Interval(Integral, 1, None, closed="left")],
        "method": [StrOptions({"RK4", "LSODA", "Radau", "BDF", "RK45", "DOP853"})],
        "n_sub": [Interval(Integral, 1, None, closed="left"), None],
        "init": [StrOptions({"mean"}), "array-like"],
        "run": [None, str, Integral],
        "time": [None, str, Integral],
    }

    def __init__(
        self,
        estimator: Any,
        dt: float = 1.0,
        *,
        hold: str = "zoh",
        window: int = 10,
        method: str = "RK4",
        n_sub: int | None = None,
        init: Any = "mean",
        run: Any = None,
        time: Any = None,
    ):
        self.estimator = estimator
        self.dt = dt
        self.hold = hold
        self.window = window
        self.method = method
        self.n_sub = n_sub
        self.init = init
        self.run = run
        self.time = time

    @_fit_context(prefer_skip_nested_validation=False)
    def fit(self, X: Any, y: Any, dydt: Any = None, groups: Any = None) -> DerivativeRegressor:
        """Fit f.

        Parameters
        ----------
        X : array-like (n_samples, n_inputs)
        y : array-like (n_samples,) or (n_samples, n_outputs)
        dydt : array-like, shape of y, optional
            Derivatives at the rows, with the input that acts from the row on; None: weak form.
        groups : array-like (n_samples,), optional

        Returns
        -------
        self
        """
        runs = self._resolve(X, y, groups, reset=True, min_rows=2 if dydt is None else 1)
        self.n_initial_ = 1
        o, m = len(self.y_mean_), runs[0].X.shape[1]
        self.output_names_ = list(runs.output_names or (["y"] if o == 1 else [f"y{k}" for k in range(o)]))
        self.input_names_ = list(runs.input_names or (["u"] if m == 1 else [f"u{k}" for k in range(m)]))
        if dydt is None:
            self._fit_weak(WeakForm(runs, self.window, self.hold == "zoh"))
        else:
            slopes = np.asarray(dydt, dtype=float).reshape(len(np.asarray(dydt)), -1)
            if slopes.shape != (runs.n_samples, len(self.y_mean_)):
                raise DataError(
                    f"dydt has shape {np.shape(dydt)}, expected that of y, ({runs.n_samples}, {len(self.y_mean_)}): "
                    "one derivative per row and output."
                )
            points = np.concatenate([np.concatenate([run.y, run.X], axis=1) for run in runs])
            target = np.concatenate(runs.unstack(slopes))
            if not np.all(np.isfinite(target)):
                raise DataError(
                    "dydt is not finite in some rows: leave these rows out, or leave dydt out for the weak form."
                )
            self._keep(fitted(self.estimator, points, _narrow(target)), points)
        self._choose_substeps(watched(runs, MOST_WATCHED))
        return self

    def predict(self, X: Any, y0: Any = None, groups: Any = None) -> np.ndarray:
        """Free run through the integrator.

        Parameters
        ----------
        X : array-like (n_samples, n_inputs)
        y0 : array-like (1, n_outputs) or (n_runs, 1, n_outputs), optional
            Outputs at the first row of each run; without it ``init`` decides.
        groups : array-like (n_samples,), optional

        Returns
        -------
        ndarray (n_samples,) or (n_samples, n_outputs)

        Raises
        ------
        SimulationDiverged
            The free run became infinite or nan or went far beyond the training outputs.
        """
        check_is_fitted(self, "estimator_")
        runs = self._resolve(X, None, groups)
        first = self._start_rows(y0, runs)
        out = self._run_free([run.X for run in runs], [run.t for run in runs], first[:, 0], self.n_sub_)
        self._refuse_far(runs, out, 'Train on more of (y, u), or try method="LSODA" if the model is stiff.')
        return self._shaped(runs, out)

    def _ahead(self, runs: Runs, r: int, history: int) -> np.ndarray:
        run, slide = runs[r], np.lib.stride_tricks.sliding_window_view
        windows, times = slide(run.X, history, axis=0).transpose(0, 2, 1), slide(run.t, history)
        return np.stack(self._run_free(list(windows), list(times), run.y[: len(times)], self.n_sub_))[:, -1]

    def derivative(self, X: Any, y: Any) -> np.ndarray:
        """The fitted f at outputs and inputs: dy/dt per time unit, shape of y.

        Parameters
        ----------
        X : array-like (n_samples, n_inputs)
        y : array-like (n_samples,) or (n_samples, n_outputs)

        Returns
        -------
        ndarray, shape of y
        """
        check_is_fitted(self, "estimator_")
        rows = np.asarray(y, dtype=float)
        points = np.concatenate([rows.reshape(len(rows), -1), np.asarray(X, dtype=float)], axis=1)
        return self._f(points).reshape(rows.shape)

    def equations(self, digits: int = 4) -> list[str]:
        """The differential equations as text, where the model is linear in named features.

        Parameters
        ----------
        digits : int, default=4
            Significant digits.

        Returns
        -------
        list of str
            One per output, such as ``"dy/dt = 8 - 2 y"``.

        Raises
        ------
        DataError
            The regressor is not linear in features, a transformer before it has no ``get_feature_names_out``, or a scaler comes
            before features that are not linear (behind them it is folded into the coefficients).
        """
        check_is_fitted(self, "estimator_")
        steps = [step for _, step in getattr(self.estimator_, "steps", None) or [("model", self.estimator_)]]
        coef, constant, names = named_terms(steps[-1], steps[:-1], [*self.output_names_, *self.input_names_])
        left = [f"d{name}/dt" for name in self.output_names_]
        return [equation(name, c, names, b, digits) for name, c, b in zip(left, coef, constant)]

    # ---- parts ------------------------------------------------------------------------------------------------------
    def _fit_weak(self, weak: WeakForm) -> None:
        """One linear fit to the integrals of the features, or a few rounds of corrected targets."""
        found = clone(self.estimator)
        steps = list(getattr(found, "steps", None) or [("model", found)])
        model = steps[-1][1]
        own = isinstance(model, BaseBlockedRegressor) and model.features is None
        if own or type(model).__module__.startswith("sklearn.linear_model"):
            features = weak.points
            for _, step in steps[:-1]:
                if step is not None and not isinstance(step, str):
                    features = step.fit_transform(features)
            features = features.toarray() if hasattr(features, "toarray") else np.asarray(features)
            # windows overlap: the evidence of terms must not take every row for a witness of its own
            weight = {"sample_weight": weak.weights} if isinstance(model, SparseRegressor) else {}
            model.fit(weak.mean(features), _narrow(weak.targets), **weight)
            if not hasattr(model, "coef_") or is_affine(model):  # no link, through which no integral goes
                self._keep(found, weak.points)
                return
        target = weak.targets
        for _ in range(WEAK_FORM_ROUNDS):
            self._keep(fitted(self.estimator, weak.centres, _narrow(target)), weak.centres)
            target = weak.targets + self._f(weak.centres) - weak.mean(self._f(weak.points))

    def _keep(self, estimator: Any, points: np.ndarray) -> None:
        """The fitted regressor, and whether it is the network that it looks like."""
        self.estimator_, net = estimator, describe_network(estimator)
        self._is_network = net is not None and agrees(net, estimator, points)

    def _f(self, points: np.ndarray) -> np.ndarray:
        net = describe_network(self.estimator_) if self._is_network else None
        values = self.estimator_.predict(points) if net is None else net(points)
        return np.asarray(values, dtype=float).reshape(len(points), -1)

    def _choose_substeps(self, runs: Runs) -> None:
        """Double the substeps until the training runs no longer move."""
        first = np.stack([run.y[0] for run in runs])
        given = [run.X for run in runs], [run.t for run in runs], first
        out = self._run_free(*given, self.n_sub or 1)
        self.n_sub_ = self.n_sub or 1
        while self.n_sub is None and not self._flat(runs) and self.method == "RK4" and self.n_sub_ < 64:
            finer = self._run_free(*given, 2 * self.n_sub_)
            moved = max(np.nanmax(np.abs(a - b) / self.y_spread_, initial=0.0) for a, b in zip(out, finer))
            lost = any(np.isfinite(b).sum() > np.isfinite(a).sum() for a, b in zip(out, finer))
            if moved <= SUBSTEPS_SETTLED and not lost:
                break
            out, self.n_sub_ = finer, 2 * self.n_sub_
        if self.n_sub is None and self.n_sub_ == 64:
            warnings.warn(
                'the fitted model is stiff for its sample time: 64 substeps were taken; try method="LSODA".',
                RuntimeWarning,
                stacklevel=3,
            )
        self._watch_training_runs(
            runs,
            out,
            "Train on more of (y, u), take fewer knots or terms, a penalty (Ridge) or a network, or fit the free run itself: "
            'RecursivePredictor(loss="shooting").',
        )
        error = np.concatenate([a[1:] - run.y[1:] for a, run in zip(out, runs)])
        mean = np.mean(error**2) if len(error) else np.nan
        self.free_run_rmse_ = float(np.sqrt(mean)) if np.isfinite(mean) else float("inf")

    def _flat(self, runs: Runs) -> bool:
        """Whether f goes in steps, as forests do: finer integration has nothing to converge to."""
        points = np.concatenate([np.concatenate([run.y, run.X], axis=1) for run in runs])
        points = points[:: max(len(points) // 64, 1)]
        moved = points.copy()
        moved[:, : len(self.y_mean_)] += 1e-5 * self.y_spread_
        return bool(np.array_equal(self._f(points), self._f(moved)))

    def _run_free(
        self, inputs: list[np.ndarray], times: list[np.ndarray], first: np.ndarray, n_sub: int
    ) -> list[np.ndarray]:
        """Free runs of any lengths; nan from where a run has diverged."""
        order = 0 if self.hold == "zoh" else 1
        if self.method != "RK4":
            return [self._adaptive(U, t, start, order) for U, t, start in zip(inputs, times, first)]
        net = describe_network(self.estimator_) if self._is_network else None
        far = 1e7 * (self.y_spread_ + np.abs(self.y_mean_))[:, None]

        def slopes(t: Any, x: np.ndarray, u: np.ndarray) -> np.ndarray:
            flat, acting = x.reshape(len(x), -1), np.broadcast_to(u, (len(u), *x.shape[1:])).reshape(len(u), -1)
            lost = ~(np.abs(flat - self.y_mean_[:, None]) <= far).all(axis=0)
            points = np.concatenate([np.where(lost, self.y_mean_[:, None], flat), acting]).T
            values = self.estimator_.predict(points) if net is None else net(points)
            f = np.asarray(values, dtype=float).reshape(len(points), -1).T
            return (np.where(lost, np.nan, f) if lost.any() else f).reshape(x.shape)

        longest = max(len(U) for U in inputs)
        if longest > LONG_RUN or len(inputs) <= FEW_RUNS:
            return long_runs(slopes, inputs, times, first, order, n_sub, self.y_spread_)
        U = np.stack([lengthened(u, longest) for u in inputs])
        mean, half = hold_inputs(U, n_sub, order)
        widths = np.stack([lengthened(np.diff(t, append=t[-1] + 1.0), longest) for t in times], axis=1) / n_sub
        x = np.asarray(first, dtype=float).T
        out = np.empty((longest, *x.shape))
        for k in range(longest):  # every run has a width of its own where sampling is uneven
            out[k] = x
            if k + 1 < longest:
                ends = None if half is None else half[..., k]
                x = rk4(slopes, np.zeros(len(inputs)), x, mean[..., k], ends, widths[k])  # type: ignore[arg-type]
        return [out[: len(u), :, r] for r, u in enumerate(inputs)]

    def _adaptive(self, U: np.ndarray, t: np.ndarray, start: np.ndarray, order: int) -> np.ndarray:
        """One run by scipy, sample by sample of held input or as a whole."""
        out = np.full((len(U), len(start)), np.nan)
        out[0] = start
        edges = np.r_[0, np.flatnonzero(np.any(np.diff(U[:-1], axis=0), axis=1)) + 1, len(U) - 1]
        edges = np.unique(edges) if order == 0 else np.array([0, len(U) - 1])
        far, fine = 1e7 * (self.y_spread_ + np.abs(self.y_mean_)), 1e-9 * self.y_spread_

        def f(now: float, x: np.ndarray, a: int) -> np.ndarray:
            u = U[a] if order == 0 else np.array([np.interp(now, t, column) for column in U.T])
            if not np.all(np.abs(x - self.y_mean_) <= far):
                raise ArithmeticError
            return self._f(np.concatenate([x, u])[None])[0]

        for a, b in zip(edges[:-1].tolist(), edges[1:].tolist()):
            try:
                found = solve_ivp(
                    f, (t[a], t[b]), out[a], method=self.method, t_eval=t[a : b + 1], args=(a,), rtol=1e-6, atol=fine
                )
            except ArithmeticError:
                return out
            out[a : a + found.y.shape[1]] = found.y.T
            if not found.success:
                return out
        return out


def _narrow(target: np.ndarray) -> np.ndarray:
    """One output as scikit-learn's regressors want it."""
    return target if target.shape[1] > 1 else target[:, 0]
