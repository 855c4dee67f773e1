"""The hybrid keeps scikit-learn's contract; nested parameters, gradual improvement, the domain."""

import pickle

import numpy as np
import pytest
import sklearn
from sklearn.linear_model import LinearRegression, Ridge
from sklearn.model_selection import GridSearchCV, GroupKFold
from sklearn.neural_network import MLPRegressor
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from sklearn.utils.estimator_checks import parametrize_with_checks

from sksurrogate.compose import HybridRegressor
from sksurrogate.datasets import linear_reactor, make_reactor, make_reactor_runs
from sksurrogate.exceptions import DataError

ORDER = "row order matters to lags"
EXPECTED = {"check_methods_sample_order_invariance": ORDER, "check_methods_subset_invariance": ORDER}


@pytest.mark.slow
@parametrize_with_checks(
    [HybridRegressor(None), HybridRegressor(None, Ridge(), n_lags=2)],
    expected_failed_checks=lambda estimator: EXPECTED,
    xfail_strict=True,
)
def test_sklearn_contract(estimator, check):
    check(estimator)


def _rmse(a, b):
    return float(np.sqrt(np.mean((a - b) ** 2)))


@pytest.mark.slow
def test_nested_parameters_of_the_simulator_and_the_residual_are_searched():
    X, y, groups = make_reactor_runs(4, 60, random_state=0)
    hybrid = HybridRegressor(make_reactor(flow=3.0), Ridge(1e-3), "static")
    grid = {"simulator__params__flow": [2.0, 3.0], "residual__alpha": [1e-3, 1.0]}
    with sklearn.config_context(enable_metadata_routing=True):
        search = GridSearchCV(hybrid, grid, cv=GroupKFold(2)).fit(X, y, groups=groups)
    assert search.best_params_["simulator__params__flow"] == 2.0
    assert hybrid.simulator.params["flow"] == 3.0


@pytest.mark.slow
def test_more_runs_improve_the_hybrid_step_by_step():
    X, y, groups = make_reactor_runs(9, 120, noise=0.02, random_state=3)
    new_X, new_y, new = make_reactor_runs(6, 120, noise=0.02, random_state=4)
    first = np.stack([new_y[new == k][:5] for k in range(6)])[:, :, None]
    hybrid, errors = HybridRegressor(linear_reactor()), []
    for part in (groups < 2, (groups >= 2) & (groups < 5), groups >= 5):
        hybrid.partial_fit(X[part], y[part], groups=groups[part])
        errors.append(_rmse(hybrid.predict(new_X, y0=first, groups=new), new_y))
    assert errors[2] < errors[1] < errors[0]


@pytest.mark.parametrize("begin", ["fit", "partial_fit"])
def test_further_runs_join_those_of_the_first_call(begin):
    X, y, groups = make_reactor_runs(5, 60, noise=0.01, random_state=0)
    first, further = groups < 3, groups >= 3
    hybrid = HybridRegressor(linear_reactor(), form="static")  # it has no start: all runs, one answer
    getattr(hybrid, begin)(X[first], y[first], groups=groups[first])
    hybrid.partial_fit(X[further], y[further], groups=groups[further])
    whole = HybridRegressor(linear_reactor(), form="static").fit(X, y, groups=groups)
    np.testing.assert_array_equal(hybrid.predict(X, groups=groups), whole.predict(X, groups=groups))
    np.testing.assert_array_equal(hybrid.region_.low, whole.region_.low)
    assert hybrid.free_run_rmse_ == whole.free_run_rmse_


@pytest.mark.slow
def test_fit_forgets_the_runs_before_it():
    X, y, groups = make_reactor_runs(6, 60, noise=0.01, random_state=0)
    parts = [groups < 2, (groups >= 2) & (groups < 4), groups >= 4]
    hybrid = HybridRegressor(linear_reactor(), form="static")
    hybrid.partial_fit(X[parts[0]], y[parts[0]], groups=groups[parts[0]])
    hybrid.fit(X[parts[1]], y[parts[1]], groups=groups[parts[1]])
    hybrid.partial_fit(X[parts[2]], y[parts[2]], groups=groups[parts[2]])
    known = groups >= 2
    whole = HybridRegressor(linear_reactor(), form="static").fit(X[known], y[known], groups=groups[known])
    np.testing.assert_array_equal(hybrid.predict(X, groups=groups), whole.predict(X, groups=groups))
    np.testing.assert_array_equal(hybrid.region_.high, whole.region_.high)


@pytest.mark.slow
def test_warm_start_goes_on_from_the_last_fit():
    X, y, groups = make_reactor_runs(4, 100, random_state=0)
    cold = HybridRegressor(linear_reactor()).fit(X, y, groups=groups)
    warm = HybridRegressor(linear_reactor(), warm_start=True).fit(X, y, groups=groups)
    before = warm.residual_.net_.theta.size
    warm.fit(X, y, groups=groups)
    assert warm.residual_.net_.theta.size == before
    assert warm.free_run_rmse_ <= 1.05 * cold.free_run_rmse_


@pytest.mark.slow
def test_far_from_the_data_the_physics_is_left_alone_and_the_spread_says_so():
    X, y, groups = make_reactor_runs(6, 120, u_range=(0.05, 0.12), y0_range=(3.0, 6.0), noise=0.01, random_state=0)
    hybrid = HybridRegressor(linear_reactor()).fit(X, y, groups=groups)
    inside, far = np.full((60, 1), 0.1), np.full((60, 1), 0.6)
    assert np.all(hybrid.validity(inside) == 1.0) and np.all(hybrid.validity(far)[10:] < 1e-3)
    np.testing.assert_allclose(hybrid.predict(far)[10:], linear_reactor().simulate(far)[10:, 0], rtol=1e-2)
    mean, near = hybrid.predict(inside, return_std=True)
    _, wide = hybrid.predict(far, return_std=True)
    assert mean.shape == near.shape == (60,) and np.all(wide[10:] > 5 * near[10:].max())
    disagree = hybrid._free(far, None, None, True)[1].spread[0][
        10:, 0
    ]  # without the correction all of its reach is lost
    parts = np.ravel(hybrid.left_out_rmse_)[0] ** 2 + disagree**2 + hybrid.correction_.reach[0] ** 2
    np.testing.assert_allclose(wide[10:] ** 2, parts, rtol=2e-3)


@pytest.mark.slow
def test_the_spread_holds_what_the_members_disagree_by():
    X, y, groups = make_reactor_runs(6, 120, u_range=(0.05, 0.12), y0_range=(3.0, 6.0), noise=0.01, random_state=2)
    hybrid = HybridRegressor(linear_reactor()).fit(X, y, groups=groups)
    inside = np.full((60, 1), 0.1)
    _, std = hybrid.predict(inside, return_std=True)
    _, free, _ = hybrid._free(inside, None, None, True)
    doubt = hybrid.region_.doubt(np.hstack([inside, free.y[0]])) + 1.0 - free.weight[0]
    disagree, known = free.spread[0][:, 0], np.ravel(hybrid.left_out_rmse_)[0]
    assert disagree.max() > 0.05 * known
    sure = doubt == 0.0
    np.testing.assert_allclose(std[sure] ** 2, known**2 + disagree[sure] ** 2, rtol=1e-12)


@pytest.mark.slow
def test_the_spread_grows_from_the_edge_of_the_data_on_and_stays():
    """Where the correction has not started to fade yet; back inside, the run still remembers where it was."""
    X, y, groups = make_reactor_runs(6, 120, u_range=(0.05, 0.12), y0_range=(3.0, 6.0), noise=0.01, random_state=0)
    hybrid = HybridRegressor(linear_reactor()).fit(X, y, groups=groups)
    there_and_back = np.concatenate([np.full(40, 0.1), np.full(20, 0.155), np.full(40, 0.1)])[:, None]
    _, std = hybrid.predict(there_and_back, return_std=True)
    assert np.all(hybrid.validity(there_and_back) == 1.0)
    assert std[40:].min() > 0.4 * hybrid.correction_.reach[0] > 2.0 * std[:40].max()
    distance = (0.155 - X.max()) / np.ptp(X)  # half the range of the input
    np.testing.assert_allclose(
        hybrid.region_.doubt(np.array([[0.1, y.mean()], [0.155, y.mean()], [0.1, y.mean()]])),
        [0.0, *2 * [1 - np.exp(-((distance / 0.5) ** 2))]],
    )


@pytest.mark.slow
def test_two_standard_deviations_hold_most_of_unseen_runs():
    X, y, groups = make_reactor_runs(8, 120, noise=0.02, random_state=0)
    new_X, new_y, new = make_reactor_runs(6, 120, noise=0.02, random_state=5)
    hybrid = HybridRegressor(linear_reactor()).fit(X, y, groups=groups)
    first = np.stack([new_y[new == k][:5] for k in range(6)])[:, :, None]
    mean, std = hybrid.predict(new_X, y0=first, groups=new, return_std=True)
    assert np.all(std.reshape(6, 120)[:, :5] == 0.0)
    inside = np.abs(mean - new_y)[std > 0] < 2 * std[std > 0]
    assert inside.mean() > 0.75


@pytest.mark.slow
@pytest.mark.parametrize(
    "residual",
    [
        LinearRegression(),
        make_pipeline(
            StandardScaler(),
            MLPRegressor(
                hidden_layer_sizes=(4,), activation="tanh", solver="lbfgs", alpha=1e-4, max_iter=300, random_state=0
            ),
        ),
        MLPRegressor(
            hidden_layer_sizes=(4,), activation="logistic", solver="lbfgs", alpha=1e-4, max_iter=300, random_state=0
        ),
    ],
)
@pytest.mark.filterwarnings("ignore:lbfgs failed to converge")
def test_shooting_lowers_the_free_run_error_of_your_residual(residual):
    X, y, groups = make_reactor_runs(5, 100, noise=0.05, random_state=0)
    one = HybridRegressor(linear_reactor(), residual).fit(X, y, groups=groups)
    shot = HybridRegressor(linear_reactor(), residual, loss="shooting").fit(X, y, groups=groups)
    for hybrid in (one, shot):  # all of the correction, whatever left-out runs say of it
        hybrid.correction_.keep(np.ones(1), 1.0)
        hybrid.correction_.judge([X[groups == k] for k in range(5)], [y[groups == k][:, None] for k in range(5)])
    assert shot.correction_.rmse < one.correction_.rmse
    # the fitted numbers are in the user's own estimator, and the hybrid steps with exactly these
    phi = np.random.default_rng(0).normal(size=(7, 12))
    np.testing.assert_allclose(shot.residual_.predict(phi), shot.correction_.step(phi)[:, 0], rtol=1e-9)


def test_shooting_without_slopes_speaks():
    from sklearn.ensemble import RandomForestRegressor

    X, y, groups = make_reactor_runs(2, 60, random_state=0)
    with pytest.raises(DataError, match="RandomForestRegressor gives none"):
        HybridRegressor(linear_reactor(), RandomForestRegressor(3), loss="shooting").fit(X, y, groups=groups)


@pytest.mark.slow
def test_a_calibrated_simulator_is_fitted_first():
    from sksurrogate.physics import CalibratedSimulator

    X, y, groups = make_reactor_runs(3, 80, random_state=0)
    hybrid = HybridRegressor(CalibratedSimulator(make_reactor(flow=2.5), ["flow"])).fit(X, y, groups=groups)
    assert hybrid.simulator_.params["flow"] == pytest.approx(2.0, abs=1e-3)


def test_two_outputs_and_pickle():
    X, y, groups = make_reactor_runs(3, 80, random_state=0)
    Y = np.c_[y, 0.5 * y + 1.0]
    hybrid = HybridRegressor(None).fit(X, Y, groups=groups)
    assert hybrid.score(X, Y, groups=groups) > 0.95
    again = pickle.loads(pickle.dumps(hybrid))
    np.testing.assert_array_equal(again.predict(X, groups=groups), hybrid.predict(X, groups=groups))


@pytest.mark.slow
@pytest.mark.parametrize("form", ["output", "static", "dynamics"])
def test_skops_asks_for_types_of_this_package_only(form):
    skops_io = pytest.importorskip("skops.io")
    X, y, groups = make_reactor_runs(3, 60, random_state=0)
    hybrid = HybridRegressor(linear_reactor(), form=form).fit(X, y, groups=groups)
    stored = skops_io.dumps(hybrid)
    types = skops_io.get_untrusted_types(data=stored)
    assert all(name.startswith("sksurrogate.") for name in types)
    again = skops_io.loads(stored, trusted=types)
    np.testing.assert_array_equal(again.predict(X, groups=groups), hybrid.predict(X, groups=groups))


@pytest.mark.slow
def test_figure_8_is_closed_to_95_percent_in_every_draw():
    from sksurrogate.demo import _closed

    simulator = linear_reactor()
    for seed in range(8):
        X, y, groups = make_reactor_runs(8, 150, noise=0.02, random_state=seed)
        new_X, new_y, new = make_reactor_runs(16, 150, noise=0.02, random_state=1000 + seed)
        hybrid = HybridRegressor(simulator).fit(X, y, groups=groups)
        first = np.stack([new_y[new == k][:5] for k in range(16)])[:, :, None]
        before = np.concatenate([simulator.simulate(new_X[new == k], x0=first[k, 0])[:, 0] for k in range(16)])
        assert _closed(before, hybrid.predict(new_X, y0=first, groups=new), new_y, 0.02) > 0.95, f"draw {seed}"


def test_first_rows_that_are_not_finite_are_refused_by_name():
    X, y, groups = make_reactor_runs(4, 60, noise=0.01, random_state=0)
    hybrid = HybridRegressor(linear_reactor()).fit(X, y, groups=groups)
    first = y[: hybrid.n_initial_].copy()
    first[1] = np.nan
    with pytest.raises(ValueError, match="y0 is not finite at row 1, output 0 of run 0"):
        hybrid.predict(X[:60], y0=first)
    with pytest.raises(ValueError, match=r"y0 has shape \(4, 1\), expected \(5, n_outputs\)"):
        hybrid.predict(X[:60], y0=np.zeros((4, 1)))
