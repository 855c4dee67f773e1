"""A free run that would need ever shorter steps is given up in words instead of going on for ever."""

import numpy as np
import pytest
from scipy.linalg import expm

from sksurrogate.effects import CATALOGUE, AugmentedSimulator, BalanceEffect, Parameter, _free_run
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


@pytest.mark.parametrize(("frequency", "damping"), [(8.897, 0.04914), (8.897, 0.1), (4.0, 0.3)])
def test_a_stable_plant_stays_with_its_exact_solution_where_two_substeps_lead_away(frequency, damping):
    """A body with a mode that rings twice a minute, sampled every quarter: the linear system by the matrix exponential.

    Steps that are too long grew to 1e66; a run that began there was called closed at 1e35.
    """
    dt, gain, loss, rows = 0.25, 26.07, 0.941, 300
    body = ODESimulator(
        lambda t, x, u, p: [u[0] - loss * x[0]],
        states=["c"], inputs=["rate"], outputs=["c"], params={}, dt=dt,
    )  # fmt: skip
    U = np.full((rows, 1), 5.0)
    U[40:42] = 60.0
    found = AugmentedSimulator(
        body, [CATALOGUE["hidden_mode"]("c", "c")], [{"gain": gain, "angular_frequency": frequency, "damping": damping}]
    ).simulate(U)[:, 0]
    A = np.zeros((4, 4))  # c, z, z', u
    A[0] = -loss - gain, gain, 0.0, 1.0
    A[1, 2] = 1.0
    A[2] = frequency**2, -(frequency**2), -2 * damping * frequency, 0.0
    step, x, exact = expm(A * dt), np.zeros(4), []
    for u in U[:, 0]:
        x[3] = u
        exact.append(x[0])
        x = step @ x
    np.testing.assert_allclose(found, exact, atol=1e-6 * np.max(np.abs(exact)))


@pytest.mark.slow
@pytest.mark.parametrize("effect", ["coulomb_friction", "hysteresis"])
def test_a_long_run_in_windows_is_the_run_sample_by_sample(monkeypatch, effect):
    cart = ODESimulator(
        lambda t, x, u, p: [x[1], u[0] - x[0] - 0.3 * x[1]],
        states=["x", "v"], inputs=["u"], outputs=["x"], params={}, dt=0.1,
    )  # fmt: skip
    values = {"coulomb_friction": {"level": 0.3}, "hysteresis": {"stiffness": 2.0, "limit": 0.2}}[effect]
    real = AugmentedSimulator(cart, [CATALOGUE[effect]("v", "v" if effect == "coulomb_friction" else "x")], [values])
    U = np.repeat(np.random.default_rng(0).uniform(-1, 1, 70), 15)[:, None]
    in_windows = real.simulate(U)
    monkeypatch.setattr(_free_run, "LONG_RUN", 10_000)
    monkeypatch.setattr(_free_run, "_closed", lambda bound, near: None)
    np.testing.assert_allclose(in_windows, real.simulate(U), atol=1e-8)


@pytest.mark.slow
def test_a_long_run_of_a_friction_takes_few_calls():
    calls = [0]

    def cart(t, x, u, p):
        calls[0] += 1
        return [x[1], u[0] - x[0] - 0.3 * x[1]]

    plant = ODESimulator(cart, states=["x", "v"], inputs=["u"], outputs=["x"], params={}, dt=0.1)
    U = np.repeat(np.random.default_rng(0).uniform(-1, 1, 1000), 20)[:, None]
    AugmentedSimulator(plant, [CATALOGUE["coulomb_friction"]("v", "v")], [{"level": 0.3}]).simulate(U)
    assert calls[0] < 20 * len(U)  # 72 a sample where the first runs are made sample by sample
