"""Work is counted wherever it is done."""

import multiprocessing
import pickle
import sys

import numpy as np
import pytest

from sksurrogate.blind._plants import CountingRhs


def decay(t, x, u, p):
    return [-x[0]]


def test_columns_add_up_and_travel():
    rhs = CountingRhs(decay)
    rhs(0.0, np.ones((1, 7)), None, {})
    again = pickle.loads(pickle.dumps(rhs))
    again(0.0, np.ones((1, 2)), None, {})
    assert (rhs.columns, again.columns) == (7, 9)


@pytest.mark.skipif(sys.platform != "linux", reason="no fork")
@pytest.mark.filterwarnings("ignore:This process")
def test_what_a_fork_asks_counts():
    rhs = CountingRhs(decay)
    other = multiprocessing.get_context("fork").Process(target=rhs, args=(0.0, np.ones((1, 5)), None, {}))
    other.start()
    other.join()
    assert rhs.columns == 5
