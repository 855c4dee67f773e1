"""Scores of regions, shapes and follow-ups against cases where the answer is known."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import norm

from sksurrogate.blind import draw
from sksurrogate.blind._follow import CONTROL, experiment, follow, followed
from sksurrogate.blind._shape import active, region_score, rows_of_rule, shape_curve, shape_score, true_curve
from sksurrogate.blind._truths import Truth


@pytest.fixture(scope="module")
def regional():
    case = draw("region", 1)
    assert case.truths[0].name == "input_saturation"
    return case


def test_rules_are_read():
    signals = {"a": np.array([0.0, 1.0, 2.0]), "b": np.array([-1.0, -1.0, 1.0])}
    assert rows_of_rule("everywhere", signals).all()
    assert rows_of_rule("a > 0.5 and b <= 0", signals).tolist() == [False, True, False]
    assert rows_of_rule("c > 1", signals) is None and rows_of_rule("a about 1", signals) is None


def test_the_true_region_scores_one_and_everywhere_scores_its_part(regional):
    truth, mask = regional.truths[0], active(regional)
    limit = truth.params["limit"]
    rules = [
        {"rule": f"{truth.location} > {limit}", "share": 0.6, "samples": 0.1},
        {"rule": f"{truth.location} <= {-limit}", "share": 0.4, "samples": 0.1},
        {"rule": f"{truth.location} > {-limit} and {truth.location} <= {limit}", "share": 0.0, "samples": 0.8},
    ]
    assert region_score(regional, rules) == pytest.approx(1.0)
    everywhere = region_score(regional, [{"rule": "everywhere", "share": 1.0, "samples": 0.5}])
    assert everywhere == pytest.approx(2 * mask.mean() / (1 + mask.mean()))
    assert region_score(regional, []) is None


@pytest.mark.slow
def test_a_learned_curve_is_compared_with_the_true_term():
    case = draw("novel", 0)
    truth = case.truths[0]
    at = np.linspace(-2, 2, 30) * truth.params["scale"] + truth.params["middle"]
    true = true_curve(truth, at)
    curves = [{"variable": truth.variable, "at": at, "value": 2 * true + 5.0}]
    drawn = shape_curve(case, {"location": truth.location, "curves": curves})
    assert shape_score(drawn) == pytest.approx(1.0) and drawn["variable"] == truth.variable
    np.testing.assert_allclose(drawn["value"], 2 * np.array(drawn["true"]), atol=2e-3 * np.ptp(true))
    curves[0]["value"] = -true
    assert shape_score(shape_curve(case, {"location": truth.location, "curves": curves})) == pytest.approx(-1.0)
    assert shape_curve(case, {"location": "elsewhere", "curves": curves}) is None and shape_score(None) is None


def test_true_curves_are_the_formulae():
    v = np.array([-2.0, 1.0, 3.0])
    cubic = true_curve(Truth("cubic_stiffness", "x", "v", {"coefficient": 2.0}), v)
    np.testing.assert_allclose(cubic, -2 * v**3)
    clipped = true_curve(Truth("input_saturation", "u", None, {"limit": 1.5}), v)
    np.testing.assert_allclose(clipped, [0.5, 0.0, -1.5])
    assert true_curve(Truth("input_delay", "u", None, {"delay": 1.0}), v) is None


@pytest.mark.slow
def test_the_suggested_experiment_is_one_more_run(regional):
    best = "a run with inputs twice as far from their mean"
    question = follow(regional, {"next_experiment": {"best": best}})
    before = regional.question
    new = question.groups > before.groups.max()
    assert new.sum() == min((before.groups == 0).sum(), 400)
    u = before.X[before.groups == 0][: new.sum()]
    np.testing.assert_allclose(question.X[new] - u.mean(axis=0), 2 * (u - u.mean(axis=0)), atol=1e-9)
    again = follow(regional, {}, CONTROL)
    np.testing.assert_allclose(
        again.y[again.groups == again.groups.max()], before.y[: new.sum()], atol=8 * regional.noise.max()
    )
    assert follow(regional, {}) is None and experiment(regional, "a dance") is None


@pytest.mark.slow
def test_the_suggested_experiment_is_scored_against_the_same_run_again(regional):
    """The tied names are asked again, nothing else; leads in nats are read from twice the log likelihoods."""
    truth = regional.truths[0]
    effect = {"name": "drift", "location": "x", "variable": None, "equivalents": [list(truth.key)]}
    best = {"best": "a run with inputs twice as far from their mean", "gain": 12.0}
    evidence = [["drift", "x", None, 50.0], [*truth.key, 48.0]]
    answer = {"effects": [effect], "next_experiment": best, "evidence": evidence}
    asked = []

    def ask(question):
        asked.append(question)
        own = {"name": truth.name, "location": truth.location, "variable": truth.variable, "equivalents": []}
        classes = [own] if len(asked) == 1 else [effect]
        return {"effects": classes, "evidence": [["drift", "x", None, 60.0], [*truth.key, 90.0]]}

    found = followed(regional, answer, {"classes": [2]}, ask)
    assert [q.effects for q in asked] == [sorted({"drift", truth.name})] * 2
    assert (found["class_before"], found["class_after"], found["class_repeated"]) == (2, 1, 2)
    assert (found["lead_before"], found["lead_after"], found["gain_expected"]) == (-1.0, 15.0, 12.0)
    assert found["truth_before"] and found["truth_after"]
    assert followed(regional, answer, {"classes": [1]}, ask) == {}
    untold = followed(regional, {"effects": [effect], "next_experiment": None}, {"classes": [2]}, ask)
    assert untold["experiment"] is None and untold["class_after"] is None and len(asked) == 2


@pytest.mark.parametrize(
    ("name", "location", "variable", "params", "rows"),
    [
        ("end_stop", "speed", "angle", {"edge": 2.0}, [False, True, True]),
        ("end_stop", "angle", None, {"edge": 2.0}, [False, True, True]),
        ("state_saturation", "angle", None, {"limit": 3.0}, [False, False, True]),
        ("state_saturation", "angle", "speed", {"limit": 3.0}, [False, False, True]),
        ("end_stop", "elsewhere", None, {"edge": 2.0}, None),
    ],
)
def test_a_stop_acts_where_its_position_is_and_a_limit_where_its_state_is(name, location, variable, params, rows):
    states = np.column_stack([[1.0, 2.0, 3.0], np.zeros(3)])
    plant = SimpleNamespace(states=["angle", "speed"], inputs=["torque"])
    case = SimpleNamespace(truths=[Truth(name, location, variable, params)], plant=plant, states=states)
    found = active(case)
    assert found is None if rows is None else found.tolist() == rows


def test_a_reading_at_the_limit_of_a_sensor_is_told_from_the_others_in_98_of_100():
    rng, noise = np.random.default_rng(0), 0.05
    y = np.r_[np.full(4000, 1.0), np.full(4000, 0.7)] + noise * rng.normal(size=8000)
    question = SimpleNamespace(simulator=SimpleNamespace(outputs=["level"]), y=y[:, None])
    truth = Truth("sensor_saturation", "level", None, {"limit": 1.0})
    case = SimpleNamespace(truths=[truth], plant=None, question=question, noise=np.array([noise]))
    at_the_limit, elsewhere = np.split(active(case), 2)
    assert np.mean(at_the_limit) == pytest.approx(norm.cdf(2.0), abs=0.01) and not elsewhere.any()
