"""One hidden layer: inner products against the orthogonal route."""

import numpy as np
import pytest

from sksurrogate.kernels.least_squares import levenberg_marquardt, several_starts
from sksurrogate.neural import _shallow
from sksurrogate.neural._network import draw_layers
from sksurrogate.neural._problems import projected


def problem(n_in=2, n_units=4, n_out=1, activation="tanh", weighted=False, alpha=0.0, n_rows=80):
    rng = np.random.default_rng(n_in + n_units + n_out)
    X, Y = rng.normal(size=(n_rows, n_in)), rng.normal(size=(n_rows, n_out))
    weights = rng.uniform(0.1, 2.0, n_rows) if weighted else None
    layers = draw_layers((n_in, n_units, n_out), (activation, "identity"), rng)
    return projected(layers, X, Y, weights, alpha), layers.below(1).theta


@pytest.mark.parametrize("weighted", [False, True])
@pytest.mark.parametrize("alpha", [0.0, 0.1])
@pytest.mark.parametrize(
    ("n_in", "n_units", "n_out", "activation"), [(1, 5, 1, "tanh"), (3, 4, 2, "logistic"), (2, 6, 3, "relu")]
)
def test_inner_products_agree_with_the_orthogonal_route(n_in, n_units, n_out, activation, weighted, alpha):
    shallow, omega = problem(n_in, n_units, n_out, activation, weighted, alpha)
    for found, wanted in zip(shallow(omega), shallow.exact(omega)):
        np.testing.assert_allclose(found, wanted, atol=1e-9 * np.abs(wanted).max())


@pytest.mark.parametrize("weighted", [False, True])
@pytest.mark.parametrize("alpha", [0.0, 0.1])
def test_the_orthogonal_branch_agrees_with_itself(monkeypatch, weighted, alpha):
    shallow, omega = problem(2, 4, 2, "tanh", weighted, alpha)
    monkeypatch.setattr(_shallow, "PIVOTS", np.inf)
    for found, wanted in zip(shallow(omega), shallow.exact(omega)):
        np.testing.assert_allclose(found, wanted, rtol=1e-12)


def test_a_probe_leaves_nothing_behind():
    shallow, omega = problem(weighted=True, alpha=0.01)
    before = shallow(omega)
    shallow.probe(omega + 1.0)
    after = shallow(omega)
    for one, other in zip(before, after):
        np.testing.assert_array_equal(one, other)


def test_ill_conditioned_bases_take_the_orthogonal_route():
    shallow, omega = problem(1, 3)
    omega[:3] = 1e-9  # three units that are lines
    cost, gradient, gram = shallow(omega)
    wanted = shallow.exact(omega)
    np.testing.assert_allclose(cost, wanted[0], rtol=1e-9)
    assert np.isfinite(gradient).all() and np.isfinite(gram).all()


def test_a_constant_layer_has_no_finite_cost():
    shallow, omega = problem(1, 3)
    assert shallow(np.zeros_like(omega))[0] == np.inf
    assert shallow(np.full_like(omega, np.nan))[0] == np.inf


def test_a_hopeless_start_is_left_and_the_best_one_goes_on():
    """Squares with two valleys: starts in the worse one are given few evaluations."""
    calls = []

    def evaluate(theta):
        calls.append(1)
        t = theta[0]
        residual = np.array([t * t - 1.0, 0.3 * (t - 1.0), 0.1])
        jacobian = np.array([[2.0 * t], [0.3], [0.0]])
        return float(residual @ residual), jacobian.T @ residual, jacobian.T @ jacobian

    fit, costs = several_starts(evaluate, [np.array([1.3]), np.array([-3.0]), np.array([-2.0])], first=60)
    assert abs(fit.theta[0] - 1.0) < 1e-6
    assert len(costs) == 3 and len(calls) < 90  # 180 without leaving


def test_a_paused_search_goes_on_as_if_nothing_had_happened():
    shallow, omega = problem(2, 4)
    whole = levenberg_marquardt(shallow, omega.copy(), max_iter=40)
    parts = levenberg_marquardt(shallow, omega.copy(), max_iter=40, pause=lambda fit: len(fit.history) > 5)
    assert not parts.done
    levenberg_marquardt(shallow, parts, max_iter=41 - parts.n_iter)
    np.testing.assert_allclose(parts.theta, whole.theta, rtol=1e-12)
