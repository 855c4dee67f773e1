"""Recursive models check their own training runs in free run, and say how far a run is to be trusted."""

import warnings

import numpy as np
import pytest
from sklearn.base import BaseEstimator, RegressorMixin
from sklearn.linear_model import LinearRegression

from sksurrogate.compose import DerivativeRegressor, RecursivePredictor, StateSpaceRegressor
from sksurrogate.datasets import make_reactor_runs


class Growing(RegressorMixin, BaseEstimator):
    """Whatever the data, the past grows by half from step to step."""

    def fit(self, Z, y):
        self.n_features_in_ = Z.shape[1]
        return self

    def predict(self, Z):
        return 1.5 * np.asarray(Z)[:, 0] + 0.1


@pytest.mark.parametrize("model", [DerivativeRegressor(Growing(), n_sub=2), RecursivePredictor(Growing())])
def test_training_runs_that_leave_are_named_with_the_way_out(model):
    X, y, groups = make_reactor_runs(3, 40, random_state=0)
    with pytest.warns(UserWarning, match='3 of 3 training runs leave the range.*run 0.*loss="shooting"'):
        fitted = model.fit(X, y, groups=groups)
    assert fitted.left_region_ == [0, 1, 2]


@pytest.mark.parametrize(
    "model",
    [
        RecursivePredictor(LinearRegression(), 2, 2),
        DerivativeRegressor(LinearRegression(), dt=0.02),
        StateSpaceRegressor(1),
    ],
)
def test_runs_that_stay_are_valid_until_they_leave(model):
    X, y, groups = make_reactor_runs(4, 60, u_range=(0.1, 0.15), y0_range=(4.0, 6.0), random_state=0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        model.fit(X, y, groups=groups)
    assert model.left_region_ == []
    n = model.n_initial_
    inside = model.validity(X[:60], y0=y[:n, None])
    assert inside.shape == (60,) and inside.min() > 0.9
    far = X[:60].copy()
    far[30:40] += 0.2  # four times the range of the inputs
    outside = model.validity(far, y0=y[:n, None])
    np.testing.assert_array_equal(outside[:30], inside[:30])
    assert outside[30:].max() < 1e-6  # from then on: a free run remembers
