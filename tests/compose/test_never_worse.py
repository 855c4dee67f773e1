"""A hybrid keeps the share of its correction that left-out runs support, down to none."""

import numpy as np
import pytest
from sklearn.linear_model import LinearRegression
from sklearn.neighbors import KNeighborsRegressor

from sksurrogate.compose import HybridRegressor
from sksurrogate.compose._correction_report import reaches
from sksurrogate.compose._left_out import folds_of
from sksurrogate.compose._support import block_powers, supported
from sksurrogate.datasets import linear_reactor, make_reactor, make_reactor_runs
from sksurrogate.export import state_space
from sksurrogate.physics import CallableSimulator, ODESimulator


def identity(U):
    return U[:, [0]]


def test_the_supported_factor_is_the_closed_form_minimum_where_all_blocks_agree():
    """Error e - f d with <e, d> = a and <d, d> = c: the minimum is at a / c, and no block disagrees."""
    factors = np.linspace(0.0, 1.0, 21)
    for best in (0.25, 0.6, 1.0):
        power = np.outer(1.0 - 2.0 * best * factors + factors**2, [1.0, 5.0, 2.0, 100.0])
        found = supported(power, factors)
        assert found.factor == pytest.approx(best, abs=0.026)
        assert found.closed == pytest.approx(best**2, abs=1e-3)
        assert found.standard_error == pytest.approx(0.0, abs=1e-12)


def test_the_jackknife_is_the_standard_error_of_a_mean_for_equal_blocks():
    rng = np.random.default_rng(0)
    gain = 0.5 + 0.1 * rng.normal(size=12)
    found = supported(np.stack([np.ones(12), 1.0 - gain]), np.array([0.0, 1.0]))
    assert found.standard_error == pytest.approx(np.std(gain, ddof=1) / np.sqrt(12))


def test_one_block_that_gains_among_many_that_lose_supports_nothing():
    power = np.ones((2, 10))
    power[1] = [0.0, *9 * [1.05]]
    assert supported(power, np.array([0.0, 1.0])).factor == 0.0
    power[1] = 0.5
    assert supported(power, np.array([0.0, 1.0])).factor == 1.0


def test_a_clear_correction_is_kept_whole_unless_a_smaller_share_is_surely_better():
    factors = np.linspace(0.0, 1.0, 21)
    best = 0.9 + 0.15 * np.random.default_rng(0).normal(size=8)  # of each block
    power = 1.0 - 2.0 * np.outer(factors, best) + factors[:, None] ** 2
    assert supported(power, factors).factor == 1.0
    assert supported(1.0 - 1.8 * factors[:, None] + np.outer(factors**2, np.ones(8)), factors).factor == 0.9


@pytest.mark.slow
def test_a_gain_that_chance_explains_supports_nothing():
    """Without any gain, one record of twenty keeps something: Student's t, as few blocks as there are."""
    rng, kept = np.random.default_rng(0), 0
    for _ in range(1000):
        kept += supported(np.stack([np.ones(8), 1.0 - rng.normal(size=8)]), np.array([0.0, 1.0])).factor > 0
    assert kept / 1000 == pytest.approx(0.05, abs=0.02)  # 1000 draws: 0.007


def test_blocks_that_gain_much_and_little_support_what_none_of_them_loses():
    power = np.array([[0.01, 0.93, 0.01, 0.21, 0.01, 0.09, 0.01, 2.44]] * 2)
    power[1] *= [1.0, 0.0, 0.05, 0.01, 0.9, 0.1, 1.0, 0.85]
    found = supported(power, np.array([0.0, 1.0]))
    assert found.factor == 1.0 and 0.05 < found.sure < 0.2 and found.closed < found.standard_error
    power[1, 7] = 3.5  # the largest loses
    assert supported(power, np.array([0.0, 1.0])).factor == 0.0


def test_free_runs_over_the_same_rows_are_one_block():
    errors = [np.random.default_rng(run).normal(size=(2, 30, 1)) for run in range(9)]
    ends, lengths = [(run, 30) for run in range(9)], [30] * 9
    once, twice = block_powers(errors, ends, lengths), block_powers(2 * errors, 2 * ends, lengths)
    assert once.shape == (2, 9, 1)
    np.testing.assert_allclose(twice, 2.0 * once)
    # eight blocks of three rows, the first of them not judged
    cut = block_powers([np.ones((2, 21, 1)), np.ones((2, 8, 1))], [(0, 24), (0, 24)], [24])
    np.testing.assert_allclose(cut[0, :, 0], [3.0, 3.0, 3.0, 3.0, 5.0, 6.0, 6.0])


def test_a_correction_reaches_as_far_as_two_left_out_runs_have_gone_beyond_the_others():
    rng = np.random.default_rng(0)
    simulator, groups = CallableSimulator(identity), np.repeat(np.arange(3), 60)
    side = np.linspace(0.0, 1.0, 60)
    # left out, the first run lies half of the range of the others outside, and so does the last
    X, noise = np.concatenate([side, 1.0 + side, 2.0 + side])[:, None], 0.3 * rng.normal(size=180)
    apart = HybridRegressor(simulator, LinearRegression(), "static", n_lags=1).fit(
        X, 1.5 * X[:, 0] + 2.0 * noise, groups=groups
    )
    assert apart.shrinkage_ > 0.5 and apart.report_.fade == pytest.approx(0.5, abs=0.02)
    X = rng.uniform(size=(180, 1))  # no run leaves the others: nothing is known of outside
    alike = HybridRegressor(simulator, LinearRegression(), "static").fit(X, 1.5 * X[:, 0] + noise, groups=groups)
    assert alike.shrinkage_ > 0.5 and alike.report_.fade == 0.1
    exact = HybridRegressor(simulator, LinearRegression(), "static").fit(X, 1.5 * X[:, 0], groups=groups)
    assert exact.report_.fade == 1.0  # it leaves nothing of any run: it follows the plant
    inf = np.inf
    assert reaches(np.array([0.7, 0.0, 0.0])) == [(1.0, 0.1), (0.7, 0.25), (0.1, inf)]
    assert reaches(np.array([9.0, 0.5, 0.0])) == [(1.0, 0.25), (0.5, inf)]
    assert reaches(np.array([9.0, 7.0, 0.0])) == [(1.0, inf)]
    assert reaches(np.array([0.4])) == [(1.0, 0.1), (0.4, 0.25), (0.1, inf)]


def test_one_run_that_went_far_is_enough_for_a_correction_that_halves_the_error_of_every_run():
    rng = np.random.default_rng(0)
    groups = np.repeat(np.arange(9), 60)
    X, noise = rng.uniform(size=(540, 1)), 0.13 * rng.normal(size=540)
    X[groups == 8] = 1.2 + 0.6 * X[groups == 8]

    def fitted(beyond):
        y = np.where(groups == 8, beyond, 1.5) * X[:, 0] + noise
        simulator = CallableSimulator(identity)
        return HybridRegressor(simulator, LinearRegression(), "static", n_lags=1).fit(X, y, groups=groups).report_

    right, wrong = fitted(1.5), fitted(1.0)
    assert right.fade == pytest.approx(0.8, abs=0.05) and np.all(right.shrinkage == 1.0)
    assert wrong.fade < 0.5  # the run outside speaks against the correction


def test_a_run_that_starts_outside_the_measured_outputs_is_the_simulators():
    """Twice the reach outside a share of 1 / e of the correction is left, far outside nothing."""
    X, groups = np.random.default_rng(0).uniform(size=(180, 1)), np.repeat(np.arange(3), 60)
    y = X[:, 0] + 0.3
    hybrid = HybridRegressor(CallableSimulator(identity), LinearRegression(), "static").fit(X, y, groups=groups)
    assert hybrid.report_.fade == 1.0
    for beyond, left in ((0.0, 1.0), (1.0, 1.0), (2.0, np.exp(-1.0)), (9.0, 0.0)):
        first = np.full((5, 1), y.max() + beyond * np.ptp(y))
        added = hybrid.predict(X[:60], y0=first)[5:] - X[5:60, 0]
        np.testing.assert_allclose(added, 0.3 * left, atol=1e-6)
    alone = HybridRegressor(None).fit(X, y, groups=groups)
    assert alone.correction_.trust(first) == 1.0  # without a simulator there is nothing else


@pytest.mark.parametrize("lengths", [[97], [40, 55], [20, 30, 25, 40, 33]])
def test_every_row_is_judged_by_a_fit_that_has_not_seen_it(lengths):
    seen = [np.zeros(n, int) for n in lengths]
    for fold in folds_of(lengths, 3):
        taught = [np.zeros(n, bool) for n in lengths]
        for run, start, stop in fold.taught:
            taught[run][start:stop] = True
        for piece in fold.judged:
            rows = np.arange(piece.judged, piece.stop)
            assert not taught[piece.run][rows].any()
            seen[piece.run][rows] += 1
    assert all(np.all(one[3:] > 0) for one in seen)


@pytest.mark.slow
@pytest.mark.parametrize("form", ["output", "static", "series"])
def test_a_correction_learned_from_noise_is_dropped(form):
    rng = np.random.default_rng(0)
    X, groups = rng.normal(size=(400, 1)), np.repeat(np.arange(4), 100)
    y = X[:, 0] + 0.1 * rng.normal(size=400)
    hybrid = HybridRegressor(CallableSimulator(identity), KNeighborsRegressor(1), form).fit(X, y, groups=groups)
    assert hybrid.shrinkage_ == 0.0
    np.testing.assert_array_equal(hybrid.predict(X, groups=groups), X[:, 0])
    assert hybrid.free_run_rmse_ == pytest.approx(np.std(y - X[:, 0]), rel=0.1)
    assert "the simulator is used alone" in str(hybrid.report_)
    assert hybrid.report_.whole_rmse > hybrid.report_.rmse == hybrid.report_.simulator_rmse


def test_each_output_keeps_its_own_share():
    rng = np.random.default_rng(1)
    X, groups = rng.normal(size=(400, 2)), np.repeat(np.arange(4), 100)
    y = X + 0.1 * rng.normal(size=(400, 2))
    y[:, 0] += 0.5
    hybrid = HybridRegressor(CallableSimulator(lambda U: U), LinearRegression(), "static").fit(X, y, groups=groups)
    assert hybrid.shrinkage_[0] == 1.0 and hybrid.shrinkage_[1] < 1.0
    assert "output 0" in str(hybrid.report_) and "output 1" in str(hybrid.report_)


@pytest.mark.slow
def test_a_term_inside_the_plant_is_dropped_where_the_plant_is_right():
    X, y, groups = make_reactor_runs(4, 80, noise=0.05, random_state=0)
    hybrid = HybridRegressor(make_reactor(), KNeighborsRegressor(1), "dynamics").fit(X, y, groups=groups)
    assert hybrid.shrinkage_ == 0.0
    first = np.stack([y[groups == k][:1] for k in range(4)])[:, :, None]
    alone = np.concatenate([make_reactor().simulate(X[groups == k], x0=first[k, 0])[:, 0] for k in range(4)])
    predicted = hybrid.predict(X, y0=first, groups=groups)
    np.testing.assert_allclose(predicted, alone, rtol=1e-4)  # fixed steps, and steps with their error controlled


@pytest.mark.slow
def test_the_whole_correction_is_kept_where_it_closes_the_gap():
    X, y, groups = make_reactor_runs(6, 120, noise=0.02, random_state=0)
    hybrid = HybridRegressor(linear_reactor()).fit(X, y, groups=groups)
    assert hybrid.shrinkage_ == 1.0
    assert hybrid.report_.rmse < 0.1 * hybrid.report_.simulator_rmse


@pytest.mark.slow
@pytest.mark.parametrize("beyond", [0.0, 0.7])
def test_the_graph_of_a_shrunk_hybrid_is_its_prediction(beyond):
    X, y, groups = make_reactor_runs(3, 80, noise=0.02, random_state=0)
    hybrid = HybridRegressor(linear_reactor()).fit(X, y, groups=groups)
    hybrid.correction_.keep(np.array([0.4]), 0.3)
    first = y[:5] + beyond * (y.max() + np.ptp(y) - y[:5])  # a run that starts outside keeps less of the correction
    predicted = hybrid.predict(X[:40], y0=first)
    state, graph, found = hybrid.graph_state(X[:40], y0=first), hybrid.to_graph(), []
    for row in X[5:40]:
        at = graph(x=state, u=row)
        state = at["x_next"]
        found.append(at["y"][0])
    np.testing.assert_allclose(found, predicted[5:], atol=1e-5)


@pytest.mark.slow
def test_a_plant_without_inputs_has_a_hybrid():
    def fall(t, x, u, p):
        return x[1], -9.81 - p["drag"] * x[1]

    def ball(drag):
        return ODESimulator(fall, states=["h", "v"], inputs=[], outputs=["h"], params={"drag": drag}, dt=0.05)

    X, groups = np.zeros((240, 0)), np.repeat(np.arange(4), 60)
    y = np.concatenate([ball(0.3).simulate(np.zeros((60, 0)), x0=[10.0 * k, 0.0])[:, 0] for k in range(4)])
    hybrid = HybridRegressor(ball(0.0)).fit(X, y, groups=groups)
    predicted = hybrid.predict(np.zeros((60, 0)), y0=y[60:65])
    assert np.std(predicted - y[60:120]) < 0.1 * np.std(
        ball(0.0).simulate(np.zeros((60, 0)), x0=[10.0, 0.0])[:, 0] - y[60:120]
    )


@pytest.mark.slow
def test_the_gain_of_a_hybrid_that_never_fades_is_that_of_its_settled_runs():
    """Two ways to dy/du at a steady state: the linearised graph, and constant inputs held until the output rests."""
    X, y, groups = make_reactor_runs(6, 120, noise=0.02, random_state=0)
    hybrid = HybridRegressor(linear_reactor(), fade=float("inf")).fit(X, y, groups=groups)
    at = state_space(hybrid.to_graph(), [0.15])
    gain = at.C @ np.linalg.solve(np.eye(len(at.x0)) - at.A, at.B) + at.D
    low, high = (hybrid.predict(np.full((600, 1), 0.15 + step))[-1] for step in (-1e-4, 1e-4))
    assert gain.item() == pytest.approx((high - low) / 2e-4, rel=1e-3)


@pytest.mark.slow
def test_auto_takes_no_form_of_which_less_is_supported_than_of_the_best():
    # a term inside the plant is kept at a half, and gains as much within one standard error
    X, y, runs = make_reactor_runs(8, 80, noise=0.02, random_state=0)
    best = HybridRegressor(linear_reactor(), form="output").fit(X, y, groups=runs)
    inside = HybridRegressor(linear_reactor(), form="dynamics").fit(X, y, groups=runs)
    auto = HybridRegressor(linear_reactor(), form="auto").fit(X, y, groups=runs)
    assert inside.shrinkage_ < best.shrinkage_
    assert inside.report_.gain > best.report_.gain - best.report_.standard_error
    assert auto.form_ == "output"
