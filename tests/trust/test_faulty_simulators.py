"""Simulators that raise, warn, return nan, print or are slow for some candidates: these candidates are lost, the diagnosis is not."""

import time
import warnings

import numpy as np
import pytest
from scipy.signal import cont2discrete, lfilter

from sksurrogate.gap import GapDiagnoser
from sksurrogate.gap._pipeline import DiagnosisPipeline
from sksurrogate.physics import CalibratedSimulator, CallableSimulator, ODESimulator, StepSimulator

DT, PARAMS = 0.1, {"k": 4.0, "c": 0.6}
NAMES = {"inputs": ["u"], "outputs": ["q"], "params": PARAMS, "dt": DT}
ASKED = ["input_gain", "input_bias", "sensor_gain", "parameter_error"]
U = np.concatenate([np.repeat(np.random.default_rng(k).uniform(-1, 1, 15), 8)[:, None] for k in range(3)])
RUNS = np.repeat([0, 1, 2], 120)
LOW, HIGH = U.min() - 1e-9, U.max() + 1e-9


class Odd(Exception):
    """No error that a numerical program would raise."""


class Fault:
    """What a simulator does at points that are not those of the record, while it is on."""

    def __init__(self, kind):
        self.kind, self.on, self.hits = kind, True, 0

    def __call__(self, bad):
        if not (self.on and np.any(bad)):
            return None
        self.hits += 1
        if self.kind == "raises":
            raise ValueError("the input is refused")
        if self.kind == "raises something odd":
            raise Odd("the input is refused")
        if self.kind == "has a mistake":
            return undefined_name  # noqa: F821
        if self.kind == "warns":
            warnings.warn(f"warning {self.hits}", RuntimeWarning, stacklevel=2)
        if self.kind == "prints":
            print("out of range")
        if self.kind == "is slow":
            time.sleep(1e-4)
        return {"gives nan": np.nan, "gives 1e200": 1e200}.get(self.kind)


KINDS = ["raises", "raises something odd", "gives nan", "gives 1e200", "warns", "prints", "is slow"]


def beyond(u):
    return (np.asarray(u) < LOW) | (np.asarray(u) > HIGH)


def right_hand_side(fault):  # a hardening spring: a gain of the input is no gain of the sensor
    def rhs(t, x, u, p):
        bad = beyond(u[0]) | (np.asarray(p["k"]) != PARAMS["k"])
        value, a = fault(bad), u[0] - p["k"] * x[0] * (1 + x[0] ** 2) - p["c"] * x[1]
        return x[1], a if value is None else np.where(bad, value, a)

    return ODESimulator(rhs, states=["q", "v"], **NAMES)


def step_function(fault):
    def step(t, x, u, p, dt):
        bad = beyond(u[0]) | (np.asarray(p["k"]) != PARAMS["k"])
        value, v = fault(bad), x[1] + dt * (u[0] - p["k"] * x[0] * (1 + x[0] ** 2) - p["c"] * x[1])
        return x[0] + dt * v, v if value is None else np.where(bad, value, v)

    return StepSimulator(step, states=["q", "v"], **NAMES)


def trajectories(fault):
    def whole_run(U, p):
        value = fault(beyond(U).any() or p["k"] != PARAMS["k"])
        num, den, _ = cont2discrete(([1.0], [1.0, p["c"], p["k"]]), DT)
        Y = lfilter(num.ravel(), den, U[:, 0])[:, None]
        Y[len(Y) // 2 :] = Y[len(Y) // 2 :] if value is None else value
        return Y

    return CallableSimulator(whole_run, **NAMES)


SIMULATORS = [right_hand_side, step_function, trajectories]


def measured(make):
    """Readings of a plant whose actuator gives 15 % less than the simulator's."""
    plant = make(Fault("none"))
    Y = np.concatenate([plant.simulate(0.85 * U[k == RUNS]) for k in range(3)])
    return Y + 2e-3 * np.random.default_rng(9).normal(size=Y.shape)


def diagnosed(make, fault, **options):
    diagnoser = GapDiagnoser(make(fault), effects=ASKED, n_jobs=1, random_state=0, **options)
    return diagnoser.fit(U, measured(make), groups=RUNS).report_


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("make", SIMULATORS)
def test_candidates_that_the_simulator_fails_for_are_lost_and_the_right_one_is_named(make, kind):
    fault = Fault(kind)
    with warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always")
        report = diagnosed(make, fault)
    assert [effect.name for effect in report.effects] == ["input_gain"] and fault.hits
    assert report.effects[0].params["relative_error"] == pytest.approx(-0.15, abs=0.02)
    assert [str(one.message) for one in heard] == (["warning 1"] if kind == "warns" else [])
    said = {
        "raises": "the input is refused",
        "gives nan": "outputs that are not finite" if make is trajectories else "nan]",
    }
    for one in [words for start, words in said.items() if kind.startswith(start)]:
        assert any("was left out" in note and one in note for note in report.notes)
    if kind in ("warns", "prints", "is slow"):
        assert not any("was left out: " in note for note in report.notes)


@pytest.mark.slow
@pytest.mark.parametrize("make", SIMULATORS)
def test_a_mistake_in_the_simulator_stands_in_the_sentence_for_the_right_effect_may_be_lost(make):
    report = diagnosed(make, Fault("has a mistake"))
    words = (
        "But the simulator has a mistake, and effects that needed this part of it could not be tried: NameError: name"
    )
    assert report.mistakes == ("NameError: name 'undefined_name' is not defined",)
    for text in (report.sentence, " ".join(str(report).split()), report.to_html()):
        assert words in text
    honest = diagnosed(make, Fault("raises"))  # a refusal of a point is none
    assert honest.mistakes == () and "mistake" not in honest.sentence


@pytest.mark.slow
@pytest.mark.parametrize(
    "stage",
    ["look_for_names", "find_equivalents", "leave_runs_out", "look_at_what_is_left", "share_the_gap", "suggest_an_experiment"],
)  # fmt: skip
@pytest.mark.parametrize(("make", "kind"), [(right_hand_side, "raises something odd"), (trajectories, "gives 1e200")])
def test_a_failure_that_begins_at_a_stage_ends_no_diagnosis(make, kind, stage, monkeypatch):
    fault, usual = Fault(kind), getattr(DiagnosisPipeline, stage)
    fault.on = False

    def within(pipeline):
        fault.on = True
        usual(pipeline)

    monkeypatch.setattr("sksurrogate.gap._pipeline.STAGES", _with_stage(usual, within))
    report = diagnosed(make, fault, free_params=["c"])
    assert [effect.name for effect in report.effects] == ["input_gain"]


def _with_stage(usual, within):
    from dataclasses import replace

    from sksurrogate.gap._pipeline import STAGES

    stages = tuple(replace(stage, ask=within) if stage.ask is usual else stage for stage in STAGES)
    assert stages != STAGES
    return stages


@pytest.mark.parametrize("kind", ["raises", "gives nan", "gives 1e200"])
@pytest.mark.parametrize("make", [right_hand_side, step_function])
def test_parameters_are_calibrated_where_some_values_fail(make, kind):
    fault = Fault(kind)
    Y = np.concatenate([make(Fault("none")).set_params(params__c=0.9).simulate(U[k == RUNS]) for k in range(3)])
    fitted = CalibratedSimulator(make(fault), params=["c"]).fit(U, Y[:, 0], groups=RUNS)
    assert fitted.params_["c"] == pytest.approx(0.9, rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("make", [right_hand_side, step_function])
def test_the_structure_of_a_plant_is_read_at_recorded_inputs(make):
    seen = []
    plant = make(Fault("none"))
    name = "rhs" if make is right_hand_side else "step"
    inner = getattr(plant, name)
    plant.set_params(**{name: lambda t, x, u, *rest: (seen.append(np.array(u)), inner(t, x, u, *rest))[1]})
    GapDiagnoser(plant, effects=["constant_bias"], n_jobs=1, random_state=0).fit(U, measured(make), groups=RUNS)
    offered = np.concatenate([u.ravel() for u in seen])
    assert np.mean(beyond(offered)) < 0.01  # a probe of small steps about the first input
    assert np.isfinite(offered).all() and np.abs(offered).max() < 1.6


def test_a_mistake_at_the_first_point_of_the_data_speaks_at_once():
    def rhs(t, x, u, p):
        return x[1], u[0] - p["stiffness"] * x[0]

    with pytest.raises(ValueError, match="parameter 'stiffness' is not in params"):
        GapDiagnoser(ODESimulator(rhs, states=["q", "v"], **NAMES)).fit(U, np.zeros((360, 1)) + U, groups=RUNS)


def test_a_simulator_of_trajectories_that_fails_along_the_data_shows_its_own_error():
    def whole_run(U, p):
        raise Odd("no licence")

    with pytest.raises(Odd, match="no licence"):
        GapDiagnoser(CallableSimulator(whole_run, **NAMES)).fit(U, U.copy(), groups=RUNS)
