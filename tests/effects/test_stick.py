"""Dry friction that sticks: steps follow the jump, so that slopes are those of the free run and a fit finds the level."""

from dataclasses import replace

import numpy as np
import pytest

from sksurrogate.effects import CATALOGUE, AugmentedSimulator, starting
from sksurrogate.gap.fit._build import build_problem
from sksurrogate.gap.fit._ode import Numerics
from sksurrogate.kernels.free_runs import free_run
from sksurrogate.kernels.linearised import linearise
from sksurrogate.kernels.record import Record
from sksurrogate.physics import ODESimulator
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._simulator import describe

DT, N, RUNS, LEVEL = 0.05, 200, 3, 2.8


def rhs(t, x, u, p):
    return x[1], 5.0 * u[0] - 3.0 * x[0] - 0.3 * x[1]


def sticking(u, substeps=200):
    """The same with dry friction of LEVEL, by short steps that never turn a velocity round."""
    x, h, out = np.zeros(2), DT / substeps, []
    for value in u:
        out.append(x.copy())
        for _ in range(substeps):
            push = 5.0 * value - 3.0 * x[0] - 0.3 * x[1]
            before = x[1] + h * push
            v = np.sign(before) * max(abs(before) - h * LEVEL, 0.0)
            x = np.array([x[0] + h * v, v])
    return np.array(out)


@pytest.fixture(scope="module")
def problem():
    rng = np.random.default_rng(0)
    U = [np.repeat(rng.uniform(-1.6, 1.6, N // 40), 40)[:, None] for _ in range(RUNS)]
    Y = [sticking(u[:, 0]) for u in U]
    assert np.mean(np.abs(np.concatenate(Y)[:, 1]) < 1e-6) > 0.1  # it sticks
    Y = [y + 0.005 * rng.normal(size=y.shape) for y in Y]
    simulator = ODESimulator(rhs, states=["q", "v"], inputs=["f"], outputs=["q", "v"], params={}, dt=DT)
    plant = describe(simulator, n_inputs=1, n_outputs=2, dt=DT)
    record = Record.from_runs(U, Y, [DT * np.arange(N)] * RUNS, DT)
    found, smoothed = build_problem(PlantModel(plant), record, (), ("v",))
    return replace(found, numerics=Numerics(2, 150.0)), smoothed


@pytest.mark.parametrize(
    ("name", "rest"), [("coulomb_friction", ()), ("asymmetric_friction", (0.1,)), ("stribeck_friction", (4.0, 0.5))]
)
@pytest.mark.parametrize("level", [1.0, LEVEL])
def test_slopes_are_those_of_the_free_run_while_it_sticks(problem, name, rest, level):
    problem, smoothed = problem
    model, theta = problem.augmented((CATALOGUE[name]("v", "v"),)), np.array([level, *rest])
    first = smoothed.x[:, problem.record.starts]
    x = free_run(model, theta, first)
    slope = linearise(model, theta, x, np.abs(theta)).Z_theta[:, 0]
    h = np.zeros(len(theta))
    h[0] = 1e-3 * level
    changed = (free_run(model, theta + h, first) - free_run(model, theta - h, first)) / (2 * h[0])
    assert np.linalg.norm(slope - changed) < 0.02 * np.linalg.norm(changed)


@pytest.mark.parametrize("start", [0.3, 1.0, 6.0])
def test_the_level_is_found_from_far_off(problem, start):
    problem, smoothed = problem
    candidate = problem.fit((CATALOGUE["coulomb_friction"]("v", "v"),), np.array([start]), smoothed.x)
    assert candidate.fit.theta[0] == pytest.approx(LEVEL, rel=0.03)


@pytest.mark.parametrize("exponent", [0.05, 0.3, 0.6])
@pytest.mark.parametrize("coefficient", [1.0, 20.0])
def test_a_power_below_one_comes_to_rest_as_in_closed_form(exponent, coefficient):
    """|x|^(1 - m) falls in a straight line and stays at 0, however steep the law is there."""
    still = ODESimulator(lambda t, x, u, p: (u[0],), states=["x"], inputs=["u"], outputs=["x"], params={}, dt=0.01)
    law = CATALOGUE["power_law"]("x", "x")
    values = {"coefficient": coefficient, "exponent": exponent}
    t = 0.01 * np.arange(300)
    remains = np.maximum(1.0 - (1.0 - exponent) * coefficient * t, 0.0) ** (1.0 / (1.0 - exponent))
    for sign in (1.0, -1.0):
        x = AugmentedSimulator(still, [law], [values]).simulate(np.zeros((300, 1)), x0=[sign])[:, 0]
        np.testing.assert_allclose(x, sign * remains, atol=2e-5)
    late = AugmentedSimulator(still, [starting(law)], [{**values, "onset": 0.5}])
    x = late.simulate(np.zeros((300, 1)), x0=[1.0])[:, 0]  # the window opens within the substeps beside 0.5
    np.testing.assert_allclose(x[51:], remains[1:250], atol=2e-5)
