"""The contract of scikit-learn, also the checks that it does not run for third parties."""

import pickle

import numpy as np
import pytest
from scipy import sparse
from sklearn.base import clone
from sklearn.preprocessing import FunctionTransformer, PolynomialFeatures, SplineTransformer
from sklearn.utils import estimator_checks
from sklearn.utils.estimator_checks import parametrize_with_checks

from sksurrogate.compose import RecursivePredictor
from sksurrogate.exceptions import DataError
from sksurrogate.linear import Bounds, Curvature, PCRRegressor, PenalizedRegressor, Ridge

ESTIMATORS = [
    PenalizedRegressor(),
    PenalizedRegressor([Ridge()], alpha="gcv"),
    PenalizedRegressor([Ridge(), Curvature()], [Bounds(-1.0, 1.0)], fit_intercept=False),
    PenalizedRegressor([Ridge(0.1)], solver="qr", block_size=3),
    PenalizedRegressor([Ridge()], features=PolynomialFeatures(2, include_bias=False)),
    PCRRegressor(),
    PCRRegressor(8, scale=True),
    PCRRegressor(0.9, solver="qr"),
    PCRRegressor("gcv", features=SplineTransformer(4, sparse_output=True)),
]


@parametrize_with_checks(ESTIMATORS)
def test_sklearn_contract(estimator, check):
    check(estimator)


@pytest.mark.parametrize("estimator", ESTIMATORS, ids=lambda e: str(e)[:60])
@pytest.mark.parametrize("name", ["check_param_validation", "check_dataframe_column_names_consistency"])
def test_checks_that_third_parties_are_not_asked(estimator, name):
    getattr(estimator_checks, name)(type(estimator).__name__, clone(estimator))


def data(n=80, p=4, q=2, seed=0):
    rng = np.random.default_rng(seed)
    X = rng.normal(size=(n, p)) + 2
    return X, X @ rng.normal(size=(p, q)) + 0.1 * rng.normal(size=(n, q)) + 5, rng.integers(0, 4, n)


@pytest.mark.parametrize("estimator", ESTIMATORS, ids=lambda e: str(e)[:60])
class TestEveryLinearFit:
    def test_weights_equal_repetition(self, estimator):
        X, Y, w = data()
        # a transformer that looks at the data sees the rows without their weights
        estimator = clone(estimator)
        if estimator.features is not None:
            estimator.set_params(features=PolynomialFeatures(2, include_bias=False))
        one = clone(estimator).fit(X, Y, sample_weight=w)
        two = clone(estimator).fit(np.repeat(X, w, axis=0), np.repeat(Y, w, axis=0))
        np.testing.assert_allclose(one.predict(X), two.predict(X), rtol=1e-8)

    def test_two_outputs_share_rows_only(self, estimator):
        if "gcv" in (getattr(estimator, "alpha", 0), getattr(estimator, "n_components", 0)):
            pytest.skip("one alpha or rank for all outputs is chosen from their joint error")
        X, Y, _ = data()
        both = clone(estimator).fit(X, Y)
        for k in range(2):
            alone = clone(estimator).fit(X, Y[:, k])
            np.testing.assert_allclose(both.predict(X)[:, k], alone.predict(X), rtol=1e-8)
            np.testing.assert_allclose(both.coef_[k], alone.coef_, atol=1e-8)
            assert isinstance(alone.intercept_, float)

    def test_streams_equal_one_fit(self, estimator):
        X, Y, w = data()
        estimator = clone(estimator)
        if estimator.features is not None:
            estimator.set_params(features=PolynomialFeatures(2, include_bias=False))
        whole = clone(estimator).fit(X, Y, sample_weight=w)
        stream = clone(estimator)
        for a in range(0, 80, 20):
            stream.partial_fit(X[a : a + 20], Y[a : a + 20], w[a : a + 20])
        np.testing.assert_allclose(stream.predict(X), whole.predict(X), rtol=1e-9)
        np.testing.assert_allclose(stream.coef_, whole.coef_, atol=1e-9)

    def test_sparse_equals_dense(self, estimator):
        X, Y, _ = data()
        X[X < 2] = 0
        if isinstance(estimator.features, SplineTransformer):
            pytest.skip("SplineTransformer takes dense X only")
        dense = clone(estimator).fit(X, Y)
        thin = clone(estimator).fit(sparse.csr_array(X), Y)
        np.testing.assert_allclose(thin.predict(sparse.csr_array(X)), dense.predict(X), rtol=1e-8)

    def test_pickle_and_blocks_change_nothing(self, estimator):
        X, Y, _ = data()
        one = clone(estimator).fit(X, Y)
        np.testing.assert_array_equal(pickle.loads(pickle.dumps(one)).predict(X), one.predict(X))
        two = clone(estimator).set_params(block_size=7).fit(X, Y)
        np.testing.assert_allclose(two.predict(X), one.predict(X), rtol=1e-8)

    @pytest.mark.parametrize("flat", [True, False])
    def test_jacobian_equals_differences(self, estimator, flat):
        X, Y, _ = data()
        model = clone(estimator).fit(X, Y[:, 0] if flat else Y)
        at = X[np.argsort(np.abs(X - X.mean(axis=0)).max(axis=1))[:5]]
        J = model.jacobian(at)
        assert J.shape == ((5, 4) if flat else (5, 2, 4))
        for j in range(4):
            step = 1e-4 * np.eye(4)[j]
            slope = (model.predict(at + step) - model.predict(at - step)) / 2e-4
            np.testing.assert_allclose(J[..., j], slope, atol=1e-4)

    def test_unlike_outputs_in_a_stream_are_refused(self, estimator):
        X, Y, _ = data()
        model = clone(estimator).partial_fit(X, Y)
        with pytest.raises(DataError, match="1 outputs, but the rows before had 2"):
            model.partial_fit(X, Y[:, 0])
        # and leave nothing behind
        both = clone(estimator).partial_fit(X, Y).partial_fit(X, Y)
        np.testing.assert_array_equal(model.partial_fit(X, Y).coef_, both.coef_)

    def test_no_row_that_counts(self, estimator):
        X, Y, _ = data()
        with pytest.raises(ValueError, match="zero"):
            clone(estimator).fit(X, Y, sample_weight=np.zeros(len(X)))


def test_features_are_made_in_blocks():
    X, Y, _ = data(1000)
    seen = []

    def spy(X):
        seen.append(len(X))
        return np.hstack([X, X**2])

    model = PenalizedRegressor(features=FunctionTransformer(spy), block_size=100).fit(X, Y)
    assert max(seen) == 100 and sum(seen) == 1001
    plain = PenalizedRegressor().fit(np.hstack([X, X**2]), Y)
    np.testing.assert_allclose(model.coef_, plain.coef_, rtol=1e-9)
    np.testing.assert_allclose(model.predict(X), plain.predict(np.hstack([X, X**2])), rtol=1e-12)


def test_a_jacobian_of_the_features_is_used():
    class Squares(FunctionTransformer):
        def __init__(self):
            super().__init__(np.square)

        def jacobian(self, X):
            return 2 * X[:, :, None] * np.eye(X.shape[1])

    X, Y, _ = data()
    model = PenalizedRegressor(features=Squares()).fit(X, Y)
    np.testing.assert_array_equal(model.jacobian(X), np.einsum("qj,nj->nqj", model.coef_, 2 * X))


@pytest.mark.parametrize("library", ["pandas", "polars"])
@pytest.mark.parametrize("features", [None, SplineTransformer(4)])
def test_frames_keep_their_names(library, features):
    frames = pytest.importorskip(library)
    X, Y, _ = data()
    frame = frames.DataFrame({name: X[:, j] for j, name in enumerate("abcd")})
    target = frames.Series(Y[:, 0])
    model = PenalizedRegressor([Ridge()], features=features).fit(frame, target)
    assert list(model.feature_names_in_) == list("abcd")
    np.testing.assert_allclose(model.predict(frame), clone(model).fit(X, Y[:, 0]).predict(X))
    with pytest.raises(ValueError, match="feature names"):
        model.predict(frame[["b", "a", "c", "d"]])


def test_free_runs_of_a_model_with_its_own_features():
    rng = np.random.default_rng(0)
    X, y = rng.normal(size=(300, 1)), np.zeros(300)
    for t in range(1, 300):
        y[t] = 0.8 * y[t - 1] + np.tanh(X[t - 1, 0])
    splines = PenalizedRegressor([Ridge(1e-3)], features=SplineTransformer(8, extrapolation="linear"))
    assert RecursivePredictor(splines, [1], 1).fit(X, y).free_run_rmse_ < 0.05


@pytest.mark.parametrize("estimator", [PenalizedRegressor([Ridge()], alpha="gcv"), PCRRegressor(3)])
def test_moments_of_several_machines_add_up(estimator):
    X, Y, _ = data()
    whole = clone(estimator).fit(X, Y)
    parts = [clone(estimator).partial_fit(X[rows], Y[rows]).moments_ for rows in (slice(0, 30), slice(30, 80))]
    joined = clone(estimator).fit_moments(parts[0].merge(parts[1]), n_outputs=2)
    np.testing.assert_allclose(joined.coef_, whole.coef_, atol=1e-10)
    np.testing.assert_allclose(joined.predict(X), whole.predict(X), atol=1e-10)


def test_rows_of_weight_zero_are_not_seen_by_features_either():
    """Knots, ranges and scales are learned from the rows that count."""
    from sksurrogate.features import SplineFeatures
    from sksurrogate.linear import PenalizedRegressor

    rng = np.random.default_rng(0)
    X = rng.uniform(-1, 1, (80, 1))
    y = np.sin(3 * X[:, 0])
    far = np.r_[X, [[50.0]], [[-70.0]]]
    weights = np.r_[np.ones(80), 0.0, 0.0]
    alone = PenalizedRegressor(features=SplineFeatures(6)).fit(X, y)
    beside = PenalizedRegressor(features=SplineFeatures(6)).fit(far, np.r_[y, 9.0, 9.0], sample_weight=weights)
    np.testing.assert_allclose(beside.predict(X), alone.predict(X), atol=1e-8)
