"""Principal component regression against the singular value decomposition and scikit-learn."""

import runpy
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import LinAlgWarning
from sklearn.base import clone
from sklearn.decomposition import PCA
from sklearn.linear_model import LinearRegression
from sklearn.model_selection import GridSearchCV
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from sksurrogate.features import SplineFeatures
from sksurrogate.linear import PCRRegressor


def data(n=70, p=8, q=2, seed=0):
    rng = np.random.default_rng(seed)
    X = rng.normal(size=(n, p)) @ rng.normal(size=(p, p)) + 3
    return X, X @ rng.normal(size=(p, q)) + rng.normal(size=(n, q))


@pytest.mark.parametrize("solver", ["gram", "qr"])
@pytest.mark.parametrize("scale", [True, False])
@pytest.mark.parametrize("r", [1, 3, 8])
def test_equals_the_pipeline_of_sklearn(solver, scale, r):
    X, Y = data()
    ours = PCRRegressor(r, scale=scale, solver=solver).fit(X, Y)
    steps = [StandardScaler()] if scale else []
    theirs = make_pipeline(*steps, PCA(r, svd_solver="full"), LinearRegression()).fit(X, Y)
    np.testing.assert_allclose(ours.predict(X), theirs.predict(X), atol=1e-9)
    pca = theirs[-2]
    np.testing.assert_allclose(np.abs(np.sum(ours.components_ * pca.components_, axis=1)), 1, atol=1e-9)
    np.testing.assert_allclose(ours.explained_variance_ratio_, pca.explained_variance_ratio_, rtol=1e-9)
    np.testing.assert_allclose(ours.explained_variance_ * 70 / 69, pca.explained_variance_, rtol=1e-9)
    assert ours.solver_ == solver and ours.n_components_ == r


@pytest.mark.parametrize("solver", ["gram", "qr"])
def test_truncated_singular_values(solver):
    X, Y = data()
    Z = X - X.mean(axis=0)
    U, s, Vt = np.linalg.svd(Z, full_matrices=False)
    expected = Vt[:4].T @ ((U[:, :4].T @ Y) / s[:4, None])
    np.testing.assert_allclose(PCRRegressor(4, solver=solver).fit(X, Y).coef_.T, expected, atol=1e-9)


def test_all_components_are_least_squares():
    X, Y = data()
    np.testing.assert_allclose(PCRRegressor().fit(X, Y).coef_, LinearRegression().fit(X, Y).coef_, atol=1e-8)


def test_a_null_space_is_left_out():
    X, Y = data()
    X = np.c_[X, X[:, 0], np.full(70, 1e6)]
    for scale in (False, True):
        model = PCRRegressor(scale=scale).fit(X, Y)
        assert model.n_components_ == 8
        np.testing.assert_allclose(model.predict(X), LinearRegression().fit(X[:, :8], Y).predict(X[:, :8]), atol=1e-7)
    assert PCRRegressor(100).fit(X, Y).n_components_ == 8
    np.testing.assert_allclose(PCRRegressor().fit(X, Y).coef_, LinearRegression().fit(X, Y).coef_, atol=1e-7)


@pytest.mark.parametrize("share", [0.3, 0.8, 0.999])
def test_share_of_variance(share):
    X, Y = data()
    ours = PCRRegressor(share).fit(X, Y)
    assert ours.n_components_ == PCA(share, svd_solver="full").fit(X).n_components_
    assert ours.explained_variance_ratio_.sum() >= share > ours.explained_variance_ratio_[:-1].sum()


def test_gcv_is_that_of_its_definition():
    X, Y = data()
    model = PCRRegressor("gcv").fit(X, Y)
    for r in range(1, 9):
        residual = Y - PCRRegressor(r).fit(X, Y).predict(X)
        assert model.gcv_scores_[r] == pytest.approx(70 * np.sum(residual**2) / (70 - 1 - r) ** 2)
    assert model.gcv_scores_[0] == pytest.approx(70 * np.sum((Y - Y.mean(axis=0)) ** 2) / 69**2)
    assert model.n_components_ == np.argmin(model.gcv_scores_)


def test_gcv_finds_a_low_rank():
    rng = np.random.default_rng(0)
    latent = rng.normal(size=(200, 3)) * [5, 4, 3]
    X = latent @ np.linalg.qr(rng.normal(size=(20, 3)))[0].T + 0.1 * rng.normal(size=(200, 20))
    y = latent @ [1.0, -1, 2] + 0.5 * rng.normal(size=200)
    # an unlucky component or two may pass: the criterion is asymptotic
    assert 3 <= PCRRegressor("gcv").fit(X, y).n_components_ <= 6


def test_nothing_to_learn_gives_the_mean():
    model = PCRRegressor(2).fit(np.ones((4, 3)), np.arange(4.0))
    assert model.n_components_ == 0 and not model.coef_.any() and model.intercept_ == 1.5


def test_small_components_take_the_qr_route():
    x = np.linspace(0, 1, 300)
    X = np.vander(x, 16, increasing=True)[:, 1:]
    y = np.exp(x)
    auto = PCRRegressor(solver="auto").fit(X, y)
    assert auto.solver_ == "qr" and auto.n_components_ == 15
    np.testing.assert_allclose(auto.predict(X), y, atol=1e-9)
    assert PCRRegressor(6).fit(X, y).solver_ == "gram"
    with pytest.warns(LinAlgWarning, match="lost the directions"):
        PCRRegressor().partial_fit(X, y)


def test_search_over_knots_degree_and_rank():
    rng = np.random.default_rng(0)
    x = rng.uniform(size=(120, 1))
    y = np.sin(6 * x[:, 0]) + 0.1 * rng.normal(size=120)
    grid = {
        "splinefeatures__n_knots": [3, 8],
        "splinefeatures__degree": [1, 3],
        "pcrregressor__n_components": [2, 6, None, "gcv"],
    }
    search = GridSearchCV(make_pipeline(SplineFeatures(sparse_output=True), PCRRegressor()), grid).fit(x, y)
    assert search.best_score_ > 0.95
    # and the same through the features of the regressor, in blocks
    one = PCRRegressor(5, features=SplineFeatures(8), block_size=13).fit(x, y)
    two = make_pipeline(SplineFeatures(8), PCRRegressor(5)).fit(x, y)
    np.testing.assert_allclose(one.predict(x), two.predict(x), atol=1e-10)
    assert clone(one).get_params()["features__n_knots"] == 8
    inside = np.linspace(0.1, 0.9, 7)[:, None]
    slope = (one.predict(inside + 1e-5) - one.predict(inside - 1e-5)) / 2e-5
    np.testing.assert_allclose(one.jacobian(inside)[:, 0], slope, rtol=1e-5, atol=1e-5)


@pytest.mark.slow
def test_example_of_knots_and_rank(monkeypatch):
    example = Path(__file__).parents[2] / "examples" / "fits" / "plot_choose_knots_and_rank.py"
    pyplot = pytest.importorskip("matplotlib.pyplot")
    monkeypatch.setattr(pyplot, "show", lambda: None)
    found = runpy.run_path(str(example))
    pyplot.close("all")
    assert found["grade"] < 0.22


@pytest.mark.parametrize("n", [0, -1, 0.0, 1.0, "all"])
def test_a_number_of_components_that_means_nothing_is_refused(n):
    with pytest.raises(ValueError, match="The 'n_components' parameter of PCRRegressor must be"):
        PCRRegressor(n_components=n).fit(*data())


@pytest.mark.parametrize(("n", "kept"), [(1, 1), (1e-9, 1), (1.0 - 1e-12, 8), (None, 8)])
def test_counts_and_shares_at_their_limits_are_taken(n, kept):
    assert PCRRegressor(n_components=n).fit(*data()).n_components_ == kept
