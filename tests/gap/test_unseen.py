"""A position that nobody measures: a spring on it is named though no output shows where the run began."""

from dataclasses import replace

import numpy as np
import pytest

from sksurrogate.effects import CATALOGUE
from sksurrogate.gap.fit._build import build_problem
from sksurrogate.gap.fit._evidence import estimate_noise
from sksurrogate.gap.fit._prior import seen_square, start_cost
from sksurrogate.gap.screen._responses import Responses
from sksurrogate.gap.screen._screen import screen
from sksurrogate.gap.screen._unseen_starts import moved_through, unseen_starts
from sksurrogate.kernels.record import Record
from sksurrogate.physics import ODESimulator
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._simulator import describe

RUNS, N, DT, NOISE = 4, 200, 0.1, 0.003


def shaft(spring=0.0, loss=0.5):
    """A shaft whose speed alone is measured."""
    return ODESimulator(
        lambda t, x, u, p: (x[1], u[0] - loss * x[1] - spring * x[0]),
        states=["angle", "speed"], inputs=["torque"], outputs=["speed"], params={}, dt=DT,
    )  # fmt: skip


def problem_of(spring, angles, loss=0.5):
    rng = np.random.default_rng(1)
    U = [np.repeat(rng.uniform(-1.0, 1.0, N // 10), 10)[:, None] for _ in range(RUNS)]
    Y = [shaft(spring, loss).simulate(u, x0=np.array([a, 0.0])).reshape(N, 1) for u, a in zip(U, angles)]
    Y = [y + NOISE * rng.normal(size=y.shape) for y in Y]
    plant = describe(shaft(), n_inputs=1, n_outputs=1, dt=DT)
    record = Record.from_runs(U, Y, [DT * np.arange(N)] * RUNS, DT)
    return build_problem(PlantModel(plant), record, (), ("speed",))


def null_of(problem, x):
    return estimate_noise(problem.fit((), np.zeros(0), x), problem.first_noise())


def test_the_smoothed_path_starts_where_the_guess_does_unless_the_data_say_otherwise():
    _, smoothed = problem_of(0.0, np.zeros(RUNS))
    starts = N * np.arange(RUNS)
    np.testing.assert_allclose(smoothed.x[0, starts], 0.0, atol=1e-3)


def test_what_an_unseen_angle_does_through_a_spring_is_a_constant_force():
    problem, smoothed = problem_of(0.0, np.zeros(RUNS))
    s = Responses(null_of(problem, smoothed.x).candidate, smoothed.x)
    spring, bias = CATALOGUE["linear_loss"]("speed", "angle"), CATALOGUE["constant_bias"]("speed")
    unseen = unseen_starts(s)
    assert len(unseen) == 1
    (through,) = moved_through(s, unseen, spring, np.array([0.2]))
    force, _ = s.columns(bias, np.array([[-0.2 * np.ptp(s.smoothed.x[0])]]))
    np.testing.assert_allclose(through, force[:, 0], rtol=1e-5, atol=1e-8 * np.ptp(force))
    assert not len(moved_through(s, unseen, CATALOGUE["linear_loss"]("speed", "speed"), np.array([0.2])))


@pytest.mark.parametrize("angles", [(0.0, 0.0, 0.0, 0.0), (3.0, -2.0, 5.0, 1.0)])
def test_the_screen_tells_a_spring_whatever_the_angles_at_the_start(angles):
    """Beside the forces that the starts make, the spring's column explains the gap to the noise."""
    problem, smoothed = problem_of(0.02, angles)
    null = null_of(problem, smoothed.x)
    spring, loss = CATALOGUE["linear_loss"]("speed", "angle"), CATALOGUE["linear_loss"]("speed", "speed")
    best = max(screen([spring, loss], null.candidate, smoothed.x, null.noise).starts, key=lambda start: start.white)
    assert best.effect is spring
    assert best.theta[0] == pytest.approx(0.02, rel=0.25)
    assert best.left < 0.05 * null.fit.cost


def test_where_a_run_began_that_nobody_measured_is_not_what_makes_one_effect_of_another():
    """A loss that an angle makes is nearly the same for all angles far from 0: what it buys must be paid for."""
    problem, smoothed = problem_of(0.0, np.zeros(RUNS), loss=0.7)
    product, x = CATALOGUE["bilinear"]("speed", "angle*speed"), smoothed.x.copy()
    x[0] += 500.0 * problem.scale[0]
    far = problem.fit((product,), np.array([-0.2 / (500.0 * problem.scale[0])]), x)
    alone = problem.fit((), np.zeros(0), smoothed.x)
    assert far.fit.cost < 1.1 * N * RUNS < alone.fit.cost  # it closes the gap
    assert start_cost(far) > 1000.0
    assert start_cost(alone) < 1.0


def test_a_start_that_no_output_shows_at_all_costs_nothing_wherever_a_fit_leaves_it():
    """Without a spring no output shows the angle; behind a sensor at its limit fits had left starts at 1e7 sizes."""
    problem, smoothed = problem_of(0.0, np.zeros(RUNS))
    x = smoothed.x.copy()
    x[0] += 500.0 * problem.scale[0]
    far = problem.fit((), np.zeros(0), x)
    assert np.all(np.abs(far.fit.x[0, problem.record.starts]) > 400.0 * problem.scale[0])
    assert start_cost(far) < 1.0


def test_a_start_that_outputs_show_costs_what_its_distance_does():
    problem, smoothed = problem_of(1.0, (40.0, -30.0, 50.0, 20.0))
    spring = CATALOGUE["linear_loss"]("speed", "angle")
    fitted = problem.fit((spring,), np.array([1.0]), smoothed.x)
    problem = replace(problem, scale=problem.scale / 30.0)
    starts = problem.record.starts
    away = (fitted.fit.x[:, starts] - problem.run[:, starts]) / (10.0 * problem.scale[:, None])
    assert start_cost(replace(fitted, problem=problem)) == pytest.approx(np.sum(away**2), rel=0.02)
    assert np.sum(away**2) > 1.0


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e26])
def test_what_is_shown_of_a_start_whatever_the_size_of_the_slopes(size):
    """A diagnosis had ended where a free run bursts: two states seen as one, with slopes beyond all digits."""
    H, x = size * np.array([[1.0, -1.0], [-1.0, 1.0]]), np.array([3.0, 1.0])
    assert seen_square(H, x) == pytest.approx(2.0 * size / (1.0 + 2.0 * size) * 2.0)
