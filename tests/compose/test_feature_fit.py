"""Shooting through features: slopes against differences, planted recursions found again, better free runs."""

import numpy as np
import pytest
from sklearn.ensemble import RandomForestRegressor
from sklearn.linear_model import LinearRegression, Ridge
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import PolynomialFeatures, SplineTransformer, StandardScaler

from sksurrogate.compose import RecursivePredictor
from sksurrogate.exceptions import DataError
from sksurrogate.features import SplineFeatures
from sksurrogate.kernels.lag_basis import BasisLoss, LagBasis
from sksurrogate.kernels.rollout import march
from sksurrogate.linear import PCRRegressor


def planted(n_runs=4, n=120, noise=0.0, seed=0):
    """y[t] = 0.7 y[t-1] - 0.1 y[t-1]^2 + 0.5 u[t], read with noise."""
    rng = np.random.default_rng(seed)
    X, y = rng.uniform(-1, 1, (n_runs, n)), np.zeros((n_runs, n))
    for t in range(1, n):
        y[:, t] = 0.7 * y[:, t - 1] - 0.1 * y[:, t - 1] ** 2 + 0.5 * X[:, t]
    y += noise * rng.normal(size=y.shape)
    return X.reshape(-1, 1), y.ravel(), np.repeat(np.arange(n_runs), n)


def quadratic():
    return make_pipeline(StandardScaler(), PolynomialFeatures(2, include_bias=False), LinearRegression())


@pytest.mark.parametrize("n_outputs", [1, 2])
def test_slopes_and_free_runs_are_those_of_the_plain_loop(n_outputs):
    rng = np.random.default_rng(0)
    U, target = rng.normal(size=(2, 30, 1)), rng.normal(size=(2, 30, n_outputs))
    n_features = 2 * n_outputs + 2
    model = LagBasis(
        lambda z: np.c_[z, np.sin(z)],
        0.1 * rng.normal(size=(2 * n_features, n_outputs)),
        rng.normal(size=n_outputs),
        (1, 3),
        ((0, 0), (0, 2)),
    )
    loss = BasisLoss(U, target, 3)
    y = loss.run(model)
    np.testing.assert_allclose(y, march(model, U, target[:, :3], (1, 3), ((0, 0), (0, 2))))
    np.testing.assert_allclose(loss.run(model, y + 0.1), y, atol=1e-9)
    slopes = loss.slopes(model, y)
    for k in range(len(model.theta)):
        step = 1e-6 * (np.arange(len(model.theta)) == k)
        wanted = (loss.run(model.at(model.theta + step)) - loss.run(model.at(model.theta - step)))[:, 3:] / 2e-6
        np.testing.assert_allclose(slopes[..., k], wanted, atol=1e-6)


@pytest.mark.parametrize("horizon", [None, 1, 7])
def test_a_planted_polynomial_recursion_is_found(horizon):
    X, y, groups = planted()
    model = RecursivePredictor(quadratic(), 0, 1, loss="shooting", horizon=horizon, alpha=0.0)
    model.fit(X, y, groups=groups)
    assert model.free_run_rmse_ < 1e-6 and not model.compiled_
    np.testing.assert_allclose(model.estimator_.predict([[0.3, -0.4]]), 0.7 * 0.3 - 0.1 * 0.09 + 0.5 * -0.4, atol=1e-6)


def test_a_horizon_of_one_step_is_least_squares_on_the_features():
    X, y, groups = planted(noise=0.1)
    fits = [
        RecursivePredictor(quadratic(), 0, 1, loss=loss, horizon=1, alpha=0.0).fit(X, y, groups=groups)
        for loss in ("one_step", "shooting")
    ]
    a, b = (fit.estimator_[-1].coef_ for fit in fits)
    np.testing.assert_allclose(a, b, atol=1e-5)


@pytest.mark.parametrize(
    "estimator",
    [
        quadratic(),
        make_pipeline(SplineFeatures(n_knots=5), Ridge(1e-3)),
        make_pipeline(SplineTransformer(5, extrapolation="linear"), Ridge(1e-3)),
        PCRRegressor(6, features=SplineFeatures(n_knots=5)),
    ],
)
def test_shooting_through_features_beats_one_step_on_noisy_data(estimator):
    X, y, groups = planted(noise=0.15)
    X1, y1, groups1 = planted(n_runs=8, seed=1)
    error = {}
    for loss in ("one_step", "shooting"):
        model = RecursivePredictor(estimator, 0, 1, loss=loss).fit(X, y, groups=groups)
        error[loss] = 1 - model.score(X1, y1, groups=groups1)
    assert error["shooting"] < 0.6 * error["one_step"]
    assert np.isfinite(model.shooting_loss_)


@pytest.mark.slow
def test_two_outputs_and_runs_of_unequal_length():
    X, y, groups = planted()
    Y = np.c_[y, 3 + y**2]
    keep = np.r_[0:400]
    model = RecursivePredictor(quadratic(), 0, 1, loss="shooting", stability=0.1)
    model.fit(X[keep], Y[keep], groups=groups[keep])
    assert model.score(X, Y, groups=groups) > 0.99


def test_what_has_no_slopes_says_what_has():
    X, y, groups = planted()
    with pytest.raises(DataError, match=r"RandomForestRegressor gives none: use a network.*features in a pipeline"):
        RecursivePredictor(RandomForestRegressor(2), loss="shooting").fit(X, y, groups=groups)
