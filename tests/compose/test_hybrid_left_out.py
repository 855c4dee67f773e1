"""The stated deviation of a hybrid holds on runs that it has not seen, also with residuals that learn runs by heart."""

import numpy as np
import pytest
from sklearn.dummy import DummyRegressor
from sklearn.ensemble import RandomForestRegressor
from sklearn.neighbors import KNeighborsRegressor

from sksurrogate.compose import HybridRegressor
from sksurrogate.compose._left_out import _joined
from sksurrogate.datasets import linear_reactor, make_reactor_runs
from sksurrogate.physics import CallableSimulator


def nothing(U):
    return np.zeros((len(U), 1))


def _data(n_runs, seed, n=100):
    X, y, groups = make_reactor_runs(n_runs, n, random_state=seed)
    return X, y + 0.1 * np.random.default_rng(seed).normal(size=len(y)), groups


@pytest.mark.parametrize("form", ["static", "series"])
@pytest.mark.parametrize(
    "residual", [RandomForestRegressor(10, random_state=0), KNeighborsRegressor(1)], ids=["forest", "neighbour"]
)
def test_the_deviation_of_a_residual_that_learns_by_heart_holds_on_new_runs(residual, form):
    held, ratio = [], []
    for seed in range(2):
        hybrid = HybridRegressor(linear_reactor(), residual, form=form)
        X, y, groups = _data(6, seed)
        hybrid.fit(X, y, groups=groups)
        X, y, groups = _data(6, 100 + seed)
        first = np.stack([y[groups == k][: hybrid.n_initial_] for k in np.unique(groups)])[:, :, None]
        mean, std = hybrid.predict(X, y0=first, groups=groups, return_std=True)
        ahead = std > 0
        z = ((mean - y) / np.where(ahead, std, 1.0))[ahead]
        held.append(np.mean(np.abs(z) < 1.645))
        ratio.append(np.sqrt(np.mean(z**2)))
        assert np.all(hybrid.left_out_rmse_ >= hybrid.free_run_rmse_)
    # In-sample deviations held 0.1 to 0.3 of these 90 % intervals, errors were 6 to 13 times as large.
    assert np.mean(held) > 0.8 and np.mean(ratio) < 1.5


def test_left_out_runs_are_those_of_the_folds():
    """A constant residual: what a fold is off by is the mean of the others less its own deviation."""
    levels, n = np.array([1.0, 2.0, 4.0, 8.0]), 30
    X, groups = np.zeros((4 * n, 1)), np.repeat(np.arange(4), n)
    y = np.repeat(levels, n)
    hybrid = HybridRegressor(None, DummyRegressor(), form="static", n_lags=1).fit(X, y, groups=groups)
    means = [levels[[1, 2]].mean(), levels[[0, 2, 3]].mean(), levels[[0, 1, 3]].mean(), levels[[1, 2]].mean()]
    expected = np.sqrt(np.mean((np.array(means) - levels) ** 2))
    np.testing.assert_allclose(hybrid.left_out_rmse_, expected)
    np.testing.assert_allclose(hybrid.free_run_rmse_, levels.std())


def test_one_run_is_judged_on_each_of_its_eight_blocks():
    """A constant residual: off by the mean of the other blocks; the first row of a block starts it, at both its runs."""
    y = np.r_[np.zeros(42), np.ones(22)]
    hybrid = HybridRegressor(None, DummyRegressor(), form="static", n_lags=1).fit(np.zeros((64, 1)), y)
    expected = []
    for k in range(8):
        taught = [np.arange(8 * k)] * (k > 0) + [np.arange(8 * (k + 1), 64)] * (k < 7)
        mean = np.concatenate([y[rows[1:]] for rows in taught]).mean()
        block = y[8 * k : 8 * (k + 1)] - mean
        expected += [block[1:], block] if k else [block[1:]]
    np.testing.assert_allclose(hybrid.left_out_rmse_, np.sqrt(np.mean(np.concatenate(expected) ** 2)))


def test_runs_too_short_to_be_cut_support_no_correction():
    short = HybridRegressor(None, DummyRegressor(), form="static", n_lags=3).fit(np.zeros((8, 1)), np.arange(8.0))
    np.testing.assert_allclose(short.left_out_rmse_, short.free_run_rmse_)
    hybrid = HybridRegressor(CallableSimulator(nothing), DummyRegressor(), form="static", n_lags=3)
    hybrid.fit(np.zeros((8, 1)), np.arange(8.0))
    np.testing.assert_array_equal(hybrid.predict(np.zeros((8, 1))), 0.0)
    assert hybrid.shrinkage_ == 0.0 and "too short" in str(hybrid.report_)
    report = hybrid.report_  # nothing is kept, nothing gained, nothing was left out
    assert report.shrinkage == report.gain == report.standard_error == report.n_blocks == 0
    assert np.isnan([report.simulator_rmse, report.whole_rmse, report.rmse]).all()


def test_blocks_that_follow_each_other_in_a_run_are_one():
    blocks = [(0, 20, 30), (0, 0, 10), (1, 0, 10), (0, 10, 20), (1, 15, 20), (2, 20, 30)]
    assert _joined(blocks) == [(0, 0, 30), (1, 0, 10), (1, 15, 20), (2, 20, 30)]
