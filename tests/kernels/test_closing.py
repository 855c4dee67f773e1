"""When a free run by Newton's method over time counts as closed."""

import numpy as np
import pytest

from sksurrogate.kernels.banded import recursion_band
from sksurrogate.kernels.integrate import close

STARTS, ROWS, TOLERANCE = np.array([0]), 60, 1e-3
DECAY = 0.8


class Counted:
    """``x' = 0.8 x + 1``, and how often it was asked."""

    def __init__(self):
        self.calls = 0

    def __call__(self, x):
        self.calls += 1
        return DECAY * x + 1.0


def closed_with(slope, size):
    """The run from 0 with slopes of another map, and what it is: its largest error, the number of calls."""
    step, other = Counted(), np.full((1, 1, ROWS), slope)
    x0 = np.zeros((1, ROWS))
    x, closed, _ = close(step, x0, STARTS, np.array([size]), TOLERANCE, band=recursion_band(other, STARTS))
    assert closed
    exact = (1.0 - DECAY ** np.arange(ROWS)) / (1.0 - DECAY)
    return float(np.max(np.abs(x[0] - exact))) / size, step.calls


@pytest.mark.parametrize("slope", [0.79, 0.77, 0.74, 0.7])
def test_a_run_is_closed_once_the_corrections_ahead_are_small(slope):
    error, calls = closed_with(slope, 1.0)
    # corrections of a chord shrink by (0.8 - slope) / (1 - slope) each: those ahead are a geometric series
    rate = (DECAY - slope) / (1.0 - slope)
    corrections = 5.0 * rate ** np.arange(20) * (1.0 - rate)
    ahead = corrections * rate / (1.0 - rate)
    assert error < TOLERANCE
    assert calls <= 2 + int(np.argmax(ahead < TOLERANCE))
    assert calls <= int(np.argmax(corrections < TOLERANCE))  # before one of them is that small itself
