"""Faults that no test noticed once: each has a closed form here."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from sksurrogate.effects import CATALOGUE, AugmentedSimulator
from sksurrogate.effects._structure import kinematic_states
from sksurrogate.physics import ODESimulator
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._simulator import describe

N, DT = 60, 0.1


def level(hold="zoh"):
    """dx/dt = u - x."""
    return ODESimulator(
        lambda t, x, u, p: (u[0] - x[0],), states=["x"], inputs=["u"], outputs=["x"], params={}, dt=DT, hold=hold
    )


def augmented(plant, *effects):
    return AugmentedSimulator(plant, [CATALOGUE[name](*where) for name, where, _ in effects], [v for *_, v in effects])


def test_a_drift_acts_beside_another_effect():
    t = DT * np.arange(N)
    a, b, c = 0.3, 0.7, 1.5  # dx/dt = -(1 + c) x + b + a t from 0
    plant = augmented(
        level(), ("linear_loss", ("x", "x"), (c,)), ("drift", ("x",), (a,)), ("constant_bias", ("x",), (b,))
    )
    k = 1.0 + c
    exact = a * t / k + (b / k - a / k**2) * (1.0 - np.exp(-k * t))
    np.testing.assert_allclose(plant.simulate(np.zeros((N, 1)))[:, 0], exact, atol=1e-7)


@pytest.mark.parametrize("reverse", [False, True])
def test_effects_of_one_sensor_act_in_the_order_of_the_table(reverse):
    effects = [("sensor_gain", ("x",), (0.5,)), ("sensor_bias", ("x",), (2.0,)), ("sensor_saturation", ("x",), (3.0,))]
    plant = augmented(level(), *(effects[::-1] if reverse else effects))
    U = np.ones((N, 1))
    plain = level().simulate(U)
    np.testing.assert_allclose(plant.simulate(U), np.minimum(1.5 * plain + 2.0, 3.0), atol=1e-9)


@pytest.mark.parametrize("delay", [0.5, 1.0, 2.3])
def test_a_fractional_delay_of_a_joined_input(delay):
    rng = np.random.default_rng(0)
    U = rng.normal(size=(N, 1))
    t, late = DT * np.arange(N), delay * DT
    exact, x = [0.0], [0.0]
    nodes = np.unique(np.round(np.r_[t, t[t + late < t[-1]] + late], 12))
    for begin, end in zip(nodes[:-1], nodes[1:]):
        x = solve_ivp(lambda s, x: np.interp(s - late, t, U[:, 0]) - x, (begin, end), x, rtol=1e-10, atol=1e-12).y[
            :, -1
        ]
        if np.any(np.isclose(end, t)):
            exact.append(float(x[0]))
    plant = augmented(level("foh"), ("input_delay", ("u",), (late,)))
    np.testing.assert_allclose(plant.simulate(U)[:, 0], exact, atol=2e-6)


def test_a_state_that_is_an_integral_at_one_point_only_is_none():
    def rhs(t, x, u, p):
        return (x[1] * (1.0 + 0.3 * np.sin(x[0])), u[0] - x[1])  # x' = x[1] at x[0] = 0 alone

    plant = ODESimulator(rhs, states=["q", "v"], inputs=["u"], outputs=["q"], params={}, dt=DT)
    assert kinematic_states(PlantModel(describe(plant))) == ()
