"""Feedforward networks: the contract of scikit-learn, Bishop's bars, identities of the paper, exact slopes."""

import pickle
import subprocess
import sys
import warnings
from dataclasses import replace

import numpy as np
import pytest
from sklearn.base import clone
from sklearn.exceptions import ConvergenceWarning
from sklearn.linear_model import LinearRegression, Ridge
from sklearn.model_selection import GridSearchCV
from sklearn.utils._testing import ignore_warnings
from sklearn.utils.estimator_checks import (
    check_dataframe_column_names_consistency,
    check_param_validation,
    parametrize_with_checks,
)

from sksurrogate.exceptions import DataError
from sksurrogate.features import HeavisideFeatures
from sksurrogate.neural import FNNRegressor
from sksurrogate.neural._network import ACTIVATIONS, Layers, draw_layers
from sksurrogate.neural._problems import Rows, Smoothness, normal_equations, projected, squares

x = np.linspace(-1, 1, 50)[:, None]
#: Function, and the bar for the median mean squared error of ten seeds.
BISHOP = {
    "square": (x[:, 0] ** 2, 1e-12),
    "absolute": (np.abs(x[:, 0]), 2e-5),
    "sine": (np.sin(2 * np.pi * x[:, 0]), 1e-8),
    "step": (2.0 * (x[:, 0] >= 0) - 1.0, 1e-20),
}

SETTINGS = [
    FNNRegressor(),
    FNNRegressor((3, 2), ["tanh", "logistic"], solver="lm", alpha=1e-4, n_starts=2),
    FNNRegressor(activation="binary_step", hidden_layer_sizes=(20,)),
    FNNRegressor(early_stopping=True, n_starts=2),
    FNNRegressor((6,), ["relu"], solver="lbfgs", alpha=1e-3, max_epochs=200),
]


@parametrize_with_checks(SETTINGS, xfail_strict=True)
@pytest.mark.filterwarnings("ignore::sklearn.exceptions.ConvergenceWarning")
def test_sklearn_contract(estimator, check):
    check(estimator)


@pytest.mark.slow
@parametrize_with_checks([FNNRegressor((10,), solver="adam", learning_rate=0.1, max_epochs=40)], xfail_strict=True)
def test_sklearn_contract_in_torch(estimator, check):
    check(estimator)


def test_checks_that_scikit_learn_keeps_for_itself():
    check_param_validation("FNNRegressor", FNNRegressor())
    check_dataframe_column_names_consistency("FNNRegressor", FNNRegressor())


@pytest.mark.parametrize("name", BISHOP)
def test_bishops_functions_are_met(name):
    y, bar = BISHOP[name]
    errors = [np.mean((FNNRegressor(random_state=s).fit(x, y).predict(x) - y) ** 2) for s in range(10)]
    assert np.median(errors) <= bar


@pytest.mark.slow
def test_least_squares_needs_no_torch():
    code = (
        "import sys, numpy as np; from sksurrogate.neural import FNNRegressor; X = np.eye(9)[:, :2];"
        "FNNRegressor().fit(X, X[:, 0]).predict(X); sys.exit('torch' in sys.modules or 'skorch' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.parametrize("solver", ["lm", "lbfgs", "adam"])
def test_the_same_seed_gives_the_same_bits(solver):
    y = BISHOP["sine"][0]
    model = FNNRegressor(solver=solver, max_epochs=30, batch_size=20, random_state=3)
    with ignore_warnings(category=ConvergenceWarning):
        one, other = model.fit(x, y).predict(x), clone(model).fit(x, y).predict(x)
    np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("solver", ["lm", "adam"])
def test_pickle_predicts_the_same_and_goes_on(solver):
    y = np.c_[BISHOP["sine"][0], x]
    model = FNNRegressor(solver=solver, max_epochs=20 if solver == "adam" else None, random_state=0).fit(x, y)
    model.net_  # noqa: B018  (made on access, left out of the pickle)
    again = pickle.loads(pickle.dumps(model))
    np.testing.assert_array_equal(again.predict(x), model.predict(x))
    again.partial_fit(x, y)


def test_the_callers_torch_generator_is_left_alone():
    torch = pytest.importorskip("torch")
    torch.manual_seed(5)
    state = torch.get_rng_state()
    model = FNNRegressor(solver="adam", batch_size=16, max_epochs=3, random_state=0).fit(x, x[:, 0])
    model.net_  # noqa: B018
    assert torch.equal(torch.get_rng_state(), state)


@pytest.mark.parametrize("solver", ["lm", "lbfgs", "adam"])
@pytest.mark.parametrize("shape", ["one", "column", "two"])
def test_net_is_an_initialised_skorch_net_with_the_same_outputs(solver, shape):
    y = {"one": x[:, 0] ** 2, "column": x**2, "two": np.c_[x**2, 3 * x]}[shape]
    model = FNNRegressor((4, 3), ["tanh", "silu"], solver=solver, max_epochs=10, random_state=0)
    with ignore_warnings(category=ConvergenceWarning):
        model.fit(x, y)
    assert model.predict(x).shape == y.shape
    net = model.net_
    assert net.initialized_
    assert net is model.net_
    np.testing.assert_allclose(net.predict(x), model.predict(x).reshape(50, -1), atol=1e-10)
    pickle.loads(pickle.dumps(net))


@pytest.mark.parametrize("kind", [kind for kind in ACTIVATIONS if kind != "binary_step"])
def test_activations_agree_with_torch_in_value_and_slope(kind):
    torch = pytest.importorskip("torch")
    z = np.linspace(-4, 4, 41) + 0.01
    ours = ACTIVATIONS[kind]
    theirs = torch.tensor(z, requires_grad=True)
    value = getattr(torch.nn, ours.torch_name)()(theirs)
    value.sum().backward()
    np.testing.assert_allclose(ours.value(z), value.detach().numpy(), atol=1e-12)
    np.testing.assert_allclose(ours.slope(z, ours.value(z)), theirs.grad.numpy(), atol=1e-12)


@pytest.mark.parametrize("smooth", [None, Smoothness(0.2, 0.0), Smoothness(0.0, 0.1), Smoothness(0.3, 0.1)])
@pytest.mark.parametrize("kinds", [("tanh", "identity"), ("silu", "logistic", "identity"), ("gelu", "softplus")])
def test_sums_of_squares_have_the_slopes_of_differences(kinds, smooth):
    rng = np.random.default_rng(0)
    sizes = (3, *[4] * (len(kinds) - 1), 2)
    layers = draw_layers(sizes, kinds, rng)
    X, Y, w = rng.normal(size=(30, 3)), rng.normal(size=(30, 2)), rng.uniform(0.5, 2, 30)
    rows = Rows(X, Y, w, np.full(3, 0.1), np.full(3, 1.5), np.full(2, 0.2), np.full(2, 0.7), smooth)
    theta, alpha = layers.theta, 0.3
    evaluate, by_gradient = normal_equations(layers, rows, alpha), squares(layers, rows, alpha)
    cost, gradient, gram = evaluate(theta)
    step = 1e-6 * np.eye(len(theta))
    differences = [(by_gradient(theta + s)[0] - by_gradient(theta - s)[0]) / 2e-6 for s in step]
    np.testing.assert_allclose(by_gradient(theta)[0], cost)
    np.testing.assert_allclose(by_gradient(theta)[1], differences, rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(2 * gradient, differences, rtol=1e-5, atol=1e-5)
    if smooth is not None:
        return

    def residual(theta):
        misfit = layers.at(theta)((X - 0.1) / 1.5) - (Y - 0.2) / 0.7
        return np.r_[(np.sqrt(w)[:, None] * misfit).ravel(), np.sqrt(alpha * layers.is_weight) * theta]

    J = np.stack([(residual(theta + s) - residual(theta - s)) / 2e-6 for s in step], axis=1)
    np.testing.assert_allclose(gram, J.T @ J, rtol=1e-5, atol=1e-5)


def test_variable_projection_finds_the_output_layer_of_least_squares():
    rng = np.random.default_rng(1)
    X, Y = rng.normal(size=(40, 2)), rng.normal(size=(40, 1))
    layers = draw_layers((2, 3, 1), ("tanh", "identity"), rng)
    problem = projected(layers, X, Y, None, 0.0)
    omega = layers.below(1).theta
    linear = LinearRegression().fit(layers.below(1)(X), Y)
    np.testing.assert_allclose(problem(omega)[0], np.sum((linear.predict(layers.below(1)(X)) - Y) ** 2))
    np.testing.assert_allclose(problem.solve(omega)[:-1].ravel(), linear.coef_.ravel())


@pytest.mark.parametrize("kinds", ["tanh", ["elu", "gelu"], ["softsign", "relu", "logistic"]])
@pytest.mark.parametrize("n_outputs", [1, 2])
def test_jacobian_agrees_with_differences(kinds, n_outputs):
    rng = np.random.default_rng(2)
    X = rng.normal(size=(60, 3)) * [1, 10, 0.1] + [0, 5, 1]
    Y = np.stack([np.sin(X[:, 0]) + 0.1 * X[:, 1], X[:, 2] * 3], axis=1)[:, :n_outputs]
    model = FNNRegressor((5, 4), kinds, max_epochs=10, n_starts=1, random_state=0)
    model.fit(X, Y[:, 0] if n_outputs == 1 else Y)
    slopes = model.jacobian(X)
    assert slopes.shape == ((60, 3) if n_outputs == 1 else (60, 2, 3))
    for j, h in enumerate([1e-6, 1e-5, 1e-7]):
        step = h * np.eye(3)[j]
        differences = (model.predict(X + step) - model.predict(X - step)) / (2 * h)
        np.testing.assert_allclose(slopes[..., j], differences, rtol=1e-5, atol=1e-5)


def test_coefs_are_for_raw_inputs_and_outputs():
    X = 100 + 20 * x
    model = FNNRegressor(random_state=0).fit(X, 5000 + BISHOP["sine"][0])
    assert [w.shape for w in model.coefs_] == [(1, 5), (5, 1)]
    by_hand = np.tanh(X @ model.coefs_[0] + model.intercepts_[0]) @ model.coefs_[1] + model.intercepts_[1]
    np.testing.assert_allclose(by_hand[:, 0], model.predict(X))
    assert model.loss_ == model.loss_curve_[-1] < 1e-4


def test_no_hidden_layer_is_linear_regression():
    rng = np.random.default_rng(3)
    X, y, w = rng.normal(size=(40, 3)), rng.normal(size=40), rng.uniform(0, 1, 40)
    model = FNNRegressor(()).fit(X, y, sample_weight=w)
    np.testing.assert_allclose(model.predict(X), LinearRegression().fit(X, y, w).predict(X))
    np.testing.assert_allclose(model.jacobian(X), np.tile(LinearRegression().fit(X, y, w).coef_, (40, 1)))


def test_alpha_is_the_ridge_of_standardised_data():
    rng = np.random.default_rng(4)
    X, y = rng.normal(size=(40, 3)), rng.normal(size=40)
    scaled, level = (X - X.mean(0)) / X.std(0), y.mean()
    ridge = Ridge(alpha=0.1 * 40).fit(scaled, (y - level) / y.std())
    model = FNNRegressor((), alpha=0.1).fit(X, y)
    np.testing.assert_allclose(model.predict(X), ridge.predict(scaled) * y.std() + level)
    general = FNNRegressor((), alpha=0.1, solver="adam", learning_rate=0.02, max_epochs=2000, random_state=0).fit(X, y)
    np.testing.assert_allclose(general.predict(X), model.predict(X), atol=1e-4)


def test_ridge_shrinks_the_weights():
    y = BISHOP["step"][0]
    sizes = []
    for alpha in (0.0, 1e-4, 1e-2):
        model = FNNRegressor(alpha=alpha, random_state=0).fit(x, y)
        sizes.append(sum(np.sum(w**2) for w in model._trained.outcome.layers.weights))
    assert sizes[0] > sizes[1] > sizes[2]


@pytest.mark.parametrize("solver", ["lm", "lbfgs"])
def test_the_three_losses_have_one_minimiser(solver):
    y = BISHOP["absolute"][0]
    models = {
        loss: FNNRegressor(loss=loss, solver=solver, alpha=1e-4, random_state=0, max_epochs=3000).fit(x, y)
        for loss in ("mse", "rss", "rmse")
    }
    for model in models.values():
        np.testing.assert_allclose(model.predict(x), models["mse"].predict(x))
    np.testing.assert_allclose(models["rss"].loss_, 50 * models["mse"].loss_)
    np.testing.assert_allclose(models["rmse"].loss_, np.sqrt(models["mse"].loss_))


@pytest.mark.slow
def test_the_three_losses_have_one_minimiser_in_torch():
    rng = np.random.default_rng(5)
    X = rng.normal(size=(40, 2))
    y = X @ [1.0, -2.0] + 0.5 * rng.normal(size=40)
    best = FNNRegressor(()).fit(X, y).predict(X)
    for loss in ("mse", "rss", "rmse"):
        model = FNNRegressor((), solver="adam", loss=loss, learning_rate=0.02, max_epochs=1500, random_state=0)
        np.testing.assert_allclose(model.fit(X, y).predict(X), best, atol=1e-3)


@pytest.mark.parametrize("solver", ["gd", "line_search", "momentum", "nesterov", "adam", "adamw", "rmsprop"])
def test_every_row_of_table_2_lowers_the_loss(solver):
    y = BISHOP["square"][0]
    model = FNNRegressor(solver=solver, max_epochs=150, random_state=0, tol=0).fit(x, y)
    assert model.n_iter_ == len(model.loss_curve_) == 150
    assert model.loss_curve_[-1] < 0.7 * model.loss_curve_[0]
    assert model.score(x, y) > 0.2


def test_line_search_never_raises_the_loss():
    model = FNNRegressor(solver="line_search", max_epochs=60, random_state=0, tol=0).fit(x, BISHOP["sine"][0])
    assert np.all(np.diff(model.loss_curve_) <= 1e-12)


def test_first_step_of_gradient_descent_is_equation_8():
    # without hidden layer: W <- W - eta dL/dW from the weights drawn
    y = BISHOP["square"][0] + x[:, 0]
    model = FNNRegressor((), solver="gd", learning_rate=0.1, max_epochs=1, random_state=0).fit(x, y)
    scaled, target = (x - x.mean()) / x.std(), (y - y.mean()) / y.std()
    seed = np.random.RandomState(0).randint(2**31 - 1)
    start = draw_layers((1, 1), ("identity",), np.random.default_rng(seed))
    misfit = start(scaled)[:, 0] - target
    w = start.weights[0][0, 0] - 0.1 * 2 * np.mean(misfit * scaled[:, 0])
    b = start.biases[0][0] - 0.1 * 2 * np.mean(misfit)
    np.testing.assert_allclose(model.predict(x), (scaled[:, 0] * w + b) * y.std() + y.mean())


def test_a_layer_of_steps_equals_heaviside_features_and_least_squares():
    # second Remark 1: shifted steps and an identity output layer
    rng = np.random.default_rng(6)
    X, y = np.sort(rng.uniform(-1, 1, 80))[:, None], rng.normal(size=80)
    model = FNNRegressor((7,), "binary_step").fit(X, y)
    thresholds = -model.intercepts_[0] / model.coefs_[0][0]
    steps = HeavisideFeatures(thresholds).fit_transform(X)
    np.testing.assert_allclose(model.predict(X), LinearRegression().fit(steps, y).predict(steps), atol=1e-10)
    # zero-order splines: between thresholds the prediction is the mean of the data there
    piece = steps.sum(axis=1)
    means = np.array([y[piece == k].mean() for k in range(8)])
    np.testing.assert_allclose(model.predict(X), means[piece.astype(int)], atol=1e-10)
    assert not model.jacobian(X).any()


def test_steps_below_a_trained_layer_stay_as_drawn():
    model = FNNRegressor((10, 4), ["binary_step", "tanh"], n_starts=2, random_state=0).fit(x, BISHOP["sine"][0])
    assert model.score(x, BISHOP["sine"][0]) > 0.8
    assert len(set(np.round(model.predict(x), 6))) <= 11


def test_a_step_at_the_output_is_refused():
    with pytest.raises(DataError, match="slope is zero everywhere"):
        FNNRegressor((5,), ["tanh", "binary_step"]).fit(x, x[:, 0])


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"hidden_layer_sizes": (0,)}, "positive integers"),
        ({"activation": ["tanh", "tanh", "tanh"]}, "3 entries"),
        ({"activation": ["sigmoid"]}, "'sigmoid' is unknown"),
    ],
)
def test_settings_that_do_not_fit_are_named(settings, message):
    with pytest.raises(DataError, match=message):
        FNNRegressor(**settings).fit(x, x[:, 0])


def test_weights_of_zero_everywhere_are_refused():
    with pytest.raises(ValueError, match="at least one"):
        FNNRegressor().fit(x, x[:, 0], sample_weight=np.zeros(50))


def test_an_output_layer_may_be_bounded():
    y = 1 / (1 + np.exp(-4 * x[:, 0]))
    model = FNNRegressor((3,), ["tanh", "logistic"], random_state=0).fit(x, y)
    assert model.score(x, y) > 0.9999
    assert np.all((model.predict(100 * x) >= 0) & (model.predict(100 * x) <= 1))


@pytest.mark.slow
@pytest.mark.parametrize("solver", ["lm", "lbfgs", "adam"])
def test_early_stopping_keeps_the_best_on_rows_set_aside(solver):
    rng = np.random.default_rng(7)
    X = rng.uniform(-1, 1, (60, 1))
    y = X[:, 0] ** 2 + 0.3 * rng.normal(size=60)
    model = FNNRegressor((20,), solver=solver, early_stopping=True, validation_fraction=0.3, random_state=0)
    model.set_params(learning_rate=0.05 if solver == "adam" else None).fit(X, y)
    stopped = min(model.validation_curve_)
    assert stopped < model.validation_curve_[-1] or len(model.validation_curve_) < 20
    fresh = rng.uniform(-1, 1, (500, 1))
    plain = FNNRegressor((20,), solver="lm", random_state=0)
    with ignore_warnings(category=ConvergenceWarning):
        plain.fit(X, y)
    assert model.score(fresh, fresh[:, 0] ** 2) > plain.score(fresh, fresh[:, 0] ** 2)


def test_blocks_that_arrive_one_by_one_reach_the_fit_of_all():
    rng = np.random.default_rng(8)
    X = rng.uniform(-2, 2, (3000, 1))
    y = np.tanh(2 * X[:, 0]) + 0.3 * X[:, 0] + 0.05 * rng.normal(size=3000)
    blocks = FNNRegressor((3,), random_state=0)
    for first in range(0, 3000, 300):
        blocks.partial_fit(X[first : first + 300], y[first : first + 300])
    whole = FNNRegressor((3,), random_state=0).fit(X, y)
    truth = np.tanh(2 * X[:, 0]) + 0.3 * X[:, 0]
    assert np.sqrt(np.mean((blocks.predict(X) - truth) ** 2)) < 0.01
    assert np.sqrt(np.mean((blocks.predict(X) - whole.predict(X)) ** 2)) < 0.01


@pytest.mark.slow
def test_partial_fit_in_torch_makes_one_epoch_a_block():
    model = FNNRegressor(solver="adam", learning_rate=0.05, random_state=0)
    for _ in range(300):
        model.partial_fit(x, BISHOP["square"][0])
    assert model.n_iter_ == 1
    assert model.score(x, BISHOP["square"][0]) > 0.95


def test_partial_fit_refuses_another_number_of_outputs():
    model = FNNRegressor(random_state=0).partial_fit(x, x[:, 0])
    with pytest.raises(DataError, match="2 columns"):
        model.partial_fit(x, np.c_[x, x])


def test_grid_search_over_nodes_activation_and_alpha():
    y = BISHOP["sine"][0]
    grid = {"hidden_layer_sizes": [(2,), (5,)], "activation": ["tanh", "logistic"], "alpha": [1e-6, 1e-1]}
    order = np.random.default_rng(0).permutation(50)
    search = GridSearchCV(FNNRegressor(n_starts=2, random_state=0), grid, cv=3).fit(x[order], y[order])
    assert search.best_params_["hidden_layer_sizes"] == (5,)
    assert search.best_params_["alpha"] == 1e-6
    assert search.best_score_ > 0.99


def test_large_sets_start_from_a_subsample_and_end_on_all_rows():
    rng = np.random.default_rng(9)
    X = rng.normal(size=(30_000, 2))
    y = np.tanh(X[:, 0] - 0.5 * X[:, 1]) + 0.01 * rng.normal(size=30_000)
    model = FNNRegressor((2,), random_state=0).fit(X, y)
    assert model.solver_ == "lm"
    assert np.sqrt(np.mean((model.predict(X) - y) ** 2)) < 0.0101
    weighted = FNNRegressor((2,), random_state=0).fit(X, y, sample_weight=np.full(30_000, 2.0))
    # Both end where steps gain next to nothing, not at one point: a ten-thousandth of the noise apart on average, a few rows
    # far out by more.
    assert np.sqrt(np.mean((weighted.predict(X) - model.predict(X)) ** 2)) < 1e-4 * 0.01


def test_auto_takes_the_solver_that_suits_the_size():
    rng = np.random.default_rng(10)
    X = rng.normal(size=(50, 3))
    with ignore_warnings(category=ConvergenceWarning):
        assert FNNRegressor((40, 40), max_epochs=3).fit(X, X[:, 0]).solver_ == "lbfgs"
    assert FNNRegressor((4,)).fit(X, X[:, 0]).solver_ == "lm"


def test_a_search_that_still_falls_warns_with_the_way_out():
    with pytest.warns(ConvergenceWarning, match="raise max_epochs"):
        FNNRegressor((8,), solver="lbfgs", max_epochs=30, random_state=1).fit(x, BISHOP["sine"][0])


def test_a_fit_that_settles_does_not_warn():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        model = FNNRegressor(random_state=0).fit(x, BISHOP["square"][0])
    assert model.score(x, BISHOP["square"][0]) > 0.99


def test_layers_join_and_part():
    layers = draw_layers((2, 3, 4, 1), ("tanh", "relu", "identity"), np.random.default_rng(0))
    X = np.random.default_rng(1).normal(size=(5, 2))
    whole = layers.below(2).joined(layers.above(2))
    np.testing.assert_array_equal(whole(X), layers(X))
    np.testing.assert_array_equal(layers.at(layers.theta)(X), layers(X))
    assert isinstance(whole, Layers) and whole.sizes == (2, 3, 4, 1)


class Listener:
    """Counts steps, scores on the way and may stop the fit."""

    def __init__(self, most=10**9):
        self.most, self.scores, self.ended = most, [], False

    def setup(self, estimator, context):
        self.scores.clear()

    def on_fit_task_begin(self, estimator, context):
        return None

    def on_fit_task_end(self, estimator, context, *, X, y, fitted_estimator):
        if context.parent is None:
            return False
        self.scores.append(fitted_estimator.score(X, y))
        return len(self.scores) >= self.most

    def teardown(self, estimator, context):
        self.ended = True


@pytest.mark.parametrize("solver", ["lm", "lbfgs", "adam"])
@pytest.mark.parametrize("early_stopping", [False, True])
def test_callbacks_hear_of_every_step_and_may_stop(solver, early_stopping):
    pytest.importorskip("sklearn.callback")
    y = BISHOP["sine"][0]
    model = FNNRegressor(solver=solver, max_epochs=40, n_starts=1, early_stopping=early_stopping, random_state=0)
    all_steps = Listener()
    with ignore_warnings(category=ConvergenceWarning):
        plain = clone(model).fit(x, y)
        heard = model.set_callbacks(all_steps).fit(x, y)
    np.testing.assert_array_equal(heard.predict(x), plain.predict(x))
    assert all_steps.ended and len(all_steps.scores) > 5
    if solver != "adam" and not early_stopping:
        assert max(all_steps.scores) == pytest.approx(model.score(x, y))
    few = Listener(3)
    model.set_callbacks(few).fit(x, y)
    assert len(few.scores) == 3


def test_closeness_pulls_towards_a_prespecified_solution():
    rng = np.random.default_rng(11)
    X, y = rng.normal(size=(40, 2)), rng.normal(size=40)
    prior = FNNRegressor(()).fit(X, X @ [1.0, 2.0])
    for closeness in (0.0, 1.0, 1e9):
        # a linear model shows the closed form: the mean of both fits, weighted
        model = clone(FNNRegressor((), prior=prior.predict, closeness=closeness)).fit(X, y)
        apart = LinearRegression().fit(X, y).predict(X)
        expected = (apart + closeness * prior.predict(X)) / (1 + closeness)
        np.testing.assert_allclose(model.predict(X), expected, atol=1e-7)


@pytest.mark.slow
def test_weights_of_rows_count_in_mini_batches():
    rng = np.random.default_rng(12)
    X = rng.normal(size=(400, 1))
    w = np.where(X[:, 0] > 0, 50.0, 0.1)
    y = np.where(X[:, 0] > 0, 2.0, -1.0) * X[:, 0]
    exact = FNNRegressor(()).fit(X, y, sample_weight=w)
    settings = {"solver": "adam", "batch_size": 50, "learning_rate": 0.01, "max_epochs": 200, "random_state": 0}
    model = FNNRegressor((), **settings).fit(X, y, sample_weight=w)
    np.testing.assert_allclose(model.coefs_[0], exact.coefs_[0], rtol=0.02)


def test_smoothness_weighs_the_slopes_of_the_jacobian():
    rng = np.random.default_rng(13)
    layers = draw_layers((2, 4, 1), ("tanh", "identity"), rng)
    X, Y = rng.normal(size=(30, 2)), rng.normal(size=(30, 1))
    rows = Rows(X, Y, None, np.zeros(2), np.ones(2), np.zeros(1), np.ones(1))
    plain = squares(layers, rows, 0.0)(layers.theta)[0]
    sloped = squares(layers, replace(rows, smooth=Smoothness(0.5, 0.0)), 0.0)(layers.theta)[0]
    np.testing.assert_allclose(sloped - plain, 0.5 * np.sum(layers.jacobian(X) ** 2), rtol=1e-3)
    bent = squares(layers, replace(rows, smooth=Smoothness(0.0, 0.5)), 0.0)(layers.theta)[0]
    step = 1e-4 * np.eye(2)
    second = [(layers(X + s) - 2 * layers(X) + layers(X - s)) / 1e-8 for s in step]
    np.testing.assert_allclose(bent - plain, 0.5 * np.sum(np.square(second)), rtol=1e-3)


def test_slope_is_a_ridge_for_a_linear_model():
    rng = np.random.default_rng(14)
    X, y = rng.normal(size=(40, 3)), rng.normal(size=40)
    ridge = FNNRegressor((), alpha=0.3).fit(X, y).predict(X)
    np.testing.assert_allclose(FNNRegressor((), slope=0.3).fit(X, y).predict(X), ridge, atol=1e-6)
    np.testing.assert_allclose(FNNRegressor((), slope=0.3, solver="lbfgs").fit(X, y).predict(X), ridge, atol=1e-5)
    adam = FNNRegressor((), slope=0.3, solver="adam", learning_rate=0.02, max_epochs=1500, random_state=0)
    np.testing.assert_allclose(adam.fit(X, y).predict(X), ridge, atol=1e-3)


def test_curvature_calms_a_fit_to_noise():
    rng = np.random.default_rng(15)
    X = np.sort(rng.uniform(-1, 1, (40, 1)), axis=0)
    y = np.sin(3 * X[:, 0]) + 0.2 * rng.normal(size=40)
    fine = np.linspace(-1, 1, 200)[:, None]
    with ignore_warnings(category=ConvergenceWarning):
        rough = FNNRegressor((10,), random_state=0).fit(X, y).score(fine, np.sin(3 * fine[:, 0]))
        calm = FNNRegressor((10,), curvature=1e-3, random_state=0).fit(X, y).score(fine, np.sin(3 * fine[:, 0]))
    assert calm > max(rough, 0.95)


def test_steps_have_no_slope_to_weigh():
    with pytest.raises(DataError, match="has neither"):
        FNNRegressor(activation="binary_step", slope=1.0).fit(x, x[:, 0])
