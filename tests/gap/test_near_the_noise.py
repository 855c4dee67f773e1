"""At the noise small things count: forms that lead there, starts that lie apart, white noise of slow plants."""

from dataclasses import replace

import numpy as np
import pytest

from sksurrogate.effects import CATALOGUE
from sksurrogate.gap.fit._build import build_problem
from sksurrogate.gap.fit._evidence import arrived, estimate_noise
from sksurrogate.gap.fit._ode import QUIET_OUTPUT, REACH
from sksurrogate.gap.screen._screen import Start
from sksurrogate.gap.search._fit_from_starts import APART, apart
from sksurrogate.kernels.banded import first_order_scan, recursion_band, solve_recursion
from sksurrogate.kernels.record import Record
from sksurrogate.physics import ODESimulator
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._simulator import describe

RUNS, N, DT, NOISE = 4, 250, 0.5, 0.01


def slow(t, x, u, p):
    """Nearly an integrator: a small force adds up."""
    return (u[0] - p["loss"] * x[0],)


def simulator(law=slow):
    return ODESimulator(law, states=["level"], inputs=["flow"], outputs=["level"], params={"loss": 0.01}, dt=DT)


def problem_of(true=slow, seed=0, free=()):
    rng = np.random.default_rng(seed)
    U = [np.repeat(rng.uniform(-1, 1, N // 10), 10)[:, None] for _ in range(RUNS)]
    Y = [simulator(true).simulate(u, x0=np.zeros(1)).reshape(N, 1) for u in U]
    Y = [y + NOISE * rng.normal(size=y.shape) for y in Y]
    plant = describe(simulator(), n_inputs=1, n_outputs=1, dt=DT)
    record = Record.from_runs(U, Y, [DT * np.arange(N)] * RUNS, DT)
    return build_problem(PlantModel(plant), record, free, ("level",))


def test_a_quiet_force_moves_no_output_by_more_than_its_share_of_the_noise():
    problem, smoothed = problem_of()
    null = problem.fit((), np.zeros(0), smoothed.x)
    D, starts = null.disturbance, problem.record.starts
    rng, a = np.random.default_rng(1), np.exp(-0.1)
    w = first_order_scan(a, np.sqrt(1 - a * a) * rng.normal(size=problem.record.n_samples), starts)
    b = np.zeros((1, 1, problem.record.n_samples))
    b[0, 0, 1:] = DT * problem.quiet_force()[0] * w[:-1]
    b[:, :, starts] = 0.0
    moved = solve_recursion(recursion_band(np.ascontiguousarray(D.A.transpose(1, 2, 0)), starts), b)
    assert 0.1 * QUIET_OUTPUT * NOISE < np.std(moved) < 2.0 * QUIET_OUTPUT * NOISE


def test_white_noise_of_a_slow_plant_is_called_white():
    problem, smoothed = problem_of()
    null = estimate_noise(problem.fit((), np.zeros(0), smoothed.x), problem.first_noise())
    assert null.noise.sigma[0] == pytest.approx(NOISE, rel=0.05)
    assert null.noise.force[0] < 3.0 * problem.quiet_force()[0]


def test_steps_of_an_effect_are_held_within_its_size_and_those_of_free_parameters_are_not():
    problem, smoothed = problem_of(free=("loss",))
    effect = CATALOGUE["constant_bias"]("level")
    candidate = problem.fit((effect,), np.array([0.02, 0.0]), smoothed.x)
    _, _, precision, pull = candidate.columns()
    prior, _ = candidate.step_prior
    assert precision[0] == pytest.approx((REACH * candidate.fit.theta[0]) ** -2)
    assert precision[1] == pytest.approx(prior[1])
    assert pull[0] == 0.0


def test_the_noise_is_reached_by_the_residual_and_not_by_a_noise_that_grew():
    problem, smoothed = problem_of()
    null = estimate_noise(problem.fit((), np.zeros(0), smoothed.x), problem.first_noise())
    worse = replace(null.candidate, fit=replace(null.fit, cost=1.1 * null.fit.cost))
    assert arrived(null, worse)
    assert not arrived(null, null.candidate)
    assert not arrived(None, worse)


def test_starts_of_an_effect_that_jumps_lie_apart():
    effect = CATALOGUE["input_quantization"]("flow")

    def start(step, evident=False):
        return Start(effect, np.array([step]), 0.0, 0.0, 0.0, np.zeros((1, 1)), evident)

    group = [start(1.0), start(1.0 + 0.5 * APART), start(1.0 + 2 * APART), start(0.5), start(0.25)]
    assert [one.theta[0] for one in apart(group, 3)] == [1.0, 1.0 + 2 * APART, 0.5]
    assert len(apart([start(1.0, True), start(1.001, True)], 3)) == 2
