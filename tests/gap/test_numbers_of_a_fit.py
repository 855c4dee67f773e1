"""Numbers that a fit hands on, against closed forms: the error of its integration, parameters of some runs alone, a sensor's signal."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import brentq

from sksurrogate.effects import CATALOGUE
from sksurrogate.gap.decide import _intervals
from sksurrogate.gap.fit._build import build_problem, build_trajectory
from sksurrogate.gap.fit._ode import Numerics
from sksurrogate.gap.unnamed._channel import fit_signal
from sksurrogate.kernels.record import Record
from sksurrogate.physics import CallableSimulator, ODESimulator
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._simulator import describe

NAMES = {"inputs": ["u"], "params": {"k": 1.0}, "dt": 1.0}


def record_of(U, Y, dt=1.0):
    return Record.from_runs(list(U), list(Y), [dt * np.arange(len(u)) for u in U], dt)


def test_the_error_of_the_integration_is_that_of_its_steps():
    # x' = -k x. A step of Runge and Kutta multiplies by R(k dt), where e^(-k dt) is right: which k makes both equal is known.
    plant = describe(
        ODESimulator(lambda t, x, u, p: (-p["k"] * x[0] + 0 * u[0],), states=["x"], outputs=["x"], **NAMES)
    )
    t, rng = np.arange(8.0), np.random.default_rng(0)
    Y = [(x0 * np.exp(-1.2 * t))[:, None] * (1 + 1e-7 * rng.normal(size=(8, 1))) for x0 in (1.0, 2.0)]
    problem, smoothed = build_problem(PlantModel(plant), record_of([np.zeros((8, 1))] * 2, Y), (), ("x",))
    problem = problem.at(Numerics(1, 50.0))
    candidate = problem.fit((CATALOGUE["parameter_error"]("k"),), np.zeros(1), smoothed.x)

    def fitted(n):
        """The rate whose decay in n steps is that of 1.2."""
        return brentq(
            lambda z: (1 - z / n + (z / n) ** 2 / 2 - (z / n) ** 3 / 6 + (z / n) ** 4 / 24) ** n - np.exp(-1.2),
            0.5,
            1.5,
        )

    assert candidate.fit.theta[0] == pytest.approx(fitted(1) - 1.0, abs=1e-4)
    assert candidate.numerical_change()[0] == pytest.approx(abs(fitted(2) - fitted(1)), rel=0.02)


@pytest.mark.parametrize("numerical", [0.0, 0.3])
def test_an_interval_holds_noise_and_integration_at_right_angles(numerical, monkeypatch):
    candidate = SimpleNamespace(
        effects=(),
        slice_of=None,
        signals={},
        fit=SimpleNamespace(theta=np.array([2.0])),
        numerical_change=lambda: np.array([numerical]),
        problem=SimpleNamespace(bounds=lambda effects: (np.array([-9.0]), np.array([9.0]))),
    )
    found = SimpleNamespace(candidate=candidate, fit=candidate.fit)
    monkeypatch.setattr(_intervals, "covariance", lambda found: np.array([[0.04]]))
    low, high = _intervals.intervals(found)
    half = np.sqrt((1.6449 * 0.2) ** 2 + numerical**2 + 1e-3**2)
    np.testing.assert_allclose([low[0], high[0]], [2.0 - half, 2.0 + half], rtol=1e-4)


def test_the_interval_of_a_power_law_does_not_widen_with_what_another_parameter_does_not_show(monkeypatch):
    """The logarithm of its coefficient at 10^5 has the error 0.1; a second effect cannot be seen at all."""
    effects, size = (CATALOGUE["power_law"]("p", "p"), CATALOGUE["linear_loss"]("p", "p")), 1e5
    theta = np.array([2.0 * size**-1.5, 1.5, 0.3])
    gain = size**1.5
    # Of the gain c s^m and the exponent m, independent errors: then c moves with m along its valley.
    to_theta = np.array([[1 / gain, -theta[0] * np.log(size)], [0.0, 1.0]])
    known = np.full((3, 3), np.inf)
    known[:2, :2] = to_theta @ np.diag([0.2**2, 0.05**2]) @ to_theta.T
    candidate = SimpleNamespace(
        effects=effects,
        slice_of=[slice(0, 2), slice(2, 3)].__getitem__,
        signals={"p": np.full(3, size)},
        fit=SimpleNamespace(theta=theta),
        numerical_change=lambda: np.zeros(3),
        problem=SimpleNamespace(bounds=lambda effects: (np.full(3, -9.0), np.full(3, 9.0))),
    )
    found = SimpleNamespace(candidate=candidate, fit=candidate.fit)
    monkeypatch.setattr(_intervals, "covariance", lambda found: known)
    low, high = _intervals.intervals(found)
    log_error = 1.6449 * np.hypot(0.1, 0.05 * np.log(size))
    np.testing.assert_allclose(np.log([low[0], high[0]] / theta[0]), [-log_error, log_error], rtol=1e-3)
    assert [low[2], high[2]] == [-9.0, 9.0]


def test_one_step_leads_to_what_some_of_the_runs_say_where_outputs_are_linear_in_the_parameters():
    """x' = 1.3 u with a drift of the first run: without it the step ends where a fit of the others does."""
    plant = describe(ODESimulator(lambda t, x, u, p: (p["k"] * u[0],), states=["x"], outputs=["x"], **NAMES))
    rng = np.random.default_rng(0)
    U = rng.uniform(-1.0, 1.0, (3, 20, 1))
    Y = [np.cumsum(np.r_[2.0, 1.3 * u[:-1, 0]])[:, None] + 0.01 * rng.normal(size=(20, 1)) for u in U]
    Y[0] += 0.05 * np.arange(20)[:, None]
    problem, smoothed = build_problem(PlantModel(plant), record_of(U, Y), (), ("x",))
    effects = (CATALOGUE["parameter_error"]("k"),)
    candidate = problem.fit(effects, np.zeros(1), smoothed.x)
    some, rows = problem.on([1, 2]), problem.record.run_of_row > 0
    theta, x = candidate.without_rows(some, rows)
    others = some.fit(effects, np.zeros(1), smoothed.x[:, rows])
    assert abs(candidate.fit.theta[0] - others.fit.theta[0]) > 1e-3
    assert theta[0] == pytest.approx(others.fit.theta[0], abs=1e-6)
    starts = some.record.starts
    np.testing.assert_allclose(x[:, starts], others.fit.x[:, starts], atol=1e-6)


@pytest.mark.parametrize("effect", [CATALOGUE["sensor_gain"]("y"), CATALOGUE["sensor_bias"]("y")])
def test_a_run_left_out_is_simulated_with_what_the_others_say(effect):
    plant = describe(CallableSimulator(lambda U, p: p["k"] * U, outputs=["y"], **NAMES))
    rng = np.random.default_rng(0)
    U = rng.uniform(1.0, 2.0, (2, 60, 1))
    gain = effect.name == "sensor_gain"
    Y = [1.3 * U[0] if gain else U[0] + 0.3, U[1]]  # the first run says 0.3, the second nothing
    record = record_of(U, [y + 1e-6 * rng.normal(size=y.shape) for y in Y])
    problem = build_trajectory(plant, record, (), [0, 1])
    candidate = problem.fit((effect,), np.array([0.1]))
    assert 0.05 < candidate.fit.theta[0] < 0.25
    one, other = (candidate.left_out(record, np.array([train]), np.array([1 - train]))[0] for train in (0, 1))
    np.testing.assert_allclose(one, 1.3 * U[1, :, 0] if gain else U[1, :, 0] + 0.3, atol=1e-3)
    np.testing.assert_allclose(other, U[0, :, 0], atol=1e-3)


def two_states_and_a_slow_signal(n=400):
    """A plant, its generator of numbers, inputs, a signal of deviation 0.6 that is correlated over ten samples, and the sensors' noise."""
    plant = describe(
        ODESimulator(lambda t, x, u, p: (u[0] - p["k"] * x[0], x[0] - x[1]), states=["x", "z"], outputs=["x", "z"], **NAMES)
    )  # fmt: skip
    rng = np.random.default_rng(3)
    U = np.repeat(rng.uniform(-1, 1, n // 10), 10)[:, None]
    slow = np.zeros(n)
    for k in range(1, n):
        slow[k] = np.exp(-0.1) * slow[k - 1] + 0.6 * np.sqrt(1 - np.exp(-0.2)) * rng.normal()
    return plant, rng, U, slow, np.array([0.05, 0.05])


@pytest.mark.parametrize("sensor", [0, 1])
def test_a_free_signal_at_a_sensor_is_its_own(sensor):
    plant, rng, U, slow, sd = two_states_and_a_slow_signal()
    Y = plant.simulator.simulate(U) + sd * rng.normal(size=(len(U), 2))
    Y[:, sensor] += slow
    problem, _ = build_problem(PlantModel(plant), record_of([U], [Y]), (), ("x", "z"))
    null = problem.fit((), np.zeros(0), problem.run)
    D = null.disturbance.with_forces(null.disturbance.B.transpose(1, 2, 0)[:, :1])
    spread, found = np.std(Y, axis=0), []
    for one in (0, 1):
        found.append(fit_signal(D, null.residual, sd, spread, 1.0, one))
    values = [value for _, value, _ in found]
    assert values[sensor] > values[1 - sensor] + 100.0
    noise = found[sensor][0]
    assert noise.coloured[sensor] == pytest.approx(0.6, rel=0.3)
    assert noise.coloured[1 - sensor] == pytest.approx(1e-2 * sd[0])  # the signal is at one place
    assert noise.sigma[1 - sensor] == pytest.approx(0.05, rel=0.15)


def test_a_free_signal_in_a_balance_is_a_force_and_no_noise_of_a_sensor():
    plant, rng, U, slow, sd = two_states_and_a_slow_signal()
    Y = plant.simulator.simulate(U + slow[:, None]) + sd * rng.normal(size=(len(U), 2))
    problem, _ = build_problem(PlantModel(plant), record_of([U], [Y]), (), ("x", "z"))
    null = problem.fit((), np.zeros(0), problem.run)
    D = null.disturbance.with_forces(null.disturbance.B.transpose(1, 2, 0)[:, :1])
    noise, value, _ = fit_signal(D, null.residual, sd, np.std(Y, axis=0), 1.0, None)
    assert value > max(fit_signal(D, null.residual, sd, np.std(Y, axis=0), 1.0, one)[1] for one in (0, 1)) + 100.0
    assert noise.force[0] == pytest.approx(0.6, rel=0.3)
    np.testing.assert_allclose(noise.coloured, 1e-2 * sd, rtol=1e-9)
    assert noise.sigma[1] == pytest.approx(
        0.05, rel=0.3
    )  # ten steps do not tell all of the white noise at x from the force
