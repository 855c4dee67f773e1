"""A law that turns round with the state of its own balance, whatever it is multiplied by: steps can follow it."""

import numpy as np
import pytest

from sksurrogate.effects import AugmentedSimulator
from sksurrogate.effects._formula import Term
from sksurrogate.effects._law import LawEffect
from sksurrogate.physics import ODESimulator

FORCE = 50.0  #: Of the friction, for an angle of 1


def turning(shape, width):
    """Friction in the balance of the speed, in proportion to the square of the angle."""
    own, values = (shape, "speed", 0.0, width), (-FORCE,)
    if shape == "tanh":
        own, values = (shape, "speed", width, 0.0), (-FORCE, width)
    return LawEffect("speed", "angle*speed", (Term((own, ("square", "angle", 0.0, 0.0))),), values, free=True)


def caliper(friction=None):
    def rates(t, x, u, p):
        rub = 0.0 if friction is None else friction(x)
        return [x[1], u[0] - 40.0 * x[0] - rub]

    names = {"states": ["angle", "speed"], "inputs": ["torque"], "outputs": ["angle"], "x0": [1.0, 0.0]}
    return ODESimulator(rates, **names, params={}, dt=0.02)


@pytest.mark.parametrize("shape", ["sign", "tanh"])
def test_its_slope_is_one_that_steps_can_follow(shape):
    law, h = turning(shape, 1e-9), 0.02
    theta = law.starts(None)[0]
    angle, speed = np.array([0.0, 0.5, 2.0]), np.full(3, 1e-7)
    width = law.smoothed(theta, 0.1, h)
    force = law.term(0.0, speed, (angle, speed), theta, width)
    slope = -force / speed
    assert np.all(slope * h <= 2.0 + 1e-9) and slope[2] * h > 1.9
    np.testing.assert_allclose(law.term(0.0, speed, (angle, 1e3 * np.ones(3)), theta, width), -FORCE * angle**2)


@pytest.mark.slow
@pytest.mark.parametrize("shape", ["sign", "tanh"])
def test_a_run_that_comes_to_rest_stays_there(shape):
    law = turning(shape, 1e-9)
    U = 40.0 + 20.0 * np.sin(np.arange(300) / 9.0)[:, None]  # about the angle of 1: less than the friction
    rubbing = AugmentedSimulator(caliper(), [law], [law.starts(None)[0]], scale=[1.0, 1.0])
    y = rubbing.simulate(U).ravel()
    assert np.isfinite(y).all() and np.ptp(y) < 0.05
    soft = caliper(friction=lambda x: FORCE * np.tanh(x[1] / 0.5) * x[0] ** 2).simulate(U).ravel()
    assert np.sqrt(np.mean((y - soft) ** 2)) < 0.05


def test_a_turn_of_another_signal_keeps_its_width():
    law = LawEffect("speed", "angle", (Term((("tanh", "angle", 0.3, 0.0),)),), (-2.0,), free=True)
    assert law.smoothed(law.starts(None)[0], 0.1, 0.02) == 0.0
