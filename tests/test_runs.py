"""The border."""

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sksurrogate.exceptions import DataError, RunError
from sksurrogate.runs import cut_runs, resolve_runs, stack_runs, unstack_runs


@given(st.lists(st.integers(1, 6), min_size=1, max_size=5))
def test_stack_and_unstack_are_inverse(lengths):
    parts = [np.random.default_rng(n).normal(size=(n, 2)) for n in lengths]
    X, _, groups = stack_runs(parts)
    for part, again in zip(parts, unstack_runs(X, groups), strict=True):
        np.testing.assert_array_equal(part, again)


@given(st.integers(10, 60), st.integers(1, 3), st.integers(0, 3))
def test_cut_runs_leaves_gaps_and_loses_nothing_else(n, blocks, gap):
    labels = cut_runs(n, blocks, gap)
    assert (labels == -1).sum() == gap * (blocks - 1)
    assert set(labels) - {-1} == set(range(blocks))
    runs = resolve_runs(np.zeros((n, 1)), groups=labels)
    assert sum(len(run) for run in runs) == n - gap * (blocks - 1)


def test_groups_win_over_run_and_the_run_column_is_no_input():
    X = np.array([[0, 1.0], [0, 2.0], [1, 3.0]])
    assert [len(run) for run in resolve_runs(X, run=0)] == [2, 1]
    by_groups = resolve_runs(X, run=0, groups=["a", "b", "b"])
    assert [run.label for run in by_groups] == ["a", "b"]
    assert by_groups[0].X.shape == (1, 1)


def test_uneven_sampling_is_refused_by_row():
    X = np.array([[0.0, 1], [0.1, 1], [0.25, 1], [0.3, 1]])
    with pytest.raises(DataError, match="uneven sampling after row 1"):
        resolve_runs(X, time=0, dt=0.1)


@pytest.mark.parametrize("dt", [0.5, 1.0, 2.0, None])
def test_rows_without_a_clock_lie_at_multiples_of_the_sample_time(dt):
    grid = (dt or 1.0) * np.r_[np.arange(4), np.arange(3)]
    runs = resolve_runs(np.zeros((7, 1)), groups=[0] * 4 + [1] * 3, dt=dt)
    clocked = resolve_runs(np.column_stack([grid, np.zeros(7)]), groups=[0] * 4 + [1] * 3, time=0)
    assert runs.dt == clocked.dt == (dt or 1.0)
    for one, other, times in zip(runs, clocked, np.split(grid, [4]), strict=True):
        np.testing.assert_array_equal(one.t, times)
        np.testing.assert_allclose(other.t, times)


def test_short_runs_say_how_many_rows_are_needed():
    with pytest.raises(RunError, match=r"run 'b' has 1 rows .*2 are needed"):
        resolve_runs(np.zeros((3, 1)), groups=["a", "a", "b"], min_rows=2)


def labels_of(groups, **how):
    return [run.label for run in resolve_runs(np.zeros((4, 1)), groups=groups, **how)]


@pytest.mark.parametrize("kind", [list, np.array, pd.Series, lambda g: pd.Series(g).astype("string")])
def test_a_label_of_minus_one_leaves_rows_out_as_text_too(kind):
    labels = kind(["a", "-1", "b", "b"])
    assert labels_of(labels) == ["a", "b"]
    assert [len(part) for part in unstack_runs(np.zeros(4), labels)] == [1, 2]
    assert cut_runs(labels, 1).tolist() == [0, -1, 1, 1]
    X = np.array([[1.0], [np.inf], [2.0], [3.0]])  # what is left out need not be finite
    assert [run.start for run in resolve_runs(X, groups=labels)] == [0, 2]
    with pytest.raises(RunError, match="every row is labelled -1"):
        labels_of(kind(4 * ["-1"]))


def test_a_run_column_of_texts_leaves_rows_out():
    frame = pd.DataFrame({"u": [1.0, 2.0, 3.0], "run": ["a", "-1", "b"]})
    assert [run.label for run in resolve_runs(frame, run="run")] == ["a", "b"]
    assert [run.label for run in resolve_runs(frame.to_numpy(), run=1)] == ["a", "b"]
    assert [run.label for run in resolve_runs(frame.to_numpy().astype(str), run=1)] == ["a", "b"]
    assert [run.label for run in resolve_runs(frame.set_index("run"), run="index")] == ["a", "b"]


def test_a_number_and_its_text_are_two_runs():
    assert labels_of([1, 1, "1", "1"]) == [1, "1"]
    assert labels_of(["a", -1, -1, 2]) == ["a", 2]
    frame = pd.DataFrame({"u": np.zeros(3), "run": [1, "1", "-1"]})
    assert [run.label for run in resolve_runs(frame, run="run")] == [1, "1"]
    with pytest.raises(DataError, match="groups contains NaN: row 1"):
        labels_of(["a", np.nan, "b", "b"])


def test_what_is_masked_counts_as_missing():
    hidden = np.ma.masked_array([[1.0], [1e6], [2.0], [3.0]], mask=[[0], [1], [0], [0]])
    y = hidden[:, 0]
    for X, target in ((hidden, None), (np.zeros((4, 1)), y), (np.zeros((4, 1)), hidden.astype(int))):
        with pytest.raises(DataError, match="contains NaN: row 1, column 0"):
            resolve_runs(X, target)
    assert np.isnan(resolve_runs(np.zeros((4, 1)), y, allow_nan=True)[0].y[1, 0])
    assert resolve_runs(np.ma.masked_array([[1.0], [2.0]]))[0].X.tolist() == [[1.0], [2.0]]
    with pytest.raises(DataError, match="groups contains NaN: row 1"):
        labels_of(np.ma.masked_array([0, 0, 0, 1], mask=[0, 1, 0, 0]))
    assert np.isnan(stack_runs([hidden], [y])[1]).tolist() == [False, True, False, False]


def test_a_time_that_is_missing_is_refused():
    with pytest.raises(DataError, match="time=0 contains NaN: row 1"):
        resolve_runs(np.array([[0.0, 1.0], [np.nan, 1.0]]), time=0, groups=[0, 1])


@pytest.mark.parametrize("settings", [{"n_blocks": 2, "gap": -1}, {"n_blocks": 2.5}, {"n_blocks": 0}])
def test_cut_runs_wants_counts(settings):
    with pytest.raises(DataError, match="must be an int of at least"):
        cut_runs(np.zeros(10, int), **settings)


def test_labels_of_runs_may_not_be_missing():
    with pytest.raises(DataError, match=r"groups contains NaN: row 1.*-1 leaves a row out"):
        resolve_runs(np.ones((3, 1)), groups=[0.0, np.nan, 1.0])
    days = np.array(["2020-01-01", "NaT", "2020-01-02"], dtype="datetime64[D]")
    for labels in (days, days - days[0]):
        with pytest.raises(DataError, match=r"groups contains NaN: row 1.*-1 leaves a row out"):
            resolve_runs(np.ones((3, 1)), groups=labels)


def test_runs_to_be_stacked_have_the_same_columns():
    with pytest.raises(DataError, match=r"run 1 of X has shape \(3, 2\) and run 0 \(2, 1\)"):
        stack_runs([np.ones((2, 1)), np.ones((3, 2))])
    with pytest.raises(DataError, match="X holds no run"):
        stack_runs([])


@pytest.mark.parametrize("missing", [np.nan, None])
def test_a_run_column_may_not_be_missing(missing):
    frame = pd.DataFrame({"u": [1.0, 2.0, 3.0], "run": np.array(["a", "a", missing], dtype=object)})
    with pytest.raises(DataError, match="run='run' contains NaN: row 2"):
        resolve_runs(frame, run="run")


def test_a_text_column_is_named():
    frame = pd.DataFrame({"u": [1.0, 2.0], "mode": ["on", "off"]})
    with pytest.raises(DataError, match=r"X holds something that is not a number at row 0, column 'mode' .*run="):
        resolve_runs(frame)
