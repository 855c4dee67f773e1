"""The discrete hot loop: one recursion by three routes, slopes against differences."""

import numpy as np
import pytest

from sksurrogate.kernels.rollout import Net, fit_free_run, free_run, free_run_jacobian, march


def network(n_features, n_outputs, hidden=(3,), activation="tanh", seed=0):
    rng = np.random.default_rng(seed)
    sizes = [n_features, *hidden, n_outputs]
    weights = tuple(0.5 * rng.normal(size=pair) for pair in zip(sizes, sizes[1:]))
    biases = tuple(0.1 * rng.normal(size=n) for n in sizes[1:])
    return Net(weights, biases, activation, rng.normal(size=n_features), rng.uniform(1, 2, n_features))


@pytest.mark.parametrize("activation", ["tanh", "logistic", "relu", "identity"])
@pytest.mark.parametrize(("n_outputs", "n_runs", "hidden"), [(1, 1, (3,)), (1, 9, (3, 2)), (2, 3, (4,)), (1, 2, ())])
@pytest.mark.parametrize("lags", [[1], [1, 2, 3], [2, 5]])
def test_fast_routes_equal_the_plain_recursion(activation, n_outputs, n_runs, hidden, lags):
    rng = np.random.default_rng(1)
    net = network(len(lags) * n_outputs + 2, n_outputs, hidden, activation)
    known, first = rng.normal(size=(150, n_runs, 2)), rng.normal(size=(5, n_runs, n_outputs))
    np.testing.assert_allclose(free_run(net, known, first, lags), march(net, known, first, lags), rtol=1e-9, atol=1e-9)


def test_newton_goes_on_where_a_chunk_ends():
    rng = np.random.default_rng(2)
    net = network(6, 1)
    known, first = rng.normal(size=(10_000, 1, 1)), rng.normal(size=(5, 1, 1))
    lags = [1, 2, 3, 4, 5]
    np.testing.assert_allclose(free_run(net, known, first, lags), march(net, known, first, lags), atol=1e-9)


@pytest.mark.parametrize(("n_outputs", "lags"), [(1, [1, 2, 3]), (2, [1, 3])])
def test_sensitivities_equal_central_differences(n_outputs, lags):
    rng = np.random.default_rng(3)
    net = network(len(lags) * n_outputs + 1, n_outputs)
    known, first = rng.normal(size=(30, 2, 1)), rng.normal(size=(3, 2, n_outputs))
    J = free_run_jacobian(net, known, free_run(net, known, first, lags), 3, lags)
    for j in range(net.theta.size):
        up, down = (net.at(net.theta + s * 1e-6 * (np.arange(net.theta.size) == j)) for s in (1, -1))
        slope = (free_run(up, known, first, lags) - free_run(down, known, first, lags))[3:] / 2e-6
        np.testing.assert_allclose(J[..., j], slope, atol=2e-8)


def test_weights_of_a_planted_network_are_found_by_its_free_run():
    rng = np.random.default_rng(4)
    truth = network(3, 1)
    known, first = rng.normal(size=(120, 3, 1)), rng.normal(size=(2, 3, 1))
    target = free_run(truth, known, first, [1, 2])
    start = truth.at(truth.theta + 0.1 * rng.normal(size=truth.theta.size))
    _, cost = fit_free_run(start, known, target, 2, [1, 2], max_iter=200)
    assert cost < 1e-10
