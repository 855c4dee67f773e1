"""Linear lag models: the lag matrix decides."""

import numpy as np
import pandas as pd
import pytest
from sklearn.linear_model import LinearRegression
from sklearn.linear_model import Ridge as SklearnRidge
from sklearn.utils.estimator_checks import parametrize_with_checks

from sksurrogate.exceptions import DataError, RunError
from sksurrogate.features import LagEmbedding
from sksurrogate.linear import LaggedLinearRegressor, PCRRegressor, PenalizedRegressor, Ridge

ORDER = "row order matters to lags"
EXPECTED = {"check_methods_sample_order_invariance": ORDER, "check_methods_subset_invariance": ORDER}


@parametrize_with_checks(
    [LaggedLinearRegressor(), LaggedLinearRegressor([0, 2], estimator=PCRRegressor())],
    expected_failed_checks=lambda estimator: EXPECTED,
    xfail_strict=True,
)
def test_sklearn_contract(estimator, check):
    check(estimator)


def data(n=300, q=1, seed=0):
    rng = np.random.default_rng(seed)
    X = rng.normal(size=(n, 2)) + [5, 0]
    groups = np.repeat(["a", "b", "c"], [n // 2, n // 3, n - n // 2 - n // 3])
    return X, rng.normal(size=(n, q)) + X @ rng.normal(size=(2, q)), groups


@pytest.mark.parametrize("lags", [0, 3, [1, 4], {1: [0, 2], 0: 3}, {1: 5}])
@pytest.mark.parametrize("q", [None, 2])
def test_equals_the_lag_matrix(lags, q):
    X, Y, groups = data(q=q or 1)
    y = Y[:, 0] if q is None else Y
    model = LaggedLinearRegressor(lags).fit(X, y, groups=groups)
    embedding = LagEmbedding(lags)
    Phi = embedding.fit_transform(X, groups=groups)
    known = embedding.complete(X, groups=groups)
    reference = LinearRegression().fit(Phi[known], y[known])
    assert model.columns_ == embedding.columns_
    np.testing.assert_allclose(model.coef_, reference.coef_, atol=1e-11)
    np.testing.assert_allclose(model.intercept_, reference.intercept_, atol=1e-10)
    np.testing.assert_allclose(model.predict(X, groups=groups), reference.predict(Phi), atol=1e-10)
    np.testing.assert_allclose(model.estimator_.predict(Phi), reference.predict(Phi), atol=1e-10)
    assert model.score(X, y, groups=groups) == pytest.approx(reference.score(Phi, y))


def test_a_penalty_is_that_of_the_estimator():
    X, Y, groups = data()
    model = LaggedLinearRegressor(3, estimator=PenalizedRegressor([Ridge(10.0)])).fit(X, Y[:, 0], groups=groups)
    embedding = LagEmbedding(3)
    Phi = embedding.fit_transform(X, groups=groups)[embedding.complete(X, groups=groups)]
    reference = SklearnRidge(10.0).fit(Phi, Y[embedding.complete(X, groups=groups), 0])
    np.testing.assert_allclose(model.coef_, reference.coef_, atol=1e-10)


def test_a_planted_arx_model_is_found():
    rng = np.random.default_rng(0)
    u, y = rng.normal(size=500), np.zeros(500)
    for t in range(2, 500):
        y[t] = 1.5 * y[t - 1] - 0.7 * y[t - 2] + u[t - 1] + 2.0
    frame = pd.DataFrame({"u": u, "y": y})
    model = LaggedLinearRegressor({"y": [1, 2], "u": [1]}).fit(frame, y)
    np.testing.assert_allclose(model.coef_, [1.5, -0.7, 1.0], atol=1e-9)
    assert model.intercept_ == pytest.approx(2.0) and model.feature_names_ == ["y_lag1", "y_lag2", "u_lag1"]
    np.testing.assert_allclose(model.predict(frame)[2:], y[2:], atol=1e-9)


def test_run_column_and_rows_left_out():
    X, Y, groups = data()
    labels = np.select([groups == "a", groups == "b"], [0, 1], -1)
    table = np.c_[X, labels]
    model = LaggedLinearRegressor(2, run=2).fit(table, Y[:, 0])
    keep = labels >= 0
    reference = LaggedLinearRegressor(2).fit(X[keep], Y[keep, 0], groups=groups[keep])
    np.testing.assert_allclose(model.coef_, reference.coef_, atol=1e-12)
    predicted = model.predict(table)
    assert np.isnan(predicted[~keep]).all() and np.isfinite(predicted[keep]).all()
    assert np.isfinite(model.score(table, Y[:, 0]))


@pytest.mark.parametrize("frame", [False, True])
@pytest.mark.parametrize("flat", [False, True])
def test_windows_with_holes_are_dropped_if_told_so(frame, flat):
    X, Y, groups = data()
    X, Y = X.copy(), Y[:, 0].copy() if flat else Y.copy()
    X[7, 0], X[20:23, 1], Y[40] = np.nan, np.nan, np.nan
    table = pd.DataFrame(X, columns=[f"u{j}" for j in range(X.shape[1])]) if frame else X
    with pytest.raises(ValueError, match="NaN"):
        LaggedLinearRegressor(2).fit(table, Y, groups=groups)
    model = LaggedLinearRegressor(2, missing="drop").fit(table, Y, groups=groups)
    whole = np.isfinite(X).all(axis=1) & np.isfinite(Y.reshape(len(Y), -1)).all(axis=1)
    stretches = np.cumsum(~whole) * 10 + pd.factorize(groups)[0]
    reference = LaggedLinearRegressor(2).fit(X[whole], Y[whole], groups=stretches[whole])
    np.testing.assert_allclose(model.coef_, reference.coef_, atol=1e-10)
    predicted = model.predict(table, groups=groups)
    assert np.isnan(predicted[[7, 8, 9, 20, 24]]).all() and np.isfinite(predicted[[6, 10, 19, 25, 40]]).all()
    assert np.isfinite(model.score(table, Y, groups=groups))
    with pytest.raises(RunError, match="longest stretch without nan has"):
        LaggedLinearRegressor(300, missing="drop").fit(table, Y, groups=groups)


def test_slopes_by_the_lagged_columns_are_the_coefficients():
    X, Y, groups = data(q=2)
    model = LaggedLinearRegressor(2).fit(X, Y, groups=groups)
    rows = LagEmbedding(2).fit_transform(X, groups=groups)
    order = [model.columns_.index(column) for column in LagEmbedding(2).fit(X, groups=groups).columns_]
    slopes = model.jacobian(X, groups=groups)[:, :, order]
    np.testing.assert_allclose(
        np.einsum("npj,nj->np", slopes, rows) + model.intercept_, model.predict(X, groups=groups)
    )


def test_errors_name_the_way_out():
    X, Y, _ = data()
    with pytest.raises(DataError, match=r'missing=.*must be "error" or "drop"'):
        LaggedLinearRegressor(missing="skip").fit(X, Y)
    for lags in ("x", 1.5, [0.5], [-1]):
        with pytest.raises(DataError, match="give an int or a list of ints"):
            LaggedLinearRegressor(lags).fit(X, Y)
    with pytest.raises(RunError, match="longest lag 400 needs 401"):
        LaggedLinearRegressor(400).fit(X, Y)
    with pytest.raises(DataError, match="asks for no column"):
        LaggedLinearRegressor({}).fit(X, Y)
    with pytest.raises(DataError, match="lags names the column 'u'"):
        LaggedLinearRegressor({"u": 1}).fit(X, Y)
    with pytest.raises(DataError, match=r"cannot be fitted from moments.*LagEmbedding\(lags\)"):
        LaggedLinearRegressor(estimator=LinearRegression()).fit(X, Y)
    with pytest.raises(DataError, match="features must be None"):
        LaggedLinearRegressor(estimator=PCRRegressor(features=LagEmbedding())).fit(X, Y)


@pytest.mark.parametrize("estimator", [None, PCRRegressor(3)])
def test_runs_may_come_one_after_the_other(estimator):
    X, Y, groups = data(q=2)
    whole = LaggedLinearRegressor(3, estimator=estimator).fit(X, Y, groups=groups)
    stream = LaggedLinearRegressor(3, estimator=estimator)
    for label in "abc":
        stream.partial_fit(X[groups == label], Y[groups == label])
    np.testing.assert_allclose(stream.coef_, whole.coef_, atol=1e-12)
    np.testing.assert_allclose(stream.intercept_, whole.intercept_, atol=1e-12)
    with pytest.raises(DataError, match="1 outputs, but the runs before had 2"):
        stream.partial_fit(X, Y[:, 0])
