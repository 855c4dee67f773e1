"""The Rosenbrock step keeps its order where the law is not linear and where time and inputs enter."""

import numpy as np
import pytest

from sksurrogate.kernels.stiff import rosenbrock


@pytest.mark.parametrize("timed", [False, True])
def test_the_step_is_of_third_order(timed):
    # dx/dt = -x^2 (1 + t) with t, or with an input that equals t: 1 / x = 1 + t + t^2 / 2 from 1
    def rate(t, x, u):
        return -(x**2) * (1.0 + (t if timed else u[0]))

    start, end = np.zeros((1, 1)), np.ones((1, 1))
    errors = [rosenbrock(rate, np.zeros(1), np.ones((1, 1)), start, end, 1.0, n)[0, 0] - 0.4 for n in (1, 2, 4, 8)]
    orders = np.log2(np.abs(np.array(errors[:-1]) / errors[1:]))
    assert np.all(orders > 2.7), orders
