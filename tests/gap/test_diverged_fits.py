"""Fits that diverge: open steps to a free run far from the data are taken back, held-out runs behind a limit too, and a run that
Newton cannot close is looped."""

import numpy as np
import pytest

from sksurrogate.blind import draw
from sksurrogate.effects import CATALOGUE
from sksurrogate.gap import GapDiagnoser
from sksurrogate.gap.decide._held_out import held_out, without_names
from sksurrogate.gap.fit._build import build_problem
from sksurrogate.gap.search._fit_from_starts import fit_last
from sksurrogate.kernels import free_runs
from sksurrogate.kernels.record import Record
from sksurrogate.physics import ODESimulator
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._simulator import describe

DT, N, RUNS, LIMIT = 0.02, 400, 3, 6.3


def spring(t, x, u, p):
    return x[1], u[0] - p["stiffness"] * x[0] - p["damping"] * x[1]


def limited(u):
    """The input, following its command at LIMIT per unit of time at most."""
    out = u.copy()
    for k in range(1, len(u)):
        out[k] = out[k - 1] + np.clip(u[k] - out[k - 1], -LIMIT * DT, LIMIT * DT)
    return out


@pytest.fixture(scope="module", params=[0.1, 0.5])
def problem(request):
    plant = ODESimulator(
        spring, dt=DT, states=["place", "speed"], inputs=["force"], outputs=["place", "speed"],
        params={"stiffness": 4.0, "damping": request.param},
    )  # fmt: skip
    rng = np.random.default_rng(0)
    U = [(rng.uniform(1.0, 2.0) * np.sin(6.0 * DT * np.arange(N) + rng.uniform(0, 6.3)))[:, None] for _ in range(RUNS)]
    Y = [plant.simulate(limited(u)) for u in U]
    Y = [y + 0.005 * y.std(axis=0) * rng.normal(size=y.shape) for y in Y]
    described = describe(plant, n_inputs=1, n_outputs=2, dt=DT)
    record = Record.from_runs(U, Y, [DT * np.arange(N)] * RUNS, DT)
    return build_problem(PlantModel(described), record, (), ("place", "speed"))


@pytest.mark.parametrize("factor", [1.2, 1.5, 2.0])
def test_a_limited_rate_is_found_from_above(problem, factor):
    problem, smoothed = problem
    null = problem.fit((), np.zeros(0), smoothed.x)
    effect = CATALOGUE["rate_limit"]("force")
    found = fit_last(problem, (effect,), np.array([factor * LIMIT]), smoothed.x, null.fit, null.fit.cost)
    # The recorded staircase of the input lags the sine by half a sample; the limit of the smooth sine is a little larger.
    assert found.fit.theta[0] == pytest.approx(LIMIT, rel=0.05)
    assert found.fit.cost < 0.02 * null.fit.cost


@pytest.mark.slow
def test_the_time_of_a_jump_stays_within_the_runs():
    case = draw("effect", 13087388302232808345)  # the rate of a reactor jumps at 6.67
    question, (truth,) = case.question, case.truths
    diagnoser = GapDiagnoser(question.simulator, effects=["parameter_step"], n_jobs=1, random_state=0)
    (found,) = diagnoser.fit(question.X, question.y, groups=question.groups).report_.effects
    assert (found.name, found.location) == (truth.name, truth.location) == ("parameter_step", "second")
    assert found.params["time"] == pytest.approx(truth.params["time"], abs=0.05)


def cell(t, x, u, p):
    return -u[0] / p["capacity"], u[0] / 600.0 - x[1] / 12.0, u[0] / 4000.0 - x[2] / 120.0


def voltage(t, x, u, p):
    return (3.4 + 0.6 * x[0] + 0.12 * np.tanh(6.0 * (x[0] - 0.5)) - 0.03 * u[0] - x[1] - x[2],)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(8))
def test_a_run_that_begins_behind_the_limit_of_its_sensor_is_judged_from_the_trajectory_of_another_candidate(seed):
    """A battery whose voltmeter stands at its limit at first: no reading shows where its three states began."""
    states = ["charge", "fast", "slow"]
    common = {"dt": 2.0, "states": states, "inputs": ["load"], "x0": [0.8, 0.0, 0.0], "params": {"capacity": 2500.0}}
    plant = ODESimulator(cell, output=voltage, outputs=["voltage"], **common)
    rng, limit, noise = np.random.default_rng(seed), 3.69, 0.002
    U = [np.repeat(rng.uniform(-1.0, 4.0, 15), 20)[:, None] for _ in range(4)]
    truth = [np.minimum(plant.simulate(u), limit) for u in U]
    Y = [y + noise * rng.normal(size=y.shape) for y in truth]
    described = describe(plant, n_inputs=1, n_outputs=1, dt=2.0)
    record = Record.from_runs(U, Y, [2.0 * np.arange(300)] * 4, 2.0)
    problem, smoothed = build_problem(PlantModel(described), record, (), states)
    x = np.concatenate([ODESimulator(cell, outputs=states, **common).simulate(u) for u in U]).T
    candidate = problem.fit((CATALOGUE["sensor_saturation"]("voltage"),), np.array([limit]), x)
    assert candidate.fit.cost < 1.5 * record.y.size
    assert np.max(np.abs(candidate.fit.x[:, record.starts])) < 5.0, "what no reading shows stays near"
    held = held_out([candidate] * 4, without_names(problem.fit((), np.zeros(0), smoothed.x)))
    assert np.sqrt(np.mean((held.after - np.concatenate(truth).T) ** 2)) < 0.5 * noise


@pytest.mark.parametrize("limit", [None, 0.3])
def test_a_run_near_a_trajectory_is_the_run_by_a_loop_over_time(problem, monkeypatch, limit):
    problem, _ = problem
    model = problem.augmented(() if limit is None else (CATALOGUE["state_saturation"]("place"),))
    theta, loop, loops = np.array([] if limit is None else [limit]), free_runs.free_run, []
    monkeypatch.setattr(free_runs, "free_run", lambda *args: loops.append(1) or loop(*args))
    with np.errstate(all="ignore"):
        run = free_runs.run_near(model, theta, problem.run)
        wanted = loop(model, theta, problem.run[:, problem.record.starts])
    np.testing.assert_allclose(run, wanted, rtol=0, atol=1e-9 * model.scale.max())
    assert limit is not None or not loops, "where nothing is cut off Newton needs no loop"
