"""Parameters of networks: a prior for the weights, Table 2's constants, mini-batches, what goes with binary steps."""

import numpy as np
import pytest

from sksurrogate.exceptions import DataError
from sksurrogate.neural import FNNRegressor
from sksurrogate.neural._network import draw_layers
from sksurrogate.neural._problems import Rows, Smoothness, squares
from sksurrogate.neural._settings import BATCH, MANY_ROWS, epochs_of, read_batch
from sksurrogate.neural._torch import build_net
from sksurrogate.neural._training import choose

rng = np.random.default_rng(0)
X = rng.normal(size=(60, 2)) * [1.0, 20.0] + [3.0, -5.0]
y = 4.0 + X @ [1.5, -0.1] + 0.1 * rng.normal(size=60)
x = np.linspace(-1, 1, 50)[:, None]
square = x[:, 0] ** 2


@pytest.mark.slow
@pytest.mark.parametrize("solver", ["lm", "lbfgs", "line_search"])
def test_a_prior_of_a_linear_model_is_the_ridge_to_it(solver):
    coef, level, alpha = np.array([[1.0], [0.05]]), np.array([-2.0]), 0.3
    net = FNNRegressor((), solver=solver, alpha=alpha, theta0=([coef], [level]), max_epochs=500, tol=0).fit(X, y)
    # in standardised units, the constant as one more column
    z = np.column_stack([(X - X.mean(0)) / X.std(0), np.ones(60)])
    t = (y - y.mean()) / y.std()
    before = np.append(coef[:, 0] * X.std(0), X.mean(0) @ coef[:, 0] + level[0] - y.mean()) / y.std()
    theta = np.linalg.solve(z.T @ z / 60 + alpha * np.eye(3), z.T @ t / 60 + alpha * before)
    np.testing.assert_allclose(net.predict(X), y.mean() + y.std() * (z @ theta), rtol=1e-6)


@pytest.mark.parametrize("solver", ["lm", "lbfgs"])
def test_heavy_weights_hold_the_prior_and_none_begins_there(solver):
    first = FNNRegressor((4,), solver=solver, random_state=0).fit(x, square)
    other = np.cos(2 * x[:, 0])
    held = FNNRegressor((4,), solver=solver, alpha=1e8, theta0=first, random_state=1).fit(x, other)
    np.testing.assert_allclose(held.predict(x), first.predict(x), atol=1e-4)
    started = FNNRegressor((4,), solver=solver, n_starts=1, theta0=first, max_epochs=1).fit(x, square)
    assert started.loss_curve_[0] < 1e-6


def test_a_prior_from_many_rows_helps_where_few_are_at_hand():
    def plant(x):
        return np.tanh(2 * x[:, 0]) + 0.3 * x[:, 0]

    many = np.linspace(-2, 2, 200)[:, None]
    simulator = FNNRegressor((5,), random_state=0).fit(many, plant(many))
    few = np.array([-1.5, -0.4, 0.3, 1.2])[:, None]
    measured = 1.3 * plant(few)
    near = FNNRegressor((5,), theta0=simulator, alpha=1e-3, random_state=0).fit(few, measured)
    alone = FNNRegressor((5,), random_state=0).fit(few, measured)
    errors = [np.std(model.predict(many) - 1.3 * plant(many)) for model in (near, alone, simulator)]
    assert errors[0] < 0.5 * min(errors[1:])


def test_a_prior_counts_the_same_in_torch():
    import torch

    layers, prior = (draw_layers((2, 4, 1), ("tanh", "identity"), rng) for _ in range(2))
    ones = np.ones(2)
    rows = Rows(X, y[:, None], None, 0 * ones, ones, np.zeros(1), np.ones(1))
    cost = squares(layers, rows, 0.3 * len(X), prior.theta)(layers.theta)[0] / len(X)
    net = build_net(layers, alpha=0.3, theta0=prior.theta)
    values = net.infer({"X": torch.as_tensor(X)})
    loss = net.get_loss(values, torch.as_tensor(y[:, None]), {"X": torch.as_tensor(X)}, training=True)
    np.testing.assert_allclose(loss.item(), cost)


@pytest.mark.parametrize(("slope", "curvature"), [(0.3, 0.0), (0.0, 0.2), (0.3, 0.2)])
def test_slopes_and_curvatures_count_the_same_in_torch_and_as_calculus_says(slope, curvature):
    import torch

    layers = draw_layers((2, 1, 1), ("tanh", "identity"), rng)
    (w, v), (b, _) = layers.weights, layers.biases
    x, ones = rng.normal(size=(30, 2)), np.ones(2)
    t, out = np.tanh(x @ w + b), v[0, 0]
    steep, bent = out * (1 - t**2) * w.T, -2 * out * t * (1 - t**2) * w.T**2  # along each input, (n_rows, 2)
    here = layers(x)
    wanted = slope * np.mean(np.sum(steep**2, axis=1)) + curvature * np.mean(np.sum(bent**2, axis=1))
    rows = Rows(x, here, None, 0 * ones, ones, np.zeros(1), np.ones(1), smooth=Smoothness(slope, curvature))
    cost = squares(layers, rows, 0.0)(layers.theta)[0] / len(x)
    np.testing.assert_allclose(cost, wanted, rtol=2e-3)  # central differences over 0.01
    net = build_net(layers, slope=slope, curvature=curvature)
    given = {"X": torch.as_tensor(x)}
    loss = net.get_loss(net.infer(given), torch.as_tensor(here), given, training=True)
    np.testing.assert_allclose(loss.item(), cost, rtol=1e-6)


def test_scaling_and_back():
    layers = draw_layers((2, 4, 3), ("tanh", "identity"), rng)
    at = (np.array([1.0, -2.0]), np.array([0.5, 30.0]), np.array([1.0, 2.0, 3.0]), np.array([0.1, 1.0, 10.0]))
    np.testing.assert_allclose(layers.unscaled(*at).scaled(*at).theta, layers.theta, atol=1e-12)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"theta0": ([np.ones((2, 5))], [np.ones(5)])}, "theta0 has weights of shapes"),
        ({"theta0": [1, 2, 3]}, "theta0=.* must be a fitted FNNRegressor"),
        ({"theta0": ([np.ones((2, 5)), np.ones((5, 1))], [0, 0]), "activation": "binary_step"}, "theta0: layers up to"),
        ({"solver": "adam", "betas": (0.9, 1.0)}, "betas=.* must be two numbers"),
        ({"solver": "adam", "betas": (0.9,)}, "betas=.* must be two numbers"),
        ({"solver": "nesterov", "momentum": 0.0}, "momentum=0 leaves nothing"),
        ({"solver": "adam", "device": "abacus"}, "device='abacus' cannot be used.*There are"),
        ({"prior": lambda X: X, "closeness": 1.0}, r"prior\(X\) gave an array of shape \(60, 2\)"),
    ],
)
def test_settings_that_do_not_fit_are_named(settings, message):
    with pytest.raises(DataError, match=message):
        FNNRegressor(**settings).fit(X, y)


def test_momentum_and_betas_are_those_of_the_optimizer():
    net = FNNRegressor((3,), solver="momentum", momentum=0.5, max_epochs=3).fit(x, square)
    assert net.net_.optimizer_.param_groups[0]["momentum"] == 0.5
    net = FNNRegressor((3,), solver="adam", betas=(0.8, 0.99), max_epochs=3).fit(x, square)
    assert net.net_.optimizer_.param_groups[0]["betas"] == (0.8, 0.99)
    net.set_params(net_params={"optimizer__betas": (0.7, 0.9)}).fit(x, square)
    assert net.net_.optimizer_.param_groups[0]["betas"] == (0.7, 0.9)


def test_many_rows_are_taken_in_mini_batches():
    assert read_batch(None, MANY_ROWS) == -1
    assert read_batch(None, MANY_ROWS + 1) == BATCH
    assert read_batch(7, 10**6) == 7
    assert [epochs_of("adam", None, n) for n in (100, 50_000, 10**7)] == [1000, 100, 10]
    assert epochs_of("lm", None, 10**6) == 200


@pytest.mark.parametrize("solver", ["lm", "lbfgs", "adam"])
@pytest.mark.parametrize("sizes", [(8,), (8, 3), ()])
def test_early_stopping_and_callbacks_reach_what_stands_above_steps(solver, sizes):
    kinds = ["binary_step", "tanh"][: len(sizes)]
    net = FNNRegressor(sizes, kinds, solver=solver, early_stopping=True, max_epochs=30, random_state=0)
    net.fit(x, square)
    assert len(net.validation_curve_) > 0
    pytest.importorskip("sklearn.callback")
    listener = Listener()
    net.set_callbacks(listener).fit(x, square)
    assert listener.shapes and all(shapes == [w.shape for w in net.coefs_] for shapes in listener.shapes)


class Listener:
    """Notes the shapes of the weights after every step."""

    def __init__(self):
        self.shapes = []

    def setup(self, estimator, context):
        return None

    def on_fit_task_begin(self, estimator, context):
        return None

    def on_fit_task_end(self, estimator, context, *, fitted_estimator):
        if context.parent is not None:
            self.shapes.append([w.shape for w in fitted_estimator.coefs_])
        return False

    def teardown(self, estimator, context):
        return None


def test_closeness_without_a_prior_is_refused():
    with pytest.raises(DataError, match=r"closeness=1.0 has nothing to be close to"):
        FNNRegressor(closeness=1.0).fit(np.eye(3), [1.0, 2.0, 3.0])


def test_every_random_state_draws_other_weights():
    first = [
        FNNRegressor((2,), n_starts=1, max_epochs=1, random_state=k).fit(X[:8], y[:8]).coefs_[0] for k in range(40)
    ]
    assert len({weights.tobytes() for weights in first}) == 40


@pytest.mark.parametrize("sizes", [(), (3,), (4, 3), (4, 3, 5)])
@pytest.mark.parametrize("columns", [1, 2])
def test_blocks_have_the_outputs_of_the_first_one_whatever_the_layers(sizes, columns):
    Y = np.column_stack([y, -y])[:, :columns]
    model = FNNRegressor(sizes, max_epochs=2, solver="lm", random_state=0).partial_fit(X, Y)
    model.partial_fit(X, Y)
    with pytest.raises(DataError, match=f"y has 3 columns; the first block had {columns}"):
        model.partial_fit(X, np.column_stack([Y[:, 0]] * 3))


def test_the_loss_of_a_linear_net_is_what_it_minimises():
    alpha, z = 0.3, (X - X.mean(axis=0)) / X.std(axis=0)
    net = FNNRegressor((), alpha=alpha).fit(X, y)
    t = (y - y.mean()) / y.std()
    theta = np.linalg.solve(z.T @ z / 60 + alpha * np.eye(2), z.T @ t / 60)
    assert net.loss_curve_[-1] == pytest.approx(np.mean((t - z @ theta) ** 2) + alpha * np.sum(theta**2))


@pytest.mark.parametrize(
    ("hidden", "n_weights"), [((99,), 298), ((100,), 301), ((), 2), ((15, 15), 286), ((16, 15), 303)]
)
def test_up_to_300_weights_and_constants_are_fitted_by_levenberg_and_marquardt(hidden, n_weights):
    sizes = (1, *hidden, 1)
    layers = draw_layers(sizes, ("tanh",) * len(hidden) + ("identity",), rng)
    assert sum(part.size for part in [*layers.weights, *layers.biases]) == n_weights
    assert (choose("auto", sizes, 100) == "lm") is (n_weights <= 300)
