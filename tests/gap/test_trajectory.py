"""A simulator with ``simulate`` alone: input and sensor effects are named, the rest is listed as untestable."""

import numpy as np
import pytest

from sksurrogate.effects import BalanceEffect, LawEffect, Parameter
from sksurrogate.exceptions import SimulationDiverged, SimulatorError
from sksurrogate.gap import GapDiagnoser, _pipeline
from sksurrogate.gap.decide._rules import decide


class FirstOrder:
    """A callable plant without names, states or right-hand side."""

    inputs, outputs, dt = ("u",), ("y",), 0.1

    def simulate(self, U, x0=None, t=None):
        y = np.zeros(len(U))
        for k in range(len(U) - 1):
            y[k + 1] = y[k] + (1 - np.exp(-0.1)) * (U[k, 0] - y[k])
        return y[:, None]


def seen_as(seen, seed=0):
    """Two runs whose outputs are seen through a function."""
    rng = np.random.default_rng(seed)
    U = np.repeat(rng.uniform(-1, 1, 80), 5)[:, None]
    groups = np.repeat([0, 1], 200)
    Y = np.concatenate([FirstOrder().simulate(U[groups == run]) for run in (0, 1)])
    return U, seen(Y) + 0.005 * rng.normal(size=Y.shape), groups


def measured(bias, seed):
    return seen_as(lambda y: y + bias, seed)


def test_a_sensor_bias_is_named():
    X, y, groups = measured(0.2, 0)
    diagnoser = GapDiagnoser(FirstOrder(), random_state=0).fit(X, y, groups=groups)
    report = diagnoser.report_
    assert report.verdict == "explained"
    assert report.effects[0].name == "sensor_bias"
    low, high = report.effects[0].intervals["value"]
    assert low < 0.2 < high
    assert "coulomb_friction" in report.untestable and report.notes
    again = diagnoser.augmented_.simulate(X[groups == 0])
    assert abs(float(np.mean(again - FirstOrder().simulate(X[groups == 0]))) - 0.2) < 0.01


class Convection(BalanceEffect):
    name, parameters, equation = "convection", (Parameter("coefficient", low=0.0),), "- c v abs(v)^0.25"

    def term(self, t, x, v, theta, width):
        return -theta[0] * v * np.abs(v) ** 0.25


def test_only_what_was_asked_for_is_untestable_and_the_page_says_it():
    X, y, groups = measured(0.2, 0)
    effects = [
        Convection,
        LawEffect("level", "level"),
        "sensor_bias",
        "parameter_drift",
        "input_gain",
        Convection("level"),
    ]
    report = GapDiagnoser(FirstOrder(), effects=effects, random_state=0).fit(X, y, groups=groups).report_
    assert report.untestable == ("convection", "law: ", "parameter_drift")
    page = str(report)
    assert "Could not be tested with this simulator: convection, law: , parameter_drift." in page
    assert "parameters that drift or jump" in " ".join(page.split())
    assert max(map(len, page.splitlines())) <= 100
    few = GapDiagnoser(FirstOrder(), effects=(e for e in ["sensor_bias", "drift"]), random_state=0)
    assert few.fit(X, y, groups=groups).report_.untestable == ("drift",)
    one = GapDiagnoser(FirstOrder(), effects="sensor_bias", random_state=0).fit(X, y, groups=groups).report_
    assert one.untestable == () and "Could not be tested" not in str(one)


@pytest.mark.parametrize("effects", [["coulomb_friction", Convection], "parameter_step", Convection("level")])
def test_nothing_that_can_be_tested_is_said_before_any_work(effects):
    class Counted(FirstOrder):
        calls = 0

        def simulate(self, U, x0=None, t=None):
            Counted.calls += 1
            return super().simulate(U)

    X, y, groups = measured(0.2, 0)
    with pytest.raises(SimulatorError, match=r"effects=\[.*\]: none of them can be tested with Counted.*rhs or step"):
        GapDiagnoser(Counted(), effects=effects).fit(X, y, groups=groups)
    assert Counted.calls == 0


def test_nothing_asked_for_is_no_mistake():
    X, y, groups = measured(0.2, 0)
    report = GapDiagnoser(FirstOrder(), effects=[], random_state=0).fit(X, y, groups=groups).report_
    assert report.untestable == () and report.effects == []


def test_no_gap_gets_none():
    X, y, groups = measured(0.0, 1)
    report = GapDiagnoser(FirstOrder(), random_state=0).fit(X, y, groups=groups).report_
    assert report.verdict == "none" and report.effects == []


def test_a_parameter_and_other_initial_states_are_found_through_a_callable():
    from sksurrogate.physics import CallableSimulator

    def simulate(U, x0, p):
        y = np.zeros(len(U))
        y[0] = x0[0]
        for k in range(len(U) - 1):
            y[k + 1] = p["a"] * y[k] + p["b"] * U[k, 0]
        return y

    plant = CallableSimulator(simulate, inputs=["u"], outputs=["y"], params={"a": 0.9, "b": 0.1}, dt=0.1, x0=[0.0])
    rng = np.random.default_rng(2)
    U = np.repeat(rng.uniform(-1, 1, 60), 5)[:, None]
    groups = np.repeat([0, 1, 2], 100)
    true = {"a": 0.87, "b": 0.1}
    Y = np.concatenate([simulate(U[groups == run], [0.5 * run], true) for run in range(3)])
    report = (
        GapDiagnoser(plant, effects=["parameter_error", "sensor_bias", "sensor_gain"], random_state=0)
        .fit(U, Y + 0.003 * rng.normal(size=Y.shape), groups=groups)
        .report_
    )
    assert [(e.name, e.location) for e in report.effects] == [("parameter_error", "a")]
    low, high = report.effects[0].intervals["relative_error"]
    assert low < 0.87 / 0.9 - 1 < high


def test_a_table_of_outputs_is_enough_for_sensors():
    from sksurrogate.physics import TableSimulator

    X, y, groups = measured(0.0, 3)
    table = TableSimulator(X, y, groups=groups, inputs=["u"], outputs=["y"], dt=0.1)
    rng = np.random.default_rng(4)
    report = (
        GapDiagnoser(table, effects=["sensor_gain", "sensor_bias", "input_gain"], random_state=0)
        .fit(X, 1.2 * y + 0.005 * rng.normal(size=y.shape), groups=groups)
        .report_
    )
    assert report.effects[0].name == "sensor_gain" and report.untestable == ("input_gain",)
    with pytest.raises(
        SimulatorError, match=r"effects=\['input_gain'\]: none of them can be tested with TableSimulator"
    ):
        GapDiagnoser(table, effects=["input_gain"]).fit(X, y, groups=groups)


class Short(FirstOrder):
    def simulate(self, U, x0=None, t=None):
        return super().simulate(U)[:5]


def test_a_simulator_that_returns_too_few_rows_is_told_how_many_are_expected():
    X, y, groups = measured(0.2, 0)
    with pytest.raises(SimulatorError, match="returned 5 rows for 200 rows of inputs"):
        GapDiagnoser(Short(), random_state=0).fit(X, y, groups=groups)


class Runaway(FirstOrder):
    """Diverges from row 7 on where the first input is ``bad``."""

    def __init__(self, bad, raises=False, batch=False):
        self.bad, self.raises = bad, raises
        if batch:
            self.simulate_batch = lambda U, X0=None, t=None: np.stack([self.simulate(u) for u in U])

    def simulate(self, U, x0=None, t=None):
        y = super().simulate(U)
        if U[0, 0] in self.bad:
            if self.raises:
                raise SimulationDiverged("the tank ran dry at t = 0.7.", row=7, time=0.7, state="level")
            y[7:] = np.inf
        return y


@pytest.mark.parametrize("batch", [False, True])
def test_a_simulator_that_diverges_is_told_by_run_and_row(batch):
    X, y, groups = measured(0.0, 5)
    labels = np.array(["monday", "tuesday"])[groups]
    for raises, said in [
        (False, r"simulate gives inf for the inputs in X: run 'tuesday', row 7, t = 0\.7, output 'y', expected finite"),
        (True, r"simulate diverges for the inputs in X: run 'tuesday', the tank ran dry at t = 0\.7\. Give smaller"),
    ]:
        plant = Runaway([X[200, 0]], raises, batch)
        with pytest.raises(SimulationDiverged, match=said + r".*inputs, or leave the run out") as caught:
            GapDiagnoser(plant, effects=["sensor_bias"]).fit(X, y, groups=labels)
        error = caught.value
        assert (error.run, error.row, error.state) == ("tuesday", 7, "level" if raises else "y")
        assert abs(error.time - 0.7) < 1e-9


def test_one_run_that_diverges_has_no_label():
    X, y, _ = measured(0.0, 5)
    with pytest.raises(SimulationDiverged, match=r"in X: row 7, t = 0\.7, output 'y'.*np\.clip") as caught:
        GapDiagnoser(Runaway([X[0, 0]]), effects=["sensor_bias"]).fit(X, y)
    assert caught.value.run is None


def test_runs_that_only_diverge_together_are_told_apart_from_others():
    X, y, groups = measured(0.0, 5)
    plant = FirstOrder()
    plant.simulate_batch = lambda U, X0=None, t=None: np.full((len(U), U.shape[1], 1), np.nan if len(U) > 1 else 0.0)
    with pytest.raises(SimulationDiverged, match=r"simulate_batch gives .* finite one by one"):
        GapDiagnoser(plant, effects=["sensor_bias"]).fit(X, y, groups=groups)


def test_an_interrupt_before_the_certificate_names_nothing_for_certain(monkeypatch):
    def stopped(*given):
        raise KeyboardInterrupt

    monkeypatch.setattr(_pipeline, "held_out", stopped)
    X, y, groups = seen_as(lambda y: y + 0.2)
    with pytest.warns(UserWarning, match="interrupted"):
        report = (
            GapDiagnoser(FirstOrder(), effects=["sensor_bias", "sensor_lag"], random_state=0)
            .fit(X, y, groups=groups)
            .report_
        )
    assert (report.verdict, report.complete) == ("unknown", False)


def test_a_candidate_with_which_the_simulator_raises_is_lost_with_a_note():
    """Inputs beyond those recorded are refused: an input effect cannot be tried, a sensor effect can."""

    class Refusing(FirstOrder):
        def simulate(self, U, x0=None, t=None):
            if np.max(np.abs(U)) > 1.2:
                raise ValueError("the valve is out of range")
            return super().simulate(U)

    X, y, groups = seen_as(lambda y: 1.3 * y)
    report = (
        GapDiagnoser(Refusing(), effects=["sensor_gain", "input_gain"], random_state=0).fit(X, y, groups=groups).report_
    )
    assert [effect.name for effect in report.effects] == ["sensor_gain"]
    assert any("left out (input gain at u): ValueError: the valve is out of range" in note for note in report.notes)


def test_initial_states_are_those_of_the_last_fit():
    class Started(FirstOrder):
        x0 = [0.0]

        def simulate(self, U, x0=None, t=None):
            y = np.full(len(U), 0.0 if x0 is None else float(x0[0]))
            for k in range(len(U) - 1):
                y[k + 1] = y[k] + (1 - np.exp(-0.1)) * (U[k, 0] - y[k])
            return y[:, None]

    rng = np.random.default_rng(0)
    U = np.repeat(rng.uniform(-1, 1, 40), 5)[:, None]
    diagnoser = GapDiagnoser(Started(), effects=["sensor_bias"], random_state=0)
    for start in (0.5, -0.8):
        Y = Started().simulate(U, [start]) + 0.3 + 0.002 * rng.normal(size=(200, 1))
        diagnoser.fit(U, Y)
        assert diagnoser.initial_states_ == pytest.approx(np.array([[start]]), abs=0.02)
    diagnoser.set_params(simulator=FirstOrder()).fit(U, FirstOrder().simulate(U) + 0.3)
    assert diagnoser.initial_states_.shape == (1, 0)


def test_a_law_that_is_not_asked_for_is_unknown():
    X, y, groups = seen_as(lambda y: y + 0.5 * y**3)
    report = (
        GapDiagnoser(FirstOrder(), effects=["sensor_bias", "sensor_drift"], random_state=0)
        .fit(X, y, groups=groups)
        .report_
    )
    assert report.verdict == "unknown"
    assert report.where.location in {"u", "y"}


def test_gains_of_the_input_and_the_sensor_of_a_linear_plant_are_tied_and_it_says_so():
    X, y, groups = seen_as(lambda y: 1.3 * y)
    report = (
        GapDiagnoser(FirstOrder(), effects=["sensor_gain", "input_gain"], random_state=0)
        .fit(X, y, groups=groups)
        .report_
    )
    (effect,) = report.effects
    assert report.verdict == "explained" and len(effect.equivalents) == 1
    assert "none of the experiments tried here separates them" in effect.why
    assert effect.probability > 0.95  # up to its class
    assert report.next_experiment.parted == ()


def test_the_verdict_knows_how_many_effects_are_named(monkeypatch):
    asked = []

    def spy(facts):
        asked.append(facts)
        return decide(facts)

    monkeypatch.setattr("sksurrogate.gap._state.decide", spy)
    X, y, groups = seen_as(lambda y: 1.3 * y + 0.4)
    diagnoser = GapDiagnoser(FirstOrder(), effects=["sensor_gain", "sensor_bias"], random_state=0)
    report = diagnoser.fit(X, y, groups=groups).report_
    assert {effect.name for effect in report.effects} == {"sensor_gain", "sensor_bias"}
    assert {facts.names for facts in asked} == {2}
