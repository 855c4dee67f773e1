"""Feedforward networks as a scikit-learn regressor."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from numbers import Integral, Real
from typing import Any

import numpy as np
from sklearn.base import BaseEstimator, MultiOutputMixin, RegressorMixin, _fit_context
from sklearn.utils import check_random_state
from sklearn.utils._param_validation import HasMethods, Interval, StrOptions
from sklearn.utils.parallel import _get_threadpool_controller
from sklearn.utils.validation import _check_sample_weight

from sksurrogate._checks import checked
from sksurrogate._tables import unmasked
from sksurrogate.exceptions import DataError
from sksurrogate.neural._callbacks import CallbackSupportMixin, Tasks, with_callbacks
from sksurrogate.neural._evidence import Posterior, train_by_evidence
from sksurrogate.neural._net_access import NetAccess
from sksurrogate.neural._network import ACTIVATIONS
from sksurrogate.neural._problems import Rows
from sksurrogate.neural._settings import (
    epochs_of,
    read_activations,
    read_device,
    read_options,
    read_prior,
    read_sizes,
    read_smoothness,
)
from sksurrogate.neural._solvers import Plan, Validation
from sksurrogate.neural._training import (
    FEW_ROWS,
    GRADIENT,
    SMALL_NET,
    Torch,
    Trained,
    choose,
    memory_of,
    prepare,
    split,
    train,
    train_more,
    warn_if_falling,
)

#: Starts of the solvers where the user does not say.
STARTS = {"lm": 5}


class FNNRegressor(CallbackSupportMixin, NetAccess, MultiOutputMixin, RegressorMixin, BaseEstimator):
    r"""Feedforward network, by default fitted by Levenberg-Marquardt with variable projection.

    Layer l maps :math:`\xi^{(l)} = \sigma^{(l)}(\xi^{(l-1)} W^{(l)} + b^{(l)})`, :math:`\xi^{(0)} = x`,
    :math:`\hat y = \xi^{(n_l)}`. Inputs and outputs are standardised inside; ``coefs_`` and ``intercepts_`` belong to
    the raw ones.

    Parameters
    ----------
    hidden_layer_sizes : sequence of int, default=(5,)
        Units of the hidden layers; ``()`` is a linear model.
    activation : str or sequence of str, default="tanh"
        "identity", "binary_step", "logistic", "tanh", "relu" (paper, Table 1), "leaky_relu", "elu", "silu", "gelu",
        "softplus" or "softsign"; one for all hidden layers, or one for each. The output layer is "identity" unless the
        sequence has one entry more. Layers up to the last "binary_step" are drawn at random (thresholds at quantiles
        of the data) and stay, since their slope is zero everywhere; the layers above are trained.
    solver : str, default="auto"
        "lm": Levenberg-Marquardt; a linear output layer is eliminated (variable projection). "lbfgs": quasi-Newton with
        line search. Table 2 of the paper, in torch through skorch: "gd" (fixed rate), "line_search" (steepest descent
        with line search), "momentum", "nesterov", "adam"; also "adamw", "rmsprop". "auto": "lm" up to 300 weights,
        beyond that "lbfgs" up to 20000 rows, else "adam".
    alpha : float or "evidence", default=0.0
        Weight of the sum of squared weights (not of biases) beside the mean squared error, both in standardised units;
        with ``theta0`` of the squared distance from it. "evidence" ("lm"): penalty and noise by MacKay's evidence.
    learning_rate : float, default=None
        Of the solvers in torch; None: 0.01 ("adam", "adamw": 0.001; "line_search": 1, its first trial).
    batch_size : int, default=None
        Rows of a mini-batch of the solvers in torch; None: all, or 500 of more than 20000.
    max_epochs : int, default=None
        Iterations; None: 200 for "lm" (from the best start, after at most 60 from each), 1000 for "lbfgs", 1000 epochs
        in torch (with mini-batches as many as make 10000 steps, at least 10).
    n_starts : int, default=None
        Random starts, the best of which is kept; None: 5 for "lm", else 1.
    early_stopping : bool, default=False
        Whether to hold rows out and to keep the weights that are best on them.
    dtype : {"float64", "float32"}, default="float64"
        Of the solvers in torch; the others compute in float64.
    device : str, default="cpu"
        Of the solvers in torch, for example "cuda".
    random_state : int, RandomState instance or None, default=None
    net_params : dict, default=None
        Further parameters of the skorch net, for example ``{"optimizer__weight_decay": 0.01}``.
    loss : {"mse", "rss", "rmse"}, default="mse"
        Paper, section 3.3. All have the same minimiser, also with ``alpha``; ``loss_curve_`` is in this measure.
    tol : float, default=1e-10
        Gradient at which "lbfgs" stops, and gain over ten epochs at which the solvers in torch stop.
    validation_fraction : float, default=0.1
        Share of the rows held out by ``early_stopping``.
    n_iter_no_change : int, default=20
        Steps without a better validation loss after which ``early_stopping`` ends a search.
    prior : callable, default=None
        X -> y of a pre-specified solution to stay close to (paper, section 2.3), for example ``model.predict`` of a network
        fitted to a simulator while few rows of the plant are at hand.
    closeness : float, default=0.0
        Weight of the mean squared distance to ``prior`` at the rows of X, beside the mean squared error.
    slope, curvature : float, default=0.0
        Weights of the mean squared slopes and curvatures of the prediction at the rows of X, beside the mean squared error,
        in standardised units (paper, section 2.3). Not with "binary_step".
    momentum : float, default=0.9
        Of "momentum" and "nesterov" (paper, Table 2: rho).
    betas : (float, float), default=(0.9, 0.999)
        Decay rates of the moments of "adam" and "adamw" (paper, Table 2).
    theta0 : fitted FNNRegressor or (coefs, intercepts), default=None
        Prior estimate of weights and biases for raw inputs and outputs (paper, section 2.3): ``alpha`` weighs the squared
        distance from it, in standardised units, and the first start stands there.

    Attributes
    ----------
    coefs_, intercepts_ : list of ndarray (n_in, n_out), list of ndarray (n_out,)
        Weights and biases of every layer, for raw inputs and outputs.
    activations_ : tuple of str
        Activation of every layer, the output layer included.
    solver_ : str
        Solver that was used.
    alpha_ : float
        The penalty used.
    noise_ : ndarray (n_outputs,)
        With ``alpha="evidence"``: standard deviation of the noise, in units of y.
    loss_ : float
        Loss at the end (standardised outputs, penalty included).
    loss_curve_ : list of float
        Loss after each step of the best start; for sets of more than 20000 rows the steps on the subsample come first.
    validation_curve_ : list of float
        Mean squared error on the rows held out; empty without ``early_stopping``.
    n_iter_ : int
        Evaluations ("lm", of all starts), iterations ("lbfgs") or epochs.
    net_ : skorch.NeuralNetRegressor
        Initialised net with the fitted weights, for raw inputs; made on first access.
    n_features_in_ : int
    feature_names_in_ : ndarray of str

    See Also
    --------
    sklearn.neural_network.MLPRegressor : Networks by L-BFGS, SGD and Adam.

    Notes
    -----
    Repeated rows are merged (up to 5000 rows), so that integer weights and repeated rows give the same network.

    With scikit-learn 1.9, ``set_callbacks`` takes its callbacks (``ProgressBar``, ``ScoringMonitor`` or your own, which may
    stop a fit); they are called at every step from the best start, every iteration or every epoch.

    References
    ----------
    Lie, *Surrogate and Hybrid Models for Control*, SIMS 60 (2019), section 3.

    Examples
    --------
    >>> import numpy as np
    >>> from sksurrogate.neural import FNNRegressor
    >>> X = np.linspace(-1, 1, 50)[:, None]
    >>> net = FNNRegressor(random_state=0).fit(X, X[:, 0] ** 2)
    >>> bool(np.mean((net.predict(X) - X[:, 0] ** 2) ** 2) < 1e-10)
    True
    """

    _parameter_constraints: dict = {
        "hidden_layer_sizes": ["array-like", Interval(Integral, 1, None, closed="left")],
        "activation": [StrOptions(set(ACTIVATIONS)), list, tuple],
        "solver": [StrOptions({"auto", "lm", "lbfgs", *GRADIENT})],
        "alpha": [Interval(Real, 0, None, closed="left"), StrOptions({"evidence"})],
        "learning_rate": [Interval(Real, 0, None, closed="neither"), None],
        "batch_size": [Interval(Integral, 1, None, closed="left"), None],
        "max_epochs": [Interval(Integral, 1, None, closed="left"), None],
        "n_starts": [Interval(Integral, 1, None, closed="left"), None],
        "early_stopping": ["boolean"],
        "dtype": [StrOptions({"float64", "float32"})],
        "device": [str],
        "random_state": ["random_state"],
        "net_params": [dict, None],
        "loss": [StrOptions({"mse", "rss", "rmse"})],
        "tol": [Interval(Real, 0, None, closed="left")],
        "validation_fraction": [Interval(Real, 0, 1, closed="neither")],
        "n_iter_no_change": [Interval(Integral, 1, None, closed="left")],
        "prior": [callable, None],
        "closeness": [Interval(Real, 0, None, closed="left")],
        "slope": [Interval(Real, 0, None, closed="left")],
        "curvature": [Interval(Real, 0, None, closed="left")],
        "momentum": [Interval(Real, 0, 1, closed="left")],
        "betas": ["array-like"],
        "theta0": [list, tuple, HasMethods("predict"), None],
    }

    def __init__(
        self,
        hidden_layer_sizes: Sequence[int] | int = (5,),
        activation: str | Sequence[str] = "tanh",
        *,
        solver: str = "auto",
        alpha: float | str = 0.0,
        learning_rate: float | None = None,
        batch_size: int | None = None,
        max_epochs: int | None = None,
        n_starts: int | None = None,
        early_stopping: bool = False,
        dtype: str = "float64",
        device: str = "cpu",
        random_state: Any = None,
        net_params: dict[str, Any] | None = None,
        loss: str = "mse",
        tol: float = 1e-10,
        validation_fraction: float = 0.1,
        n_iter_no_change: int = 20,
        prior: Callable[[np.ndarray], np.ndarray] | None = None,
        closeness: float = 0.0,
        slope: float = 0.0,
        curvature: float = 0.0,
        momentum: float = 0.9,
        betas: tuple[float, float] = (0.9, 0.999),
        theta0: Any = None,
    ):
        self.hidden_layer_sizes = hidden_layer_sizes
        self.activation = activation
        self.solver = solver
        self.alpha = alpha
        self.learning_rate = learning_rate
        self.batch_size = batch_size
        self.max_epochs = max_epochs
        self.n_starts = n_starts
        self.early_stopping = early_stopping
        self.dtype = dtype
        self.device = device
        self.random_state = random_state
        self.net_params = net_params
        self.loss = loss
        self.tol = tol
        self.validation_fraction = validation_fraction
        self.n_iter_no_change = n_iter_no_change
        self.prior = prior
        self.closeness = closeness
        self.slope = slope
        self.curvature = curvature
        self.momentum = momentum
        self.betas = betas
        self.theta0 = theta0

    @with_callbacks
    @_fit_context(prefer_skip_nested_validation=True)
    def fit(self, X: Any, y: Any, sample_weight: Any = None) -> FNNRegressor:
        """Train the network from random starts.

        Parameters
        ----------
        X : array-like (n_samples, n_features)
        y : array-like (n_samples,) or (n_samples, n_outputs)
        sample_weight : array-like (n_samples,), optional

        Returns
        -------
        self
        """
        rows, plan, solver = self._begin(X, y, sample_weight)
        tasks = Tasks.of(self, X, y, rows)
        listener = None if tasks is None else tasks.step
        validation = None if listener is None else Validation(None, listener=listener)
        if self.early_stopping and len(rows) > 1:
            rows, held = split(rows, self.validation_fraction, plan.rng)
            validation = Validation(held, self.n_iter_no_change, listener)
        with self._one_thread(rows):
            trained, plan = self._trained_on(rows, plan, validation)
            if len(rows) <= FEW_ROWS and len(trained.outcome.layers.theta) <= SMALL_NET:
                # beyond, one more pass over the data or a large square matrix costs more than it is worth
                trained.memory = memory_of(self.solver_, trained, rows, plan)
        self._keep(trained, rows, plan)
        if not trained.outcome.settled and solver not in GRADIENT:
            warn_if_falling(trained.outcome.curve, self.max_epochs)
        if tasks is not None:
            tasks.end()
        return self

    @_fit_context(prefer_skip_nested_validation=True)
    def partial_fit(self, X: Any, y: Any, sample_weight: Any = None) -> FNNRegressor:
        """Go on with a further block of rows: for data that do not fit into memory.

        The first block sets the scaling and is fitted from random starts ("lm", "lbfgs"). Every further block is fitted
        together with a quadratic form that stands for the rows before it, as in an extended Kalman filter. The solvers in
        torch make one epoch over each block.

        Parameters
        ----------
        X : array-like (n_samples, n_features)
        y : array-like (n_samples,) or (n_samples, n_outputs)
        sample_weight : array-like (n_samples,), optional

        Returns
        -------
        self
        """
        if self.alpha == "evidence":
            raise DataError(
                'partial_fit: alpha="evidence" looks at all rows together; use fit, or give alpha a number.'
            )
        if not hasattr(self, "coefs_"):
            rows, plan, solver = self._begin(X, y, sample_weight)
            if solver in GRADIENT:
                plan = replace(plan, max_iter=1)
            trained = train(solver, plan, rows, None, self._torch())
            trained.memory = memory_of(self.solver_, trained, rows, plan)
            self._keep(trained, rows, plan)
            return self
        data, target, weights = self._checked(X, y, sample_weight, reset=False)
        if target.shape[1] != len(self.intercepts_[-1]):
            raise DataError(
                f"y has {target.shape[1]} columns; the first block had {len(self.intercepts_[-1])}: give every block the same "
                "outputs, or start again with fit."
            )
        rows = replace(self._rows, X=data, Y=target, weights=weights)
        plan = self._plan(rows, self.solver_)
        if self._trained.memory is None and self.solver_ not in GRADIENT:
            raise DataError(
                f"partial_fit remembers earlier rows for up to 2000 weights (after fit: {SMALL_NET} weights and {FEW_ROWS} "
                'rows); begin with partial_fit, or take solver="adam".'
            )
        self._keep(train_more(self.solver_, plan, rows, self._trained, self._torch()), rows, plan)
        return self

    def _trained_on(self, rows: Rows, plan: Plan, validation: Validation | None) -> tuple[Trained, Plan]:
        """The trained network, and the plan with the penalty used."""
        self._posterior: Posterior | None = None
        self.__dict__.pop("noise_", None)
        if self.alpha != "evidence":
            return train(self.solver_, plan, rows, validation, self._torch()), plan
        if self.early_stopping:
            raise DataError('early_stopping=True and alpha="evidence" both keep from overfitting: take one of them.')
        trained, plan, self._posterior = train_by_evidence(self.solver_, plan, rows, self._torch())
        self.noise_ = np.sqrt(self._posterior.noise) * rows.gain
        return trained, plan

    def _begin(self, X: Any, y: Any, sample_weight: Any) -> tuple[Rows, Plan, str]:
        """Checked and scaled data, what to train, and with which solver."""
        data, target, weights = self._checked(X, y, sample_weight, reset=True)
        activations = read_activations(self.activation, read_sizes(self.hidden_layer_sizes))
        rows = prepare(data, target, weights, activations[-1] == "identity")
        rows = replace(rows, smooth=read_smoothness(self.slope, self.curvature, activations))
        solver = choose(self.solver, self._sizes(rows), len(rows))
        self.solver_, self.activations_ = solver, activations
        return rows, self._plan(rows, solver), solver

    def _checked(self, X: Any, y: Any, sample_weight: Any, reset: bool) -> tuple[Any, np.ndarray, np.ndarray | None]:
        """X, y with two axes, and weights or None."""
        X, y = checked(self, X, y, reset=reset, dtype=np.float64, multi_output=True, y_numeric=True)
        if reset:
            self._one_column = y.ndim == 1
        weights = None
        if sample_weight is not None:
            weights = _check_sample_weight(unmasked(sample_weight), X, dtype=np.float64, ensure_non_negative=True)
            if not weights.any():
                raise DataError("sample_weight is zero everywhere: at least one row must count.")
        Y = np.asarray(y, dtype=float).reshape(len(X), -1)
        if self.prior is None and self.closeness:
            raise DataError(f"closeness={self.closeness!r} has nothing to be close to: give prior=model.predict too.")
        if self.prior is not None and self.closeness:
            # |y - f|^2 + c |y0 - f|^2 = (1 + c) |(y + c y0) / (1 + c) - f|^2 + what does not depend on f
            known = np.asarray(self.prior(X[:]), dtype=float)
            if known.size != Y.size or not np.isfinite(known).all():
                raise DataError(
                    f"prior(X) gave an array of shape {known.shape}, expected finite values in the shape {y.shape} of y."
                )
            Y = (Y + self.closeness * known.reshape(Y.shape)) / (1.0 + self.closeness)
        return X, Y, weights

    def _sizes(self, rows: Rows) -> tuple[int, ...]:
        """Inputs, hidden units, outputs."""
        return (rows.X.shape[1], *read_sizes(self.hidden_layer_sizes), rows.Y.shape[1])

    def _plan(self, rows: Rows, solver: str) -> Plan:
        seed = check_random_state(self.random_state).randint(2**31 - 1)
        sizes = self._sizes(rows)
        return Plan(
            sizes,
            self.activations_,
            0.0 if isinstance(self.alpha, str) else float(self.alpha),
            self.n_starts or STARTS.get(solver, 1),
            self.max_epochs or epochs_of(solver, self.batch_size, len(rows)),
            float(self.tol),
            np.random.default_rng(seed),
            read_prior(self.theta0, sizes, self.activations_, rows),
        )

    def _torch(self) -> Torch:
        options = read_options(self.solver_, self.momentum, self.betas, self.net_params)
        device = read_device(self.device) if self.solver_ in GRADIENT else self.device
        return Torch(self.learning_rate, self.batch_size, self.dtype, device, self.loss, options)

    def _one_thread(self, rows: Rows) -> Any:
        """One BLAS thread for small matrices: a second one only waits, and long where the machine is shared."""
        small = len(rows) <= FEW_ROWS or choose("auto", self._sizes(rows), len(rows)) == "lm"
        return _get_threadpool_controller().limit(limits=1 if small else None, user_api="blas")

    def _keep(self, trained: Trained, rows: Rows, plan: Plan) -> None:
        """Store what was learned, for raw inputs and outputs."""
        found = trained.outcome
        raw = found.layers.unscaled(rows.mean, rows.scale, rows.shift, rows.gain)
        self._layers, self._trained, self.alpha_ = raw, trained, plan.alpha
        # only what partial_fit needs of the scaling: no rows of the data
        self._rows = replace(rows, X=rows.X[:0].copy(), Y=rows.Y[:0].copy(), weights=None)
        self.coefs_, self.intercepts_ = list(raw.weights), list(raw.biases)
        curve = np.asarray(found.curve)
        if self.solver_ not in GRADIENT and self.loss != "mse":
            curve = np.sqrt(curve) if self.loss == "rmse" else curve * rows.total
        self.loss_curve_ = curve.tolist()
        self.loss_ = self.loss_curve_[-1] if self.loss_curve_ else np.nan
        self.validation_curve_ = list(found.validation)
        self.n_iter_ = found.n_iter
        self.__dict__.pop("_net", None)
