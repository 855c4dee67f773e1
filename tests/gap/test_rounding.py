"""A grid of readings that nothing named explains is a missing quantizer, wherever its name is not known."""

from types import SimpleNamespace

import numpy as np
import pytest

from sksurrogate.effects._lattice import lattice_steps
from sksurrogate.effects._sensor import SensorQuantization
from sksurrogate.gap import GapDiagnoser
from sksurrogate.gap.fit._rounding import GRID_SHARE, is_rounded, names_steps, rounds_a_display, unnamed_rounding
from sksurrogate.kernels.record import Record
from sksurrogate.physics import ODESimulator
from sksurrogate.physics._simulator import describe


def tank():
    return ODESimulator(
        lambda t, x, u, p: [u[0] - p["k"] * x[0]],
        states=["level"],
        inputs=["flow"],
        outputs=["level"],
        params={"k": 1.0},
        dt=0.1,
    )


def experiment(step, noise, seed=0):
    rng = np.random.default_rng(seed)
    U = np.repeat(rng.uniform(0.5, 3.0, (6, 15)), 20, axis=1)
    Y = np.stack([tank().simulate(u[:, None])[:, 0] for u in U])
    Y = step * np.round(Y / step) if step else Y
    Y += noise * rng.normal(size=Y.shape)
    return U.reshape(-1, 1), Y.reshape(-1, 1), np.repeat(np.arange(6), 300)


def free_run(step, noise, effects=()):
    """A candidate whose free run is that of the true tank, beside readings in steps."""
    _, Y, _ = experiment(step, noise)
    true = experiment(0.0, 0.0)[1]
    record = Record.from_runs([np.zeros((len(Y), 0))], [Y], [np.arange(len(Y)) * 0.1], 0.1)
    problem = SimpleNamespace(plant=SimpleNamespace(outputs=("level",)), record=record)
    return SimpleNamespace(effects=effects, problem=problem, fit=SimpleNamespace(y=true.T))


@pytest.mark.parametrize("noise", [0.0, 0.01, 0.03])
def test_the_step_and_the_error_of_the_rounding_are_found(noise):
    candidate = free_run(0.3, noise)
    found = unnamed_rounding(candidate)
    assert found.sensor == "level"
    assert found.step == pytest.approx(0.3, rel=1e-3)
    assert found.share == pytest.approx(0.3 / 12**0.5 / candidate.problem.record.y.std(), rel=1e-3)


@pytest.mark.parametrize(("step", "noise"), [(0.0, 0.01), (0.3, 0.15)])
def test_smooth_readings_and_steps_below_the_noise_stand_on_no_grid(step, noise):
    assert unnamed_rounding(free_run(step, noise)) is None


@pytest.mark.parametrize(("step", "named", "shown"), [(0.3, 0.3, True), (0.3, 0.25, False), (0.0, 0.3, False)])
def test_a_rounding_is_seen_in_readings_that_stand_on_its_steps(step, named, shown):
    candidate = free_run(step, 0.01, effects=(SensorQuantization("level"),))
    candidate.theta_of = lambda i: np.array([named])
    assert names_steps(candidate) is shown


def test_a_slow_disturbance_that_shifts_the_free_run_hides_no_grid():
    candidate = free_run(0.3, 0.01)
    candidate.fit.y = candidate.fit.y + 0.03 * np.sin(np.arange(candidate.fit.y.shape[1]) / 40.0)
    assert unnamed_rounding(candidate).step == pytest.approx(0.3, rel=1e-3)


def test_a_grid_far_finer_than_what_is_left_is_not_what_is_missing():
    candidate = free_run(0.3, 0.01)
    candidate.fit.y = candidate.fit.y + 0.3 * np.sin(np.arange(candidate.fit.y.shape[1]) / 40.0)
    assert unnamed_rounding(candidate) is None


def test_a_named_quantizer_explains_its_grid():
    assert unnamed_rounding(free_run(0.3, 0.01, (SensorQuantization("level"),))) is None


def test_levels_of_an_input_are_no_grid_of_the_sensor():
    level = np.repeat([0.0, 1.0, 2.0, 3.0, 1.0], 100)
    y = level + 0.05 * np.random.default_rng(0).normal(size=500)
    assert lattice_steps(y)
    assert not is_rounded(y, level, lattice_steps(y)[0])


@pytest.mark.slow
def test_without_its_name_the_sensor_is_the_place_and_the_step_is_told():
    U, Y, runs = experiment(0.3, 0.02)
    report = GapDiagnoser(tank(), effects=["linear_loss", "sensor_gain"], random_state=0).fit(U, Y, groups=runs).report_
    assert report.verdict == "unknown"
    assert report.where.location == "level"
    assert any("steps of 0.3" in note for note in report.notes)


@pytest.mark.slow
def test_with_its_name_it_is_named():
    U, Y, runs = experiment(0.3, 0.02)
    effects = ["linear_loss", "sensor_gain", "sensor_quantization"]
    report = GapDiagnoser(tank(), effects=effects, random_state=0).fit(U, Y, groups=runs).report_
    assert report.verdict == "explained"
    assert [effect.name for effect in report.effects] == ["sensor_quantization"]


def test_a_fine_grid_is_what_every_converter_has():
    U, Y, runs = experiment(0.01, 0.002)
    report = GapDiagnoser(tank(), effects=["linear_loss", "sensor_gain"], random_state=0).fit(U, Y, groups=runs).report_
    assert report.verdict == "none"


@pytest.mark.slow
def test_the_fine_grid_of_a_display_is_no_cause_beside_a_loss():
    """Readings that a display gives in steps larger than their noise: the loss alone is named, and no rounding is tried unless asked for."""

    def lossy(step):
        rng = np.random.default_rng(1)
        U = np.repeat(rng.uniform(0.5, 3.0, (4, 10)), 20, axis=1)
        plant = tank().set_params(params={"k": 1.15})
        Y = np.stack([plant.simulate(u[:, None])[:, 0] for u in U])
        Y = step * np.round((Y + 0.2 * step * rng.normal(size=Y.shape)) / step)
        return U.reshape(-1, 1), Y.reshape(-1, 1), np.repeat(np.arange(4), 200)

    U, Y, runs = lossy(0.01)
    assert 0.01 / 12**0.5 / Y.std() < GRID_SHARE
    report = GapDiagnoser(tank(), random_state=0, n_jobs=1).fit(U, Y, groups=runs).report_
    assert report.verdict == "explained" and len(report.effects) == 1
    (effect,) = report.effects
    members = {(effect.name, effect.location), *(other[:2] for other in effect.equivalents)}
    assert {("linear_loss", "level"), ("parameter_error", "k")} & members
    assert "sensor_quantization" not in {row["name"] for row in report.ranking}
    plant = describe(tank(), n_inputs=1, n_outputs=1, dt=0.1)
    record = Record.from_runs([U], [Y], [0.1 * np.arange(len(U))], 0.1)
    assert rounds_a_display(SensorQuantization("level"), plant, record)
    coarse = Record.from_runs([U], [0.3 * np.round(Y / 0.3)], [0.1 * np.arange(len(U))], 0.1)
    assert not rounds_a_display(SensorQuantization("level"), plant, coarse)
