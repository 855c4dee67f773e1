"""A law that no name carries is seen along the free run, and a disturbance is not taken for one."""

import numpy as np
import pytest
from scipy.signal import lfilter

from sksurrogate.gap import GapDiagnoser
from sksurrogate.gap.fit._build import build_problem
from sksurrogate.gap.fit._evidence import estimate_noise
from sksurrogate.gap.unnamed._law_evidence import LawQuestion, law_beside
from sksurrogate.kernels.record import Record
from sksurrogate.physics import ODESimulator, StepSimulator
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._simulator import describe

DT, N, RUNS = 0.05, 300, 5


def body(law):
    """A spring with a law in the speed that the simulator may lack, pushed by ``u`` and by a disturbance ``w``."""

    def rhs(t, x, u, p):
        return x[1], u[0] + u[1] - p["k"] * x[0] - p["d"] * x[1] - law * np.tanh(20.0 * x[1])

    return ODESimulator(
        rhs, dt=DT, x0=[0.0, 0.0], states=["q", "v"], inputs=["u", "w"], outputs=["q"], params={"k": 4.0, "d": 0.5}
    )


def left_by_the_null(law, shaken, seed, push=0.0, lag=0, step=0.0):
    """The null and its problem: steps as inputs, a coloured force, sensor noise of 1 %.

    A force ``push`` that sets in halfway through each run; readings that are ``lag`` samples old; an input in a ``step``.
    """
    rng, held = np.random.default_rng(seed), 4 if step else 20
    U, Y = [], []
    for _ in range(RUNS):
        u, w = 2.0 * np.repeat(rng.uniform(-1, 1, N // held), held), np.zeros(N)
        for k in range(1, N):
            w[k] = 0.9 * w[k - 1] + shaken * rng.normal()
        acting = step * np.round(u / step) if step else u
        y = body(law).simulate(np.stack([acting, w + push * (np.arange(N) >= N // 2)], axis=1))
        y = y[np.maximum(np.arange(N) - lag, 0)]
        U.append(np.stack([u, np.zeros(N)], axis=1))
        Y.append(y + 0.01 * y.std(axis=0) * rng.normal(size=y.shape))
    record = Record.from_runs(U, Y, [DT * np.arange(N)] * RUNS, DT)
    plant = describe(body(0.0), n_inputs=2, n_outputs=1, dt=DT)
    problem, smoothed = build_problem(PlantModel(plant), record, (), ("v",))
    null = problem.fit((), np.zeros(0), smoothed.x)
    return problem, estimate_noise(null, problem.first_noise())


def law(found):
    """The likeliest law beside the null."""
    problem = found.candidate.problem
    return law_beside(LawQuestion(found.candidate, (found.noise, problem.quiet(found.noise))), gap(found), 0.1).left


def gap(found):
    """RMS of the gap over the noise."""
    return np.sqrt(max(found.fit.cost / found.candidate.problem.record.n_values - 1.0, 1e-6))


@pytest.mark.parametrize("seed", range(4))
def test_a_disturbance_is_no_curve_of_anything(seed):
    _problem, null = left_by_the_null(0.0, 0.05, seed)
    found = law(null)
    assert found.gain < 0.0 and found.probability < 0.1


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
def test_a_law_beside_a_disturbance_of_its_size_is_found_in_its_variable(seed):
    problem, null = left_by_the_null(0.08, 0.05, seed)
    found = law(null)
    assert found.gain > 20.0
    assert found.location == "v"
    assert found.variable in ("v", "q and its past")  # what q did of late tells v
    # What the law moves the free run by, simulated with and without it (parameters and initial states follow a little).
    U = problem.record.u[0].reshape(RUNS, N)
    runs = [[body(law).simulate(np.stack([u, 0 * u], axis=1)) for u in U] for law in (0.08, 0.0)]
    true = np.std(np.subtract(*runs)) / problem.sd[0]
    assert found.size * gap(null) == pytest.approx(true, rel=0.25)
    assert found.deviation == pytest.approx(true * problem.sd[0] / problem.record.spread[0], rel=0.25)


def test_without_noise_but_that_of_the_sensor_less_is_enough():
    _problem, null = left_by_the_null(0.02, 0.0, 0)
    assert law(null).gain > 20.0
    assert law(null).variable in ("v", "q and its past")


def test_a_force_that_sets_in_at_one_time_is_a_curve_of_time():
    _problem, null = left_by_the_null(0.0, 0.05, 0, push=0.4)
    found = law(null)
    assert found.gain > 20.0
    assert found.variable == "time" and found.location in ("v", "u")  # u pushes v alone


def test_a_sensor_that_reads_late_is_a_curve_of_its_own_past():
    _problem, null = left_by_the_null(0.0, 0.05, 0, lag=2)
    found = law(null)
    assert found.gain > 20.0
    assert found.variable in ("q and its past", "u and its past")  # late at either end of a linear plant is the same


def test_an_actuator_that_moves_in_steps_is_a_fine_curve_of_its_input():
    _problem, null = left_by_the_null(0.0, 0.0, 0, step=0.5)
    found = law(null)
    assert found.gain > 20.0
    assert (found.location, found.variable) == ("u", "u")


def test_one_factor_serves_all_blocks():
    _problem, null = left_by_the_null(0.08, 0.05, 0)
    D, rng = null.candidate.disturbance, np.random.default_rng(0)
    r, *blocks = (rng.normal(size=(1, k, RUNS * N)) for k in (2, 3, 1))
    for block, G in zip(blocks, D.grams_beside(r, null.noise)(blocks)):
        assert np.allclose(G, D.gram(np.concatenate([r, block], axis=1), null.noise)[0], rtol=1e-8, atol=1e-8)


@pytest.mark.slow
def test_a_law_of_measured_signals_that_only_tells_how_a_disturbance_goes_on_does_not_count():
    """A gas furnace, its noise of second order: along the measured path a law of the gas and of what it makes seems certain."""

    def furnace(delta):
        def step(t, x, u, p, dt):
            return [p["delta"] * x[0] - 0.53 * x[2] - 0.37 * x[3] - 0.51 * x[4], u[0], x[1], x[2], x[3]]

        return StepSimulator(
            step, states=["c", "u1", "u2", "u3", "u4"], inputs=["gas"], outputs=["co2"], output=lambda t, x, u, p: [x[0]],
            params={"delta": delta}, dt=1.0, x0=np.zeros(5),
        )  # fmt: skip

    rng = np.random.default_rng(0)
    gas, noise = (
        lfilter([1.0], [1.0, -a, -b], rng.normal(size=400))[100:, None] for a, b in ((1.85, -0.88), (1.53, -0.63))
    )
    y = furnace(0.57).simulate(gas / gas.std())
    y = y + 0.06 * y.std() * noise / noise.std()
    names = ["sensor_bias", "input_gain"]
    diagnoser = GapDiagnoser(furnace(0.547), effects=names, free_params=["delta"], random_state=0, n_jobs=1)
    report = diagnoser.fit(gas / gas.std(), y).report_
    assert report.verdict == "explained" and report.reasons.features["lawful"] < 0.1
    (named,) = report.effects
    assert (named.name, named.location) == ("parameter_error", "delta")
    assert 0.547 * (1.0 + named.params["relative_error"]) == pytest.approx(0.57, abs=0.01)
