"""Lags: against pandas' shift within each run, and the contract."""

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sklearn.base import clone
from sklearn.utils import estimator_checks as checks
from sklearn.utils.estimator_checks import parametrize_with_checks

from sksurrogate.exceptions import DataError, RunError
from sksurrogate.features import Interpolator, LagEmbedding
from sksurrogate.features._lag import _whole
from sksurrogate.runs import resolve_runs

TIME_AWARE = {
    "check_methods_sample_order_invariance": "rows are in time order: a lag is a row earlier in the same run",
    "check_methods_subset_invariance": "a subset of rows has another past",
}
SETTINGS = [LagEmbedding(), LagEmbedding([0, 3], fill=0.0)]


@parametrize_with_checks(SETTINGS, expected_failed_checks=lambda _: TIME_AWARE)
def test_check_estimator(estimator, check):
    check(estimator)


@pytest.mark.filterwarnings("ignore:X (does not have valid|has) feature names:UserWarning")
@pytest.mark.parametrize("estimator", SETTINGS, ids=repr)
@pytest.mark.parametrize(
    "check",
    [
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


@given(lengths=st.lists(st.integers(1, 9), min_size=1, max_size=5), lags=st.sets(st.integers(0, 6), min_size=1))
@settings(max_examples=50, deadline=None)
def test_lags_are_pandas_shift_within_each_run(lengths, lags):
    groups = np.repeat(np.arange(len(lengths)), lengths)
    frame = pd.DataFrame(np.random.default_rng(0).normal(size=(len(groups), 2)), columns=["u", "v"])
    out = LagEmbedding(sorted(lags), fill="nan").set_output(transform="pandas").fit_transform(frame, groups=groups)
    for column in ("u", "v"):
        for lag in lags:
            expected = frame[column].groupby(groups).shift(lag)
            np.testing.assert_array_equal(out[f"{column}_lag{lag}"], expected)


def test_run_as_a_column_equals_groups():
    frame = pd.DataFrame({"u": np.arange(6.0), "batch": [3, 3, 3, 8, 8, 8]})
    by_column = LagEmbedding(2, run="batch").fit(frame)
    by_groups = LagEmbedding(2).fit(frame[["u"]])
    np.testing.assert_array_equal(
        by_column.transform(frame), by_groups.transform(frame[["u"]], groups=frame["batch"].to_numpy())
    )
    assert by_column.get_feature_names_out().tolist() == ["u_lag0", "u_lag1", "u_lag2"]
    np.testing.assert_array_equal(by_column.complete(frame), [False, False, True] * 2)
    kept = LagEmbedding([0], run="batch", keep_run=True).set_output(transform="pandas").fit_transform(frame)
    assert kept.columns.tolist() == ["u_lag0", "batch"] and kept["batch"].tolist() == [3, 3, 3, 8, 8, 8]


def test_lags_by_column():
    X = np.arange(8.0).reshape(4, 2)
    out = LagEmbedding({1: [2], 0: 1}).fit(X)
    assert out.get_feature_names_out(["u", "v"]).tolist() == ["v_lag2", "u_lag0", "u_lag1"]
    np.testing.assert_array_equal(out.transform(X)[3], [3.0, 6.0, 4.0])


def test_errors():
    with pytest.raises(DataError, match="every lag must be at least 0"):
        LagEmbedding([-1]).fit(np.zeros((4, 1)))
    with pytest.raises(DataError, match=r"fill='past' must be"):
        LagEmbedding(fill="past").fit(np.zeros((4, 1)))
    with pytest.raises(DataError, match="asks for no column"):
        LagEmbedding({}).fit(np.zeros((4, 1)))
    with pytest.raises(RunError, match="in two pieces"):
        LagEmbedding().fit(np.zeros((3, 1)), groups=[0, 1, 0])


@pytest.mark.parametrize("fill", ["edge", "nan", 0.5])
def test_large_matrices_in_blocks_and_threads(monkeypatch, fill):
    X = np.random.default_rng(0).normal(size=(1001, 2))
    lags = {0: [0, 3, 700], 1: [1, 40]}
    for groups in (None, np.repeat(np.arange(91), 11), np.r_[np.full(4, -1), np.zeros(900), np.full(97, 2)]):
        slow = LagEmbedding(lags, fill=fill).fit_transform(X, groups=groups)
        with monkeypatch.context() as patch:
            patch.setattr("sksurrogate.features._lag._LAG_ROWS", 64)
            patch.setattr("sksurrogate.features._lag._SHARED_NUMBERS", 0)
            for threads in (1, 3):
                patch.setattr("sksurrogate.features._lag._openmp_effective_n_threads", lambda threads=threads: threads)
                quick = LagEmbedding(lags, fill=fill).fit_transform(X, groups=groups)
                np.testing.assert_array_equal(quick, slow)
    assert LagEmbedding([5]).fit_transform(X)[5:, 0] == pytest.approx(X[:-5, 0])


def test_one_run_between_rows_left_out_is_as_it_is_alone_and_rows_of_one_array_are_not_copied():
    X = np.random.default_rng(0).normal(size=(50, 2))
    groups = np.r_[np.full(4, -1), np.zeros(40), np.full(6, -1)]
    found = LagEmbedding([0, 1, 7]).fit_transform(X, groups=groups)
    np.testing.assert_array_equal(found[4:44], LagEmbedding([0, 1, 7]).fit_transform(X[4:44]))
    assert np.isnan(found[:4]).all() and np.isnan(found[44:]).all()
    for labels in (None, groups, np.repeat([0, 1], 25)):
        assert np.shares_memory(_whole(resolve_runs(X, groups=labels)), X)


@pytest.mark.parametrize("fill", ["edge", "nan", 3.5])
@pytest.mark.parametrize("threads", [False, True])
def test_every_number_is_that_of_the_definition(monkeypatch, fill, threads):
    """Random runs, some a row long, gaps, scattered lags, blocks that cut runs: against the definition, entry by entry."""
    from sksurrogate.features import _lag

    rng = np.random.default_rng(0)
    monkeypatch.setattr(_lag, "_SHARED_NUMBERS", 0 if threads else 10**9)
    for trial in range(30):
        monkeypatch.setattr(_lag, "_LAG_ROWS", int(rng.integers(1, 40)))
        n, m = int(rng.integers(1, 100)), int(rng.integers(1, 4))
        X = rng.normal(size=(n, m))
        groups = rng.permutation(n)[np.cumsum(rng.random(n) < rng.choice([0.05, 0.3])) % n]
        groups[groups == 1] = -1 if trial % 3 and np.any(groups != 1) else 1
        embedding = LagEmbedding({j: rng.integers(0, 30, size=4).tolist() for j in range(m)}, fill=fill)
        found = embedding.fit_transform(X, groups=groups)
        wanted = np.full(found.shape, np.nan)
        for t in np.flatnonzero(groups != -1):
            start = t
            while start > 0 and groups[start - 1] == groups[t]:
                start -= 1
            edge = X[start] if fill == "edge" else np.full(m, np.nan if fill == "nan" else fill)
            for i, (column, lag) in enumerate(embedding.columns_):
                wanted[t, i] = X[t - lag, column] if t - lag >= start else edge[column]
        np.testing.assert_array_equal(found, wanted)


@pytest.mark.parametrize("lags", [-1, True, 1.5, [0, -2], "2"])
def test_lags_that_mean_nothing_are_refused(lags):
    with pytest.raises(DataError, match=r"lags=.*every lag must be at least 0"):
        LagEmbedding(lags).fit(np.ones((3, 1)))


@pytest.mark.parametrize("fill", [None, True, "edg"])
def test_a_fill_that_is_no_policy_is_refused(fill):
    with pytest.raises(DataError, match=r"fill=.* must be .edge., .nan. or a number"):
        LagEmbedding(1, fill=fill).fit(np.ones((3, 1)))


@pytest.mark.parametrize("step", [LagEmbedding(1, run="run", keep_run=True), Interpolator(run="run", keep_run=True)])
def test_a_run_that_is_kept_beside_numbers_has_a_number(step):
    frame = pd.DataFrame({"run": ["a", "a", "b"], "u": [1.0, 2.0, 3.0]})
    with pytest.raises(DataError, match="run 'a' is not a number"):
        step.fit_transform(frame)
    numbered = step.fit_transform(frame.assign(run=pd.factorize(frame["run"])[0]))
    assert numbered[:, -1].tolist() == [0.0, 0.0, 1.0]
