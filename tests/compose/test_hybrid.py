"""The hybrid: no correction gives the simulator back; Figure 8 is closed."""

import numpy as np
import pytest
from sklearn.dummy import DummyRegressor

from sksurrogate.compose import HybridRegressor
from sksurrogate.datasets import linear_reactor, make_reactor, make_reactor_runs


def test_a_correction_of_zero_gives_the_simulator_back():
    X, y, groups = make_reactor_runs(2, 60, random_state=0)
    hybrid = HybridRegressor(linear_reactor(), DummyRegressor(strategy="constant", constant=0.0)).fit(
        X, y, groups=groups
    )
    simulated = np.concatenate([linear_reactor().simulate(X[groups == k])[:, 0] for k in range(2)])
    np.testing.assert_array_equal(hybrid.predict(X, groups=groups), simulated)


@pytest.mark.slow
def test_a_perfect_simulator_needs_no_correction():
    X, y, groups = make_reactor_runs(3, 80, random_state=0)
    hybrid = HybridRegressor(make_reactor()).fit(X, y, groups=groups)
    assert hybrid.free_run_rmse_ < 1e-6


@pytest.mark.slow
def test_figure_8_closes_95_percent_of_the_gap_on_unseen_runs():
    from sksurrogate.demo import _closed

    X, y, groups = make_reactor_runs(10, 200, noise=0.02, random_state=0)
    new_X, new_y, new = make_reactor_runs(8, 200, noise=0.02, random_state=1)
    simulator = linear_reactor()
    hybrid = HybridRegressor(simulator).fit(X, y, groups=groups)
    first = np.stack([new_y[new == k][:5] for k in range(8)])[:, :, None]
    before = np.concatenate([simulator.simulate(new_X[new == k], x0=new_y[new == k][:1])[:, 0] for k in range(8)])
    assert _closed(before, hybrid.predict(new_X, y0=first, groups=new), new_y, 0.02) > 0.95


def test_runs_abreast_equal_runs_one_by_one():
    X, y, groups = make_reactor_runs(3, 60, random_state=0)
    hybrid = HybridRegressor(linear_reactor()).fit(X, y, groups=groups)
    together = hybrid.predict(X, groups=groups)
    for k in range(3):
        np.testing.assert_allclose(hybrid.predict(X[groups == k]), together[groups == k], atol=1e-10)


@pytest.mark.slow
def test_y0_of_the_wrong_shape_says_what_is_expected():
    X, y, groups = make_reactor_runs(2, 60, random_state=0)
    hybrid = HybridRegressor(linear_reactor()).fit(X, y, groups=groups)
    with pytest.raises(ValueError, match=r"expected \(5, n_outputs\) or \(2, 5, n_outputs\)"):
        hybrid.predict(X, y0=np.zeros((3, 5, 1)), groups=groups)
