"""The robots of the check: drawn, marched without the package's own simulators, scored."""

import numpy as np
import pytest

from sksurrogate.blind import ROBOT_ARMS, run_blind_check
from sksurrogate.blind._linkage import LINKAGE_ANSWERS, linkage_case
from sksurrogate.blind._robot_arms import _oracle_error, draw_robot_case, score_robot_case
from sksurrogate.blind._robots import ANSWERS, robot_case
from sksurrogate.exceptions import SurrogateError
from sksurrogate.physics import MuJoCoSimulator

mujoco = pytest.importorskip("mujoco")


def drawn(make, kind, seed=0):
    rng = np.random.default_rng([seed, len(kind or "")])
    return next(case for case in (make(rng, kind) for _ in range(60)) if case is not None)


def test_the_march_by_mujoco_alone_is_what_the_simulator_gives():
    case = drawn(robot_case, None)
    robot = case["robot"]
    simulator = MuJoCoSimulator(robot.mjcf(), outputs=[f"{j}.pos" for j in robot.joints], dt=robot.dt)
    for U, x0, y in zip(case["U"], case["X0"], case["clean"]):
        np.testing.assert_allclose(simulator.simulate(U, x0=x0), y, atol=1e-9)


@pytest.mark.slow
def test_the_march_of_the_arm_is_what_its_equations_give():
    case = drawn(linkage_case, None)
    for U, x0, y in zip(case["U"][:2], case["X0"], case["clean"]):
        np.testing.assert_allclose(case["simulator"].simulate(U, x0=x0), y, atol=1e-5)


@pytest.mark.parametrize("kind", ANSWERS)
def test_every_kind_makes_a_gap_in_a_robot(kind):
    case = drawn(robot_case, kind)
    error = (case["clean"] - _nominal(case)) / case["noise"]
    assert np.sqrt(np.mean(error**2)) == pytest.approx(case["gap"]) and 5.0 <= case["gap"] < 200.0


def _nominal(case):
    robot = case["robot"]
    simulator = MuJoCoSimulator(robot.mjcf(), outputs=[f"{j}.pos" for j in robot.joints], dt=robot.dt)
    return np.stack([simulator.simulate(U, x0=x0) for U, x0 in zip(case["U"], case["X0"])])


@pytest.mark.slow
@pytest.mark.parametrize("kind", LINKAGE_ANSWERS)
def test_every_friction_makes_a_gap_in_an_arm(kind):
    assert 5.0 <= drawn(linkage_case, kind)["gap"] < 200.0


def test_the_same_seed_draws_the_same_case():
    one, other = (draw_robot_case("robot", 4) for _ in range(2))
    assert one.facts == other.facts and np.array_equal(one.question.y, other.question.y)


def answer(case, verdict, *effects):
    named = [
        {
            "name": n,
            "location": p,
            "variable": None,
            "params": {},
            "intervals": {},
            "probability": 1.0,
            "equivalents": e,
        }
        for n, p, e in effects
    ]
    return {"verdict": verdict, "effects": named, "where": {"location": None}, "predicted": case.y_test}


def test_right_are_the_names_of_a_kind_at_its_joint_up_to_twins():
    case = draw_robot_case("robot", 4)
    name, place = case.answers[0]
    assert score_robot_case(case, answer(case, "explained", (name, place, [])))["right"]
    twin = ("drift", "elsewhere", [[name, place, None]])
    assert score_robot_case(case, answer(case, "explained", twin))["right"]
    assert not score_robot_case(case, answer(case, "explained", ("drift", "elsewhere", [])))["right"]
    both = answer(case, "explained", (name, place, []), ("drift", "elsewhere", []))
    row = score_robot_case(case, both)
    assert not row["right"] and row["false_names"] == 1 and row["shrink"] == 1.0


def test_the_place_of_what_has_no_name_is_its_joint_its_drive_or_its_balance():
    case = draw_robot_case("robot_unknown", 1)
    joint = case.facts["truths"][0]["location"]
    said = [
        {**answer(case, "unknown"), "where": {"location": p}} for p in (joint, f"drive_{joint}", f"{joint}.vel", None)
    ]
    assert [score_robot_case(case, one)["place"] for one in said] == [True, True, True, False]


def test_an_oracle_that_errs_by_some_sizes_errs_by_their_share_on_test_runs():
    rng = np.random.default_rng(0)
    noise, scale, moved = np.array([0.1, 0.3]), np.array([2.0, 5.0]), rng.normal(size=(6, 20, 2))
    across = rng.normal(size=(4, 20, 2))
    slopes = moved[:4] / noise**2
    across -= moved[:4] * np.sum(slopes * across) / np.sum(slopes * moved[:4])  # nothing of the effect's kind
    found = _oracle_error(-0.7 * moved[:4] + across, noise, scale, moved)
    assert found == pytest.approx(0.7 * np.sqrt(np.mean((moved[4:] / scale) ** 2)))
    assert _oracle_error(across, noise, scale, 0 * moved) == 0.0


def test_a_model_that_follows_the_plant_is_beside_the_oracle_and_the_simulator_alone_is_not():
    case = draw_robot_case("robot", 4)
    exact = answer(case, "explained")
    simulator = case.question.simulator
    alone = {
        **exact,
        "predicted": [simulator.simulate(U, x0) for U, x0 in zip(case.question.X_test, case.question.x0_test)],
    }
    assert score_robot_case(case, exact)["beside_oracle"] <= 1.0 < 1.05 < score_robot_case(case, alone)["beside_oracle"]
    assert 0.9 < score_robot_case(case, exact)["oracle"] <= 1.0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arm", "verdict"), [("linkage_none", "none"), ("robot_none", "none"), ("robot_unknown", "unknown")]
)
def test_nothing_and_the_unknown_have_no_name(arm, verdict):
    case = draw_robot_case(arm, 1)
    assert score_robot_case(case, answer(case, verdict))["right"]
    assert not score_robot_case(case, {**answer(case, "partial", ("drift", "x", [])), "predicted": 0 * case.y_test})[
        "right"
    ]


def says_nothing(question):
    """A diagnosis that finds no gap."""
    simulate = question.simulator.simulate
    predicted = [simulate(U, x0=x0).tolist() for U, x0 in zip(question.X_test, question.x0_test)]
    return {"verdict": "none", "effects": [], "predicted": predicted, "seconds": 0.0, "processor_seconds": 0.0}


@pytest.mark.slow
def test_a_robot_is_asked_like_the_others():
    """Another diagnosis in the other process: it says that there is nothing."""
    result = run_blind_check(1, "linkage_none", seed=0, diagnosis=f"{__name__}:says_nothing")
    assert [row["right"] for row in result.rows] == [True] and set(ROBOT_ARMS) >= {row["arm"] for row in result.rows}
    assert "linkage_none" in result.to_markdown()
    with pytest.raises(SurrogateError, match="robot_unknown"):
        run_blind_check(1, "robots")
