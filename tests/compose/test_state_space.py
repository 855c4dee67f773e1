"""State-space models: planted systems found again, sensitivities against differences, starts from first rows."""

import numpy as np
import pytest
from scipy.linalg import solve_discrete_lyapunov
from sklearn.utils.estimator_checks import parametrize_with_checks

from sksurrogate.compose import StateSpaceRegressor
from sksurrogate.compose._state_fit import _padded, _StaysNear
from sksurrogate.datasets import make_reactor_runs
from sksurrogate.exceptions import DataError
from sksurrogate.kernels.state_model import Block, StateModel
from sksurrogate.kernels.state_space import OutputErrorLoss, _abreast, fit_output_error, simulate, subspace

ORDER = "row order matters to a model of runs"
EXPECTED = {"check_methods_sample_order_invariance": ORDER, "check_methods_subset_invariance": ORDER}


# a strong penalty: a network that is fitted to rows in no order may run away from another start
@pytest.mark.filterwarnings("ignore:the free runs of")  # rows without order
@parametrize_with_checks(
    [
        StateSpaceRegressor(1, max_iter=10),
        StateSpaceRegressor(1, hidden_layer_sizes=(2,), max_iter=5, alpha=1.0, random_state=0),
    ],
    expected_failed_checks=lambda estimator: EXPECTED,
)
def test_sklearn_contract(estimator, check):
    check(estimator)


def planted(n_runs=4, n=300, noise=0.0, seed=0, offset=0.0):
    """Two states, one measured, from random initial states."""
    rng = np.random.default_rng(seed)
    A, B, C = np.array([[0.9, 0.2], [-0.2, 0.85]]), np.array([0.0, 1.0]), np.array([1.0, 0.0])
    X, y = rng.normal(size=(n_runs, n)), np.empty((n_runs, n))
    for r in range(n_runs):
        x = 3 * rng.normal(size=2)
        for t in range(n):
            y[r, t] = C @ x
            x = A @ x + B * X[r, t]
    y += noise * rng.normal(size=y.shape) + offset
    return X.reshape(-1, 1), y.ravel(), np.repeat(np.arange(n_runs), n), A


def test_slopes_of_a_block_are_those_of_differences():
    rng = np.random.default_rng(0)
    block = Block(3, 2, (4, 3))
    theta, z = rng.normal(size=block.size), rng.normal(size=(5, 3))
    value, by_z, by_theta = block.jacobians(theta, z)
    np.testing.assert_array_equal(value, block.value(theta, z))
    for found, alone in zip((value, by_z), block.slopes(theta, z)):
        np.testing.assert_allclose(found, alone, rtol=1e-12)
    for found, at, move in ((by_theta, theta, lambda e: (theta + e, z)), (by_z, z[0], lambda e: (theta, z + e))):
        rough = [(block.value(*move(e)) - block.value(*move(-e))) / 2e-6 for e in 1e-6 * np.eye(len(at))]
        np.testing.assert_allclose(found, np.stack(rough, axis=-1), atol=1e-8)


@pytest.mark.parametrize("feedthrough", [False, True])
def test_the_gradient_of_the_objective_is_that_of_differences(feedthrough):
    rng = np.random.default_rng(1)
    model = StateModel(2, 1, 2, (3,), feedthrough)
    theta = 0.4 * rng.normal(size=model.f.size + model.g.size)
    U, Y, starts, x0 = rng.normal(size=(25, 1)), rng.normal(size=(25, 2)), np.array([0, 10]), rng.normal(size=(2, 2))
    Y[3] = np.nan
    objective = OutputErrorLoss(model, U, Y, starts, 0.1)
    _, gradient, _, _, own = objective.normal(theta, x0, simulate(model, theta, x0, U, starts))
    cost = lambda theta, x0: objective.cost(theta, x0, None)[0]  # noqa: E731
    for i in range(len(theta)):
        e = 1e-6 * np.eye(len(theta))[i]
        assert 2 * gradient[i] == pytest.approx((cost(theta + e, x0) - cost(theta - e, x0)) / 2e-6, abs=1e-7)
    for i in range(4):
        e = 1e-6 * np.eye(4)[i].reshape(2, 2)
        assert 2 * own.ravel()[i] == pytest.approx((cost(theta, x0 + e) - cost(theta, x0 - e)) / 2e-6, abs=1e-7)


def test_newton_over_time_is_the_loop():
    rng = np.random.default_rng(2)
    model = StateModel(2, 1, 1, (5,))
    theta = 0.3 * rng.normal(size=model.f.size + model.g.size)
    U, starts, x0 = rng.normal(size=(60, 1)), np.array([0, 17, 40]), rng.normal(size=(3, 2))
    loop = _abreast(model, theta, x0, U, starts)
    fast = simulate(model, theta, x0, U, starts, guess=loop + 0.1 * rng.normal(size=loop.shape))
    np.testing.assert_allclose(fast, loop, atol=1e-10)


def test_the_subspace_start_is_exact_without_noise():
    X, y, groups, A = planted()
    runs = [X[groups == r] for r in range(4)], [y[groups == r][:, None] for r in range(4)]
    found = subspace(*runs, 2, 6, False)
    np.testing.assert_allclose(
        np.sort_complex(np.linalg.eigvals(found[0])), np.sort_complex(np.linalg.eigvals(A)), atol=1e-5
    )


def test_sixteen_rows_without_noise_are_enough_for_a_state():
    """So few that a past of one row more than there are states is the longest that can be projected on."""
    X, y, x = np.random.default_rng(0).normal(size=(16, 1)), np.empty(16), 2.0
    for t in range(16):
        y[t], x = x, -0.6 * x + X[t, 0]
    assert subspace([X], [y[:, None]], 1, 2, False) is not None and subspace([X], [y[:, None]], 1, 3, False) is None
    model = StateSpaceRegressor(1, refine=False).fit(X, y)
    np.testing.assert_allclose(model.poles_, [-0.6], atol=1e-6)


def test_a_planted_system_is_found_and_run_freely():
    X, y, groups, A = planted(offset=7.0)
    model = StateSpaceRegressor(2).fit(X, y, groups=groups)
    np.testing.assert_allclose(np.sort_complex(model.poles_), np.sort_complex(np.linalg.eigvals(A)), atol=1e-6)
    assert model.free_run_rmse_ < 1e-6 and model.score(X, y, groups=groups) > 1 - 1e-8
    ahead = model.predict_ahead(X, y, 5, groups=groups)
    np.testing.assert_allclose(ahead[10:300], y[10:300], atol=1e-3)
    assert np.isnan(ahead[:10]).all() and np.isnan(ahead[300:310]).all()


def test_with_noise_output_error_beats_the_subspace_and_reaches_the_noise():
    X, y, groups, A = planted(noise=0.5)
    refined = StateSpaceRegressor(2).fit(X, y, groups=groups)
    rough = StateSpaceRegressor(2, refine=False).fit(X, y, groups=groups)
    assert refined.free_run_rmse_ == pytest.approx(0.5, rel=0.06)  # 1200 rows: 2 % a standard error
    assert refined.free_run_rmse_ <= rough.free_run_rmse_
    true = np.sort_complex(np.linalg.eigvals(A))
    assert np.abs(np.sort_complex(refined.poles_) - true).max() < 0.01
    P = solve_discrete_lyapunov(refined.A_, np.eye(2))
    assert np.all(np.linalg.eigvalsh(P) > 0)


def test_runs_of_unequal_length_with_two_outputs_and_feedthrough():
    rng = np.random.default_rng(3)
    X, groups = rng.normal(size=(500, 2)), np.repeat([0, 1], [180, 320])
    y, x = np.empty((500, 2)), np.zeros(1)
    for t in range(500):
        x = np.array([2.0]) if t in (0, 180) else x
        y[t] = [x[0] + 0.5 * X[t, 1], -x[0]]
        x = 0.8 * x + X[t, 0]
    model = StateSpaceRegressor(1, feedthrough=True).fit(X, y, groups=groups)
    assert model.score(X, y, groups=groups) > 1 - 1e-8
    assert StateSpaceRegressor(1).fit(X, y, groups=groups).score(X, y, groups=groups) < 0.995


@pytest.mark.slow
def test_networks_learn_the_reactor_where_a_line_cannot():
    X, y, groups = make_reactor_runs(10, 120, random_state=0)
    X1, y1, groups1 = make_reactor_runs(10, 120, random_state=1)
    linear = StateSpaceRegressor(1).fit(X, y, groups=groups).score(X1, y1, groups=groups1)
    neural = StateSpaceRegressor(1, hidden_layer_sizes=(6,), random_state=0).fit(X, y, groups=groups)
    assert neural.score(X1, y1, groups=groups1) > 0.995 > linear


def test_pieces_with_states_of_their_own():
    X, y, groups, A = planted(noise=0.1)
    model = StateSpaceRegressor(2, horizon=50).fit(X, y, groups=groups)
    assert model.x0_.shape == (24, 2)
    assert np.abs(np.sort_complex(model.poles_) - np.sort_complex(np.linalg.eigvals(A))).max() < 0.01


def test_starts_without_first_rows():
    X, y, groups, _ = planted()
    model = StateSpaceRegressor(2, init="steady").fit(X, y, groups=groups)
    held = model.predict(np.full((50, 1), 0.7))
    np.testing.assert_allclose(held, held[0], atol=1e-6)
    mean = model.set_params(init="mean").predict(X[:50])
    assert np.all(np.isfinite(mean))
    array = model.set_params(init=y[:6, None]).predict(X[:300])
    np.testing.assert_allclose(array, y[:300], atol=1e-4)


def test_what_is_wrong_is_said():
    X, y, groups, _ = planted()
    with pytest.raises(ValueError, match=r"'n_states' parameter.* must be an int"):
        StateSpaceRegressor(0).fit(X, y)
    with pytest.raises(ValueError, match=r"'alpha' parameter.*evidence"):
        StateSpaceRegressor(2, alpha=None).fit(X, y)
    with pytest.raises(ValueError, match="'init' parameter"):
        StateSpaceRegressor(2, init="x").fit(X, y)
    with pytest.raises(ValueError, match=r"hidden_layer_sizes=\(0,\): expected units per layer"):
        StateSpaceRegressor(2, hidden_layer_sizes=(0,)).fit(X, y)
    model = StateSpaceRegressor(2).fit(X, y, groups=groups)
    with pytest.raises(DataError, match=r"expected \(6, 1\)"):
        model.predict(X, y0=[1.0])
    with pytest.raises(ValueError, match="init='rest'"):
        model.set_params(init="rest").predict(X)


def test_a_fit_does_not_move_from_its_optimum():
    X, y, groups, _ = planted(noise=0.3)
    model = StateSpaceRegressor(2).fit(X, y, groups=groups)
    U, Y = model._scaled_u(X), ((y - model.y_mean_) / model.y_spread_)[:, None]
    again = fit_output_error(model.model_, model.theta_, model.x0_, U, Y, np.arange(4) * 300, max_iter=20)
    assert again.cost == pytest.approx((model.free_run_rmse_ / model.y_spread_[0]) ** 2, rel=1e-4)


@pytest.mark.parametrize("feedthrough", [False, True])
def test_matrices_in_units_give_the_free_run(feedthrough):
    X, y, groups, A = planted(offset=7.0)
    X = 3.0 + 5.0 * X
    model = StateSpaceRegressor(2, feedthrough=feedthrough, init="mean").fit(X, y, groups=groups)
    A1, B, C, D, b, c = model.matrices()
    np.testing.assert_allclose(np.sort_complex(np.linalg.eigvals(A1)), np.sort_complex(np.linalg.eigvals(A)), atol=1e-5)
    x, free = model.x_mean_, []
    for u in X[:50]:
        free.append((C @ x + D @ u + c)[0])
        x = A1 @ x + B @ u + b
    np.testing.assert_allclose(model.predict(X[:50]), free, rtol=1e-8)
    with pytest.raises(DataError, match="a network has no matrices"):
        StateSpaceRegressor(1, hidden_layer_sizes=(2,), max_iter=1, random_state=0).fit(X, y).matrices()


def test_steps_to_models_that_run_away_from_another_start_are_not_taken():
    U = np.zeros((200, 1))
    model = StateModel(1, 1, 1)
    fading, growing = (model.affine(*[np.array(v, ndmin=k) for v, k in zip((a, 1, 1, 0, 0, 0), (2, 2, 2, 2, 1, 1))])
                       for a in (0.9, 1.1))  # fmt: skip
    stays, x = _StaysNear(model, U, np.array([0])), np.linspace(-1, 1, 200)[:, None]
    assert stays(fading, x)
    assert not stays(growing, x)
    X, y, _, _ = planted(n_runs=1)
    started = StateModel(2, 1, 1).affine(
        0.5 * np.eye(2), np.ones((2, 1)), np.ones((1, 2)), np.zeros((1, 1)), np.zeros(2), np.zeros(1)
    )
    fits = [
        fit_output_error(StateModel(2, 1, 1), started, np.zeros((1, 2)), X, y[:, None], np.array([0]), accepts=accepts)
        for accepts in (None, lambda theta, x: bool(np.abs(theta).max() <= 1.0), lambda theta, x: False)
    ]
    assert fits[0].cost <= fits[1].cost <= fits[2].cost and np.abs(fits[1].theta).max() <= 1.0
    np.testing.assert_array_equal(fits[2].theta, started)


def test_shorter_runs_are_padded_with_their_last_row():
    parts = [np.array([[1.0, 9.0], [2.0, 8.0], [3.0, 7.0]]), np.array([[4.0, 6.0]])]
    assert _padded(parts).tolist() == [parts[0].tolist(), [[4.0, 6.0]] * 3]


@pytest.mark.parametrize("n_states", [3, 4])
def test_the_refined_model_of_a_stable_plant_is_stable(n_states):
    rng = np.random.default_rng(0)
    runs, X, y = np.repeat([0, 1], [90, 60]), rng.normal(size=(150, 2)), np.zeros((150, 2))
    for run in (0, 1):
        for t in np.flatnonzero(runs == run)[2:]:
            y[t, 0] = 0.7 * y[t - 1, 0] - 0.2 * y[t - 2, 1] + X[t - 1, 0]
            y[t, 1] = 0.5 * y[t - 1, 1] + 0.3 * X[t, 1] + 0.1 * y[t - 1, 0] ** 2
    y += 0.02 * rng.normal(size=y.shape)
    fitted = StateSpaceRegressor(n_states, feedthrough=True).fit(X, y, groups=runs)
    assert np.abs(fitted.poles_).max() <= 1.0
    assert fitted.score(X, y, groups=runs) > 0.5  # from the first rows, not from the fitted initial states
