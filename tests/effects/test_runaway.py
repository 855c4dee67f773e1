"""A free run that would need ever shorter steps is given up in words instead of going on for ever."""

import numpy as np
import pytest

from sksurrogate.effects import AugmentedSimulator, BalanceEffect, Parameter
from sksurrogate.exceptions import SurrogateError
from sksurrogate.physics import ODESimulator


class Whistle(BalanceEffect):
    name, equation = "whistle", "c sin(w t)"
    parameters = (Parameter("size"), Parameter("angular_frequency", low=0.0))

    def term(self, t, x, v, theta, width):
        return theta[0] * np.sin(theta[1] * t) + 0.0 * v


def whistling(angular_frequency):
    plant = ODESimulator(lambda t, x, u, p: [u[0] - x[0]], states=["x"], inputs=["u"], outputs=["x"], params={}, dt=0.1)
    return AugmentedSimulator(plant, [Whistle("x", "x")], [{"size": 1e3, "angular_frequency": angular_frequency}])


def test_a_run_that_needs_too_many_steps_is_given_up():
    with pytest.raises(SurrogateError, match="row 1"):
        whistling(1e5).simulate(np.ones((4, 1)))


def test_a_fast_one_is_followed():
    t, w = 0.1 * np.arange(6), 1e3
    y = whistling(w).simulate(np.ones((6, 1))).ravel()
    exact = 1 - np.exp(-t) + 1e3 * (np.sin(w * t) - w * np.cos(w * t) + w * np.exp(-t)) / (1 + w**2)
    np.testing.assert_allclose(y, exact, atol=1e-3)
