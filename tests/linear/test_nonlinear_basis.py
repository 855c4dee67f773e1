"""Basis functions with free places and widths: recovery of what was planted, slopes, scikit-learn's contract."""

import numpy as np
import pytest
from scipy.interpolate import BSpline, make_lsq_spline
from sklearn.utils.estimator_checks import check_param_validation, parametrize_with_checks

from sksurrogate.linear import NonlinearBasisRegressor
from sksurrogate.linear._nonlinear_basis import Bumps, Knots


@parametrize_with_checks(
    [
        NonlinearBasisRegressor(n_starts=2),
        NonlinearBasisRegressor("spline", 4, alpha=1e-10, n_starts=1),
        NonlinearBasisRegressor("knots", 3, degree=1, n_starts=1, max_iter=50),
    ],
    xfail_strict=True,
)
def test_sklearn_contract(estimator, check):
    check(estimator)


def test_parameters_are_checked():
    check_param_validation("NonlinearBasisRegressor", NonlinearBasisRegressor())


def test_planted_gaussians_in_two_inputs_are_recovered():
    rng = np.random.default_rng(0)
    X = rng.uniform(-3, 3, (400, 2)) * [1, 50]
    centers, widths = np.array([[-1.0, 40.0], [1.0, -60.0]]), np.array([[0.8, 60.0], [1.5, 30.0]])
    z = (X[:, None] - centers) / widths
    y = np.exp(-0.5 * (z**2).sum(axis=2)) @ [3.0, -2.0] + 10
    model = NonlinearBasisRegressor(n_basis=2, random_state=0).fit(X, y)
    order = np.argsort(model.centers_[:, 0])
    np.testing.assert_allclose(model.centers_[order], centers, rtol=1e-5)
    np.testing.assert_allclose(model.widths_[order], widths, rtol=1e-5)
    np.testing.assert_allclose(model.coef_[order], [3, -2], rtol=1e-5)
    assert model.intercept_ == pytest.approx(10)


@pytest.mark.parametrize("degree", [1, 2, 3])
def test_planted_knots_are_recovered_and_the_fit_is_scipys_spline_on_them(degree):
    rng = np.random.default_rng(1)
    x = np.sort(rng.uniform(0, 10, 300))
    y = np.sin(x) * 0.1 + 3 * np.maximum(x - 2.5, 0) ** degree - 4 * np.maximum(x - 6.0, 0) ** degree
    y -= np.sin(x) * 0.1
    model = NonlinearBasisRegressor("knots", 2, degree=degree, random_state=0).fit(x[:, None], y)
    np.testing.assert_allclose(model.knots_, [[2.5, 6.0]], rtol=1e-4)
    knots = np.r_[[x[0]] * (degree + 1), model.knots_[0], [x[-1]] * (degree + 1)]
    np.testing.assert_allclose(model.predict(x[:, None]), make_lsq_spline(x, y, knots, degree)(x), atol=1e-4)


def test_a_free_knot_beats_uniform_ones():
    x = np.linspace(-1, 1, 200)
    y = np.abs(x - 0.137)
    model = NonlinearBasisRegressor("knots", 1, degree=1, random_state=0).fit(x[:, None], y)
    assert np.abs(model.predict(x[:, None]) - y).max() < 1e-6
    uniform = make_lsq_spline(x, y, np.r_[[-1] * 2, np.linspace(-1, 1, 8)[1:-1], [1] * 2], 1)
    assert np.abs(uniform(x) - y).max() > 1e-3


def test_spline_bump_is_the_cardinal_spline():
    z = np.linspace(-4, 4, 101)
    for degree in (1, 2, 3, 4):
        knots = np.arange(degree + 2) - 0.5 * (degree + 1)
        theirs = BSpline.basis_element(knots, extrapolate=False)
        value, slope = (theirs(0.0) * part for part in Bumps(1, 1, degree).bump(z))  # ours have height 1
        np.testing.assert_allclose(value, np.nan_to_num(theirs(z)), atol=1e-12)
        between = np.abs((z + 0.5 * (degree + 1)) % 1 - 0.5) < 0.49  # not at knots, where degree 1 has two slopes
        np.testing.assert_allclose(slope[between], np.nan_to_num(theirs.derivative()(z))[between], atol=1e-12)


@pytest.mark.parametrize("basis", [Bumps(3, 2, -1), Bumps(3, 2, 3), Knots(3, 2, 2)])
def test_slopes_agree_with_differences(basis):
    rng = np.random.default_rng(2)
    X = rng.normal(size=(20, 2))
    omega = basis.start(X, rng)
    theta = rng.normal(size=len(basis.values(omega, X)))
    tangent = basis.tangent(omega, X, theta)
    for k, step in enumerate(1e-6 * np.eye(len(omega))):
        differences = theta @ (basis.values(omega + step, X) - basis.values(omega - step, X)) / 2e-6
        np.testing.assert_allclose(tangent[k], differences, atol=1e-5)
    for i, step in enumerate(1e-6 * np.eye(2)):
        differences = theta @ (basis.values(omega, X + step) - basis.values(omega, X - step)) / 2e-6
        np.testing.assert_allclose(basis.by_input(omega, X, theta)[i], differences, atol=1e-5)


@pytest.mark.parametrize("basis", ["gaussian", "spline", "knots"])
@pytest.mark.parametrize("n_outputs", [1, 2])
def test_jacobian_of_the_prediction(basis, n_outputs):
    rng = np.random.default_rng(3)
    X = rng.uniform(0, 1, (80, 2)) * [1, 20] + [5, 0]
    Y = np.stack([np.sin(4 * X[:, 0]) + X[:, 1], X[:, 1] ** 2], axis=1)
    y = Y[:, 0] if n_outputs == 1 else Y
    model = NonlinearBasisRegressor(basis, 3, alpha=1e-6, n_starts=1, max_iter=5, random_state=0).fit(X, y)
    slopes = model.jacobian(X)
    assert slopes.shape == ((80, 2) if n_outputs == 1 else (80, 2, 2))
    for j, h in enumerate([1e-6, 1e-5]):
        step = h * np.eye(2)[j]
        differences = (model.predict(X + step) - model.predict(X - step)) / (2 * h)
        np.testing.assert_allclose(slopes[..., j], differences, rtol=1e-4, atol=1e-4)


def test_more_starts_find_deeper_minima():
    x = np.linspace(-1, 1, 60)[:, None]
    y = np.sin(12 * x[:, 0]) * np.exp(x[:, 0])
    one = [NonlinearBasisRegressor(n_basis=4, n_starts=1, random_state=s).fit(x, y).loss_curve_[-1] for s in range(6)]
    many = [NonlinearBasisRegressor(n_basis=4, n_starts=8, random_state=s).fit(x, y).loss_curve_[-1] for s in range(6)]
    assert np.median(many) < np.median(one)


def test_fewer_rows_than_functions_still_give_a_fit():
    X = np.array([[0.0], [1.0], [2.0]])
    model = NonlinearBasisRegressor(n_basis=10, random_state=0).fit(X, [1.0, 2.0, 0.0])
    np.testing.assert_allclose(model.predict(X), [1, 2, 0], atol=1e-6)
    assert np.isfinite(NonlinearBasisRegressor("knots", 10).fit(X, [1.0, 2.0, 0.0]).predict(X)).all()


def test_many_rows_begin_on_a_subsample_and_end_on_all():
    rng = np.random.default_rng(0)
    X = rng.uniform(-3, 3, (25_000, 1))
    y = np.exp(-0.5 * ((X[:, 0] - 1.0) / 0.5) ** 2) + 0.1 * rng.normal(size=len(X))
    model = NonlinearBasisRegressor(n_basis=1, n_starts=3, random_state=0).fit(X, y)
    assert model.centers_[0, 0] == pytest.approx(1.0, abs=0.01) and model.widths_[0, 0] == pytest.approx(0.5, abs=0.01)
    assert model.loss_curve_[-1] * np.var(y) == pytest.approx(0.01, rel=0.05) and len(model.start_losses_) >= 1
