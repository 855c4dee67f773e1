"""The forms of the hybrid, on plants that each of them can represent."""

import numpy as np
import pytest
from sklearn.linear_model import LinearRegression

from sksurrogate.compose import HybridRegressor
from sksurrogate.datasets import linear_reactor, make_reactor_runs
from sksurrogate.physics import CallableSimulator


def half(U):
    return 0.5 * U[:, [0]]


@pytest.mark.parametrize("form", ["output", "static", "series"])
def test_every_form_finds_a_static_affine_gap(form):
    rng = np.random.default_rng(0)
    X, groups = rng.normal(size=(200, 1)), np.repeat([0, 1], 100)
    y = X[:, 0] + 0.3
    hybrid = HybridRegressor(CallableSimulator(half), LinearRegression(), form).fit(X, y, groups=groups)
    predicted = hybrid.predict(X, y0=y[:5], groups=np.zeros(200, int))
    np.testing.assert_allclose(predicted[5:], y[5:], atol=1e-8)


@pytest.mark.parametrize("form", ["static", "series"])
def test_forms_without_a_past_do_not_need_the_first_outputs(form):
    X, y, groups = make_reactor_runs(6, 120, random_state=0)
    hybrid = HybridRegressor(linear_reactor(), form=form).fit(X, y, groups=groups)
    assert np.all(np.isfinite(hybrid.predict(X, groups=groups)))


def test_an_unknown_form_speaks():
    with pytest.raises(ValueError, match=r"'form' parameter of HybridRegressor must be.*Got 'nope'"):
        HybridRegressor(linear_reactor(), form="nope").fit(np.ones((20, 1)), np.ones(20))
