"""Cases, seal, the other process, scores, resuming."""

import gc
import json
import os
import pickle
import sys
import time
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from sksurrogate.blind import ARMS, BlindResult, Case, draw, run_blind_check, run_case
from sksurrogate.blind import _score as scoring
from sksurrogate.blind._big_plants import BIG_PLANTS
from sksurrogate.blind._choose import make_setting, sized
from sksurrogate.blind._excite import initial_states, inputs
from sksurrogate.blind._march import march
from sksurrogate.blind._plants import PLANTS
from sksurrogate.blind._seal import Seal, close_seal
from sksurrogate.blind._solve import Solver
from sksurrogate.blind._truths import KINDS, Scene
from sksurrogate.exceptions import DataError, SimulatorError, SurrogateError
from sksurrogate.physics import ODESimulator

HERE = __name__


# ---- what the other process runs in these tests


def says_nothing(question):
    """The answer of somebody who never sees a gap."""
    predicted = [question.simulator.simulate(U, x0=x) for U, x in zip(question.X_test, question.x0_test)]
    return {"verdict": "none", "effects": [], "where": {"location": None}, "predicted": predicted, "seconds": 0.0}


def looks_around(question):
    """Everything that the diagnosing process can see, as text."""
    from sksurrogate.blind._cases import Case as TheCase
    from sksurrogate.blind._seal import Seal as TheSeal

    held = [type(thing).__name__ for thing in gc.get_objects() if isinstance(thing, (TheCase, TheSeal))]
    seals = [str(p) for p in Path.cwd().glob("sealed-*/*.sealed")]  # the folder of temporary files
    texts = [Path(p).read_text() for p in seals]
    seen = json.dumps(
        {"question": repr(vars(question)), "argv": sys.argv, "environment": dict(os.environ), "files": texts}
    )
    return {**says_nothing(question), "held": held, "seen": seen, "seals": len(seals), "effects_left": question.effects}


def raises(question):
    raise ValueError("lost the thread")


def dies(question):
    os._exit(3)


def tells_its_number(question):
    return {"number": os.getpid()}


def sleeps(question):
    time.sleep(60)


@cache
def drawn(arm, seed=0):
    """A case, drawn once."""
    return draw(arm, seed)


@pytest.fixture(scope="module")
def solver():
    with Solver(f"{HERE}:says_nothing") as one:
        yield one


# ---- cases


QUICK = ("effect", "detuned", "outside", "none", "unexcited")


@pytest.mark.parametrize("arm", [arm if arm in QUICK else pytest.param(arm, marks=pytest.mark.slow) for arm in ARMS])
def test_a_case_holds_what_its_arm_says(arm):
    case = drawn(arm)
    without = ("none", "disturbed", "coloured", "spikes", "tails", "trends")
    assert len(case.truths) == {"two": 2, "three": 3}.get(arm, 0 if arm in without else 1)
    question, gap = case.question, case.facts["gap_over_noise"]
    assert question.X.shape[0] == question.y.shape[0] == question.groups.shape[0] == case.states.shape[0]
    assert np.isfinite(question.y).all() and np.isfinite(case.y_test).all()
    if arm in ("effect", "detuned", "region", "time", "outside", "novel", "outside_disturbed"):
        assert 2.0 < gap < 120
    if arm == "weak":
        assert gap < 4.0
    if arm == "sizes":
        assert 0.02 < gap < 40
    if arm in ("none", "coloured", "unexcited"):
        assert gap < 0.02
    if arm in ("outside", "outside_disturbed"):
        assert question.effects and not {t.name for t in case.truths} & set(question.effects)
    else:
        assert question.effects is None
    assert (question.free_params == "all") == (arm in ("detuned", "far"))
    if arm not in ("detuned", "far"):
        assert question.simulator.params == case.plant.params


@pytest.mark.parametrize("plant", BIG_PLANTS.values(), ids=BIG_PLANTS)
def test_a_big_plant_has_the_states_of_its_name_and_is_its_simulator(plant):
    assert len(plant.states) == int(plant.name.rsplit("_", 1)[1]) in (6, 8, 10, 12)
    rng = np.random.default_rng(0)
    U = inputs(rng, plant, "steps", 2, 60)
    X0 = initial_states(rng, plant, 2)
    course = march(plant, U, X0, substeps=8)
    expected = plant.simulator().simulate_batch(U, X0)
    np.testing.assert_allclose(course.outputs, expected, atol=5e-5 * np.abs(expected).max())


@pytest.mark.slow
def test_a_seed_repeats_a_case_and_no_seed_does_not():
    one, two, other = draw("effect", 3), draw("effect", 3), draw("none")
    np.testing.assert_array_equal(one.question.y, two.question.y)
    assert one.facts == two.facts and other.facts["seed"] != draw("none").facts["seed"]


def test_the_noise_is_what_it_is_said_to_be():
    case = drawn("none")
    groups, simulator = case.question.groups, case.question.simulator
    clean = np.concatenate([simulator.simulate(case.question.X[groups == r], x0=x) for r, x in enumerate(case.starts)])
    np.testing.assert_allclose((case.question.y - clean).std(axis=0), case.noise, rtol=0.15)


# ---- seal and process


def test_a_seal_opens_only_with_its_pad_and_only_unchanged(tmp_path):
    seal = close_seal({"truths": [{"name": "sensor_bias"}]}, tmp_path)
    assert seal.open() == {"truths": [{"name": "sensor_bias"}]}
    assert json.loads(seal.path.read_text())["sha256"] == seal.sha256
    with pytest.raises(SurrogateError, match="its hash differs"):
        Seal(seal.path, seal.sha256, bytes(len(seal.pad))).open()
    with pytest.raises(TypeError, match="stays in the process"):
        pickle.dumps(seal)
    stored = json.loads(seal.path.read_text())
    stored["sealed"] = ("1" if stored["sealed"][0] == "0" else "0") + stored["sealed"][1:]
    seal.path.write_text(json.dumps(stored))
    with pytest.raises(SurrogateError, match="its hash differs"):
        seal.open()


@pytest.mark.slow
def test_the_diagnosis_cannot_reach_the_truth():
    """The other process looks at its objects, arguments, environment and every seal it finds; and finds nothing."""
    found = {}
    row = run_case(
        "outside", 5, diagnosis=f"{HERE}:looks_around", look=lambda case, answer: found.update(case=case, answer=answer)
    )
    case, answer = found["case"], found["answer"]
    assert row["sha256"] and "error" not in answer and answer["held"] == []
    assert answer["seals"] >= 1  # it holds the very file, and that is noise without the pad
    truth = case.truths[0]
    names = {name for name in KINDS if name in answer["seen"]}
    assert names <= set(answer["effects_left"]) and truth.name not in names
    for text in (str(case.facts["seed"]), *(f"{float(v):.8g}" for v in truth.params.values())):
        assert len(text) < 6 or text not in answer["seen"]  # "5" is in every text


def test_a_question_holds_no_part_of_the_case():
    case = drawn("effect")
    known = pickle.dumps(case.question)
    assert not any(name.encode() in known for name in KINDS) and not isinstance(case.question, Case)
    assert set(vars(case.question)) == {
        "simulator", "X", "y", "groups", "free_params", "effects", "X_test", "x0_test", "X_far", "x0_far", "time",
    }  # fmt: skip


@pytest.mark.slow
def test_a_diagnosis_that_fails_dies_or_hangs_is_a_row_of_its_own():
    question = drawn("none").question
    for function, limit, said in (("raises", 60, "lost the thread"), ("dies", 60, "ended"), ("sleeps", 3, "in time")):
        with Solver(f"{HERE}:{function}", limit) as one:
            assert said in one.ask(question)["error"]


# ---- scores


def answer_of(case, *effects, verdict="explained", location=None):
    """An answer that names these (name, location, variable, params) and predicts perfectly."""
    return {
        "verdict": verdict,
        "effects": [
            {"name": n, "location": l, "variable": v, "params": dict(p), "probability": 0.9,
             "intervals": {k: [0.9 * q - 1e-9, 1.1 * q + 1e-9] if q > 0 else [1.1 * q - 1e-9, 0.9 * q + 1e-9] for k, q in p.items()},
             "equivalents": [list(e) for e in equal]}
            for n, l, v, p, equal in effects
        ],
        "where": {"location": location}, "predicted": case.y_test, "seconds": 1.0, "shrink": {"fraction": 1.0},
    }  # fmt: skip


def test_the_truth_scores_full_marks_up_to_twins():
    case = drawn("effect")
    truth = case.truths[0]
    row = scoring.score(case, answer_of(case, (*truth.key, truth.params, []), location=truth.location))
    assert row["right"] and row["exact"] == 1 and row["place"] and all(row["covered"]) and row["shrink"] == 1.0
    assert 0.9 < row["oracle"] <= 1.0
    twin = scoring.score(case, answer_of(case, ("sensor_bias", "elsewhere", None, {"value": 1.0}, [truth.key])))
    assert twin["right"] and twin["exact"] == 0 and twin["classes"] == [2]
    wrong = scoring.score(case, answer_of(case, ("sensor_bias", "elsewhere", None, {"value": 1.0}, [])))
    assert not wrong["right"] and wrong["false_names"] == 1 and wrong["imitated"]
    beside = scoring.score(
        case, answer_of(case, (*truth.key, truth.params, []), ("drift", "elsewhere", None, {"rate": 1.0}, []))
    )
    assert not beside["right"] and beside["named"] == 1


def test_controls_and_unknowns():
    case = drawn("none")
    assert scoring.score(case, answer_of(case, verdict="none"))["right"]
    assert not scoring.score(case, answer_of(case, ("drift", "x", None, {"rate": 1.0}, [])))["right"]
    novel = drawn("novel")
    said = scoring.score(novel, answer_of(novel, verdict="unknown", location=novel.truths[0].location))
    assert said["right"] and said["place"]
    assert not scoring.score(novel, answer_of(novel, verdict="none"))["right"]


def test_the_oracle_pays_for_the_noise_alone():
    """Half the noise, half the oracle's error."""
    case = drawn("effect")
    full = scoring.oracle_error(case)
    groups = case.question.groups
    keys = [(0, name) for name in case.truths[0].params]
    U = case.question.X.reshape(int(groups.max()) + 1, -1, case.question.X.shape[1])
    clean = scoring._columns(case, U, case.starts, keys, [1e-9] * len(keys))[0].reshape(case.question.y.shape)
    quiet = replace(case.question, y=clean + 0.5 * (case.question.y - clean))
    assert scoring.oracle_error(replace(case, question=quiet)) == pytest.approx(0.5 * full, rel=0.05)


# ---- campaign


@pytest.mark.slow
def test_a_broken_off_check_is_taken_up_again(tmp_path, solver):
    file = tmp_path / "rows.jsonl"
    first = run_blind_check(2, ["none", "coloured"], seed=1, diagnosis=f"{HERE}:says_nothing", resume=file)
    with file.open("a") as stream:
        stream.write('{"arm": "none", "broken')
    again = run_blind_check(4, ["none", "coloured"], seed=1, diagnosis=f"{HERE}:says_nothing", resume=file)
    assert len(first.rows) == 2 and len(again.rows) == 4
    assert [row["sha256"] for row in again.rows[:2]] == [row["sha256"] for row in first.rows]
    assert len({(row["arm"], row["seed"]) for row in again.rows}) == 4
    assert all(row["right"] for row in again.rows) and len(BlindResult.load(file).rows) == 4


@pytest.mark.slow
def test_a_case_takes_longer_than_its_answer_and_less_than_its_call(solver):
    started = time.perf_counter()
    row = run_case("none", 3, diagnosis=f"{HERE}:says_nothing", solver=solver)
    assert 0 <= row.get("seconds", 0.0) <= row["whole_seconds"] <= time.perf_counter() - started


@pytest.mark.parametrize("name", ["constant_bias", "sensor_gain", "sensor_rectification"])
def test_an_effect_is_sized_to_its_gap_and_one_without_a_size_has_it_or_not(name):
    plant, kind = PLANTS["oscillator"], KINDS[name]
    setting = make_setting(np.random.default_rng(2), plant, [np.sin(0.2 * np.arange(200))[:, None]] * 2, "effect")
    outputs, location = setting.nominal.outputs, "velocity" if kind.place == "balance" else plant.outputs[0]
    signal = outputs[..., 0].ravel()
    given = (setting, name, location, None, kind, Scene(signal, signal, signal, 1.0, plant.dt, 10.0, np.full(4, 0.5)))
    truth = sized(*given, target=20.0, least=0.0)
    faulty = march(plant, setting.U, setting.X0, [truth], substeps=8).outputs
    gap = np.sqrt(np.mean(((faulty - outputs) / (setting.noise * setting.scale))[..., setting.read] ** 2))
    if kind.size(1.0, given[-1]):
        assert gap == pytest.approx(20.0, rel=0.2)
    else:
        assert (
            sized(*given, target=20.0, least=0.9 * gap) is not None
            and sized(*given, target=20.0, least=1.1 * gap) is None
        )


def test_arms_and_files_that_are_not_there_say_so(tmp_path):
    with pytest.raises(SurrogateError, match=r"arms: \['nune'\] unknown"):
        run_blind_check(1, "nune")
    with pytest.raises(SurrogateError, match=r"diagnosis='my/answer.py:f': write module:function"):
        run_blind_check(1, "none", diagnosis="my/answer.py:f")
    for wrong, said in (
        ({"cases": 0}, "cases=0: expected a whole number"),
        ({"n_jobs": 0}, "n_jobs=0: expected 1 or more"),
        ({"follow_up": 3}, "follow_up=3: expected a share"),
        ({"resume": tmp_path / "no" / "rows.jsonl"}, "there is no folder"),
    ):
        with pytest.raises(SurrogateError, match=said):
            run_blind_check(**{"cases": 1, "arms": "none", **wrong})
    with pytest.raises(DataError, match="there is no such file"):
        BlindResult.load(tmp_path / "none.jsonl")


@pytest.mark.slow
def test_tables_and_page(tmp_path, solver):
    rows = []
    for arm, seed in (("none", 0), ("effect", 0), ("novel", 0)):
        case = drawn(arm, seed)
        rows.append(scoring.score(case, solver.ask(case.question)))
    result = BlindResult((*rows, {"arm": "none", "seed": 9, "error": "ValueError: broke", "right": False}))
    scores = {row["arm"]: row for row in result.scores()}
    assert scores["none"]["cases"] == 2 and scores["none"]["failed"] == 1 and scores["effect"]["right"] == 0.0
    kinds = dict(result.failures())
    assert set(kinds) == {"no answer", "not named, said none", "none where it should be unknown"}
    page = result.to_html(tmp_path / "page.html")
    assert "<h2>By plant</h2>" in page and (tmp_path / "page.html").read_text() == page
    assert "not named, said none" in result.to_markdown()


@pytest.mark.slow
def test_the_command_line(tmp_path, capsys, monkeypatch):
    from sksurrogate.blind import _campaign
    from sksurrogate.cli import main

    monkeypatch.setattr(
        _campaign.run_blind_check,
        "__kwdefaults__",
        {**_campaign.run_blind_check.__kwdefaults__, "diagnosis": f"{HERE}:says_nothing"},
    )
    page, rows = tmp_path / "page.html", tmp_path / "rows.jsonl"
    assert (
        main(["blind", "--cases", "1", "--arms", "none", "--seed", "3", "--html", str(page), "--resume", str(rows)])
        == 0
    )
    assert "| none | 1 | 1 |" in capsys.readouterr().out and page.exists() and len(rows.read_text().splitlines()) == 1
    assert main(["blind", "--html", str(tmp_path / "no" / "page.html")]) == 2
    assert main(["blind", "--arms", "nothing"]) == 2
    assert "arms: ['nothing'] unknown" in capsys.readouterr().err


# ---- a simulator of the user's own


def own_rhs(t, x, u, p):
    if x[0] > 1e9:  # branches on values: goes column by column
        return [0.0, 0.0]
    return [x[1], p["b"] * u[0] - p["k"] * x[0] - p["c"] * x[1]]


def own(**more):
    return ODESimulator(
        own_rhs, states=["q", "v"], inputs=["f"], outputs=["q"], params={"b": 1.0, "k": 4.0, "c": 0.5}, dt=0.1, **more
    )


@pytest.mark.slow
def test_a_simulator_of_your_own(solver):
    from sksurrogate.blind._own_simulator import plant_of

    U = np.repeat(np.random.default_rng(0).uniform(-1, 1, 24), 5)[:, None]
    plant, runs = plant_of(own(), X=U, groups=np.repeat([0, 1], 60), x0_spread=[0.1, 0.1])
    assert plant.kinematic == {"q": "v"} and [len(run) for run in runs] == [60, 60]
    for arm in ("effect", "none"):
        case = draw(arm, 4, plant=plant, runs=runs)
        np.testing.assert_array_equal(case.question.X, U)
        assert case.facts["excitation"] == "recorded" and "error" not in solver.ask(case.question)
    with pytest.raises(SimulatorError, match="give recorded inputs"):
        plant_of(own())
    with pytest.raises(SimulatorError, match="'f' is missing"):
        plant_of(own(), input_ranges={"g": (0, 1)})
    with pytest.raises(SimulatorError, match="x0_spread has 1 values"):
        plant_of(own(), input_ranges={"f": (0, 1)}, x0_spread=[0.1])


@pytest.mark.slow
def test_baselines_answer_the_cases_of_a_check_that_was_done(tmp_path, monkeypatch):
    from sksurrogate.blind import _baselines

    monkeypatch.setattr(_baselines, "BASELINES", ("whiteness",))
    rows, out = tmp_path / "rows.jsonl", tmp_path / "baselines.jsonl"
    done = [
        {"arm": "none", "seed": 1, "right": True},
        {"arm": "none", "seed": 2, "right": None},
        {"arm": "none", "seed": 3, "right": True},
    ]
    rows.write_text("".join(json.dumps(row) + "\n" for row in done))
    assert _baselines.main([str(rows), str(out), "--first", "1"]) == 0
    assert _baselines.run_baselines(rows, out, first=2) == 1  # the first is there, the second could not be drawn
    found = BlindResult.load(out).rows
    assert [row["seed"] for row in found] == [1, 3] and all(row["diagnosis"].endswith(":whiteness") for row in found)
    assert all(row["verdict"] in ("none", "unknown") and row["processor_seconds"] >= 0 for row in found)


@pytest.mark.slow
def test_an_answering_process_is_replaced_in_time(monkeypatch):
    """Memory that a diagnosis does not give back cannot grow over a long check."""
    from sksurrogate.blind import _solve

    monkeypatch.setattr(_solve, "FRESH", 2)
    question = drawn("none").question
    with Solver(f"{HERE}:tells_its_number") as one:
        numbers = [one.ask(question)["number"] for _ in range(5)]
    assert numbers[0] == numbers[1] != numbers[2] == numbers[3] != numbers[4]


def test_an_interrupt_keeps_what_is_there(tmp_path, monkeypatch, capsys):
    from sksurrogate.blind import _campaign
    from sksurrogate.cli import main

    row = {"arm": "none", "seed": 1, "error": "ValueError: broke", "right": False}

    def answered(jobs, n_jobs):
        yield row
        raise KeyboardInterrupt

    monkeypatch.setattr(_campaign, "_answered", answered)
    file = tmp_path / "rows.jsonl"
    assert main(["blind", "--cases", "3", "--arms", "none", "--resume", str(file)]) == 130
    assert "interrupted after 1 cases; the same command goes on" in capsys.readouterr().err
    assert not run_blind_check(3, "none").complete and len(BlindResult.load(file).rows) == 1


def test_a_simulator_from_a_file_that_no_import_finds(tmp_path, solver):
    """As the command line loads it; and one that holds a lock is refused in words."""
    from sksurrogate.cli import load_simulator

    head = "from sksurrogate.physics import ODESimulator\n"
    rhs = "def rhs(t, x, u, p):\n    return [p['b'] * u[0] - x[0]]\n"
    more = "dict(states=['x'], inputs=['u'], outputs=['x'], params={'b': 1.0}, dt=0.1)"
    file = tmp_path / "a_plant_of_mine.py"
    file.write_text(head + rhs + f"one = ODESimulator(rhs, **{more})\nimport threading\nrhs.lock = threading.Lock()\n")
    question = replace(drawn("none").question, simulator=load_simulator(f"{file}:one"))
    with pytest.raises(SimulatorError, match="cannot be sent to the diagnosing process"):
        solver.ask(question)
    file.write_text(head + rhs + f"one = ODESimulator(rhs, **{more})\n")
    simulator = load_simulator(f"{file}:one")
    own = replace(question, simulator=simulator, X_test=np.ones((1, 5, 1)), x0_test=np.zeros((1, 1)))
    assert len(solver.ask(own)["predicted"][0]) == 5
