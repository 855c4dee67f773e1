"""Splits without holes, scans against single fits, intervals against the coverage they promise."""

import numpy as np
import pytest
import sklearn
from sklearn.frozen import FrozenEstimator
from sklearn.linear_model import LinearRegression, Ridge
from sklearn.model_selection import GridSearchCV

from sksurrogate.compose import RecursivePredictor
from sksurrogate.datasets import make_reactor_runs
from sksurrogate.displays import FreeRunDisplay
from sksurrogate.exceptions import DataError, RunError
from sksurrogate.model_selection import BlockedSplit, ConformalFreeRun, FreeRunScorer, scan_orders, split_runs
from sksurrogate.model_selection._conformal import _scale, _widths


def planted(n_runs, n=40, noise=0.1, seed=0, delay=1):
    """y[t] = 1.2 y[t-1] - 0.5 y[t-2] + u[t-delay], process noise."""
    rng = np.random.default_rng(seed)
    X, y = rng.normal(size=(n_runs, n)), rng.normal(size=(n_runs, n))
    for t in range(2, n):
        y[:, t] = 1.2 * y[:, t - 1] - 0.5 * y[:, t - 2] + X[:, t - delay] + noise * rng.normal(size=n_runs)
    return X.reshape(-1, 1), y.ravel(), np.repeat(np.arange(n_runs), n)


@pytest.mark.parametrize("groups", [None, "cut", "runs"])
def test_folds_have_no_hole_and_keep_the_gap(groups):
    split, n = BlockedSplit(4, gap=3), 100
    labels = {None: None, "cut": split.labels(n), "runs": np.repeat(np.arange(10), 10)}[groups]
    tested = []
    for train, test in split.split(np.zeros((n, 1)), groups=labels):
        tested.append(test)
        assert not set(train) & set(test)
        for rows in (train, test):
            jumps = np.flatnonzero(np.diff(rows) != 1)
            for j in jumps:  # a jump only where a run ends
                assert labels is not None and labels[rows[j]] != labels[rows[j + 1]]
        if groups != "runs":
            assert min(abs(a - b) for a in (train[0], train[-1]) for b in (test[0], test[-1])) > 3
    rows = np.sort(np.concatenate(tested))
    assert len(rows) == len(set(rows)) == (np.sum(labels >= 0) if groups else n)


def test_too_few_runs_say_how_to_cut():
    with pytest.raises(RunError, match=r"labels\(groups\)"):
        list(BlockedSplit(3).split(np.zeros((4, 1)), groups=[0, 0, 1, 1]))
    with pytest.raises(RunError, match="do not fit"):
        list(BlockedSplit(2, gap=9).split(np.zeros((8, 1))))


def test_one_record_in_a_search():
    X, y, _ = planted(1, 400)
    split = BlockedSplit(4, gap=4)
    with sklearn.config_context(enable_metadata_routing=True):
        search = GridSearchCV(
            RecursivePredictor(Ridge(1e-6)), {"output_lags": [1, 2, 3]}, cv=split,
            scoring=FreeRunScorer("neg_rmse", n_initial=3),
        )  # fmt: skip
        search.fit(X, y, groups=split.labels(400))
    assert search.best_params_["output_lags"] in (2, 3)
    assert search.cv_results_["mean_test_score"][0] < search.best_score_ - 0.3


def test_three_sets_keep_runs_whole():
    groups = np.repeat(np.arange(12), [5, 9, 7, 20, 11, 5, 8, 10, 6, 9, 7, 13])
    sets = split_runs(groups, random_state=0)
    assert sorted(np.concatenate(sets)) == list(range(len(groups)))
    labels = [set(groups[rows]) for rows in sets]
    assert not labels[0] & labels[1] and not labels[0] & labels[2] and not labels[1] & labels[2]
    assert all(0.1 < len(rows) / len(groups) < 0.3 for rows in sets[1:])
    assert [len(rows) for rows in split_runs(groups, validation=0.0, random_state=1)][1] == 0
    with pytest.raises(RunError, match="3 are needed"):
        split_runs([0, 0, 1, 1])
    with pytest.raises(DataError, match="together below 1"):
        split_runs(groups, validation=0.6, grading=0.5)


def test_a_scan_is_what_single_fits_give():
    X, y, groups = planted(6)
    scan = scan_orders(X, y, groups, max_output_lags=3, max_input_lags=3, n_splits=3, alpha=0.0)
    assert list(zip(scan.output_lags, scan.input_lags)) == [(ny, nu) for ny in (1, 2, 3) for nu in (0, 1, 2, 3)]
    i = int(np.flatnonzero((scan.output_lags == 2) & (scan.input_lags == 1))[0])
    one, free = [], []
    for k in range(3):
        held = groups % 3 == k
        # the scan fits all orders on the same rows: those with three lags
        model = RecursivePredictor(LinearRegression(), 1, 2)
        rows = np.concatenate([np.flatnonzero(groups == r)[1:] for r in range(6) if r % 3 != k])
        model.fit(X[rows], y[rows], groups=groups[rows])
        rows = np.concatenate([np.flatnonzero(groups == r)[1:] for r in range(6) if r % 3 == k])
        error = model.predict_one_step(X[rows], y[rows], groups=groups[rows]) - y[rows]
        one.append(error[np.isfinite(error)])
        free.append(FreeRunScorer("neg_rmse").score(model, X[rows], y[rows], groups=groups[rows]))
        assert held.sum() == 80
    assert scan.one_step[i] * y.std() == pytest.approx(np.sqrt(np.mean(np.concatenate(one) ** 2)))
    assert scan.free_run[i] * y.std() == pytest.approx(np.sqrt(np.mean(np.square(free))))


@pytest.mark.parametrize("delay", [0, 1, 3])
def test_a_scan_finds_the_planted_orders(delay):
    X, y, groups = planted(10, 100, delay=delay)
    scan = scan_orders(X, y, groups, max_output_lags=4, max_input_lags=4)
    assert (scan.best_output_lags, scan.best_input_lags) == (2, delay)
    assert str(scan).startswith(f"best: output_lags=2, input_lags={delay}")


def test_a_scan_of_two_outputs_equals_that_of_each_where_they_are_apart():
    X, y, groups = planted(6)
    X2, y2, _ = planted(6, seed=1)
    both = scan_orders(np.column_stack([X, X2]), np.column_stack([y, y2]), groups, max_output_lags=2, max_input_lags=2)
    assert both.best_output_lags == 2 and both.free_run.min() < 0.2


@pytest.mark.parametrize("kind", ["run", "row"])
def test_the_interval_covers_as_often_as_it_promises(kind):
    within = []
    for seed in range(12):
        X, y, groups = planted(60, 30, noise=0.5, seed=seed)
        model = ConformalFreeRun(RecursivePredictor(LinearRegression(), 1, 2), kind=kind, random_state=seed)
        model.fit(X, y, groups=groups)
        X1, y1, groups1 = planted(100, 30, noise=0.5, seed=1000 + seed)
        first = y1.reshape(100, 30)[:, :2, None]
        low, high = model.predict_interval(X1, y0=first, groups=groups1)
        inside = ((low <= y1) & (y1 <= high)).reshape(100, 30)
        within.append(inside.all(axis=1).mean() if kind == "run" else inside[:, 2:].mean())
    # 0.9 to 0.9 + 1 / 31, and three standard errors of 12 calibrations
    assert 0.85 < np.mean(within) < 0.98


def test_a_fitted_model_is_calibrated_on_all_runs(tmp_path):
    X, y, groups = planted(20, noise=0.3)
    fitted = RecursivePredictor(LinearRegression(), 1, 2).fit(X[:400], y[:400], groups=groups[:400])
    model = ConformalFreeRun(FrozenEstimator(fitted)).fit(X[400:], y[400:], groups=groups[400:])
    assert len(model.calibration_runs_) == 10
    np.testing.assert_array_equal(model.predict(X[:40], y0=y[:2]), fitted.predict(X[:40], y0=y[:2]))
    low, high = model.predict_interval(np.zeros((60, 1)), y0=y[:2])
    assert np.all(high[:2] == low[:2]) and np.all(np.isinf(high[40:])) and np.all(np.isfinite(high[:40]))
    pytest.importorskip("matplotlib")
    display = FreeRunDisplay.from_estimator(model.estimator_, X[:40], y[:40], groups=groups[:40], intervals=model)
    assert len(display.ax_[0, 0].collections) == 1
    display.figure_.clf()


def test_too_few_runs_say_how_many():
    X, y, groups = make_reactor_runs(6, 50, u_range=(0.1, 0.15), random_state=0)
    with pytest.raises(RunError, match=r"coverage=0\.9 needs 9 calibration runs"):
        ConformalFreeRun(RecursivePredictor(LinearRegression())).fit(X, y, groups=groups)


@pytest.mark.parametrize(
    "given", [{name: v} for name in ("coverage", "calibration") for v in (0.0, 1.0)] + [{"kind": "runs"}]
)
def test_shares_lie_between_0_and_1_and_the_kind_is_one_of_two(given):
    with pytest.raises(ValueError, match=f"'{next(iter(given))}' parameter of ConformalFreeRun must"):
        ConformalFreeRun(LinearRegression(), **given).fit(np.zeros((9, 1)), np.zeros(9))


def test_filters_and_steps_give_one_free_run():
    X, y, groups = planted(6)
    # a copy of y as a second output goes step by step and adds nothing
    filtered = scan_orders(X, y, groups, max_output_lags=2, max_input_lags=1, alpha=1e-6)
    steps = scan_orders(X, np.column_stack([y, y]), groups, max_output_lags=2, max_input_lags=1, alpha=1e-6)
    np.testing.assert_allclose(steps.free_run, filtered.free_run, rtol=1e-4)
    np.testing.assert_allclose(steps.one_step, filtered.one_step, rtol=1e-4)


@pytest.mark.parametrize("wrong", [{"n_splits": 1}, {"gap": -1}, {"blocks_per_split": 0}])
def test_each_argument_of_a_split_is_refused_alone(wrong):
    with pytest.raises(ValueError, match=f"{next(iter(wrong))}={next(iter(wrong.values()))}.*at least 2 folds"):
        list(BlockedSplit(**({"n_splits": 3} | wrong)).split(np.zeros((40, 1))))


@pytest.mark.parametrize(
    ("shares", "sets"), [((0.3, 0.3), [1, 1, 1]), ((0.4, 0.0), [1, 1, 0]), ((0.0, 0.4), [1, 0, 1])]
)
def test_as_few_runs_as_there_are_sets_give_one_each(shares, sets):
    n = sum(sets)
    found = split_runs(np.repeat(np.arange(n), 7), validation=shares[0], grading=shares[1], random_state=0)
    assert [len(rows) for rows in found] == [7 * k for k in sets]
    assert sorted(np.concatenate(found)) == list(range(7 * n))


def test_errors_of_one_size_have_one_scale_however_many_runs_reach_a_row():
    lengths = [60, 60, 100, 100, 200]
    errors = [np.where(np.arange(n)[:, None] < 2, np.nan, [[3.0, 0.5]]) for n in lengths]
    np.testing.assert_allclose(_scale(errors, errors)[1:], np.tile([3.0, 0.5], (199, 1)))
    late = [np.where(np.arange(20)[:, None] < 5, np.nan, 2.0)]  # what no run knows has the scale of all
    np.testing.assert_allclose(_scale(late, late), np.full((20, 1), 2.0))
    growing = [np.linspace(1.0, 2.0, n)[:, None] for n in (100, 100)]
    np.testing.assert_allclose(_scale(growing, growing)[10:-10, 0], growing[0][10:-10, 0], rtol=0.01)


@pytest.mark.parametrize(("n", "reached"), [(12, 3), (200, 20)])
def test_a_scale_is_smoothed_over_a_tenth_of_the_run_or_over_neighbours(n, reached):
    errors = [np.where(np.arange(n)[:, None] == n // 2, 1.0, 0.0)]
    scale = _scale(errors, errors)[:, 0]
    high = scale > 2 * scale.min()
    assert high.sum() == reached and high[n // 2]
    np.testing.assert_allclose(scale[high], 1.0 / np.sqrt(reached))


def test_folds_of_runs_of_unlike_lengths_have_about_equal_rows():
    groups = np.repeat(np.arange(4), [10, 10, 10, 30])
    assert [len(test) for _, test in BlockedSplit(2).split(np.zeros(60), groups=groups)] == [30, 30]
    long = np.repeat(np.arange(3), [10, 100, 10])  # the middle of none lies in the first or last third: one run each
    assert [len(test) for _, test in BlockedSplit(3).split(np.zeros(120), groups=long)] == [10, 100, 10]


@pytest.mark.parametrize("seed", range(3))
def test_a_set_ends_where_one_run_more_would_be_further_from_its_share(seed):
    lengths = np.random.default_rng(seed).integers(10, 60, 30)
    sets = split_runs(np.repeat(np.arange(30), lengths), validation=0.25, grading=0.4, random_state=seed)
    for rows, share in zip(sets[1:], (0.25, 0.4)):
        assert abs(len(rows) - share * lengths.sum()) <= 30  # half of the longest run


def test_at_each_time_the_rank_is_that_of_the_coverage():
    # Nine errors promise 0.9 by the largest: the ninth of (9 + 1) 0.9; a little more is promised by none.
    errors = [np.array([[np.nan], [k + 1.0]]) for k in range(9)]
    scale = np.ones((2, 1))
    assert _widths(errors, scale, 9, 0.9, "time").ravel().tolist() == [0.0, 9.0]
    assert _widths(errors, scale, 9, 0.5, "time").ravel().tolist() == [0.0, 5.0]
    assert _widths(errors, scale, 9, 0.91, "time")[1, 0] == np.inf
