"""The screen's column of a force: a unit push times its mean over the sample is what the plant's own step changes."""

import numpy as np
import pytest

from sksurrogate.effects import CATALOGUE
from sksurrogate.gap.fit._build import build_problem
from sksurrogate.gap.fit._evidence import estimate_noise
from sksurrogate.gap.screen._responses import Responses
from sksurrogate.kernels.record import Record
from sksurrogate.physics import ODESimulator
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._simulator import describe

SPAN, RUNS = 12.0, 2


def screener(dt):
    """A driven oscillator sampled at dt, its null fitted."""
    simulator = ODESimulator(
        lambda t, x, u, p: (x[1], u[0] - p["k"] * x[0] - 0.4 * x[1]),
        states=["q", "v"], inputs=["f"], outputs=["q"], params={"k": 4.0}, dt=dt,
    )  # fmt: skip
    n = round(SPAN / dt)
    U = [(2.0 * np.sin(w * dt * np.arange(n)))[:, None] for w in (0.7, 1.9)]
    Y = [simulator.simulate(u, x0=np.zeros(2)).reshape(n, 1) for u in U]
    rng = np.random.default_rng(0)
    Y = [y + 0.001 * rng.normal(size=y.shape) for y in Y]
    plant = describe(simulator, n_inputs=1, n_outputs=1, dt=dt)
    record = Record.from_runs(U, Y, [dt * np.arange(n)] * RUNS, dt)
    problem, smoothed = build_problem(PlantModel(plant), record, (), ("v",))
    null = estimate_noise(problem.fit((), np.zeros(0), smoothed.x), problem.first_noise())
    return Responses(null.candidate, smoothed.x)


def error(dt, effect, theta):
    """Of the push over that of two whole steps, with and without the effect."""
    s = screener(dt)
    model = s.problem.augmented((effect,))
    starts, x = np.array(theta)[:, None], s.smoothed.x[:, None]
    whole = model.bind(starts)(x) - s.after
    return float(np.linalg.norm(s.pushed(model, starts, x) - whole) / np.linalg.norm(whole))


#: Small, for a screen is a first-order question: what an effect does to itself within a sample is left to the fit.
SMALL = 1e-4


@pytest.mark.parametrize(
    ("name", "variable"), [("linear_loss", "v"), ("cubic_stiffness", "q"), ("quadratic_drag", "v"), ("drift", None)]
)
def test_the_push_converges_with_the_square_of_the_step(name, variable):
    effect = CATALOGUE[name]("v", variable) if variable else CATALOGUE[name]("v")
    coarse, fine = error(0.2, effect, [SMALL]), error(0.1, effect, [SMALL])
    assert coarse < 0.05
    assert fine < 0.35 * coarse


def test_a_constant_force_is_pushed_exactly():
    assert error(0.2, CATALOGUE["constant_bias"]("v"), [0.7]) < 1e-8


def test_a_kink_costs_a_few_percent_where_it_is_crossed():
    friction = CATALOGUE["coulomb_friction"]("v", "v")
    coarse, fine = error(0.2, friction, [0.3]), error(0.05, friction, [0.3])
    assert fine < 0.6 * coarse < 0.1


@pytest.mark.parametrize("moment", [0.0, 2.35, 6.0])
def test_a_parameter_that_jumps_changes_what_its_two_whole_steps_change(moment):
    """Exactly but for the samples within a substep of the jump, which the model smears over as much (0.2 and 2.1 %)."""
    s, effect = screener(0.1), CATALOGUE["parameter_step"]("k")
    model, theta, x = s.problem.augmented((effect,)), np.array([[0.1], [moment]]), s.smoothed.x[:, None]
    whole = model.bind(theta)(x) - s.after
    switched = s.switched(model, theta)
    t = s.problem.record.t
    outside = (t + 0.1 < moment - 0.051) | (t > moment + 0.051)
    assert np.allclose(switched[:, :, outside], whole[:, :, outside], atol=1e-12)
    assert np.linalg.norm(switched - whole) < 0.03 * np.linalg.norm(whole)
