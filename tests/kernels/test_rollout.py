"""The discrete hot loop: one recursion by four routes, slopes against differences."""

import numpy as np
import pytest

from sksurrogate.kernels.net import LagNet, Net
from sksurrogate.kernels.newton import adjoint_gradient, newton_runs, sensitivities
from sksurrogate.kernels.rollout import free_run, known_sums, long_run, march, runs_at_once
from sksurrogate.kernels.scalar import scalar_run
from sksurrogate.kernels.shooting import FreeRunLoss, fit_free_run

INPUTS = ((0, 0), (0, 2))


def network(lags, n_outputs=1, hidden=(3,), activation="tanh", seed=0, size=0.5):
    rng = np.random.default_rng(seed)
    sizes = [len(lags) * n_outputs + len(INPUTS), *hidden, n_outputs]
    weights = tuple(size * rng.normal(size=pair) for pair in zip(sizes, sizes[1:]))
    biases = tuple(0.1 * rng.normal(size=n) for n in sizes[1:])
    net = Net(weights, biases, (activation,) * len(hidden), rng.normal(size=sizes[0]), rng.uniform(1, 2, sizes[0]))
    return LagNet(net, tuple(lags), INPUTS, n_outputs)


def data(model, n_runs, n_steps, seed=1):
    rng = np.random.default_rng(seed)
    return rng.normal(size=(n_runs, n_steps, 1)), rng.normal(size=(n_runs, model.longest + 1, model.n_outputs))


def plain(model, U, first):
    return march(model.net, U, first, model.output_lags, model.input_terms)


@pytest.mark.parametrize("activation", ["tanh", "logistic", "relu", "identity"])
@pytest.mark.parametrize(("n_outputs", "n_runs", "hidden"), [(1, 1, (3,)), (1, 15, (3, 2)), (2, 3, (4,)), (1, 2, ())])
@pytest.mark.parametrize("lags", [[1], [1, 2, 3], [2, 5]])
def test_fast_routes_equal_the_plain_recursion(activation, n_outputs, n_runs, hidden, lags):
    model = network(lags, n_outputs, hidden, activation, size=0.3)
    U, first = data(model, n_runs, 150)
    wanted = plain(model, U, first)
    np.testing.assert_allclose(free_run(model, U, first), wanted, rtol=1e-9, atol=1e-9)
    folded, n = model.folded(), first.shape[1]
    np.testing.assert_allclose(runs_at_once(folded, U, first), wanted, rtol=1e-9, atol=1e-9)
    sums = known_sums(folded, U, n)
    share = sums.reshape(len(sums), n_runs, -1)
    for r in range(n_runs):
        np.testing.assert_allclose(scalar_run(folded, share[:, r], first[r]), wanted[r, n:], rtol=1e-9, atol=1e-9)
    y = np.concatenate([first, np.zeros((n_runs, 150 - n, n_outputs))], axis=1)
    assert newton_runs(folded, sums, y, n)
    np.testing.assert_allclose(y, wanted, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(("size", "hidden"), [(0.5, (3,)), (0.5, (30, 12)), (1.5, (3,)), (4.0, (3,))])
def test_a_long_run_in_pieces_equals_the_plain_recursion(size, hidden):
    model = network([1, 2, 3, 4, 5], hidden=hidden, size=size / np.sqrt(max(hidden) / 3))
    U, first = data(model, 1, 9_001)
    y, n = long_run(model.folded(), U[0], first[0]), first.shape[1]
    # every row follows from the rows before it, at the seams of the pieces too
    windows = [np.lib.stride_tricks.sliding_window_view(rows[:, 0], n + 1)[..., None] for rows in (U[0], y)]
    np.testing.assert_allclose(plain(model, windows[0], windows[1][:, :n])[:, n], windows[1][:, n], atol=1e-9)
    np.testing.assert_array_equal(y[:n], first[0])
    if size < 4.0:  # chaotic: rounding parts any two routes after some hundred steps
        np.testing.assert_allclose(y, plain(model, U, first)[0], rtol=0, atol=1e-8)


def test_a_run_that_leaves_the_floats_is_not_finite_and_raises_nothing():
    net = Net((np.array([[3.0], [1.0], [0.0]]),), (np.zeros(1),), (), np.zeros(3), np.ones(3))
    model = LagNet(net, (1,), INPUTS, 1)
    for n_steps, n_runs in ((2000, 1), (9000, 1), (1000, 20)):
        y = free_run(model, np.ones((n_runs, n_steps, 1)), np.ones((n_runs, 2, 1)))
        assert not np.isfinite(y[:, -1]).any() and np.isfinite(y[:, :100]).all()


@pytest.mark.parametrize(("n_outputs", "lags", "hidden"), [(1, [1, 2, 3], (3,)), (2, [1, 3], (3, 2)), (1, [2], ())])
@pytest.mark.parametrize("activation", ["tanh", "logistic"])
def test_sensitivities_equal_central_differences(n_outputs, lags, hidden, activation):
    model = network(lags, n_outputs, hidden, activation)
    U, first = data(model, 2, 30, seed=3)
    n, theta = first.shape[1], model.net.theta
    y = free_run(model, U, first)
    J = sensitivities(model, U, y, n)
    for j in range(theta.size):
        e = 1e-6 * (np.arange(theta.size) == j)
        slope = (plain(model.at(theta + e), U, first) - plain(model.at(theta - e), U, first))[:, n:] / 2e-6
        np.testing.assert_allclose(J[..., j], slope, atol=2e-8)
    weight = np.random.default_rng(5).normal(size=y[:, n:].shape)
    gradient = adjoint_gradient(model, U, y, n, weight)
    np.testing.assert_allclose(gradient, np.einsum("rto,rtop->p", weight, J), atol=1e-10)


def shots(weight=None, alpha=0.3):
    model = network([1, 2], hidden=(3,))
    U, first = data(model, 3, 120)
    target = free_run(model, U, first)
    target[1, 90:] = np.nan
    return model, FreeRunLoss(U, target, first.shape[1], alpha, weight)


def test_gradient_of_the_free_run_loss_equals_differences():
    truth, loss = shots(np.array([1.0, 2.0, 0.5]))
    model = truth.at(1.1 * truth.net.theta)
    theta, gradient = model.net.theta, loss.gradient(model, loss.run(model))
    for j in range(theta.size):
        e = 1e-6 * (np.arange(theta.size) == j)
        up, down = model.at(theta + e), model.at(theta - e)
        assert (loss.value(up, loss.run(up)) - loss.value(down, loss.run(down))) / 4e-6 == pytest.approx(
            gradient[j], rel=1e-5, abs=1e-6
        )


def test_a_planted_network_is_found_by_its_free_run_from_small_random_weights():
    truth, loss = shots(alpha=0.0)
    found = []
    for seed in range(3):
        start = truth.at(0.1 * np.random.default_rng(seed).normal(size=truth.net.theta.size))
        found.append(fit_free_run(loss, [start], max_iter=300, tol=1e-9)[1])
    assert max(found) < 1e-4  # of squares that sum to some hundred; the valley below is flat


def test_the_basin_is_found_on_a_part_of_the_runs(monkeypatch):
    truth, loss = shots(np.array([1.0, 2.0, 0.5]), alpha=0.1)
    some = loss.some(2 * loss.target.shape[1])
    np.testing.assert_array_equal(some.target, loss.target[[0, 2]])
    np.testing.assert_array_equal(some.weight, [1.0, 0.5])
    assert some.alpha == pytest.approx(0.1 * 2 / 3) and loss.some(10**6) is loss
    starts = [truth.at(0.1 * np.random.default_rng(seed).normal(size=truth.net.theta.size)) for seed in range(3)]
    best = fit_free_run(loss, starts, tol=1e-10)[1]
    monkeypatch.setattr("sksurrogate.kernels.shooting.BASIN_ROWS", loss.target.shape[1])
    value = fit_free_run(loss, starts, tol=1e-10)[1]
    assert value == pytest.approx(best, rel=1e-3)  # the end is that of all runs
