"""Functions that refuse a point, warn or raise: the point is lost, not the run of all others."""

import math
import multiprocessing
import sys
import warnings

import numpy as np
import pytest

from sksurrogate.exceptions import SimulationDiverged, SimulatorError
from sksurrogate.gap import GapDiagnoser
from sksurrogate.physics import CallableSimulator, ODESimulator, StepSimulator
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._simulator import describe

TANK = {"states": ["h"], "inputs": ["q"], "outputs": ["h"], "params": {"k": 1.0}, "dt": 0.1, "x0": [1.0]}


def strict(t, x, u, p):
    if np.any(np.asarray(x[0]) < 0):
        raise ValueError("the level is negative")
    return (u[0] - p["k"] * np.sqrt(x[0]),)


def by_point(t, x, u, p):
    assert np.isfinite(x).all() and np.isfinite(u).all(), "asked at what is not finite"
    return (float(u[0]) - p["k"] * math.sqrt(x[0]),)


def _rates(rhs, x, u):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        model = PlantModel(describe(ODESimulator(rhs, **TANK)))
        return model.derivative(0.0, x, u), model.refusal


@pytest.mark.parametrize("rhs", [strict, by_point])
def test_a_refused_point_is_nan_and_the_others_are_right(rhs):
    x, u = np.array([[1.0, 4.0, -1.0, 9.0]]), np.array([[0.5, 0.0, 0.0, 2.0]])
    found, said = _rates(rhs, x, u)
    np.testing.assert_array_equal(found, [[-0.5, -2.0, np.nan, -1.0]])
    assert "last raised ValueError" in said and "x=[-1.0]" in said


def test_a_point_that_is_not_finite_is_not_asked_of_a_function_of_single_points():
    found, said = _rates(by_point, np.array([[1.0, np.nan, np.inf, 1e300, 4.0]]), np.zeros((1, 5)))
    np.testing.assert_array_equal(found, [[-1.0, np.nan, np.nan, np.nan, -2.0]])
    assert not said


@pytest.mark.slow
@pytest.mark.parametrize("rhs", [strict, by_point])
def test_a_run_that_comes_to_a_refused_point_says_what_the_function_said(rhs):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        with pytest.raises(
            SimulationDiverged, match=r"became infinite or nan.*state 'h'.*rhs last raised ValueError: \w+"
        ):
            ODESimulator(rhs, **TANK).simulate(np.full((60, 1), -1.0))
        np.testing.assert_allclose(ODESimulator(rhs, **TANK).simulate(np.ones((20, 1))), 1.0, atol=1e-12)


def test_a_step_and_an_output_that_refuse_say_so():
    def step(t, x, u, p, dt):
        if np.any(np.asarray(x[0]) > 3):
            raise RuntimeError("overflow")
        return [x[0] + u[0]]

    plant = StepSimulator(step, **{**TANK, "params": {}})
    with pytest.raises(SimulationDiverged, match="step last raised RuntimeError: overflow"):
        plant.simulate(np.ones((6, 1)))

    def seen(t, x, u, p):
        if np.any(np.asarray(x[0]) > 2):
            raise ValueError("out of range")
        return [x[0]]

    plant = ODESimulator(lambda t, x, u, p: (u[0] + 0 * x[0],), **{**TANK, "outputs": ["gauge"], "output": seen})
    with pytest.raises(SimulationDiverged, match=r"'gauge'.*output last raised ValueError: out of range"):
        plant.simulate(np.ones((20, 1)))


def test_a_mistake_is_no_refusal():
    def wrong(t, x, u, p):
        return (u[0] - (nothing if np.any(np.asarray(x[0]) < 0.5) else 1.0) * x[0],)  # noqa: F821

    with pytest.raises((NameError, SimulatorError), match="name 'nothing' is not defined"), warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        ODESimulator(wrong, **TANK).simulate(np.zeros((40, 1)))


def test_a_diagnosis_goes_on_where_candidates_leave_what_the_function_takes():
    def wet(t, x, u, p):
        return (u[0] - p["k"] * np.sqrt(np.maximum(x[0], 0.0)) - 0.15,)

    random = np.random.default_rng(0)
    runs = [np.repeat(random.uniform(0.3, 1.6, (10, 1)), 10, axis=0) for _ in range(3)]
    y = np.concatenate([ODESimulator(wet, **TANK).simulate(u) for u in runs]) + 0.003 * random.normal(size=(300, 1))
    refused = []

    def narrow(t, x, u, p):
        if np.any(np.asarray(x[0]) < 0.97 * y.min()):
            refused.append(1)
            raise RuntimeError("below the table of the outflow")
        return strict(t, x, u, p)

    plant = ODESimulator(narrow, **TANK)
    asked = ["constant_bias", "linear_loss", "quadratic_loss", "input_gain", "sensor_bias"]
    report = GapDiagnoser(plant, effects=asked, n_jobs=1, random_state=0).fit(np.concatenate(runs), y, groups=np.repeat([0, 1, 2], 100)).report_  # fmt: skip
    assert refused and [e.name for e in report.effects] == ["constant_bias"]
    assert report.effects[0].params["value"] == pytest.approx(-0.15, abs=0.03)


def test_a_diagnosis_without_effects_of_inputs_asks_for_inputs_of_the_record_alone():
    random = np.random.default_rng(1)
    runs = [np.repeat(random.uniform(0.3, 1.6, (10, 1)), 10, axis=0) for _ in range(3)]
    U = np.concatenate(runs)

    def wet(t, x, u, p, missing=0.15):
        return (u[0] - p["k"] * np.sqrt(np.maximum(x[0], 1e-9)) - missing,)

    def narrow(t, x, u, p):
        if np.any(np.asarray(u[0]) < U.min() - 1e-12) or np.any(np.asarray(u[0]) > U.max() + 1e-12):
            raise KeyError("beyond the table of the valve")  # where it is asked first this ends a diagnosis
        return wet(t, x, u, p, 0.0)

    y = np.concatenate([ODESimulator(wet, **TANK).simulate(u) for u in runs]) + 0.003 * random.normal(size=(300, 1))
    asked = ["constant_bias", "linear_loss", "quadratic_loss", "sensor_bias"]
    diagnoser = GapDiagnoser(ODESimulator(narrow, **TANK), effects=asked, n_jobs=1, random_state=0)
    report = diagnoser.fit(U, y, groups=np.repeat([0, 1, 2], 100)).report_
    assert [e.name for e in report.effects] == ["constant_bias"]


def _silent(queue, function):
    with warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always")
        PlantModel(describe(ODESimulator(function, **TANK))).probe(np.ones(1))
    queue.put(len(heard))


@pytest.mark.skipif(sys.platform != "linux", reason="needs fork")
def test_a_slow_function_is_said_once_also_to_processes_that_follow():
    def slow(t, x, u, p):
        return (u[0].item() - math.sqrt(abs(x[0].item())),)

    with pytest.warns(UserWarning, match="point by point"):
        ODESimulator(slow, **TANK).simulate(np.ones((4, 1)))
    ODESimulator(slow, **TANK).simulate(np.ones((4, 1)))  # warnings are errors here
    fork = multiprocessing.get_context("fork")
    queue = fork.SimpleQueue()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of a fork beside threads of numerical libraries
        process = fork.Process(target=_silent, args=(queue, slow))
        process.start()
    process.join()
    assert queue.get() == 0


def test_a_function_of_whole_runs_that_stops_is_told_with_its_inputs():
    def closed(U, p):
        if np.any(U == 0):
            raise ValueError("u = 0 is refused")
        return p["gain"] / U

    plant = CallableSimulator(closed, inputs=["u"], outputs=["y"], params={"gain": 2.0})
    with pytest.raises(
        SimulationDiverged, match=r"stopped with ValueError: u = 0 is refused.*3 rows.*from \[0.0\] to \[2.0\]"
    ):
        plant.simulate([[1.0], [0.0], [2.0]])
    with pytest.raises(SimulatorError, match=r"U=\[nan\] in row 1"):
        plant.simulate([[1.0], [np.nan], [2.0]])
    with pytest.raises(KeyError):  # a mistake, shown as it is
        CallableSimulator(closed, inputs=["u"]).simulate([[1.0]])


def test_a_diagnosis_by_trajectories_goes_on_where_a_candidate_is_refused():
    random, refused = np.random.default_rng(0), []
    runs = [np.repeat(random.uniform(0.1, 1.0, (10, 1)), 8, axis=0) for _ in range(3)]
    highest = max(run.max() for run in runs)

    def narrow(U, p):
        if U.max() > highest:
            refused.append(1)
            raise ValueError("beyond the table of the valve")
        y = np.zeros(len(U))
        for k in range(len(U) - 1):
            y[k + 1] = y[k] + 0.1 * (np.log(U[k, 0]) * p["gain"] - y[k])
        return y

    plant = CallableSimulator(narrow, inputs=["u"], outputs=["y"], params={"gain": 1.0}, dt=0.1)
    y = np.concatenate([plant.simulate(run) for run in runs]) + 0.3 + 0.01 * random.normal(size=(240, 1))
    diagnoser = GapDiagnoser(plant, effects=["sensor_bias", "input_gain", "input_bias"], n_jobs=1, random_state=0)
    report = diagnoser.fit(np.concatenate(runs), y, groups=np.repeat([0, 1, 2], 80)).report_
    assert refused and [e.name for e in report.effects] == ["sensor_bias"]
    assert report.effects[0].params["value"] == pytest.approx(0.3, abs=0.01)


@pytest.mark.parametrize("X0", [[1.0], np.zeros((3, 2)), np.zeros((2, 3)), 1.0])
def test_initial_states_of_a_batch_have_one_row_for_each_run(X0):
    spring = ODESimulator(
        lambda t, x, u, p: (x[1], u[0] - x[0]), states=["q", "v"], inputs=["f"], outputs=["q"], params={}, dt=0.1
    )
    with pytest.raises(SimulatorError, match=r"X0 has shape .* expected \(2,\), or \(2, 2\)"):
        spring.simulate_batch(np.zeros((2, 5, 1)), X0)
