"""What a reader sees first: verdict, before and after with units, confidence, what to do next; code that runs; no noise."""

import re
from dataclasses import replace

import numpy as np
import pytest

from sksurrogate.effects import CATALOGUE, AugmentedSimulator, save_augmented, starting
from sksurrogate.gap import EffectEstimate, GapDiagnoser, GapReport
from sksurrogate.gap._provenance import _settings
from sksurrogate.gap.render._code import code_of
from sksurrogate.gap.render._curves import effect_curve
from sksurrogate.gap.render._headline import (
    changes,
    headline,
    next_steps,
    not_identified,
    related_forms,
    sentence_of,
    separating,
)
from sksurrogate.gap.render._page import html_page
from sksurrogate.gap.render._terminal import terminal_page
from sksurrogate.gap.results._data_faults import DataFault, DataFaults
from sksurrogate.gap.results._next_experiment import NextExperiment
from sksurrogate.gap.results._provenance import Provenance
from sksurrogate.gap.results._reasons import Reasons
from sksurrogate.gap.results._shrink import Shrink
from sksurrogate.gap.results._table import Table
from sksurrogate.gap.results._trace import Trace
from sksurrogate.gap.results._where import Where
from sksurrogate.physics import CallableSimulator, ODESimulator, StepSimulator
from sksurrogate.physics._simulator import describe

WRONG = EffectEstimate(
    "parameter_error", "second", None, 0.97, {"relative_error": 0.6662}, {"relative_error": (0.66, 0.67)}, 0.9995
)
RICHER = ("stribeck_friction", "speed", "speed")
FRICTION = EffectEstimate(
    "coulomb_friction", "speed", "speed", 0.9, {"level": 0.4}, {"level": (0.3, 0.5)}, 0.93, [RICHER], "", [RICHER]
)
UNITS = {"second": "1/min", "speed": "rad/s", "time": "s"}


def report(*effects, **kwargs):
    given = {
        "verdict": "explained", "sentence": "", "effects": list(effects), "ranking": Table(), "retuned": Table(),
        "where": Where("second", "parameter"), "shrink": Shrink(1.0, 0.05, 0.02, 0.97, (0.96, 0.98)), "outputs": ("speed",),
        "inputs": ("u",), "states": ("speed",), "units": UNITS, "nominal": {"second": 60.0},
        "ranges": {"speed": (-2.0, 3.0)}, "provenance": Provenance(simulator="ODESimulator", access="rhs", n_rows=10),
    }  # fmt: skip
    return GapReport(**{**given, **kwargs})


def test_a_parameter_is_shown_before_and_after_with_its_unit():
    made = report(WRONG)
    assert headline(made) == (
        "The gap is explained by the parameter second: 60 -> 99.97 1/min, which closes 97.0 % of the gap on held-out runs."
    )
    for page in (terminal_page(made), html_page(made).replace("&gt;", ">")):
        assert "second: 60 -> 99.97 1/min [99.6, 100.2]" in page
        assert "very likely (probability 1.00)" in page
        assert "relative_error" not in page.split("Code to paste")[0]


def test_an_effect_that_is_not_certain_is_named_with_its_probability():
    doubtful = replace(FRICTION, probability=0.6)
    reasons = Reasons("uncertain_names", "", {})
    said = headline(report(doubtful, verdict="unknown", reasons=reasons))
    assert said == (
        "There is no certain answer. The likeliest is coulomb friction at speed (level: 0.4 rad/s^2), which closes 97.0 % of the gap on "
        "held-out runs: more likely than not (probability 0.60)."
    )
    both = replace(
        report(doubtful, verdict="unknown", reasons=reasons), effects=[replace(WRONG, probability=0.97), doubtful]
    )
    assert "coulomb friction at speed is more likely than not (probability 0.60)" in headline(both)
    unsized = Reasons("uncertain_names", "", {"sized": False})
    said = headline(report(replace(FRICTION, probability=0.99), verdict="unknown", reasons=unsized))
    assert said.endswith(
        "of the gap on held-out runs: the interval of a magnitude includes the value at which it does nothing."
    )


def test_an_explained_gap_that_leaves_a_disturbance_says_so():
    left = headline(report(FRICTION, reasons=Reasons("disturbance_left", "", {})))
    assert left.endswith("What is left follows no law that was found.")
    assert "disturbance" not in headline(report(FRICTION, reasons=Reasons("closed", "", {})))
    lawful = Reasons("disturbance_left", "", {"lawful": 0.21, "tolerance": 0.1})
    assert headline(report(FRICTION, reasons=lawful)).endswith(
        "What is left looks like a law, but no formula of it was found that holds on held-out runs."
    )


def test_a_fault_that_is_next_to_nothing_of_the_gap_is_the_last_thing_to_do():
    faults = [
        DataFault("shift", None, "output", (), (), 2.0, share, remedy="Look at the clock.") for share in (0.3, 0.001)
    ]
    steps = [next_steps(report(FRICTION, data=DataFaults((fault,)))) for fault in faults]
    assert [step.index("Look at the clock.") for step in steps] == [0, len(steps[1]) - 1]


def test_a_free_parameter_that_moved_is_a_change_too():
    row = {"parameter": "k", "nominal": 2.0, "value": 3.0, "low": 2.9, "high": 3.1, "moved": True}
    made = report(FRICTION, retuned=Table((row, {**row, "parameter": "calm", "moved": False})), units={"k": "N/m"})
    lines = ["k: 2 -> 3 N/m [2.9, 3.1]", "90 % interval holds the value before: calm"]
    assert changes(made)[1] == ("re-tuned", lines, "")


def test_a_share_of_amplitude_beside_a_budget_of_power_is_said_in_both_units():
    row = {"part": "friction", "kind": "effect", "share": 0.91, "low": 0.9, "high": 0.92}
    made = report(FRICTION, shrink=Shrink(1.0, 0.3, 0.02, 0.698, (0.68, 0.71)), budget=Table((row,)))
    said = "Where 69.8 % of the gap is closed, that is its amplitude: 1 - (1 - 0.698)^2 = 90.9 % of its power."
    assert said in " ".join(terminal_page(made).split()) and said in html_page(made)
    for whole in (1.0, 0.98, -0.2, np.nan):
        made = report(FRICTION, shrink=Shrink(1.0, 0.3, 0.02, whole, (0.68, 0.71)), budget=Table((row,)))
        assert "its amplitude" not in terminal_page(made) + html_page(made)


def test_richer_forms_are_not_needed_and_ask_for_no_experiment():
    table = Table(({"experiment": "a faster run", "gain": 9.0, "between": "a and b", "within": True},))
    made = report(FRICTION, next_experiment=NextExperiment("", table))
    sentence = "Richer than coulomb friction at speed, not needed: stribeck friction at speed."
    assert related_forms(FRICTION) == [sentence] and not_identified(FRICTION) == []
    assert next_steps(made) == ["Use diagnoser.augmented_ as the new simulator."]
    by_command = replace(made, provenance=replace(made.provenance, command="sksurrogate diagnose plant.py:plant d.csv"))
    assert "--save" in next_steps(by_command)[0] and "diagnoser" not in next_steps(by_command)[0]
    page = html_page(made)
    assert sentence in page and "do not separate" not in page


def test_experiments_that_separate_nothing_are_not_shown():
    tied = replace(FRICTION, equivalents=[("linear_loss", "speed", "speed")], richer=[])
    rows = [
        {"experiment": f"run {k}", "gain": gain, "between": "a and b", "within": True}
        for k, gain in enumerate((9.0, 1.0))
    ]
    made = report(tied, next_experiment=NextExperiment("", Table(tuple(rows))))
    assert [row["gain"] for row in separating(made)] == [9.0]
    assert (
        next_steps(made)[0]
        == "Record run 0 to separate a and b (expected log-likelihood difference 9; 3 is enough: odds of 20 to 1)."
    )
    assert not re.search(r"\bnats?\b", html_page(made) + terminal_page(made))
    nothing = report(tied, next_experiment=NextExperiment("", Table(tuple(rows[1:]))))
    assert separating(nothing) == [] and "Experiments that separate" not in html_page(nothing)
    assert "decide between coulomb friction at speed and linear loss at speed" in next_steps(nothing)[0]


@pytest.mark.parametrize("verdict", ["none", "explained", "partial", "unknown"])
def test_no_sentence_stands_twice(verdict):
    made = report(*([] if verdict == "none" else [FRICTION]), verdict=verdict, sentence="Not shown.")
    text = re.sub(r"<(style|script)>.*?</\1>", "", html_page(made), flags=re.S)
    text = re.sub(r"<[^>]+>", "\n", text)
    sentences = [s.strip() for s in re.split(r"(?<=[.:])\s", text) if len(s.strip()) > 40]
    assert len(set(sentences)) == len(sentences)


def test_terminal_page_and_sentence_say_the_same():
    made = report(FRICTION, WRONG, nominal={"second": 60.0})
    said = headline(made)
    assert said in " ".join(terminal_page(made).split()) and said in html_page(made).replace("&gt;", ">")
    assert sentence_of(made) == f"{said} {next_steps(made)[-1]}"
    assert "and the parameter second: 60 -> 99.97 1/min, which close 97.0 %" in said


def test_blocks_of_one_run_are_not_called_runs():
    wave = np.sin(np.arange(4.0))[:, None]
    one = Trace(0, np.arange(4.0), wave, 2 * wave, wave)
    made = report(FRICTION, traces=(one, replace(one, label=1)))
    assert "<strong>Run 0" in html_page(made)
    row = {"part": "friction", "kind": "effect", "share": 0.9, "low": 0.8, "high": 1.0}
    cut = replace(made, provenance=replace(made.provenance, n_runs=1), budget=Table((row,)))
    page = html_page(cut)
    assert "<strong>Block 0" in page and "Every block, the worst first" in page
    for shown, word, other in ((cut, "blocks", "runs"), (made, "runs", "blocks")):
        text = " ".join((html_page(shown), terminal_page(shown), str(shown.summary()), sentence_of(shown)))
        assert f"held-out {word}" in text and f"held-out {other}" not in text
    two = replace(cut, traces=(one,) * 4, provenance=replace(made.provenance, n_runs=2))
    assert "<strong>Block 0" in html_page(two)


def test_the_curve_of_an_effect_is_its_law_with_its_band():
    curve = effect_curve(FRICTION, report(FRICTION))
    assert curve.explained == 1.0
    np.testing.assert_allclose(curve.value, -0.4 * np.sign(curve.at))
    moving = np.abs(curve.at) > 0.1
    np.testing.assert_allclose((curve.high - curve.low)[moving], 0.2)
    assert (curve.at[0], curve.at[-1]) == (-2.0, 3.0)
    assert effect_curve(WRONG, report(WRONG)) is None
    assert effect_curve(FRICTION, report(FRICTION, ranges={})) is None
    assert "d(speed)/dt / (rad/s^2)" in html_page(report(FRICTION))


def test_the_ranking_shows_the_column_that_decides_and_folds_the_rest():
    row = {"name": "drag", "location": "x", "variable": None, "evidence": 30.0, "bar": 18.0, "cost": 5.0, "named": True}
    page = html_page(report(FRICTION, ranking=Table((row,) * 9)))
    short = page[page.index("Single effects compared") : page.index("candidates, all columns")]
    assert "margin" in short and "<td class=n>12</td>" in short and "misfit" not in short
    assert "misfit" in page[page.index("candidates, all columns") :]


def rhs(t, x, u, p):
    return [u[0] - p["k"] * x[0] - p["c"] * np.abs(x[0]) * x[0]]


KNOWN = {"states": ["speed"], "inputs": ["u"], "outputs": ["speed"], "dt": 0.1}


@pytest.fixture(scope="module")
def diagnoser():
    plant = ODESimulator(rhs, params={"k": 1.3, "c": 0.5}, **KNOWN)
    simulator = ODESimulator(bare, params={"k": 1.0}, units={"speed": "m/s", "k": "1/s", "time": "s"}, **KNOWN)
    rng = np.random.default_rng(0)
    U = np.repeat(rng.uniform(-3, 3, (4, 12)), 10, axis=1).reshape(-1, 1)
    runs = np.repeat([3, 1, 4, 2], 120)
    Y = np.concatenate([plant.simulate(U[runs == run]) for run in (3, 1, 4, 2)]) + 0.005 * rng.normal(size=(480, 1))
    wanted = ["quadratic_drag", "sensor_bias", "linear_loss"]
    return GapDiagnoser(simulator, effects=wanted, free_params=["k"], random_state=0, n_jobs=1).fit(U, Y, groups=runs)


def bare(t, x, u, p):
    return [u[0] - p["k"] * x[0]]


def test_the_code_to_paste_gives_the_augmented_simulator(diagnoser):
    found = diagnoser.report_
    assert found.effects[0].name == "quadratic_drag"
    names = {"diagnoser": diagnoser, "U": np.linspace(0, 2, 50)[:, None]}
    exec(code_of(found), names)
    np.testing.assert_allclose(names["Y"], diagnoser.augmented_.simulate(names["U"]), atol=1e-9)
    assert names["local"].A.shape == (1, 1)


def ramp(t, x, u, p):
    return [x[1], u[0] - p["k"] * x[1]]


def next_speed(t, x, u, p, dt):
    return [x[0] + dt * (u[0] - p["k"] * x[0])]


SIMULATORS = {
    "a right-hand side without a state at rest": ODESimulator(
        ramp, states=["place", "speed"], inputs=["u"], outputs=["speed"], params={"k": 1.0}, dt=0.1
    ),
    "a step": StepSimulator(next_speed, params={"k": 1.0}, **KNOWN),
    "simulate alone": CallableSimulator(lambda U: np.cumsum(U, axis=0), inputs=["u"], outputs=["speed"], dt=0.1),
}


@pytest.mark.parametrize("kind", SIMULATORS)
@pytest.mark.parametrize("from_file", [True, False])
def test_the_code_to_paste_runs_where_the_inputs_are_all_that_is_known(kind, from_file, monkeypatch):
    """Beside the diagnoser, and from the page of a command."""
    plant = describe(SIMULATORS[kind])
    biased = EffectEstimate("input_bias", "u", None, 1.0, {"value": 0.25}, {}, 1.0)
    origin = Provenance(
        simulator="plants/a.py:plant" if from_file else type(plant.simulator).__name__, access=plant.access
    )
    made = report(biased, states=plant.states, inputs=plant.inputs, outputs=plant.outputs, provenance=origin)
    monkeypatch.setattr("sksurrogate.cli.load_simulator", {"plants/a.py:plant": plant.simulator}.__getitem__)
    names = {"U": np.ones((20, 1)), **({} if from_file else {"diagnoser": GapDiagnoser(plant.simulator)})}
    exec(code_of(made), names)
    np.testing.assert_allclose(names["Y"], plant.simulator.simulate(1.25 * names["U"]))
    assert ("local" in names) == (kind != "simulate alone")


def test_the_code_of_a_command_reads_a_law_from_the_file_that_it_saves(tmp_path, monkeypatch):
    own = EffectEstimate("of_my_own", "speed", "speed", 1.0, {"c": 0.5}, {}, 1.0)
    given, origin = SIMULATORS["a step"], Provenance(simulator="a.py:plant", access="step")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sksurrogate.cli.load_simulator", {"a.py:plant": given}.__getitem__)
    save_augmented(
        AugmentedSimulator(given, [CATALOGUE["input_bias"]("u")], [{"value": 0.25}]), tmp_path / "better.json"
    )
    names = {"U": np.ones((20, 1))}
    exec(code_of(report(own, provenance=origin)), names)
    np.testing.assert_allclose(names["Y"], given.simulate(1.25 * names["U"]))


def test_the_code_of_an_effect_that_begins_in_some_runs_is_that_effect(diagnoser):
    found = diagnoser.report_
    late = {**found.effects[0].params, "onset": 1.5}
    effects = [replace(found.effects[0], params=late, runs=(3, 1))]
    names = {"diagnoser": diagnoser}
    exec(code_of(replace(found, effects=effects)).split("Y = model")[0], names)
    drag = starting(CATALOGUE["quadratic_drag"]("speed", "speed"))
    own, U = AugmentedSimulator(diagnoser.simulator, [drag], [late], diagnoser.augmented_.retuned), np.ones((50, 1))
    np.testing.assert_allclose(names["model"].simulate(U), own.simulate(U), atol=1e-6)
    assert [len(names["model"].in_run(label).effects) for label in (3, 1, 4, 2)] == [1, 1, 0, 0]


def test_every_run_of_the_data_is_in_the_report_with_its_inputs(diagnoser):
    found = diagnoser.report_
    assert [trace.label for trace in found.traces] == [3, 1, 4, 2]
    assert all(trace.inputs.shape == (120, 1) for trace in found.traces)
    page = html_page(found)
    assert all(f"<strong>Run {run}</strong>" in page for run in (1, 2, 3, 4))
    low, high = found.ranges["speed"]
    assert low < -0.5 and high > 0.5


def test_the_provenance_is_on_the_page(diagnoser):
    page, text = html_page(diagnoser.report_), str(diagnoser.report_)
    for word in ("ODESimulator", "4, 480", "0.1 s", "quadratic_drag, sensor_bias, linear_loss"):
        assert word in page and word in " ".join(text.split())
    assert diagnoser.report_.provenance.date[:2] == "20"


def test_settings_off_their_defaults_belong_to_the_provenance():
    """Enough to repeat the report: what was ruled out, limits, the tolerance; nothing where all is at its default."""
    plain = GapDiagnoser(None)
    asked = GapDiagnoser(None, exclude=["drift", "speed"], bounds={"k": (0.0, None)}, tolerance=0.2)
    assert _settings(plain) == ""
    assert _settings(asked) == "exclude=['drift', 'speed'], bounds={'k': (0.0, None)}, tolerance=0.2"


def test_units_stand_beside_the_numbers(diagnoser):
    text = str(diagnoser.report_)
    assert re.search(r"coefficient: 0\.\d+ 1/m \[", text)
    assert re.search(r"k: 1 -> 1\.\d+ 1/s \[", text)
    two = Where("speed", "state", by_output=Table(({"output": "speed", "gap": 0.2}, {"output": "w", "gap": 0.1})),
                by_region=Table(({"rule": "speed <= 0.3", "share": 0.9, "samples": 0.5}, {"rule": "speed > 0.3", "share": 0.1, "samples": 0.5})))  # fmt: skip
    shown = terminal_page(report(FRICTION, where=two))
    assert re.search(r"speed +0\.2 +rad/s\n +w +0\.1 +-", shown) and "90.0 % at speed <= 0.3 rad/s (" in shown
    assert "speed &lt;= 0.3 rad/s" in html_page(report(FRICTION, where=two))


def test_a_gap_as_large_everywhere_as_there_are_samples_has_no_table_of_places():
    rows = [{"rule": f"speed {sign} 0.3", "share": 0.5 + d, "samples": 0.5} for sign, d in (("<=", 0.03), (">", -0.03))]
    made = report(FRICTION, where=Where("speed", "state", by_region=Table(tuple(rows))))
    for page in (terminal_page(made), html_page(made)):
        assert "The gap is spread evenly over the operating range" in page and "0.3 rad/s" not in page


def test_the_short_form_of_a_report_has_its_names():
    assert repr(report(WRONG, FRICTION)) == (
        "GapReport(verdict='explained', parameter_error, coulomb_friction, where='second')"
    )
    assert repr(report(verdict="none")) == "GapReport(verdict='none', no effect, where='second')"
