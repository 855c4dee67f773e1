"""Dry friction that sticks: it ranks first, its two parts are one law, and it is named."""

import numpy as np
import pytest

from sksurrogate.effects import CATALOGUE
from sksurrogate.effects._wires import Wire
from sksurrogate.gap import GapDiagnoser
from sksurrogate.gap.fit._build import build_problem
from sksurrogate.gap.screen._screen import screen
from sksurrogate.gap.screen._sticking import sticks
from sksurrogate.kernels.record import Record
from sksurrogate.physics import ODESimulator
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._simulator import describe

DT, N, RUNS, NOISE = 0.05, 200, 3, 0.005
LEVEL, STATIC, VELOCITY = 2.0, 4.0, 0.6


def rhs(t, x, u, p):
    return x[1], 5.0 * u[0] - 3.0 * x[0] - 0.3 * x[1]


SIMULATOR = ODESimulator(rhs, states=["q", "v"], inputs=["f"], outputs=["q", "v"], params={}, dt=DT)


def sticking(u, substeps=200):
    """The same with friction that is larger at rest, by short steps that never turn a velocity round."""
    x, h, out = np.zeros(2), DT / substeps, []
    for value in u:
        out.append(x.copy())
        for _ in range(substeps):
            before = x[1] + h * (5.0 * value - 3.0 * x[0] - 0.3 * x[1])
            level = LEVEL + (STATIC - LEVEL) * np.exp(-((before / VELOCITY) ** 2))
            v = np.sign(before) * max(abs(before) - h * level, 0.0)
            x = np.array([x[0] + h * v, v])
    return np.array(out)


@pytest.fixture(scope="module")
def runs():
    rng = np.random.default_rng(1)
    U = [np.repeat(rng.uniform(-1.2, 1.2, N // 25), 25)[:, None] for _ in range(RUNS)]
    Y = [sticking(u[:, 0]) for u in U]
    assert np.mean(np.abs(np.concatenate(Y)[:, 1]) < 1e-6) > 0.2  # it sticks
    return U, [y + NOISE * rng.normal(size=y.shape) for y in Y]


@pytest.fixture(scope="module")
def problem(runs):
    U, Y = runs
    plant = describe(SIMULATOR, n_inputs=1, n_outputs=2, dt=DT)
    record = Record.from_runs(U, Y, [DT * np.arange(N)] * RUNS, DT)
    return build_problem(PlantModel(plant), record, (), ("v",))


def test_the_screen_knows_what_stops(problem):
    found, smoothed = problem
    null = found.fit((), np.zeros(0), smoothed.x)
    names = ("coulomb_friction", "linear_loss", "quadratic_drag", "power_law", "gravity_tilt", "hidden_relaxation")
    candidates = [CATALOGUE[name]("v", "v") for name in names]
    starts = screen(candidates, null, smoothed.x, None).starts
    best = min(starts, key=lambda start: start.left)
    assert best.effect.name == "coulomb_friction"
    assert LEVEL < best.theta[0] < STATIC
    assert best.left < 0.5 * min(start.left for start in starts if start.effect.name != "coulomb_friction")


def test_it_is_named(runs):
    U, Y = runs
    found = GapDiagnoser(SIMULATOR, random_state=0).fit(np.concatenate(U), np.concatenate(Y), np.repeat(range(RUNS), N))
    report = found.report_
    assert report.verdict == "explained"
    assert [effect.name for effect in report.effects] == ["stribeck_friction"]
    (effect,) = report.effects
    assert effect.params["level"] == pytest.approx(LEVEL, rel=0.1)
    assert effect.params["static_level"] == pytest.approx(STATIC, rel=0.1)


def test_only_laws_with_a_signal_of_their_own_stick():
    theta, wide = np.ones((1, 3)), Wire(0, ((True, 0),), 0.1, feedback=1.0)
    friction = CATALOGUE["coulomb_friction"]("v", "v")
    assert sticks(friction, theta, wide, 10.0).all() and not sticks(friction, 1e-6 * theta, wide, 1e-3).any()
    assert not sticks(CATALOGUE["constant_bias"]("v"), theta, Wire(0, (), None), 10.0).any()
    assert not sticks(CATALOGUE["input_gain"]("u"), theta, wide, 10.0).any()
