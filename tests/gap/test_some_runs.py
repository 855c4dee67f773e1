"""Effects that act in some of the runs: named with their runs, absent from the others, saved with both."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
from sklearn.base import clone

from sksurrogate.effects import CATALOGUE, AugmentedSimulator, load_augmented, save_augmented
from sksurrogate.exceptions import DataError, SimulatorError
from sksurrogate.gap import GapDiagnoser
from sksurrogate.gap.render._code import code_of
from sksurrogate.gap.rounds._some_runs import _at_the_noise
from sksurrogate.physics import ODESimulator

LEVEL = 0.8
ASKED = ["coulomb_friction", "linear_loss", "input_lag"]


def spring():
    """A mass on a spring, pushed."""
    return ODESimulator(
        lambda t, x, u, p: (x[1], u[0] - p["k"] * x[0] - p["c"] * x[1]),
        states=["position", "velocity"],
        inputs=["force"],
        outputs=["position"],
        params={"k": 20.0, "c": 0.6},
        dt=0.02,
    )


def measured(acting, n_runs=5, n=150, size=6.0):
    """Runs "1" to "5" of the spring, with Coulomb friction in some of them."""
    rng, plant = np.random.default_rng(1), spring()
    rough = AugmentedSimulator(plant, [CATALOGUE["coulomb_friction"]("velocity", "velocity")], [(LEVEL,)])
    labels = [str(r + 1) for r in range(n_runs)]
    U = [np.repeat(size * rng.normal(size=n // 10), 10)[:, None] for _ in labels]
    Y = [(rough if label in acting else plant).simulate(u) for label, u in zip(labels, U)]
    return np.concatenate(U), np.concatenate(Y) + 0.002 * rng.normal(size=(n * n_runs, 1)), np.repeat(labels, n)


@pytest.fixture(scope="module")
def diagnosed():
    U, Y, runs = measured(("2", "5"))
    return GapDiagnoser(spring(), effects=ASKED, random_state=0, n_jobs=1).fit(U, Y, groups=runs)


def test_a_friction_of_two_runs_is_named_with_its_runs(diagnosed):
    report = diagnosed.report_
    assert [(e.name, e.runs) for e in report.effects] == [("coulomb_friction", ("2", "5"))]
    low, high = report.effects[0].intervals["level"]
    assert low < LEVEL < high and high - low < 0.1 * LEVEL
    assert report.verdict == "explained"
    assert "coulomb friction at velocity, in runs '2', '5'" in report.sentence
    assert "acts in runs '2', '5' alone" in report.notes[0] and "runs '1', '3', '4' would show it" in report.notes[0]
    assert "in runs '2', '5'" in str(report)
    assert json.loads(report.to_json())["effects"][0]["runs"] == ["2", "5"]
    assert "    runs=[['2', '5']],  # model.in_run(label)" in code_of(report)


def test_the_augmented_simulator_holds_the_runs(diagnosed, tmp_path):
    better, U = diagnosed.augmented_, np.ones((50, 1))
    assert better.runs == [["2", "5"]] and clone(better).runs == [["2", "5"]]
    save_augmented(better, tmp_path / "better.json")
    again = load_augmented(spring(), tmp_path / "better.json")
    for one in (better, again):
        np.testing.assert_allclose(one.in_run("1").simulate(U), spring().simulate(U), rtol=1e-6, atol=1e-9)
        np.testing.assert_array_equal(one.in_run("5").simulate(U), better.simulate(U))
    assert np.ptp(better.simulate(U) - spring().simulate(U)) > 0.001


def test_runs_of_another_type_are_refused():
    wet = AugmentedSimulator(spring(), [CATALOGUE["linear_loss"]("velocity", "velocity")], [(1.0,)], runs=[[2, 5]])
    assert len(wet.in_run(np.int64(5)).effects) == 1 and not wet.in_run(1).effects
    with pytest.raises(SimulatorError, match="label='5': the runs are listed with 5; give it in that type"):
        wet.in_run("5")
    with pytest.raises(SimulatorError, match="runs has 2 entries, effects 1"):
        wet.set_params(runs=[None, None]).in_run(1)


def test_a_file_with_labels_that_are_none_is_refused(tmp_path):
    wet = AugmentedSimulator(spring(), [CATALOGUE["linear_loss"]("velocity", "velocity")], [(1.0,)], runs=[[None]])
    with pytest.raises(DataError, match="runs: None is not the label of a run"):
        save_augmented(wet, tmp_path / "wet.json")


def test_a_friction_of_all_runs_has_no_runs():
    U, Y, runs = measured(tuple("123"), n_runs=3)
    report = GapDiagnoser(spring(), effects=ASKED, random_state=0, n_jobs=1).fit(U, Y, groups=runs).report_
    assert [(e.name, e.runs) for e in report.effects] == [("coulomb_friction", None)]


@pytest.mark.parametrize("known", [False, True])
def test_runs_at_the_noise_are_those_whose_residual_is(known):
    rng, run = np.random.default_rng(0), np.repeat([0, 1, 2], 200)
    residual = rng.normal(size=(2, 600))  # in units of the noise
    residual[1, run == 1] *= 3.0  # one output of one run is not
    record = SimpleNamespace(
        known=None, seen=lambda values: values if record.known is None else np.where(record.known, values, 0.0)
    )
    if known:  # the second run is seen where it is at the noise, the third at no time
        record.known = np.ones((2, 600), bool)
        record.known[1, run == 1] = record.known[:, run == 2] = False
        residual[~record.known] = 0.0
    null = SimpleNamespace(residual=residual, without_starts=lambda r: r, problem=SimpleNamespace(record=record))
    pipeline = SimpleNamespace(null=SimpleNamespace(candidate=null))
    assert _at_the_noise(pipeline, run).tolist() == ([0, 1] if known else [0, 2])
