"""Missing values and outliers: repaired within a run, never across."""

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.interpolate import PchipInterpolator
from sklearn import config_context
from sklearn.base import clone
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from sklearn.utils import estimator_checks as checks
from sklearn.utils.estimator_checks import parametrize_with_checks

from sksurrogate.exceptions import DataError, RunError
from sksurrogate.features import Interpolator, LagEmbedding, OutlierFilter
from sksurrogate.features._clean import fill_gaps
from sksurrogate.features._outliers import moving_line

NAN = np.nan
TIME_AWARE = {
    "check_methods_sample_order_invariance": "rows are in time order: a reading is judged by its neighbours",
    "check_methods_subset_invariance": "rows are in time order: a reading is judged by its neighbours",
}


@parametrize_with_checks(
    [Interpolator(), Interpolator("pchip", max_gap=3, ends="nan", add_indicator=True), OutlierFilter(), OutlierFilter(5, 2.0, fill="linear")],
    expected_failed_checks=lambda e: TIME_AWARE if isinstance(e, OutlierFilter) and e.window == 5 else {},
)  # fmt: skip
def test_check_estimator(estimator, check):
    check(estimator)


@pytest.mark.filterwarnings("ignore:X (does not have valid|has) feature names:UserWarning")
@pytest.mark.parametrize("estimator", [Interpolator(add_indicator=True), OutlierFilter(fill="line")], ids=repr)
@pytest.mark.parametrize(
    "check",
    [
        checks.check_param_validation,
        checks.check_set_output_transform,
        checks.check_set_output_transform_pandas,
        checks.check_set_output_transform_polars,
        checks.check_dataframe_column_names_consistency,
        checks.check_get_feature_names_out_error,
        checks.check_transformer_get_feature_names_out,
        checks.check_transformer_get_feature_names_out_pandas,
    ],
    ids=lambda check: check.__name__,
)
def test_checks_that_third_parties_do_not_get(estimator, check):
    check(type(estimator).__name__, clone(estimator))


@given(x=arrays(float, st.integers(1, 30), elements=st.one_of(st.just(NAN), st.integers(-50, 50).map(lambda k: k / 8))))
@settings(max_examples=80, deadline=None)
def test_known_values_stay_and_filled_ones_lie_between_their_neighbours(x):
    for method in ("linear", "previous", "pchip"):
        out = Interpolator(method).fit_transform(x[:, None])[:, 0]
        known = ~np.isnan(x)
        np.testing.assert_array_equal(out[known], x[known])
        if known.any():
            assert not np.isnan(out).any()
            assert out.min() >= x[known].min() - 1e-9 and out.max() <= x[known].max() + 1e-9
            # twice is once
            np.testing.assert_array_equal(Interpolator(method).fit_transform(out[:, None])[:, 0], out)
        else:
            assert np.isnan(out).all()


def test_a_straight_line_is_recovered_and_pchip_is_scipys():
    x = np.linspace(0, 3, 31)
    holes = np.random.default_rng(0).permutation(np.arange(1, 30))[:12]
    gappy = x.copy()
    gappy[holes] = NAN
    np.testing.assert_allclose(Interpolator().fit_transform(gappy[:, None])[:, 0], x, atol=1e-14)
    known = ~np.isnan(gappy)
    curve = np.where(known, x**2, NAN)
    expected = PchipInterpolator(np.flatnonzero(known), curve[known])(np.arange(31))
    np.testing.assert_allclose(Interpolator("pchip").fit_transform(curve[:, None])[:, 0], expected, atol=1e-14)


def test_runs_do_not_help_each_other():
    X = np.array([1.0, NAN, NAN, 5.0, NAN, NAN])[:, None]
    groups = [0, 0, 0, 1, 1, 2]
    assert np.array_equal(
        Interpolator().fit_transform(X, groups=groups)[:, 0], [1.0, 1.0, 1.0, 5.0, 5.0, NAN], equal_nan=True
    )
    frame = pd.DataFrame({"u": X[:, 0], "batch": groups})
    out = (
        Interpolator(run="batch", keep_run=True, add_indicator=True).set_output(transform="pandas").fit_transform(frame)
    )
    assert out.columns.tolist() == ["u", "missing(u)", "batch"]
    assert out["batch"].tolist() == groups
    assert out["missing(u)"].tolist() == [0, 1, 1, 0, 1, 1]
    with pytest.raises(RunError, match="in two pieces"):
        Interpolator(run="batch").fit(frame.iloc[[0, 3, 1]])


def test_long_gaps_and_ends_can_stay_open():
    X = np.array([NAN, 1.0, NAN, 3.0, NAN, NAN, 6.0, NAN])[:, None]
    out = Interpolator(max_gap=1, ends="nan").fit_transform(X)[:, 0]
    assert np.array_equal(out, [NAN, 1, 2, 3, NAN, NAN, 6, NAN], equal_nan=True)
    np.testing.assert_allclose(Interpolator().fit(X).missing_, [5 / 8])


def test_outliers_are_found_and_nothing_else():
    rng = np.random.default_rng(1)
    t = np.arange(400)
    clean = np.column_stack([np.sin(0.05 * t), 3 * np.cos(0.02 * t)]) + 0.02 * rng.normal(size=(400, 2))
    wrong = np.zeros((400, 2), bool)
    wrong[rng.permutation(400)[:12], 0] = True
    wrong[[0, 1, 200, 399], 1] = True  # the ends too
    X = clean + wrong * np.where(rng.random((400, 2)) < 0.5, -1, 1) * 1.0
    groups = np.repeat([0, 1], 200)
    found = OutlierFilter(threshold=6.0).fit(X, groups=groups)
    np.testing.assert_array_equal(found.mask(X, groups=groups), wrong)
    assert 0.005 < found.scale_[0] < 0.03  # the noise is 0.02, of which the line takes part
    for fill in ("linear", "pchip", "line", "previous"):
        bridged = clone(found).set_params(fill=fill).fit_transform(X, groups=groups)
        assert np.abs(bridged - clean).max() < 0.25
        np.testing.assert_array_equal(bridged[~wrong], X[~wrong])


def test_held_inputs_and_missing_values_are_left_alone():
    held = np.repeat([0.0, 4.0, 0.0, 1.0], [30, 3, 30, 30])
    gappy = np.sin(np.arange(93) / 9)
    gappy[[5, 6, 50]] = NAN
    X = np.column_stack([held, gappy])
    assert np.array_equal(OutlierFilter().fit_transform(X), X, equal_nan=True)


@pytest.mark.parametrize("size", [1e-6, 1.0, 1e6])
def test_the_unit_of_a_column_does_not_matter_with_noise_or_without(size):
    rng = np.random.default_rng(0)
    held = np.repeat([0.0, 40.0, 0.0, 1.0], [30, 3, 30, 30])  # steps of a noiseless column are its signal
    noisy = np.sin(np.arange(93) / 9) + 0.01 * rng.normal(size=93) + (np.arange(93) == 50)
    X = size * np.column_stack([held, noisy])
    assert np.argwhere(OutlierFilter(threshold=6.0).fit(X).mask(X)).tolist() == [[50, 1]]


@pytest.mark.parametrize("estimator", [Interpolator(), OutlierFilter(fill="line")], ids=repr)
def test_empty_columns_and_short_runs_pass_through(estimator):
    X = np.column_stack([np.full(6, NAN), np.arange(6.0)])
    out = estimator.fit_transform(X, groups=[0, 1, 1, 2, 2, 2])
    assert np.array_equal(out, X, equal_nan=True)


def test_a_short_burst_is_found_whole():
    x = np.sin(0.05 * np.arange(200)) + 0.01 * np.random.default_rng(0).normal(size=200)
    x[100:103] += [1.0, 1.5, 0.8]
    np.testing.assert_array_equal(
        np.flatnonzero(OutlierFilter(13, 6.0).fit(x[:, None]).mask(x[:, None])), [100, 101, 102]
    )


def test_in_a_pipeline_before_scaling():
    x = np.sin(np.arange(60) / 5)
    x[30] = 50.0
    model = make_pipeline(OutlierFilter(), Interpolator("pchip"), StandardScaler()).fit(x[:, None])
    assert np.abs(model.transform(x[:, None])).max() < 2


def test_errors():
    with pytest.raises(DataError, match="window=6 must be odd"):
        OutlierFilter(6).fit(np.zeros((9, 1)))
    with pytest.raises(DataError, match="contains infinity: row 1, column 0"):
        Interpolator().fit(pd.DataFrame({"u": [0.0, np.inf]}))


def test_groups_reach_the_repair_through_a_pipeline():
    X = np.array([1.0, NAN, NAN, 5.0])[:, None]
    model = make_pipeline(Interpolator(), LagEmbedding([1]))
    with config_context(enable_metadata_routing=True):
        out = model.fit(X, groups=[0, 0, 1, 1]).transform(X, groups=[0, 0, 1, 1])
    np.testing.assert_array_equal(out[:, 0], [1.0, 1.0, 5.0, 5.0])


def test_the_moving_line_is_the_same_backwards():
    x = np.random.default_rng(0).normal(size=40).cumsum()
    for forth, back in zip(moving_line(x, 7), moving_line(x[::-1], 7)):
        np.testing.assert_allclose(forth, back[::-1], atol=1e-12)


@pytest.mark.parametrize("method", ["linear", "previous", "pchip"])
def test_only_what_lies_beyond_the_known_values_is_an_end(method):
    nan = np.nan
    filled = fill_gaps(np.array([nan, 1.0, nan, 3.0, nan]), method, ends="nan")
    assert np.isnan(filled).tolist() == [True, False, False, False, True]
    assert filled[2] == (1.0 if method == "previous" else 2.0)
