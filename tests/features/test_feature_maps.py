"""What the feature maps are for: interpolation, smoothing, products, exact slopes, errors that say the way out."""

import tracemalloc

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given, settings
from hypothesis import strategies as st
from sklearn.base import clone
from sklearn.linear_model import LinearRegression, Ridge
from sklearn.model_selection import GridSearchCV
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import SplineTransformer

from sksurrogate.exceptions import DataError
from sksurrogate.features import FourierFeatures, GaussianFeatures, HeavisideFeatures, SplineFeatures

RNG = np.random.default_rng(0)
X2 = RNG.uniform(-1, 1, size=(60, 2))


@pytest.mark.parametrize("knots", ["uniform", "quantile"])
@pytest.mark.parametrize("degree", [0, 1, 2, 3, 5])
def test_equal_to_scikit_learn_where_it_has_the_same(knots, degree):
    ours = SplineFeatures(6, degree, knots=knots)
    peer = SplineTransformer(6, degree=degree, knots=knots)
    np.testing.assert_allclose(ours.fit_transform(X2), peer.fit_transform(X2), atol=1e-13)


@given(
    x=st.lists(st.floats(-1e3, 1e3, allow_subnormal=False), min_size=1, max_size=30),
    degree=st.integers(0, 5),
    n_knots=st.integers(2, 12),
    knots=st.sampled_from(["uniform", "quantile"]),
    extrapolation=st.sampled_from(["constant", "linear", "periodic"]),
)
@settings(max_examples=80, deadline=None)
def test_the_splines_of_every_input_sum_to_one(x, degree, n_knots, knots, extrapolation):
    X = np.array(x)[:, None]
    values = SplineFeatures(n_knots, degree, knots=knots, extrapolation=extrapolation).fit_transform(X)
    np.testing.assert_allclose(values.sum(axis=1), 1.0, atol=1e-12)
    assert values.min() > -1e-12


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_as_many_splines_as_data_interpolate_and_fewer_smooth(degree):
    # Figure 1 and the sentence after it
    rng = np.random.default_rng(1)
    x = np.sort(rng.uniform(0, 1, 80))
    truth = np.sin(2 * np.pi * x)
    y = truth + 0.2 * rng.normal(size=80)
    fit = lambda features: make_pipeline(features, LinearRegression(fit_intercept=False)).fit(x[:, None], y)  # noqa: E731
    np.testing.assert_allclose(fit(SplineFeatures(degree=degree, knots="data")).predict(x[:, None]), y, atol=1e-6)
    smooth = fit(SplineFeatures(8, degree)).predict(x[:, None])
    assert np.mean((smooth - truth) ** 2) < (0.5 if degree else 1.0) * np.mean((y - truth) ** 2)


def test_pulses_and_steps_span_the_same_functions():
    # Remark 1 on estimators, several outputs: N pulses and N + 1 steps give one and the same fit
    x = np.sort(RNG.uniform(size=25))[:, None]
    Y = RNG.normal(size=(25, 2))
    fine = np.linspace(x.min(), x.max(), 500)[:, None]
    pulses = make_pipeline(SplineFeatures(degree=0, knots="data"), LinearRegression(fit_intercept=False)).fit(x, Y)
    steps = make_pipeline(HeavisideFeatures("data"), LinearRegression(fit_intercept=False)).fit(x, Y)
    np.testing.assert_allclose(steps.predict(fine), pulses.predict(fine), atol=1e-10)
    np.testing.assert_allclose(steps.predict(x), Y, atol=1e-10)


def test_n_steps_span_as_many_pulses_in_range():
    x = np.r_[0.0, RNG.uniform(size=200), 1.0][:, None]
    steps = HeavisideFeatures(6).fit_transform(x)
    pulses = SplineFeatures(7, 0).fit_transform(x)
    inside = x[:, 0] < 1.0
    np.testing.assert_array_equal((steps - np.c_[steps[:, 1:], np.zeros(len(x))])[inside], pulses[inside])


@pytest.mark.parametrize(
    "features",
    [
        SplineFeatures(),
        SplineFeatures(degree=0),
        SplineFeatures(degree=1, knots="quantile", extrapolation="linear"),
        SplineFeatures(degree=2, extrapolation="continue"),
        SplineFeatures(extrapolation="periodic"),
        SplineFeatures(knots="data"),
        SplineFeatures(4, 2, interaction="tensor", sparse_output=True),
        HeavisideFeatures(interaction=True),
        FourierFeatures(),
        FourierFeatures(3, form="subharmonics", interaction="tensor"),
        GaussianFeatures(),
        GaussianFeatures(4, [0.5, 0.7], interaction="tensor"),
        GaussianFeatures(5, interaction="radial", random_state=0),
    ],
    ids=repr,
)
def test_jacobian_equals_central_differences(features):
    features = clone(features).fit(X2)
    X = np.random.default_rng(5).uniform(-1.3, 1.3, size=(200, 2))  # some rows outside
    jacobian = features.jacobian(X)
    assert jacobian.shape == (200, features.n_features_out_, 2)
    h = 1e-6
    dense = lambda Z: Z.toarray() if sp.issparse(Z) else Z  # noqa: E731
    for j in range(2):
        step = h * np.eye(2)[j]
        difference = (dense(features.transform(X + step)) - dense(features.transform(X - step))) / (2 * h)
        # the difference straddles a knot or the end of the range in a few rows
        far = np.abs(difference - jacobian[:, :, j]).max(axis=1) < 1e-5 * max(1.0, np.abs(difference).max())
        assert far.mean() > 0.98


@pytest.mark.parametrize(
    ("features", "one"),
    [
        (SplineFeatures(4, 2, interaction=True), SplineFeatures(4, 2)),
        (FourierFeatures(2, interaction="tensor"), FourierFeatures(2)),
        (GaussianFeatures(3, interaction="tensor"), GaussianFeatures(3)),
        (HeavisideFeatures(3, interaction="tensor"), HeavisideFeatures(3)),
    ],
)
def test_products_are_kron_of_the_inputs_and_additive_forms_stand_side_by_side(features, one):
    a, b = (clone(one).fit_transform(X2[:, [j]]) for j in (0, 1))
    np.testing.assert_allclose(features.fit_transform(X2), [np.kron(u, v) for u, v in zip(a, b)], atol=1e-15)
    side = clone(one).fit_transform(X2)
    if isinstance(one, FourierFeatures):
        b = b[:, 1:]  # the constant stands once
    np.testing.assert_allclose(side, np.hstack([a, b]), atol=1e-15)


def test_a_product_learns_what_a_sum_cannot():
    y = X2[:, 0] * X2[:, 1]
    score = lambda form: (  # noqa: E731
        make_pipeline(SplineFeatures(3, 2, interaction=form), Ridge(1e-8)).fit(X2, y).score(X2, y)
    )
    assert score("additive") < 0.7
    assert score("tensor") > 1 - 1e-6


@pytest.mark.parametrize("interaction", ["additive", "tensor"])
@pytest.mark.parametrize("extrapolation", ["constant", "periodic"])
def test_sparse_and_dense_agree(interaction, extrapolation):
    features = SplineFeatures(5, 3, interaction=interaction, extrapolation=extrapolation)
    sparse = clone(features).set_params(sparse_output=True).fit_transform(X2)
    assert sp.issparse(sparse) and sparse.format == "csr" and sparse.has_sorted_indices
    np.testing.assert_array_equal(sparse.toarray(), features.fit_transform(X2))


def test_radial_bumps_on_a_grid_are_the_product_form():
    grid = np.stack(np.meshgrid([-1.0, 0.0, 1.0], [-1.0, 0.0, 1.0], indexing="ij"), axis=-1).reshape(-1, 2)
    radial = GaussianFeatures(grid, 0.7, interaction="radial").fit_transform(X2)
    product = GaussianFeatures([-1.0, 0.0, 1.0], 0.7, interaction="tensor").fit_transform(X2)
    np.testing.assert_allclose(radial, product, rtol=1e-13)


def test_subharmonics_are_the_series_of_the_paper():
    x = RNG.normal(size=(9, 1))
    values = FourierFeatures(3, form="subharmonics").fit_transform(x)
    expected = [np.ones(9)] + [f(2 * np.pi * x[:, 0] / i) for i in (1, 2, 3) for f in (np.sin, np.cos)]
    np.testing.assert_allclose(values, np.stack(expected, axis=1), atol=1e-13)


def test_names():
    names = lambda features: features.fit(X2).get_feature_names_out(["u", "v"]).tolist()  # noqa: E731
    assert names(SplineFeatures(2, 1)) == ["spline0(u)", "spline1(u)", "spline0(v)", "spline1(v)"]
    assert names(SplineFeatures(2, 1, interaction=True))[1] == "spline0(u)*spline1(v)"
    assert names(FourierFeatures(1)) == ["1", "sin1(u)", "cos1(u)", "sin1(v)", "cos1(v)"]
    assert names(FourierFeatures(1, interaction=True))[:4] == ["1", "sin1(v)", "cos1(v)", "sin1(u)"]
    assert names(HeavisideFeatures([0.5])) == ["step0(u)", "step0(v)"]
    assert names(GaussianFeatures(2, interaction="radial", random_state=0)) == ["gauss0(u,v)", "gauss1(u,v)"]


def test_grid_search_over_knots_and_degree_finds_a_good_curve():
    x = np.linspace(0, 1, 120)[:, None]
    y = np.sin(8 * x[:, 0]) + 0.05 * RNG.normal(size=120)
    search = GridSearchCV(
        make_pipeline(SplineFeatures(), Ridge(1e-6)),
        {"splinefeatures__n_knots": [2, 8], "splinefeatures__degree": [0, 3]},
        cv=[(np.arange(0, 120, 2), np.arange(1, 120, 2))],
    ).fit(x, y)
    assert search.best_params_ == {"splinefeatures__n_knots": 8, "splinefeatures__degree": 3}
    assert search.best_score_ > 0.98


@pytest.mark.parametrize(
    ("features", "match"),
    [
        (SplineFeatures(knots=[0.0, 0.0, 1.0]), r"knots of input 0 must be at least two numbers in rising order"),
        (SplineFeatures(knots=np.zeros((4, 3))), r"knots has shape \(4, 3\), but X has 2 inputs"),
        (SplineFeatures(knots=[0.0, np.nan]), "knots holds NaN"),
        (SplineFeatures(knots="data", extrapolation="periodic"), 'knots="data" has no period'),
        (FourierFeatures(period=[1.0]), r"period=\[1.0\] must be a positive number, or one for each of the 2 inputs"),
        (GaussianFeatures(width=[1.0, -1.0]), "must be a positive number, or one for each of the 2 inputs"),
        (GaussianFeatures([0.0, 1.0], interaction="radial"), r"needs centers as \(n_centers, 2\)"),
        (SplineFeatures(5000, interaction="tensor"), "more than 10000000: use interaction"),
        (HeavisideFeatures(np.zeros((2, 2, 2))), "thresholds has shape"),
    ],
)
def test_errors_name_the_parameter_and_the_way_out(features, match):
    with pytest.raises(DataError, match=match):
        features.fit(X2)


def test_rows_outside_the_knots_can_be_refused():
    features = SplineFeatures(extrapolation="error").fit(X2)
    with pytest.raises(DataError, match=r"row 1 has 7 in input 1, outside the knots .* \(1 rows in all\)"):
        features.transform([[0.0, 0.0], [0.0, 7.0]])
    with pytest.raises(DataError, match="outside the knots"):
        features.jacobian([[9.0, 0.0]])


def peak_of(job):
    """Most bytes that a job held."""
    tracemalloc.start()
    try:
        job()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


@pytest.mark.slow
def test_the_sparse_basis_needs_a_third_of_scikit_learns_memory():
    X = np.random.default_rng(6).uniform(size=(100_000, 4))
    ours = peak_of(lambda: SplineFeatures(20, 3, sparse_output=True).fit_transform(X))
    peer = peak_of(lambda: SplineTransformer(20, degree=3, sparse_output=True).fit_transform(X))
    result = 100_000 * 16 * (8 + 4)  # values and columns: nothing else may be of that size
    assert ours < peer / 3 + 2e6
    assert ours < 1.15 * result


def test_the_fewest_thresholds_and_fewer():
    x = np.linspace(0, 1, 9)[:, None]
    assert HeavisideFeatures(1).fit_transform(x).tolist() == [[1.0]] * 9  # one step at the least value
    with pytest.raises(ValueError, match="thresholds"):
        HeavisideFeatures(0).fit(x)


@pytest.mark.parametrize("n, peaks", [(1, [5.0]), (2, [2.0, 8.0]), (4, [2.0, 4.0, 6.0, 8.0])])
def test_so_many_bumps_stand_evenly_over_the_data(n, peaks):
    x = np.linspace(2.0, 8.0, 601)[:, None]
    Z = GaussianFeatures(n, interaction=False).fit_transform(x)
    np.testing.assert_allclose(np.sort(x[np.argmax(Z, axis=0), 0]), peaks)


def test_a_period_is_any_positive_number():
    X = np.linspace(0.0, 1.0, 9)[:, None]
    waves = FourierFeatures(n_harmonics=1, period=0.5).fit_transform(X)
    assert np.ptp(np.asarray(waves), axis=0).max() == pytest.approx(2.0)  # the sine goes round twice
    with pytest.raises(ValueError, match="period"):
        FourierFeatures(period=0.0).fit(X)


@pytest.mark.parametrize("n", [1, 2, 5])
def test_steps_by_number_are_evenly_spread_from_the_least_value_and_none_is_at_the_largest(n):
    x = np.linspace(-3.0, 7.0, 41)[::-1, None]
    steps = HeavisideFeatures(n).fit(x)
    at = -3.0 + 10.0 * np.arange(n) / n
    inside = np.sort(np.r_[at - 1e-6, at + 1e-6])[:, None]
    assert np.array_equal(steps.transform(inside), (inside >= at).astype(float))


def test_periods_are_positive_one_for_each_input():
    one, two = FourierFeatures(1, period=[2.0, 3.0]).fit(X2), FourierFeatures(1, period=2.0).fit(X2[:, :1])
    np.testing.assert_array_equal(one.transform(X2)[:, : two.transform(X2[:, :1]).shape[1]], two.transform(X2[:, :1]))
    for wrong in ([2.0, 0.0], [-2.0, 3.0], [2.0, np.nan], [2.0, np.inf], [2.0], [2.0, 3.0, 4.0]):
        with pytest.raises(DataError, match="must be a positive number, or one for each of the 2 inputs"):
            FourierFeatures(1, period=wrong).fit(X2)
