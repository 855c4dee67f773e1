"""Secondary losses against closed forms, constraints against scipy and the optimality conditions."""

import runpy
import warnings
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import LinAlgWarning
from scipy.optimize import LinearConstraint, lsq_linear, minimize, nnls
from scipy.sparse import csr_matrix
from sklearn.base import clone
from sklearn.linear_model import LinearRegression, RidgeCV
from sklearn.linear_model import Ridge as SklearnRidge
from sklearn.model_selection import GridSearchCV
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import MinMaxScaler, PolynomialFeatures, SplineTransformer

from sksurrogate.exceptions import DataError
from sksurrogate.features import SplineFeatures
from sksurrogate.linear import (
    Bounds,
    CloseTo,
    Curvature,
    LinearEquality,
    LinearInequality,
    Monotone,
    OutputBounds,
    PenalizedRegressor,
    Ridge,
    RidgeTo,
    Rows,
    Slope,
)
from sksurrogate.linear._base import _range


def data(n=60, p=5, q=2, seed=0):
    rng = np.random.default_rng(seed)
    X = rng.normal(size=(n, p)) + 1
    return X, X @ rng.normal(size=(p, q)) + rng.normal(size=(n, q)) + 3


def curve(n=80, seed=0):
    """A noisy rising curve of one input."""
    rng = np.random.default_rng(seed)
    x = np.sort(rng.uniform(size=n))
    return x[:, None], np.tanh(4 * (x - 0.5)) + 0.2 * rng.normal(size=n)


# --- the slash operator, paper 2.1 --------------------------------------------------------------------------------


@pytest.mark.parametrize("solver", ["gram", "qr", "auto"])
@pytest.mark.parametrize("rows", [60, 3])
def test_slash_operator(solver, rows):
    X, Y = data()
    X, Y = X[:rows], Y[:rows]
    plain = PenalizedRegressor(fit_intercept=False, solver=solver).fit(X, Y)
    np.testing.assert_allclose(plain.coef_.T, np.linalg.pinv(X) @ Y, atol=1e-9)
    with_constant = PenalizedRegressor(solver=solver).fit(X, Y)
    reference = LinearRegression().fit(X, Y)
    np.testing.assert_allclose(with_constant.coef_, reference.coef_, atol=1e-9)
    np.testing.assert_allclose(with_constant.intercept_, reference.intercept_, atol=1e-9)


@pytest.mark.parametrize("weighted", [False, True])
def test_residual_is_orthogonal_to_the_features(weighted):
    X, Y = data()
    w = np.random.default_rng(1).uniform(size=60) if weighted else np.ones(60)
    model = PenalizedRegressor().fit(X, Y, sample_weight=w if weighted else None)
    residual = w[:, None] * (Y - model.predict(X))
    np.testing.assert_allclose(residual.T @ X, 0, atol=1e-11)
    np.testing.assert_allclose(residual.sum(axis=0), 0, atol=1e-11)


def test_alpha_zero_is_the_slash_operator():
    X, Y = data()
    np.testing.assert_allclose(
        PenalizedRegressor([Ridge(), Curvature()], alpha=0.0).fit(X, Y).coef_, PenalizedRegressor().fit(X, Y).coef_
    )


def test_the_null_space_gets_the_shortest_solution():
    X, Y = data()
    X = np.c_[X, X[:, 0] + X[:, 1], np.full(60, 7.0)]
    model = PenalizedRegressor().fit(X, Y)
    np.testing.assert_allclose(model.coef_, LinearRegression().fit(X, Y).coef_, atol=1e-10)
    assert np.isinf(model.condition_) and model.solver_ == "qr"
    np.testing.assert_allclose(model.coef_[:, -1], 0)


def test_a_nearly_dependent_column_takes_the_qr_route():
    x = np.linspace(0, 1, 300)
    X = np.vander(x, 12, increasing=True)[:, 1:]
    y = X.sum(axis=1) + 1
    model = PenalizedRegressor().fit(X, y)
    assert model.solver_ == "qr" and 1e7 < model.condition_ < 1e11
    np.testing.assert_allclose(model.coef_, 1.0, atol=1e-4)
    with pytest.warns(LinAlgWarning, match=r'nearly dependent.*Solver="auto"'):
        PenalizedRegressor(solver="gram").fit(X, y)
    with pytest.warns(LinAlgWarning, match="Fit all data at once"):
        PenalizedRegressor().partial_fit(X, y)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        ridge = PenalizedRegressor([Ridge()], alpha=1e-6).fit(X, y)
    assert ridge.solver_ == "gram"


def test_large_offsets_cost_no_digits():
    X, Y = data()
    near, far = PenalizedRegressor().fit(X, Y), PenalizedRegressor().fit(X + 1e6, Y + 1e6)
    np.testing.assert_allclose(far.coef_, near.coef_, atol=1e-8)


# --- secondary losses, paper 2.3 ----------------------------------------------------------------------------------


@pytest.mark.parametrize("solver", ["gram", "qr"])
@pytest.mark.parametrize("fit_intercept", [True, False])
def test_ridge_is_that_of_sklearn(solver, fit_intercept):
    X, Y = data()
    w = np.random.default_rng(1).uniform(size=60)
    ours = PenalizedRegressor([Ridge(2.0)], alpha=1.5, solver=solver, fit_intercept=fit_intercept)
    ours.fit(X, Y, sample_weight=w)
    theirs = SklearnRidge(3.0, fit_intercept=fit_intercept).fit(X, Y, sample_weight=w)
    np.testing.assert_allclose(ours.coef_, theirs.coef_, rtol=1e-10)
    np.testing.assert_allclose(ours.intercept_, theirs.intercept_, rtol=1e-10)


def closed_form(X, Y, rows, targets, alpha):
    """All rows stacked, the constant as an ordinary column."""
    A = np.vstack([np.c_[X, np.ones(len(X))], np.sqrt(alpha) * rows])
    return np.linalg.lstsq(A, np.vstack([Y, np.sqrt(alpha) * targets]))[0]


@pytest.mark.parametrize("solver", ["gram", "qr"])
def test_any_weighted_sum_equals_stacked_rows(solver):
    X, Y = data()
    rng = np.random.default_rng(2)
    theta0, points, values, M = (
        rng.normal(size=(2, 5)),
        rng.normal(size=(7, 5)),
        rng.normal(size=(7, 2)),
        np.ones((1, 6)),
    )
    penalties = [
        Ridge(0.5),
        RidgeTo(theta0, 0.3),
        CloseTo(points, values, 2.0),
        Slope(weight=0.7),
        Curvature(weight=0.2, blocks=(2, 3)),
        Slope(points, weight=0.1),
        Rows(M, 3.0, 0.4),
    ]
    model = PenalizedRegressor(penalties, alpha=1.3, solver=solver).fit(X, Y)
    zero = np.zeros((5, 1))
    d1, d2 = np.diff(np.eye(5), axis=0), np.array([[0, 0, 1, -2, 1.0]])
    rows = np.vstack(
        [
            np.sqrt(0.5) * np.c_[np.eye(5), zero],
            np.sqrt(0.3) * np.c_[np.eye(5), zero],
            np.sqrt(2.0) * np.c_[points, np.ones(7)],
            np.sqrt(0.7) * np.c_[d1, zero[:4]],
            np.sqrt(0.2) * np.c_[d2, zero[:1]],
            np.sqrt(0.1 * 7) * np.c_[np.eye(5), zero],
            np.sqrt(0.4) * M,
        ]
    )
    targets = np.zeros((len(rows), 2))
    targets[5:10], targets[10:17], targets[-1] = np.sqrt(0.3) * theta0.T, np.sqrt(2.0) * values, 3 * np.sqrt(0.4)
    theta = closed_form(X, Y, rows, targets, 1.3)
    np.testing.assert_allclose(model.coef_, theta[:5].T, atol=1e-10)
    np.testing.assert_allclose(model.intercept_, theta[5], atol=1e-10)


def test_large_weights_reach_what_they_ask_for():
    X, Y = data()
    theta0 = np.arange(5.0)
    np.testing.assert_allclose(
        PenalizedRegressor([RidgeTo(theta0)], alpha=1e9).fit(X, Y).coef_, [theta0] * 2, atol=1e-5
    )
    given = LinearRegression().fit(X, Y[:, ::-1])
    for values in (given, given.predict, given.predict(X)):
        model = PenalizedRegressor([CloseTo(X, values)], alpha=1e9).fit(X, Y)
        np.testing.assert_allclose(model.predict(X), given.predict(X), atol=1e-5)
    assert np.ptp(PenalizedRegressor([Slope()], alpha=1e9).fit(X, Y).coef_[0]) < 1e-5
    assert np.abs(np.diff(PenalizedRegressor([Curvature()], alpha=1e9).fit(X, Y).coef_, 2)).max() < 1e-5


SPLINES = SplineTransformer(12, degree=3, include_bias=False, sparse_output=True)


def test_a_heavy_slope_leaves_a_constant_and_a_heavy_curvature_a_line():
    X, y = curve()
    region = np.linspace(X.min(), X.max(), 40)
    flat = PenalizedRegressor([Slope(region)], alpha=1e6, features=SPLINES).fit(X, y)
    np.testing.assert_allclose(flat.predict(X), y.mean(), atol=1e-4)
    straight = PenalizedRegressor([Curvature(region)], alpha=1e4, features=SPLINES).fit(X, y)
    np.testing.assert_allclose(straight.predict(X), LinearRegression().fit(X, y).predict(X), atol=1e-3)


def test_curvature_counts_mixed_derivatives_twice():
    rng = np.random.default_rng(0)
    X = rng.uniform(-1, 1, size=(200, 2))
    poly = PolynomialFeatures(2, include_bias=False)  # x, z, x^2, xz, z^2
    model = PenalizedRegressor([Curvature([[0.0, 0.0], [0.2, 0.1]])], features=poly, fit_intercept=False)
    model.fit(X, X[:, 0])
    rows, targets = model._penalty_rows()
    # Frobenius norm of [[2a, b], [b, 2c]] is 4a^2 + 2b^2 + 4c^2, at two points
    np.testing.assert_allclose(rows.T @ rows, np.diag([0, 0, 8, 4, 8.0]), atol=1e-4)
    assert not targets.any()


@pytest.mark.parametrize("zero", [0.0, 1000.0, -1000.0])
def test_curvature_does_not_depend_on_where_zero_is(zero):
    x = np.linspace(0.0, 1.0, 60)[:, None]
    model = PenalizedRegressor([Curvature(zero + x[10:50])], features=SplineFeatures(8)).fit(
        zero + x, np.sin(9 * x[:, 0])
    )
    plain = PenalizedRegressor([Curvature(x[10:50])], features=SplineFeatures(8)).fit(x, np.sin(9 * x[:, 0]))
    rows, wanted = model._penalty_rows()[0], plain._penalty_rows()[0]
    np.testing.assert_allclose(rows, wanted, atol=1e-5 * np.abs(wanted).max())


def test_curvature_of_a_sine_is_its_integral():
    x = np.linspace(0.05, 0.95, 500)[:, None]
    model = PenalizedRegressor([Curvature(x)], alpha=0.0, features=SplineTransformer(30, degree=5, include_bias=False))
    model.fit(x, np.sin(5 * x[:, 0]))
    rows, _ = model._penalty_rows()
    theta = np.r_[model.coef_, 0.0]
    assert np.sum((rows @ theta) ** 2) == pytest.approx(np.sum((25 * np.sin(5 * x)) ** 2), rel=1e-3)


# --- lambda -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("flat", [True, False])
def test_gcv_is_that_of_its_definition(flat):
    X, Y = data(p=8)
    y = Y[:, 0] if flat else Y
    alphas = np.logspace(-3, 4, 30)
    model = PenalizedRegressor([Ridge()], alpha="gcv", alphas=alphas).fit(X, y)
    Z, T = X - X.mean(axis=0), (Y - Y.mean(axis=0))[:, : 1 if flat else 2]
    scores = []
    for alpha in alphas:
        hat = Z @ np.linalg.solve(Z.T @ Z + alpha * np.eye(8), Z.T) + 1 / 60
        scores.append(60 * np.sum((T - hat @ T) ** 2) / (60 - np.trace(hat)) ** 2)
    np.testing.assert_allclose(model.gcv_scores_, scores, rtol=1e-8)
    assert model.alpha_ == alphas[np.argmin(scores)]
    np.testing.assert_allclose(model.coef_, np.squeeze(SklearnRidge(model.alpha_).fit(X, y).coef_), rtol=1e-9)


def test_gcv_chooses_near_leave_one_out():
    rng = np.random.default_rng(0)
    X = rng.normal(size=(80, 40))
    y = X @ rng.normal(size=40) + 5 * rng.normal(size=80)
    ours = PenalizedRegressor([Ridge()], alpha="gcv").fit(X, y).alpha_
    theirs = RidgeCV(np.logspace(-3, 4, 141)).fit(X, y).alpha_
    assert 0.3 < ours / theirs < 3


def test_gcv_smooths_noisy_data():
    rng = np.random.default_rng(0)
    x = np.linspace(0, 1, 200)[:, None]
    truth = np.sin(6 * x[:, 0])
    y = truth + 0.3 * rng.normal(size=200)
    spline = SplineTransformer(60, include_bias=False, sparse_output=True)
    rough = PenalizedRegressor(features=spline).fit(x, y)
    smooth = PenalizedRegressor([Curvature()], alpha="gcv", features=spline).fit(x, y)
    error = [np.sqrt(np.mean((m.predict(x) - truth) ** 2)) for m in (rough, smooth)]
    assert error[1] < 0.6 * error[0]


def test_lambda_by_validation():
    X, Y = data(p=8)
    search = GridSearchCV(
        make_pipeline(MinMaxScaler((-1, 1)), PenalizedRegressor([Ridge(), Slope(weight=0.1)])),
        {"penalizedregressor__alpha": np.logspace(-3, 3, 7), "penalizedregressor__penalties": [[Ridge()], [Slope()]]},
    )
    assert search.fit(X, Y).best_score_ > 0.5


# --- constraints --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("solver", ["gram", "qr"])
def test_bounds_equal_scipy(solver):
    X, Y = data()
    lower, upper = np.array([-0.1, 0, 0, -np.inf, 0]), np.array([0.1, np.inf, 0.2, 0, 0.5])
    model = PenalizedRegressor(constraints=[Bounds(lower, upper)], fit_intercept=False, solver=solver).fit(X, Y)
    for k in range(2):
        reference = lsq_linear(X, Y[:, k], (lower, upper), method="bvls", tol=1e-14).x
        np.testing.assert_allclose(model.coef_[k], reference, atol=1e-9)
        held = model.active_[k] != 0
        np.testing.assert_array_equal(held, np.isclose(reference, lower) | np.isclose(reference, upper))


def test_equality_equals_elimination():
    X, Y = data()
    model = PenalizedRegressor(constraints=[LinearEquality(np.ones((1, 5)), [2.0])]).fit(X, Y)
    np.testing.assert_allclose(model.coef_.sum(axis=1), 2.0)
    # theta_4 = 2 - sum of the others
    reduced = LinearRegression().fit(X[:, :4] - X[:, 4:], Y - 2 * X[:, 4:])
    np.testing.assert_allclose(model.coef_[:, :4], reduced.coef_, atol=1e-10)
    np.testing.assert_allclose(model.intercept_, reduced.intercept_, atol=1e-10)


def test_the_intercept_can_be_constrained_too():
    X, Y = data()
    through = PenalizedRegressor(constraints=[LinearEquality([[0, 0, 0, 0, 0, 1.0]])]).fit(X, Y)
    np.testing.assert_allclose(through.intercept_, 0, atol=1e-10)
    np.testing.assert_allclose(through.coef_, PenalizedRegressor(fit_intercept=False).fit(X, Y).coef_, atol=1e-9)


def test_inequalities_and_penalties_equal_a_general_solver():
    X, Y = data(q=1)
    y = Y[:, 0]
    M = np.random.default_rng(5).normal(size=(4, 5))
    model = PenalizedRegressor(
        [Ridge()], [LinearInequality(M, 0.1), Bounds(lower=-0.5)], alpha=3.0, fit_intercept=False
    )
    model.fit(X, y)
    reference = minimize(
        lambda t: np.sum((y - X @ t) ** 2) + 3 * t @ t,
        np.zeros(5),
        jac=lambda t: 2 * X.T @ (X @ t - y) + 6 * t,
        constraints=[LinearConstraint(M, -np.inf, 0.1), LinearConstraint(np.eye(5), -0.5, np.inf)],
        method="SLSQP",
        options={"ftol": 1e-14, "maxiter": 1000},
    )
    np.testing.assert_allclose(model.coef_, reference.x, atol=1e-6)
    # Sufficient for the minimum: within the constraints, and the slope of the loss is pressed against those that hold.
    rows, room = np.vstack([M, -np.eye(5)]), np.r_[np.full(4, 0.1), np.full(5, 0.5)]
    left = room - rows @ model.coef_
    assert left.min() > -1e-9
    slope = 2 * X.T @ (X @ model.coef_ - y) + 6 * model.coef_
    _, unexplained = nnls(rows[left < 1e-7].T, -slope)
    assert unexplained < 1e-7 * np.linalg.norm(slope)


@pytest.mark.parametrize("increasing", [True, False])
@pytest.mark.parametrize("solver", ["gram", "qr"])
def test_monotone_over_a_region(increasing, solver):
    X, y = curve()
    y = y if increasing else -y
    region = np.linspace(X.min(), X.max(), 200)
    free = PenalizedRegressor(features=SPLINES, solver=solver).fit(X, y)
    held = clone(free).set_params(constraints=[Monotone(region, increasing=increasing)]).fit(X, y)
    sign = 1 if increasing else -1
    assert np.diff(sign * free.predict(region[:, None])).min() < -1e-3
    assert (sign * held.jacobian(region[:, None])).min() > -1e-7
    # between two points where the slope is zero it may dip by the square of their distance
    assert np.diff(sign * held.predict(region[:, None])).min() > -1e-4
    assert held.score(X, y) > 0.9 * free.score(X, y)


def test_output_bounds_over_a_region():
    X, y = curve()
    region = np.linspace(X.min(), X.max(), 200)[:, None]
    model = PenalizedRegressor(constraints=[OutputBounds(region, -0.8, 0.8)], features=SPLINES).fit(X, y)
    inside = model.predict(region)
    assert inside.min() >= -0.8 - 1e-8 and inside.max() <= 0.8 + 1e-8
    assert inside.min() < -0.79 and inside.max() > 0.79


def test_bounds_of_each_output():
    X, Y = data()
    model = PenalizedRegressor(constraints=[Bounds(upper=[[0.1] * 5, [0.2] * 5])]).fit(X, Y)
    np.testing.assert_allclose(model.coef_.max(axis=1), [0.1, 0.2])


def test_constraints_of_a_stream():
    X, Y = data()
    model = PenalizedRegressor(constraints=[Bounds(-0.2, 0.2)])
    whole = clone(model).fit(X, Y)
    for a in range(0, 60, 20):
        model.partial_fit(X[a : a + 20], Y[a : a + 20])
    np.testing.assert_allclose(model.coef_, whole.coef_, atol=1e-9)


# --- what the user reads ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "params, message",
    [
        ({"penalties": ["ridge"]}, "penalties holds 'ridge', expected penalties such as"),
        ({"penalties": [Ridge(-1.0)]}, r"penalties: Ridge\(weight=-1.0\): expected a weight of at least 0"),
        ({"penalties": [RidgeTo([1, 2])]}, r"RidgeTo\(theta0=...\) has shape \(2,\)"),
        ({"penalties": [CloseTo([[1.0, 2]], 0.0)]}, r"points have shape \(1, 2\), expected \(n_points, 5\)"),
        ({"penalties": [CloseTo(np.ones((3, 5)), [1.0, 2, 3, 4])]}, r"CloseTo\(values=...\) has shape \(4,\)"),
        ({"penalties": [Slope([[np.nan] * 5])]}, "points hold NaN"),
        ({"penalties": [Slope(blocks=(2, 2))]}, "must be positive and sum to the 5 features"),
        ({"penalties": [Rows(np.ones((2, 3)))]}, r"matrix has shape \(2, 3\), expected \(n_rows, 5\)"),
        ({"constraints": [Ridge()]}, "constraints holds Ridge.*expected constraints such as"),
        ({"constraints": [Bounds(1.0, 0.0)]}, r"no coefficients fulfil all constraints \['Bounds'\] of output 0"),
        ({"constraints": [Monotone(np.ones((1, 5)), input=5)]}, r"Monotone\(input=5\) is out of range"),
        ({"alpha": "gcv"}, "but there are none: give penalties="),
        (
            {"alpha": "gcv", "penalties": [Ridge()], "alphas": [-1.0]},
            r"alphas=\[-1.0\]: expected numbers of at least 0",
        ),
    ],
)
def test_errors_name_the_parameter_and_the_way_out(params, message):
    X, Y = data()
    with pytest.raises(DataError, match=message):
        PenalizedRegressor(**params).fit(X, Y)


def test_many_more_features_than_rows():
    rng = np.random.default_rng(0)
    X, y = rng.normal(size=(30, 1500)), rng.normal(size=30)
    slash = PenalizedRegressor().fit(X, y)
    np.testing.assert_allclose(slash.coef_, LinearRegression().fit(X, y).coef_, atol=1e-12)
    ridge = PenalizedRegressor([Ridge(5.0)]).fit(X, y)
    np.testing.assert_allclose(ridge.coef_, SklearnRidge(5.0).fit(X, y).coef_, atol=1e-10)


@pytest.mark.parametrize("solver", ["gram", "qr", "auto"])
def test_what_offsets_were_rounded_to_is_no_direction(solver):
    # the third column is a combination of the others but for the last place of its offset
    rng = np.random.default_rng(0)
    a = rng.normal(size=(50, 2))
    X = np.c_[a, a[:, 0] - a[:, 1] + 1e5, np.full(50, 0.1)]
    y = a @ [1.0, 2.0] + 0.1 * rng.normal(size=50)
    model = PenalizedRegressor(solver=solver).fit(X, y)
    np.testing.assert_allclose(model.predict(X), LinearRegression().fit(a, y).predict(a), atol=1e-6)
    assert np.abs(model.coef_).max() < 3 and model.coef_[3] == 0


def test_neighbours_are_those_of_the_splines():
    rng = np.random.default_rng(0)
    X = rng.uniform(size=(300, 2))
    y = X[:, 0] + 2 * X[:, 1]
    additive = PenalizedRegressor([Curvature()], features=SplineFeatures(5)).fit(X, y)
    rows, _ = additive._penalty_rows()
    assert rows.shape == (2 * (7 - 2), 15)
    given = clone(additive).set_params(penalties=[Curvature(blocks=(7, 7))]).fit(X, y)
    np.testing.assert_array_equal(given.coef_, additive.coef_)
    tensor = PenalizedRegressor([Curvature(weight=1e3)], features=SplineFeatures(5, interaction="tensor")).fit(X, y)
    rows, _ = tensor._penalty_rows()
    assert rows.shape == (2 * 7 * 5, 50)
    # planes (uniform knots) have no second differences along either axis
    np.testing.assert_allclose(tensor.predict(X), y, atol=1e-6)
    theta = np.arange(49.0).reshape(7, 7)[:, ::-1].ravel() ** 2
    squares = (np.diff(theta.reshape(7, 7), 2, axis=k) ** 2 for k in (0, 1))
    assert np.sum((rows[:, :49] @ theta) ** 2) == pytest.approx(1e3 * sum(map(np.sum, squares)))


@pytest.mark.parametrize("solver", ["gram", "qr"])
def test_an_offset_of_y_moves_the_intercept_only(solver):
    X, Y = data(p=8)
    points = X[:4]
    model = PenalizedRegressor(
        [Ridge(), CloseTo(points, 1.0, 0.1)], [OutputBounds(X, upper=8.0)], alpha="gcv", solver=solver
    ).fit(X, Y)
    lifted = clone(model).set_params(
        penalties=[Ridge(), CloseTo(points, 1.0 + 1e6, 0.1)], constraints=[OutputBounds(X, upper=8.0 + 1e6)]
    )
    lifted.fit(X, Y + 1e6)
    assert lifted.alpha_ == pytest.approx(model.alpha_)
    np.testing.assert_allclose(lifted.coef_, model.coef_, atol=1e-6)
    np.testing.assert_allclose(lifted.intercept_ - 1e6, model.intercept_, atol=1e-6)
    assert max(map(np.count_nonzero, model.active_)) > 0


def test_example_of_secondary_losses(monkeypatch):
    pyplot = pytest.importorskip("matplotlib.pyplot")
    monkeypatch.setattr(pyplot, "show", lambda: None)
    example = Path(__file__).parents[2] / "examples" / "fits" / "plot_secondary_losses.py"
    errors = runpy.run_path(str(example))["errors"]
    pyplot.close("all")
    assert errors["nothing: the slash operator"] > 10
    assert (
        max(errors["slope"], errors["curvature"], errors["rising"], errors["rising, within, little curvature"]) < 0.12
    )


def test_the_range_of_sparse_rows_is_that_of_dense_ones():
    X = np.random.default_rng(0).normal(size=(7, 3)) * [1.0, 10.0, 100.0]
    X[2, 1] = 0.0
    for dense, thin in zip(_range(X), _range(csr_matrix(X))):
        np.testing.assert_array_equal(dense, thin)
