"""Random forces of unit size, and what they move."""

import numpy as np
import pytest

from sksurrogate.gap.fit._pushes import gain_of_forces
from sksurrogate.kernels.banded import recursion_band

N, STARTS = 20_000, np.array([0, 9000])


@pytest.mark.parametrize("memory", [0.0, 0.9])
def test_the_gain_of_a_force_is_the_deviation_that_it_causes(memory):
    """``x' = m x + b w`` with ``corr(w) = a^k``: ``var x = b^2 / (1 - m^2) (1 + m a) / (1 - m a)`` in units of ``var w``."""
    band = recursion_band(np.full((1, 1, N), memory), STARTS)
    C, spread, a = np.ones((1, 1, N)), np.array([2.0]), np.exp(-0.1)
    gain = gain_of_forces(band, np.array([[3.0, 6.0]]), C, STARTS, spread)
    expected = 3.0 / 2.0 * np.sqrt((1 + memory * a) / (1 - memory * a) / (1 - memory**2))
    assert gain[0] == pytest.approx(expected, rel=0.05)  # of 20 000 correlated samples
    assert gain[1] == pytest.approx(2.0 * expected, rel=0.05)
