"""State-space models with unknown initial states, linear or neural."""

from __future__ import annotations

from numbers import Integral, Real
from typing import Any, NamedTuple

import numpy as np
from sklearn.base import BaseEstimator, _fit_context
from sklearn.preprocessing import StandardScaler
from sklearn.utils import check_random_state
from sklearn.utils._param_validation import Interval, StrOptions
from sklearn.utils.validation import check_is_fitted

from sksurrogate._dynamic import FreeRunMixin, lengthened
from sksurrogate.compose._state_fit import cut_pieces, first_rows, fit_linear, fit_networks
from sksurrogate.exceptions import DataError
from sksurrogate.kernels.state_evidence import run_variance, weigh_states
from sksurrogate.kernels.state_model import StateModel
from sksurrogate.kernels.state_space import StateFit, simulate, start_states
from sksurrogate.runs import Runs

#: What keeps free runs of state-space models from leaving.
STEADY_STATES = "Give fewer states or longer runs; with networks a larger alpha also helps."


class StateMatrices(NamedTuple):
    """A linear model in units of u and y.

    Attributes
    ----------
    A, B, C, D : ndarray
    b, c : ndarray
        Constants of the next state and of the output.
    """

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    b: np.ndarray
    c: np.ndarray


class StateSpaceRegressor(FreeRunMixin, BaseEstimator):
    """``x[t+1] = f(x[t], u[t])``, ``y[t] = g(x[t], u[t])``, fitted on the free run with unknown initial states.

    Linear without hidden layers: subspace start (N4SID), then output error. With hidden layers f and g are the refined
    linear model plus a tanh network each, trained on the free run of pieces that grow to whole runs, so that the fit starts at a stable model.

    Parameters
    ----------
    n_states : int, default=2
        Order.
    hidden_layer_sizes : tuple of int, default=()
        Of the networks in f and in g; empty: linear.
    feedthrough : bool, default=False
        Whether the current input enters y[t] at once.
    alpha : float or "evidence", default="evidence"
        Penalty on the networks' weights beside the mean squared error, in units of standardised data. "evidence": penalty and
        noise by MacKay's evidence, initial states integrated out; steps to models that diverge from other initial states are refused.
    refine : bool, default=True
        Whether a linear model is refined by output error; False: the subspace model.
    horizon : int, optional
        Multiple shooting: rows of a piece with an initial state of its own; None: whole runs. Shorter pieces are
        easier to fit and say less about the long run.
    n_initial : int, optional
        Rows of ``y0`` from which the initial state is estimated; default ``2 * n_states + 2``.
    n_starts : int, default=1
        Random starts of the networks; the best on the training runs stays.
    max_iter : int, default=100
        Steps of Levenberg-Marquardt on whole runs, half as many on each length of pieces.
    init : {"mean", "steady"} or array (n_initial, n_outputs), default="mean"
        Start where ``predict`` gets no ``y0``: mean state of the training runs, the model's rest at the first input,
        or first rows.
    run : None, column name, int or "index"
        Where X says which run a row belongs to; ``groups`` wins.
    random_state : int, RandomState or None

    Attributes
    ----------
    A_, B_, C_, D_ : ndarray
        Of the linear part, in standardised units of u and y.
    poles_ : ndarray of complex (n_states,)
        Eigenvalues of A_.
    x0_ : ndarray (n_runs, n_states)
        Initial states of the training runs.
    free_run_rmse_ : float
        On the training runs from the fitted initial states.
    noise_ : ndarray (n_outputs,)
        Standard deviation of the residual of the free runs, in units of y.
    alpha_ : float
        The penalty; 0 for a linear model.
    n_initial_ : int
    n_iter_ : int
    n_features_in_ : int

    Notes
    -----
    The loss is the simulation error. There is no one-step form, because the state is not measured. ``y0`` is turned into
    an initial state by least squares over these rows, with the training states as prior. The free run and its exact
    sensitivities are banded solves over the whole time axis.

    References
    ----------
    Lie, *Surrogate and Hybrid Models for Control*, SIMS 60 (2019), sections 2.6 and 5. Van Overschee, De Moor,
    *N4SID*, Automatica 30 (1994).

    Examples
    --------
    >>> from sksurrogate.compose import StateSpaceRegressor
    >>> from sksurrogate.datasets import make_reactor_runs
    >>> X, y, groups = make_reactor_runs(6, 100, y0_range=(4.0, 8.0), u_range=(0.1, 0.2), random_state=0)
    >>> model = StateSpaceRegressor(1, hidden_layer_sizes=(4,), random_state=0).fit(X, y, groups=groups)
    >>> round(model.score(X, y, groups=groups), 2)
    1.0
    """

    u_mean_: np.ndarray
    u_spread_: np.ndarray
    __metadata_request__predict = {"return_std": True}

    _parameter_constraints: dict = {
        "n_states": [Interval(Integral, 1, None, closed="left")],
        "hidden_layer_sizes": ["array-like"],
        "feedthrough": ["boolean"],
        "alpha": [StrOptions({"evidence"}), Interval(Real, 0, None, closed="left")],
        "refine": ["boolean"],
        "horizon": [Interval(Integral, 1, None, closed="left"), None],
        "n_initial": [Interval(Integral, 1, None, closed="left"), None],
        "n_starts": [Interval(Integral, 1, None, closed="left")],
        "max_iter": [Interval(Integral, 1, None, closed="left")],
        "init": [StrOptions({"mean", "steady"}), "array-like"],
        "run": [None, str, Integral],
        "random_state": ["random_state"],
    }

    def __init__(
        self,
        n_states: int = 2,
        *,
        hidden_layer_sizes: tuple[int, ...] = (),
        feedthrough: bool = False,
        alpha: float | str = "evidence",
        refine: bool = True,
        horizon: int | None = None,
        n_initial: int | None = None,
        n_starts: int = 1,
        max_iter: int = 100,
        init: Any = "mean",
        run: Any = None,
        random_state: Any = None,
    ):
        self.n_states = n_states
        self.hidden_layer_sizes = hidden_layer_sizes
        self.feedthrough = feedthrough
        self.alpha = alpha
        self.refine = refine
        self.horizon = horizon
        self.n_initial = n_initial
        self.n_starts = n_starts
        self.max_iter = max_iter
        self.init = init
        self.run = run
        self.random_state = random_state

    @_fit_context(prefer_skip_nested_validation=False)
    def fit(self, X: Any, y: Any, groups: Any = None) -> StateSpaceRegressor:
        """Fit f, g and the initial state of every run.

        Parameters
        ----------
        X : array-like (n_samples, n_inputs)
        y : array-like (n_samples,) or (n_samples, n_outputs)
        groups : array-like (n_samples,), optional

        Returns
        -------
        self
        """
        if not all(isinstance(size, Integral) and size >= 1 for size in self.hidden_layer_sizes):
            raise ValueError(
                f"hidden_layer_sizes={self.hidden_layer_sizes!r}: expected units per layer, each at least 1; () for none."
            )
        self.n_initial_ = int(self.n_initial or 2 * self.n_states + 2)
        runs = self._resolve(X, y, groups, reset=True, min_rows=2)
        inputs = StandardScaler().fit(np.concatenate([run.X for run in runs]))
        self.u_mean_, self.u_spread_ = inputs.mean_, inputs.scale_
        U, Y = [self._scaled_u(run.X) for run in runs], [(run.y - self.y_mean_) / self.y_spread_ for run in runs]
        if self.horizon is not None:
            U, Y = cut_pieces(U, self.horizon), cut_pieces(Y, self.horizon)
        networks = np.size(self.hidden_layer_sizes) > 0
        linear = fit_linear(U, Y, self.n_states, self.feedthrough, self.max_iter, self.refine or networks)
        fit, model = linear, StateModel(self.n_states, U[0].shape[1], Y[0].shape[1], (), self.feedthrough)
        self.alpha_ = 0.0
        hidden = tuple(int(n) for n in np.atleast_1d(np.asarray(self.hidden_layer_sizes, dtype=int)))
        if hidden:
            model = StateModel(self.n_states, U[0].shape[1], Y[0].shape[1], hidden, self.feedthrough)
            rng = check_random_state(self.random_state)
            fit, self.alpha_ = fit_networks(
                model, linear, U, Y, alpha=self.alpha, max_iter=self.max_iter, n_starts=self.n_starts, rng=rng
            )
        self._store(model, fit, U, Y)
        U, n = [self._scaled_u(run.X) for run in runs], self.n_initial_
        first = np.stack([(lengthened(run.y[:n], n) - self.y_mean_) / self.y_spread_ for run in runs])
        self._watch_training_runs(runs, self._outputs(self._start(U, first), U), STEADY_STATES)
        return self

    def predict(self, X: Any, y0: Any = None, groups: Any = None, return_std: bool = False) -> Any:
        """Free run.

        Parameters
        ----------
        X : array-like (n_samples, n_inputs)
        y0 : array-like (n_initial, n_outputs) or (n_runs, n_initial, n_outputs), optional
            Outputs at the first rows of each run, from which its initial state is estimated; without it ``init`` decides.
        groups : array-like (n_samples,), optional
        return_std : bool, default=False
            Also the standard deviation of a new measurement: noise, weights, and the initial state.

        Returns
        -------
        ndarray (n_samples,) or (n_samples, n_outputs)
            The first rows are ``y0`` where it is given; with ``return_std`` a pair of arrays.

        Raises
        ------
        SimulationDiverged
            The free run became infinite or nan or went far beyond the training outputs.
        """
        check_is_fitted(self, "theta_")
        runs = self._resolve(X, None, groups)
        U = [self._scaled_u(run.X) for run in runs]
        given = y0 if y0 is not None or isinstance(self.init, str) else self.init
        if given is not None:
            first = self._first_rows(given, runs, "y0" if y0 is not None else "init")
            x0 = self._start(U, (first - self.y_mean_) / self.y_spread_)
        elif self.init == "mean":
            x0 = np.broadcast_to(self.x_mean_, (len(runs), self.n_states))
        elif self.init == "steady":
            x0 = self._rest(np.stack([u[0] for u in U]))
        else:
            raise ValueError(f'init={self.init!r} must be "mean", "steady" or an array of first rows.')
        out = self._outputs(x0, U)
        self._refuse_far(runs, out, STEADY_STATES)
        if given is not None:
            for r, part in enumerate(out):
                part[: self.n_initial_] = first[r][: len(part)]
        if not return_std:
            return self._shaped(runs, out)
        n_seen = 0 if given is None else self.n_initial_
        return self._shaped(runs, out), self._shaped(runs, [self._deviation(x, u, n_seen) for x, u in zip(x0, U)])

    def matrices(self) -> StateMatrices:
        """The linear model in units of u and y: ``x' = A x + B u + b``, ``y = C x + D u + c``.

        Returns
        -------
        StateMatrices
            For controllers (``control.ss(*model.matrices()[:4], dt)``); states keep the scale of the fit.

        Raises
        ------
        DataError
            The model has hidden layers.
        """
        check_is_fitted(self, "theta_")
        if self.model_.hidden:
            raise DataError(
                f"hidden_layer_sizes={self.hidden_layer_sizes!r}: a network has no matrices; fit hidden_layer_sizes=(), "
                "or differentiate predict about an operating point."
            )
        b = self.model_.f.parts(self.theta_[: self.model_.f.size])[1]
        c = self.model_.g.parts(self.theta_[self.model_.f.size :])[1]
        B, C = self.B_ / self.u_spread_, self.C_ * self.y_spread_[:, None]
        D = self.D_ * self.y_spread_[:, None] / self.u_spread_
        return StateMatrices(
            self.A_, B, C, D, b - B @ self.u_mean_, self.y_mean_ + self.y_spread_ * c - D @ self.u_mean_
        )

    # ---- parts ------------------------------------------------------------------------------------------------------
    def _ahead(self, runs: Runs, r: int, history: int) -> np.ndarray:
        run, slide = runs[r], np.lib.stride_tricks.sliding_window_view
        windows = list(slide(self._scaled_u(run.X), history, axis=0).transpose(0, 2, 1))
        past = slide((run.y - self.y_mean_) / self.y_spread_, self.n_initial_, axis=0).transpose(0, 2, 1)
        return np.stack([part[-1] for part in self._outputs(self._start(windows, past[: len(windows)]), windows)])

    def _scaled_u(self, U: np.ndarray) -> np.ndarray:
        return (U - self.u_mean_) / self.u_spread_

    def _store(self, model: StateModel, fit: StateFit, U: list[np.ndarray], Y: list[np.ndarray]) -> None:
        """Everything that is learned."""
        self.model_, self.theta_, self.x0_, self.n_iter_ = model, fit.theta, fit.x0, max(fit.n_iter, 1)
        W, _ = model.f.parts(fit.theta[: model.f.size])[:2]
        V, _ = model.g.parts(fit.theta[model.f.size :])[:2]
        n = model.n_states
        self.A_, self.B_, self.C_ = W[:n].T.copy(), W[n:].T.copy(), V[:n].T.copy()
        self.D_ = V[n:].T.copy() if model.feedthrough else np.zeros((model.n_outputs, model.n_inputs))
        self.poles_ = np.linalg.eigvals(self.A_)
        self.x_mean_ = fit.x.mean(axis=0)
        error = model.output(fit.theta, fit.x, np.concatenate(U)) - np.concatenate(Y)
        power = float(np.mean(error**2))
        spread = np.cov(fit.x.T).reshape(n, n) + np.cov(fit.x0.T).reshape(n, n) if len(fit.x0) > 1 else np.cov(fit.x.T)
        spread = np.reshape(spread, (n, n)) + 1e-6 * np.eye(n)
        self.x_precision_ = max(power, 1e-10) * np.linalg.inv(4.0 * spread)
        self.free_run_rmse_ = float(np.sqrt(np.mean((error * self.y_spread_) ** 2)))
        self._evidence = weigh_states(
            model, fit, np.concatenate(U), np.concatenate(Y), first_rows(U), max(self.alpha_, np.finfo(float).tiny)
        )
        self.noise_ = np.sqrt(self._evidence.noise) * self.y_spread_

    def _deviation(self, x0: np.ndarray, U: np.ndarray, n_seen: int) -> np.ndarray:
        """Standard deviation of new measurements along one free run, (n_steps, n_outputs), in units of y."""
        x = simulate(self.model_, self.theta_, x0[None], U, np.zeros(1, int))
        variance = run_variance(self.model_, self.theta_, x, U, self._evidence, self.x_precision_, n_seen)
        return np.sqrt(variance) * self.y_spread_

    def _start(self, U: list[np.ndarray], first: np.ndarray) -> np.ndarray:
        """Initial states from first rows (n_runs, n_initial, n_outputs), shorter runs from what they have."""
        n, first = self.n_initial_, first.copy()
        windows = np.stack([u[np.minimum(np.arange(n), len(u) - 1)] for u in U])
        for r, u in enumerate(U):
            first[r, len(u) :] = np.nan
        return start_states(self.model_, self.theta_, windows, first, self.x_mean_, self.x_precision_)

    def _rest(self, u: np.ndarray) -> np.ndarray:
        """States after a long stay at an input, (n_runs, n_states); the mean state where the model does not rest."""
        x = np.broadcast_to(self.x_mean_, (len(u), self.n_states))
        with np.errstate(all="ignore"):
            for _ in range(2000):
                x = self.model_.following(self.theta_, x, u)
        return np.where(np.isfinite(x).all(axis=1, keepdims=True), x, self.x_mean_)

    def _outputs(self, x0: np.ndarray, U: list[np.ndarray]) -> list[np.ndarray]:
        """Free runs in units of y."""
        rows, starts = np.concatenate(U), first_rows(U)
        x = simulate(self.model_, self.theta_, x0, rows, starts)
        with np.errstate(all="ignore"):
            y = self.model_.output(self.theta_, x, rows) * self.y_spread_ + self.y_mean_
        return [y[a : a + len(u)] for a, u in zip(starts, U)]
