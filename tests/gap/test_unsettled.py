"""A slow actuator or sensor that is in motion where the runs begin: a lag from a start that the fit finds."""

import numpy as np
import pytest
from scipy.linalg import expm

from sksurrogate.effects import CATALOGUE
from sksurrogate.effects._followers import InputLag
from sksurrogate.effects._model import AugmentedModel
from sksurrogate.effects._sensor import SensorLag
from sksurrogate.effects._unsettled import UnsettledInputLag, UnsettledSensorLag
from sksurrogate.gap import GapDiagnoser
from sksurrogate.gap.render._code import code_of
from sksurrogate.kernels.free_runs import free_run
from sksurrogate.kernels.record import Record
from sksurrogate.physics import ODESimulator
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._simulator import describe

RUNS, N, DT = 3, 200, 0.05
DRAG, GAIN, LAG = 0.5, 2.0, 0.2
PLANT = ODESimulator(
    lambda t, x, u, p: (p["gain"] * u[0] - DRAG * x[0],),
    states=["speed"], inputs=["throttle"], outputs=["speed"], params={"gain": GAIN}, dt=DT,
)  # fmt: skip


def exact(inputs, w):
    """Speed and actuator as one linear system, stepped by the exponential of its matrix; the actuator begins at ``w``."""
    A = np.array([[-DRAG, GAIN, 0.0], [0.0, -1.0 / LAG, 1.0 / LAG], [0.0, 0.0, 0.0]])
    step, x, out = expm(DT * A), np.array([0.0, w]), []
    for u in inputs:
        out.append(x[0])
        x = (step @ [*x, u])[:2]
    return np.array(out)


@pytest.fixture(scope="module")
def inputs():
    return np.repeat(np.random.default_rng(0).normal(size=(RUNS, N // 10)), 10, axis=1)


@pytest.mark.parametrize("away", [0.0, 3.0])
def test_the_lag_with_a_state_of_its_own_converges_to_the_linear_system(inputs, away):
    """Of fourth order in the substep; from the first value of the input it is the lag whose start is known."""
    runs, errors = [u[:, None] for u in inputs], []
    y = np.concatenate([exact(u, u[0] + away) for u in inputs])
    record = Record.from_runs(runs, [y[k * N : (k + 1) * N, None] for k in range(RUNS)], [DT * np.arange(N)] * RUNS, DT)
    x0 = np.array([np.zeros(RUNS), inputs[:, 0] + away])
    for n_sub in (1, 2):
        model = AugmentedModel(
            PlantModel(describe(PLANT)), [UnsettledInputLag("throttle")], (), record, n_sub=n_sub, scale=np.ones(1)
        )
        assert model.free_states.tolist() == [True, True]
        errors.append(np.max(np.abs(free_run(model, np.array([LAG]), x0)[0] - y)))
    assert errors[1] < 1e-4 and errors[0] > 8.0 * errors[1]
    if not away:
        known = AugmentedModel(
            PlantModel(describe(PLANT)), [InputLag("throttle")], (), record, n_sub=2, scale=np.ones(1)
        )
        np.testing.assert_allclose(free_run(known, np.array([LAG]), x0[:1])[0], y, atol=1e-4)


@pytest.mark.parametrize("away", [0.0, 1.5], ids=["at rest", "in motion"])
def test_the_lag_of_an_actuator_in_motion_is_named(inputs, away):
    """Until now its start had no place but in a relaxation that the input drives, with a magnitude beside the time constant."""
    starts = inputs[:, 0] + away * np.array([1.0, -1.0, 0.7])
    y = np.concatenate([exact(u, w) for u, w in zip(inputs, starts)])
    y += 0.01 * np.random.default_rng(1).normal(size=len(y))
    wanted = ["input_lag", "input_delay", "hidden_relaxation", "hidden_mode", "sensor_lag", "linear_loss", "input_gain"]
    diagnoser = GapDiagnoser(PLANT, effects=[CATALOGUE[name] for name in wanted], free_params=[], n_jobs=1)
    report = diagnoser.fit(np.ravel(inputs)[:, None], y, groups=np.repeat(np.arange(RUNS), N)).report_
    (found,) = report.effects
    assert (report.verdict, found.name, found.location, found.variable) == (
        "explained", "input_lag", "throttle", None,
    ), str(report)  # fmt: skip
    assert found.params["time_constant"] == pytest.approx(LAG, rel=0.05)
    low, high = found.intervals["time_constant"]
    assert low < LAG < high and found.settled is (away == 0.0)
    assert ("not at rest where the runs begin" in str(report)) is (away != 0.0)
    (effect,) = diagnoser.augmented_.effects
    assert isinstance(effect, InputLag)  # runs of the new simulator begin at rest
    assert "settled" not in code_of(report)


def test_a_user_who_rules_the_lag_out_rules_out_both(inputs):
    y = np.concatenate([exact(u, u[0] + 1.5) for u in inputs])
    diagnoser = GapDiagnoser(
        PLANT, effects=["input_lag", "input_delay"], exclude=["input_lag"], free_params=[], n_jobs=1
    )
    report = diagnoser.fit(np.ravel(inputs)[:, None], y, groups=np.repeat(np.arange(RUNS), N)).report_
    assert {row["name"] for row in report.ranking} <= {"input_delay"}


# ---- a sensor -----------------------------------------------------------------------------------------------------------
def exact_reading(inputs, speed, w):
    """Speed and a sensor behind it as one linear system; the sensor begins at ``w``."""
    A = np.array([[-DRAG, 0.0, GAIN], [1.0 / LAG, -1.0 / LAG, 0.0], [0.0, 0.0, 0.0]])
    step, x, out = expm(DT * A), np.array([speed, w]), []
    for u in inputs:
        out.append(x[1])
        x = (step @ [*x, u])[:2]
    return np.array(out)


#: What the plant did before a run: speeds that the sensor has not followed yet.
SPEEDS, READINGS = np.array([1.0, -2.0, 0.5]), np.array([2.5, -1.0, -1.5])


def test_the_state_of_a_sensor_converges_to_the_linear_system(inputs):
    y = np.concatenate([exact_reading(*given) for given in zip(inputs, SPEEDS, READINGS)])
    readings = [y[k * N : (k + 1) * N, None] for k in range(RUNS)]
    record, errors = Record.from_runs([u[:, None] for u in inputs], readings, [DT * np.arange(N)] * RUNS, DT), []
    for n_sub in (1, 2):
        model = AugmentedModel(
            PlantModel(describe(PLANT)), [UnsettledSensorLag("speed")], (), record, n_sub=n_sub, scale=np.ones(1)
        )
        assert model.free_states.tolist() == [True, True] and model.plain_outputs == (1,)
        states = free_run(model, np.array([LAG]), np.array([SPEEDS, READINGS]))
        errors.append(np.max(np.abs(states[1] - y)))
        shown = model.bind(np.array([[LAG]])).outputs(states[:, None])
        np.testing.assert_array_equal(shown[0, 0], states[1])
    assert errors[1] < 1e-4 and errors[0] > 8.0 * errors[1]


#: A drag that tells a lag before it from a lag behind it.
SQUARE = ODESimulator(
    lambda t, x, u, p: (p["gain"] * u[0] - DRAG * x[0] * np.abs(x[0]),),
    states=["speed"], inputs=["throttle"], outputs=["speed"], params={"gain": GAIN}, dt=DT,
)  # fmt: skip


@pytest.mark.parametrize("moves", [False, True], ids=["at rest", "in motion"])
def test_the_lag_of_a_sensor_in_motion_is_named(inputs, moves):
    """With a start at rest alone two false names took its place."""
    whole = ODESimulator(
        lambda t, x, u, p: (SQUARE.rhs(t, x[:1], u, SQUARE.params)[0], (x[0] - x[1]) / LAG),
        states=["speed", "shown"], inputs=["throttle"], outputs=["shown"], params={}, dt=DT,
    )  # fmt: skip
    starts = np.column_stack([SPEEDS, READINGS if moves else SPEEDS])
    y = np.concatenate([whole.simulate(u[:, None], x0=x0)[:, 0] for u, x0 in zip(inputs, starts)])
    y += 0.01 * np.random.default_rng(1).normal(size=len(y))
    wanted = [
        "input_lag",
        "input_delay",
        "hidden_relaxation",
        "sensor_lag",
        "sensor_delay",
        "linear_loss",
        "sensor_gain",
    ]
    diagnoser = GapDiagnoser(SQUARE, effects=[CATALOGUE[name] for name in wanted], free_params=[], n_jobs=1)
    report = diagnoser.fit(np.ravel(inputs)[:, None], y, groups=np.repeat(np.arange(RUNS), N)).report_
    (found,) = report.effects
    assert (report.verdict, found.name, found.location) == ("explained", "sensor_lag", "speed"), str(report)
    assert found.params["time_constant"] == pytest.approx(LAG, rel=0.05)
    assert found.settled is not moves
    (effect,) = diagnoser.augmented_.effects
    assert isinstance(effect, SensorLag)
