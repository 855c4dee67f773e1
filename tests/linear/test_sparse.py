"""Thresholds and evidence: the planted terms are found, refitted by plain least squares, and written as an equation."""

from math import comb

import numpy as np
import pytest
from sklearn.linear_model import LinearRegression
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import PolynomialFeatures, StandardScaler
from sklearn.utils import estimator_checks
from sklearn.utils.estimator_checks import parametrize_with_checks

from sksurrogate.compose import DerivativeRegressor
from sksurrogate.datasets import simulate_experiments
from sksurrogate.exceptions import DataError
from sksurrogate.kernels.subsets import eliminate, log_evidence, refit, threshold_refit
from sksurrogate.linear import SparseRegressor
from sksurrogate.linear._equation import equation
from sksurrogate.physics import ODESimulator

ESTIMATORS = [
    SparseRegressor(),
    SparseRegressor(0.1, select=None, fit_intercept=False),
    SparseRegressor(max_terms=2, block_size=3),
]


@parametrize_with_checks(ESTIMATORS)
def test_sklearn_contract(estimator, check):
    check(estimator)


def test_parameters_are_checked():
    estimator_checks.check_param_validation("SparseRegressor", SparseRegressor())


def planted(noise=0.1, n=300, p=20, seed=0):
    rng = np.random.default_rng(seed)
    X = rng.normal(size=(n, p)) + 3
    coef = np.zeros((2, p))
    coef[0, [2, 7, 11]], coef[1, [0, 19]] = [1.0, -2.0, 0.5], [3.0, 0.7]
    return X, X @ coef.T + [4.0, -1.0] + noise * rng.normal(size=(n, 2)), coef


@pytest.mark.parametrize("settings", [{}, {"threshold": 0.05, "select": None}, {"threshold": 0.0}])
@pytest.mark.parametrize("noise", [0.0, 0.1])
def test_planted_terms_are_found_and_are_plain_least_squares(settings, noise):
    X, Y, coef = planted(noise)
    model = SparseRegressor(**settings).fit(X, Y)
    np.testing.assert_array_equal(model.support_, coef != 0)
    for k in range(2):
        S = coef[k] != 0
        plain = LinearRegression().fit(X[:, S], Y[:, k])
        np.testing.assert_allclose(model.coef_[k, S], plain.coef_, atol=1e-10)
        assert model.intercept_[k] == pytest.approx(plain.intercept_, abs=1e-9)


def test_false_terms_are_rare_and_grow_no_faster_than_the_evidence_says():
    extra = 0
    for seed in range(40):
        X, Y, coef = planted(1.0, seed=seed)
        extra += int(np.sum(SparseRegressor(0.0).fit(X, Y).support_ & (coef == 0)))
    assert extra <= 4  # 80 fits of 20 columns; the chance of one more term is about 1 / sqrt(300) each


def test_elimination_is_the_best_subset_where_columns_are_orthogonal():
    rng = np.random.default_rng(0)
    Q = np.linalg.qr(rng.normal(size=(30, 6)))[0]
    x = np.array([3.0, -1.0, 0.5, 2.0, 0.0, -4.0])
    path = eliminate(Q * np.arange(1, 7), Q @ x)
    assert path.order[::-1].tolist()[:5] == [5, 0, 3, 1, 2]
    np.testing.assert_allclose(path.squares[:6], np.cumsum(np.sort(x**2))[::-1], rtol=1e-9, atol=1e-12)


def test_the_evidence_is_bic_and_the_number_of_subsets():
    found = log_evidence(np.array([4.0, 1.0]), 100.0)
    assert found[1] - found[0] == pytest.approx(50 * np.log(4.0) - 0.5 * np.log(100.0) - 0.0)
    three = log_evidence(np.array([4.0, 1.0, 1.0, 1.0]), 100.0)
    assert three[1] - three[0] == pytest.approx(50 * np.log(4.0) - 0.5 * np.log(100.0) - np.log(3.0))
    assert np.isinf(log_evidence(np.ones(9), 8.0)[5:]).all()
    same = log_evidence(np.full(6, 2.0), 100.0)
    expected = [-50 * np.log(0.02) - 0.5 * k * np.log(100.0) - np.log(comb(5, k)) for k in range(6)]
    np.testing.assert_allclose(same, expected)


def test_dependent_columns_share_one_place():
    X, Y, _ = planted(0.0)
    twice = np.column_stack([X, X[:, 2], np.ones(len(X))])
    model = SparseRegressor().fit(twice, Y[:, 0])
    assert model.support_.sum() == 3 and model.support_[[2, 20]].sum() == 1
    np.testing.assert_allclose(model.predict(twice), Y[:, 0], atol=1e-9)


def test_thresholds_go_on_until_none_leaves():
    # with columns 0 and 1 nearly equal both pass; once one is dropped by a larger threshold the other takes all
    x = threshold_refit(np.array([[1.0, 0.0], [0.0, 1.0]]), np.array([1.0, 0.4]), np.ones(2), 0.5)
    np.testing.assert_allclose(x, [1.0, 0.0])
    np.testing.assert_allclose(refit(np.eye(2), np.ones(2), np.array([1])), [0.0, 1.0])


def test_weights_and_streams_are_as_in_the_other_linear_fits():
    X, Y, _ = planted()
    w = np.random.default_rng(1).integers(0, 3, len(X))
    one = SparseRegressor().fit(X, Y, sample_weight=w)
    two = SparseRegressor().fit(np.repeat(X, w, axis=0), np.repeat(Y, w, axis=0))
    np.testing.assert_allclose(one.coef_, two.coef_, atol=1e-9)
    stream = SparseRegressor()
    for a in range(0, 300, 100):
        stream.partial_fit(X[a : a + 100], Y[a : a + 100], w[a : a + 100])
    np.testing.assert_allclose(one.coef_, stream.coef_, atol=1e-9)


def test_equations_name_their_terms():
    X, Y, _ = planted(0.0)
    lines = SparseRegressor().fit(X, Y).equations(output_names=["a", "b"], digits=3)
    assert lines == ["a = 4 + 1 x2 - 2 x7 + 0.5 x11", "b = -1 + 3 x0 + 0.7 x19"]
    with pytest.raises(DataError, match=r"output_names=\['a'\] has 1 entries; the model has 2"):
        SparseRegressor().fit(X, Y).equations(output_names=["a"])
    small = [0.5, -0.25, 0.125]
    assert equation("y", np.array(small), ["u", "1", "v"], 0.0) == "y = 0.5 u - 0.25 + 0.125 v"
    assert equation("y", -np.array(small), ["u", "1", "v"], -0.1) == "y = -0.1 - 0.5 u + 0.25 - 0.125 v"
    nothing = SparseRegressor(fit_intercept=False).fit(X, np.zeros(300))
    assert nothing.equations() == ["y = 0"]


@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_the_duffing_equation_is_found_without_derivatives(noise):
    def rhs(t, x, u, p):
        return [x[1], -2 * x[0] - 0.5 * x[1] - 1.5 * x[0] ** 3 + u[0]]

    plant = ODESimulator(rhs, states=["q", "v"], inputs=["u"], outputs=["q", "v"], params={}, dt=0.02)
    data = simulate_experiments(plant, {"q": (-1, 1), "v": (-1, 1)}, {"u": (-1, 1)}, n_runs=12, random_state=0)
    y = data.y + noise * np.random.default_rng(0).normal(size=data.y.shape)
    library = make_pipeline(PolynomialFeatures(3, include_bias=False), SparseRegressor())
    model = DerivativeRegressor(library, 0.02).fit(data.X, y, groups=data.groups)
    support = model.estimator_[-1].support_
    names = model.estimator_[0].get_feature_names_out(["q", "v", "u"])
    assert set(names[support[0]]) == {"v"} and set(names[support[1]]) == {"q", "v", "u", "q^3"}
    first, second = model.equations(digits=2)
    assert first.startswith("dy0/dt") and "y1" in first and "y0^3" in second
    assert model.score(data.X, y, groups=data.groups) > 0.99


def test_equations_say_what_they_need():
    X, Y, _ = planted(n=60)
    groups = np.repeat([0, 1], 30)
    scaled = DerivativeRegressor(make_pipeline(StandardScaler(), SparseRegressor(1e9, select=None))).fit(
        X, Y[:, 0], groups=groups
    )
    assert scaled.equations(2)[0].startswith("dy/dt = ")
    from sklearn.tree import DecisionTreeRegressor

    tree = DerivativeRegressor(DecisionTreeRegressor(max_depth=1)).fit(X, Y[:, 0], groups=groups)
    with pytest.raises(DataError, match="DecisionTreeRegressor has no coef_"):
        tree.equations()


@pytest.mark.parametrize("most", [1, 2, 3, 4, 7])
def test_as_many_terms_as_are_allowed_and_no_more(most):
    X, Y, _ = planted()
    three = SparseRegressor(max_terms=most).fit(X, Y[:, 0])
    assert three.support_.sum() == min(most, 3)
