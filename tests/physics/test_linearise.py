"""Linearisation and steady state of the paper's Eq. (9) against its derivatives by hand."""

import numpy as np
import pytest

from sksurrogate.datasets import make_reactor
from sksurrogate.exceptions import SimulatorError
from sksurrogate.physics import CallableSimulator, StepSimulator, linearise, steady_state


def test_the_reactor_equals_its_derivatives_by_hand():
    u = 0.15
    y = steady_state(make_reactor(), [u], x0=[5.0])[0]
    k, dk = np.exp(-1 / u), np.exp(-1 / u) / u**2
    assert 2 * (4 - y) - 100 * k * y**2 + 1000 * k * y == pytest.approx(0.0, abs=1e-9)
    lin = linearise(make_reactor(), [y], [u])
    assert lin.A[0, 0] == pytest.approx(-2 - 200 * k * y + 1000 * k, rel=1e-8)
    assert lin.B[0, 0] == pytest.approx(dk * (1000 * y - 100 * y**2), rel=1e-8)
    assert lin.C[0, 0] == pytest.approx(1.0) and lin.D[0, 0] == 0.0 and lin.dt == 0.0


def test_a_step_gives_its_matrices_and_a_control_system():
    pytest.importorskip("control")
    plant = StepSimulator(
        lambda t, x, u, p, dt: [0.5 * x[0] + 2 * u[0]], states=["x"], inputs=["u"], outputs=["x"], dt=0.1
    )
    system = linearise(plant, steady_state(plant, [1.0]), [1.0]).to_control()
    assert system.A[0, 0] == pytest.approx(0.5) and system.B[0, 0] == pytest.approx(2.0) and system.dt == 0.1
    assert steady_state(plant, [1.0])[0] == pytest.approx(4.0)


def test_mistakes_speak():
    with pytest.raises(SimulatorError, match="trajectories only"):
        linearise(CallableSimulator(np.sin), [0.0], [0.0])
    ramp = StepSimulator(lambda t, x, u, p, dt: [x[0] + 1.0], states=["x"], inputs=["u"], outputs=["x"])
    with pytest.raises(SimulatorError, match="no steady state"):
        steady_state(ramp, [0.0])
    with pytest.raises(SimulatorError, match=r"x0 has 2 values, expected 1: one for each of states=\['x'\]"):
        linearise(ramp, [1.0, 2.0], [0.0])
    with pytest.raises(SimulatorError, match=r"u0 has 2 values, expected 1: one for each of inputs=\['u'\]"):
        steady_state(ramp, [0.0, 1.0])
