"""Pieces of a long record."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from sksurrogate.gap.fit._record_parts import excerpt
from sksurrogate.kernels.record import Record


def record_of(lengths):
    n = sum(lengths)
    row = np.arange(n, dtype=float)
    return Record(row[None], 2 * row[None], row, np.cumsum([0, *lengths[:-1]]), 1.0)


@given(st.lists(st.integers(8, 5000), min_size=1, max_size=30), st.integers(50, 20_000))
@settings(max_examples=60, deadline=None)
def test_pieces_are_rows_of_the_record_in_order_and_within_one_run(lengths, most):
    whole = record_of(lengths)
    part, rows = excerpt(whole, most)
    assert part.n_samples == len(rows) <= max(most, 0) or part.n_samples == whole.n_samples <= most
    assert np.all(np.diff(rows) > 0)
    np.testing.assert_array_equal(part.u[0], whole.u[0, rows])
    np.testing.assert_array_equal(part.y[0], whole.y[0, rows])
    for piece in np.split(rows, part.starts[1:]):
        assert np.all(np.diff(piece) == 1)
        assert len(np.unique(whole.run_of_row[piece])) == 1


def test_a_short_record_stays_as_it_is():
    whole = record_of([300, 300])
    part, rows = excerpt(whole, 600)
    assert part is whole
    assert len(rows) == 600


def test_pieces_reach_over_the_whole_record():
    part, rows = excerpt(record_of([100_000]), 9000)
    assert rows[0] == 0
    assert rows[-1] == 99_999
    assert part.n_samples > 8000
