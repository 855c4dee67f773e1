"""Time stamps that jitter and have gaps: laid on a grid, or cut where inputs differ across a gap."""

import numpy as np
import pytest

from sksurrogate._stamps import on_grid, with_rows_in_gaps
from sksurrogate.exceptions import DataError
from sksurrogate.runs import resolve_runs


def runs_of(t, u, y, dt=None):
    return resolve_runs(np.column_stack([u, t]), y, time=1, dt=dt, allow_uneven=True, unmeasured=True)


def test_even_stamps_change_nothing():
    t = 7.0 + 0.1 * np.arange(20) + 1e-6 * np.sin(np.arange(20))
    runs = runs_of(t, np.arange(20.0), np.arange(20.0))
    laid, offsets = on_grid(runs, 0.1, "zoh", "t")
    assert offsets is None and laid[0].t[0] == 0.0
    np.testing.assert_array_equal(laid[0].X[:, 0], np.arange(20.0))
    filled, uneven, first = with_rows_in_gaps(runs, 0.1, "zoh", "t")
    assert not uneven and len(filled) == 1 and first.tolist() == [0]


def test_held_inputs_keep_their_integral_and_readings_their_stamps():
    rng = np.random.default_rng(0)
    t = np.arange(30) + rng.uniform(-0.2, 0.2, 30)
    u, y = rng.normal(size=30), rng.normal(size=30)
    (run,), (offset,) = on_grid(runs_of(t, u, y), 1.0, "zoh", "t")
    n = len(run.X)
    assert np.sum(run.X[: n - 1]) == pytest.approx(np.sum(u[:-1] * np.diff(t)) + u[-1] * (n - 1 - (t[-1] - t[0])))
    known = ~np.isnan(run.y[:, 0])
    np.testing.assert_allclose((run.t + offset)[known], t - t[0])
    np.testing.assert_array_equal(run.y[known, 0], y)


def test_a_gap_is_filled_where_inputs_stand_and_cut_where_they_differ():
    t = np.r_[np.arange(10.0), 14.2 + np.arange(10.0)]
    stands = runs_of(t, np.ones(20), np.arange(20.0))
    (run,), uneven, _ = with_rows_in_gaps(stands, 1.0, "zoh", "t")
    assert uneven and len(run.X) == 24 and np.isnan(run.y[10:14, 0]).all()
    np.testing.assert_allclose(np.diff(run.t)[9:14], 1.04)
    moved = runs_of(t, np.r_[np.ones(10), np.zeros(10)], np.arange(20.0))
    parts, uneven, first = with_rows_in_gaps(moved, 1.0, "zoh", "t")
    assert not uneven and [len(part.X) for part in parts] == [10, 10] and first.tolist() == [0]
    assert parts[1].label == "t = 14.2" and parts[1].t[0] == 14.2


def test_mistakes_get_a_way_out():
    t = np.arange(10.0)
    with pytest.raises(
        DataError, match=r"usual step of the data is 1, .* simulator 0.001 \(milliseconds in the data\?\)"
    ):
        on_grid(runs_of(t, t, t), 0.001, "zoh", "t")
    with pytest.raises(DataError, match="label the parts between the gaps as runs"):
        with_rows_in_gaps(runs_of(np.r_[t, 1000.0 + t], np.ones(20), np.ones(20)), 1.0, "zoh", "t")
