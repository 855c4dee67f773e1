"""Inputs between the rows of a record: made once for all models, those of :func:`hold` and of what was recorded before a cut."""

import numpy as np
import pytest

from sksurrogate.kernels.record import Record
from sksurrogate.kernels.signals import hold, stacked

U = np.random.default_rng(0).normal(size=(40, 2))


def record():
    """Two runs."""
    return Record.from_runs([U[:25], U[25:]], [U[:25, :1], U[25:, :1]], [np.arange(25.0), np.arange(15.0)], 1.0)


@pytest.mark.parametrize("order", [0, 1])
def test_they_are_those_of_a_hold_and_made_once(order):
    one = record()
    mean, half, shown = one.acting(4, order)
    expected = stacked([hold(u, 4, order, one.starts) for u in one.u])
    for found, wanted in zip((mean, half, shown), expected):
        assert (found is None and wanted is None) or np.array_equal(found, wanted)
    assert one.acting(4, order)[0] is mean and one.acting(2, order)[0] is not mean


def test_a_cut_record_goes_on_from_what_was_before_the_cut():
    whole = record()
    pieces = whole.cut(np.array([0, 10, 25]))
    for found, wanted in zip(pieces.acting(3, 1), whole.acting(3, 1)):
        assert np.array_equal(found, wanted)  # a straight line leads from row 9 to row 10


def test_a_plant_without_inputs_has_none():
    mean, half, shown = Record.from_runs([np.zeros((5, 0))], [np.zeros((5, 1))], [np.arange(5.0)], 1.0).acting(2, 0)
    assert mean.shape == (2, 0, 1, 5) and half is None and shown.shape == (0, 1, 5)
