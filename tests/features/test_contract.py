"""What scikit-learn asks of every transformer, the checks included that it does not run for third parties."""

import pickle

import numpy as np
import pytest
from sklearn.base import clone
from sklearn.utils import estimator_checks as checks
from sklearn.utils.estimator_checks import parametrize_with_checks

from sksurrogate.features import FourierFeatures, GaussianFeatures, HeavisideFeatures, SplineFeatures

MAPS = [
    SplineFeatures(),
    SplineFeatures(4, 0, knots="quantile", extrapolation="linear"),
    SplineFeatures(4, 2, extrapolation="periodic"),
    SplineFeatures(knots="data", extrapolation="zero"),
    SplineFeatures(3, 1, interaction="tensor", extrapolation="continue"),
    HeavisideFeatures(),
    HeavisideFeatures("data"),
    HeavisideFeatures([0.0, 0.5], interaction=True),
    FourierFeatures(),
    FourierFeatures(1, form="subharmonics", interaction="tensor"),
    GaussianFeatures(),
    GaussianFeatures(3, interaction="tensor"),
    GaussianFeatures(4, interaction="radial", random_state=0),
]
HIDDEN_CHECKS = [
    checks.check_param_validation,
    checks.check_set_output_transform,
    checks.check_set_output_transform_pandas,
    checks.check_set_output_transform_polars,
    checks.check_global_output_transform_pandas,
    checks.check_global_set_output_transform_polars,
    checks.check_dataframe_column_names_consistency,
    checks.check_get_feature_names_out_error,
    checks.check_transformer_get_feature_names_out,
    checks.check_transformer_get_feature_names_out_pandas,
]


@parametrize_with_checks([*MAPS, SplineFeatures(sparse_output=True)])
def test_check_estimator(estimator, check):
    check(estimator)


# some of these checks fit on a frame and transform an array on purpose
@pytest.mark.filterwarnings("ignore:X (does not have valid|has) feature names:UserWarning")
@pytest.mark.parametrize("estimator", MAPS, ids=repr)
@pytest.mark.parametrize("check", HIDDEN_CHECKS, ids=lambda check: check.__name__)
def test_checks_that_third_parties_do_not_get(estimator, check):
    check(type(estimator).__name__, clone(estimator))


@pytest.mark.parametrize("estimator", MAPS, ids=repr)
def test_pickle_and_clone(estimator):
    X = np.random.default_rng(0).uniform(size=(30, 2))
    fitted = clone(estimator).fit(X)
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(fitted)).transform(X), fitted.transform(X))
    assert repr(clone(fitted)) == repr(estimator)


@pytest.mark.parametrize("estimator", MAPS, ids=repr)
def test_names_are_distinct_and_as_many_as_columns(estimator):
    X = np.random.default_rng(0).uniform(size=(30, 3))
    fitted = clone(estimator).fit(X)
    names = fitted.get_feature_names_out(["u", "v", "w"])
    assert len(set(names)) == fitted.transform(X).shape[1] == fitted.n_features_out_


@pytest.mark.parametrize("estimator", MAPS, ids=repr)
def test_a_column_that_does_not_move_changes_no_feature_of_the_other(estimator):
    X = np.column_stack([np.full(12, 3.0), np.arange(12.0)])
    values, other = (clone(estimator).fit_transform(X + [moved, 0.0]) for moved in (0.0, 4.0))
    assert np.isfinite(values).all()
    np.testing.assert_allclose(values, other, rtol=1e-12, atol=1e-12)
