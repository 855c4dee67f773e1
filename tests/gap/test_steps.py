"""Quantizers are named and their step is found: fine steps of an input, a coarse sensor beside a coloured force."""

import numpy as np
import pytest

from sksurrogate.effects import CATALOGUE
from sksurrogate.gap import GapDiagnoser
from sksurrogate.gap.fit._build import build_problem
from sksurrogate.gap.fit._evidence import estimate_noise, judged_under
from sksurrogate.gap.search._restart import better_values
from sksurrogate.kernels.record import Record
from sksurrogate.physics import ODESimulator
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._simulator import describe

DT, N, RUNS = 0.1, 300, 4


def levels(t, x, u, p):
    return u[0] - p["drain"] * x[0], p["drain"] * x[0] - p["out"] * x[1] * abs(x[1]) ** 0.5


@pytest.fixture
def plant():
    return ODESimulator(
        levels, dt=DT, x0=[1.0, 1.0], states=["first", "second"], inputs=["flow"], outputs=["first", "second"],
        params={"drain": 0.8, "out": 0.5},
    )  # fmt: skip


def recorded(plant, rng, act=lambda u: u, read=lambda y: y, force=0.0):
    """Runs with smooth inputs, a force in the first balance (of about 1 % where it is asked for), sensor noise of 0.5 %."""
    t, U, Y = DT * np.arange(N), [], []
    for _ in range(RUNS):
        w, phase = rng.uniform(0.1, 1.2, 5), rng.uniform(0, 6.3, 5)
        u = 2.0 + 0.35 * np.sin(np.outer(t, w) + phase).sum(axis=1)
        shaken = np.zeros(N)
        for k in range(1, N):
            shaken[k] = 0.9 * shaken[k - 1] + force * rng.normal()
        y = read(plant.simulate((act(u) + shaken)[:, None]))
        U.append(u[:, None])
        Y.append(y + 0.005 * y.std(axis=0) * rng.normal(size=y.shape))
    return np.concatenate(U), np.concatenate(Y), np.repeat(np.arange(RUNS), N)


def problem_of(plant, data):
    X, y, groups = data
    runs = [groups == k for k in range(RUNS)]
    record = Record.from_runs([X[k] for k in runs], [y[k] for k in runs], [DT * np.arange(N)] * RUNS, DT)
    described = describe(plant, n_inputs=1, n_outputs=2, dt=DT)
    return build_problem(PlantModel(described), record, (), ("first", "second"))


def named(plant, data):
    X, y, groups = data
    report = GapDiagnoser(plant, random_state=0).fit(X, y, groups=groups).report_
    assert report.verdict == "explained", report.sentence
    return report.effects


def test_an_input_in_many_steps_is_named_with_its_step(plant):
    step = 0.113
    (effect,) = named(plant, recorded(plant, np.random.default_rng(5), act=lambda u: step * np.round(u / step)))
    assert (effect.name, effect.location) == ("input_quantization", "flow")
    assert effect.params["step"] == pytest.approx(step, rel=2e-3)


def test_a_coarse_sensor_beside_a_coloured_force_is_named_alone(plant):
    step = np.array([0.31, 1e-9])
    read = {"read": lambda y: step * np.round(y / step), "force": 0.003}
    (effect,) = named(plant, recorded(plant, np.random.default_rng(6), **read))
    assert (effect.name, effect.location) == ("sensor_quantization", "first")
    assert effect.params["step"] == pytest.approx(0.31, rel=2e-3)


def test_a_step_far_below_the_noise_earns_nothing(plant):
    """A prediction that jumps with its parameter has no slope: the likelihood may not follow one."""
    problem, smoothed = problem_of(plant, recorded(plant, np.random.default_rng(7)))
    null = problem.fit((), np.zeros(0), smoothed.x)
    null = estimate_noise(null, problem.first_noise())
    effects = (CATALOGUE["input_quantization"]("flow"),)
    candidate = problem.candidate(effects, null.fit)
    for step in np.geomspace(1e-6, 5e-6, 25):
        one = candidate.frozen(np.array([step]))
        assert judged_under(one, [null.noise]).log_likelihood < null.log_likelihood + 0.3


def test_a_step_larger_than_every_input_is_found(plant):
    """Inputs up to 4.9 in steps of 6: nothing below 3, 6 above; the drain is off by 7 % and free."""
    rng = np.random.default_rng(3)
    U = np.repeat(rng.uniform(0.5, 4.9, (RUNS, N // 30)), 30, axis=1)
    Y = plant.simulate_batch(6.0 * np.round(U / 6.0)[:, :, None])
    Y = Y + 0.01 * Y.std() * rng.normal(size=Y.shape)
    off = plant.set_params(params={"drain": 0.86, "out": 0.5})
    found = (
        GapDiagnoser(off, free_params="all", random_state=0)
        .fit(U.reshape(-1, 1), Y.reshape(-1, 2), groups=np.repeat(np.arange(RUNS), N))
        .report_
    )
    assert [e.name for e in found.effects] == ["input_quantization"]
    assert found.effects[0].params["step"] == pytest.approx(6.0, rel=0.02)


def test_values_nearby_are_ranked_as_their_own_free_runs_rank_them(plant):
    """All at once and to first order; every value's own free run with fitted initial states is the oracle."""
    data = recorded(plant, np.random.default_rng(5), act=lambda u: 0.31 * np.round(u / 0.31))
    problem, smoothed = problem_of(plant, data)
    effects = (CATALOGUE["input_quantization"]("flow"),)
    start = problem.candidate(effects, problem.fit((), np.zeros(0), smoothed.x).fit)
    off = start.frozen(np.array([0.31 * 1.0105]))
    steps = [step for (step,) in effects[0].scan((float(off.fit.theta[0]),))]
    cost = {step: off.frozen(np.array([step])).fit.cost for step in steps}
    best = [float(theta[0]) for theta in better_values(off)]
    assert best == sorted(cost, key=lambda step: cost[step])[: len(best)]
    assert best[0] == pytest.approx(0.31, rel=0.005)
    assert better_values(off.frozen(np.array([0.31]))) == []
    beside = *effects, CATALOGUE["input_bias"]("flow")
    first = problem.candidate(beside, off.fit).frozen(np.array([*off.fit.theta, 0.0]))
    assert better_values(first, 0)[0][0] == pytest.approx(0.31, rel=0.005)
    assert better_values(first) == []  # a bias has no steps
