"""The arms of the check that are robots: drawn, asked and scored like the others."""

from __future__ import annotations

import math
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from sksurrogate.blind._cases import ATTEMPTS, Question
from sksurrogate.blind._linkage import LINKAGE_ANSWERS, linkage_case
from sksurrogate.blind._robots import ANSWERS, INEXACT_ANSWERS, robot_case
from sksurrogate.blind._score import KEPT_OF_EFFECTS
from sksurrogate.exceptions import SurrogateError
from sksurrogate.physics import MuJoCoSimulator

#: Arm -> (what it asks, the right verdict). They are asked by name: "all" leaves them out, for they need MuJoCo and time.
ROBOT_ARMS: dict[str, tuple[str, str]] = {
    "robot": ("one effect in a robot of 2 to 6 joints (MuJoCo)", "explained"),
    "robot_none": ("no effect in a robot (MuJoCo)", "none"),
    "robot_unknown": ("a cogging torque in a robot (MuJoCo)", "unknown"),
    "linkage": ("friction at a port of a two-link arm of differential equations", "explained"),
    "linkage_none": ("no effect in a two-link arm", "none"),
}
#: Where a torque without a name enters a joint, ``{}`` standing for its name: all of them are its place.
PLACES_OF_JOINT = ("{}", "drive_{}", "{}.vel")
#: Share of the gap (amplitude) on held-out runs from which other names imitate what has no name.
ROBOT_IMITATED = 0.95


@dataclass(frozen=True)
class RobotCase:
    """A question about a robot with its answer.

    Attributes
    ----------
    arm : str
    question : Question
    answers : tuple of (str, str)
        Names and locations that are right.
    inexact : bool
        Whether a partial explanation by a right name is right too.
    facts : dict
        Plain data; ``truths`` as in the other arms.
    y_test : ndarray (n_runs, n_samples, n_outputs)
    scale, noise : ndarray (n_outputs,)
        Deviation and noise of the outputs.
    oracle : float
        Error on the test runs, outputs over their deviation, of what acts with its size fitted to the readings.
    """

    arm: str
    question: Question
    answers: tuple[tuple[str, str], ...]
    inexact: bool
    facts: dict[str, Any]
    y_test: np.ndarray
    scale: np.ndarray
    noise: np.ndarray
    oracle: float


def draw_robot_case(arm: str, entropy: int | None = None) -> RobotCase:
    """Draw a case of one of :data:`ROBOT_ARMS`.

    Raises SurrogateError where no case could be drawn.
    """
    seed = int(np.random.SeedSequence().entropy) if entropy is None else int(entropy)  # type: ignore[arg-type]
    rng = np.random.default_rng([seed, zlib.crc32(arm.encode())])
    for _ in range(ATTEMPTS):
        case = _linkage(rng, arm, seed) if arm.startswith("linkage") else _robot(rng, arm, seed)
        if case is not None:
            return case
    raise SurrogateError(f"arms: no case of {arm!r} could be drawn.")


def _robot(rng: np.random.Generator, arm: str, seed: int) -> RobotCase | None:
    """One try with MuJoCo."""
    kinds = [name for name in ANSWERS if name != "cogging"]
    kind = {"robot": str(rng.choice(kinds)), "robot_none": None, "robot_unknown": "cogging"}[arm]
    drawn = robot_case(rng, kind)
    if drawn is None:
        return None
    robot, truth = drawn["robot"], drawn["truth"]
    outputs = [f"{joint}.pos" for joint in robot.joints]
    simulator = MuJoCoSimulator(robot.mjcf(), outputs=outputs, dt=robot.dt)
    joint = "" if truth is None else robot.joints[truth.joint]
    answers = tuple((n, where.format(joint)) for n, where in ANSWERS.get(kind or "", ()))
    truths = _truths(kind, joint, answers, 0.0 if truth is None else truth.size)
    moved = "servos" if robot.servo else "motors"
    facts = {
        "plant": f"robot {len(robot.joints)}", "excitation": moved, "sensors": "gravity" if robot.gravity else "flat",
        "truths": truths,
    }  # fmt: skip
    return _case(rng, arm, seed, simulator, drawn, answers, kind in INEXACT_ANSWERS, facts)


def _linkage(rng: np.random.Generator, arm: str, seed: int) -> RobotCase | None:
    """One try with differential equations."""
    kind = None if arm == "linkage_none" else str(rng.choice(list(LINKAGE_ANSWERS)))
    drawn = linkage_case(rng, kind)
    if drawn is None:
        return None
    port = f"t{drawn['joint'] + 1}"
    answers = tuple((name, port) for name in LINKAGE_ANSWERS.get(kind or "", ()))
    truths = _truths(kind, port, answers, drawn["size"])
    facts = {"plant": "linkage", "excitation": "steps", "sensors": "all", "truths": truths}
    return _case(rng, arm, seed, drawn["simulator"], drawn, answers, kind == "load", facts)


def _truths(kind: str | None, place: str, answers: Any, size: float) -> list[dict[str, Any]]:
    """What acts, as the rows of the other arms hold it: by the catalogue's name where it has one."""
    if kind is None:
        return []
    name, location = answers[0] if answers else (kind, place)
    return [{"name": name, "location": location, "variable": None, "params": {"size": size}, "kind": kind}]


def _case(
    rng: np.random.Generator, arm: str, seed: int, simulator: Any, drawn: Mapping[str, Any], answers: Any, inexact: bool,
    facts: dict[str, Any],
) -> RobotCase:  # fmt: skip
    """Noise, question and answer."""
    clean, noise = drawn["clean"], drawn["noise"]
    n_runs, n_samples, _ = clean.shape
    y = clean + noise * rng.normal(size=clean.shape)
    question = Question(
        simulator, drawn["U"].reshape(n_runs * n_samples, -1), y.reshape(n_runs * n_samples, -1),
        np.repeat(np.arange(n_runs), n_samples), (), None, drawn["U_test"], drawn["X0_test"],
    )  # fmt: skip
    scale = np.std(clean, axis=(0, 1))
    facts |= {
        "arm": arm, "seed": seed, "domain": "robots", "noise": float(np.mean(noise / scale)), "n_runs": n_runs,
        "n_samples": n_samples, "n_states": len(simulator.states), "repeats": False, "gap_over_noise": drawn["gap"],
    }  # fmt: skip
    oracle = _oracle_error(y - clean, noise, scale, drawn["moved"] - np.concatenate([clean, drawn["test"]]))
    return RobotCase(arm, question, answers, inexact, facts, drawn["test"], scale, noise, oracle)


def _oracle_error(errors: np.ndarray, noise: np.ndarray, scale: np.ndarray, moved: np.ndarray) -> float:
    """Error on the test runs of what acts, its size fitted to readings with these errors: one Gauss-Newton step from the truth.

    All else is known to the oracle. ``moved``: what recorded and test runs change by where the size is another.
    """
    n = len(errors)
    slopes = moved[:n] / noise
    power = float(np.sum(slopes**2))  # 0 where steps of the model hide so small a change: the oracle knows the size
    step = float(np.sum(slopes * errors / noise)) / power if power > 0 else 0.0
    return abs(step) * float(np.sqrt(np.mean((moved[n:] / scale) ** 2)))


def score_robot_case(case: RobotCase, answer: Mapping[str, Any]) -> dict[str, Any]:
    """One row of results, as :func:`sksurrogate.blind._score.score` makes it.

    ``right``: the right verdict, a right name in every class that is named. ``error_after`` beside ``noise``: how the
    corrected simulator follows held-out runs. ``oracle``: by which share the error falls with what acts, fitted;
    ``beside_oracle``: the error against readings of those runs over the oracle's.
    """
    expected = ROBOT_ARMS[case.arm][1]
    row: dict[str, Any] = {**case.facts, "expected": expected}
    if "error" in answer:
        return {**row, "error": answer["error"], "right": False}
    groups = [
        {(e["name"], e["location"]), *((o[0], o[1]) for o in e.get("equivalents") or [])} for e in answer["effects"]
    ]
    right = [bool(group & set(case.answers)) for group in groups]
    unnamed = [where.format(t["location"]) for t in case.facts["truths"] for where in PLACES_OF_JOINT]
    places = {place for _, place in case.answers} or set(unnamed)
    likely_place = answer.get("where", {}).get("location")
    row |= {
        "verdict": answer["verdict"], "effects": [{k: e.get(k) for k in KEPT_OF_EFFECTS} for e in answer["effects"]],
        "named": int(any(right)), "false_names": right.count(False), "classes": [len(group) for group in groups],
        "exact": int(any((e["name"], e["location"]) in case.answers for e in answer["effects"])),
        "likely_place": likely_place, "place": likely_place in places if places else likely_place is None, "covered": [],
        "noted": bool(answer.get("notes")), "sentence": answer.get("sentence"), "reasons": answer.get("reasons"),
        "seconds": answer.get("seconds"), "processor_seconds": answer.get("processor_seconds"), "calls": None,
        "curve": None,
    }  # fmt: skip
    row |= _followed(case, answer)
    row["imitated"] = bool(answer["effects"] and (row["shrink"] or 0.0) >= ROBOT_IMITATED and not any(right))
    row["right"] = _is_right(case, row, expected)
    return row


def _is_right(case: RobotCase, row: Mapping[str, Any], expected: str) -> bool:
    """Whether the answer is the right one."""
    if expected == "none":
        return row["verdict"] == "none" and not row["effects"]
    if expected == "unknown":
        return row["verdict"] == "unknown" or row["imitated"] or (row["verdict"] == "partial" and not row["effects"])
    said = ("explained", "partial") if case.inexact else ("explained",)
    return row["verdict"] in said and bool(row["named"]) and not row["false_names"]


def _followed(case: RobotCase, answer: Mapping[str, Any]) -> dict[str, Any]:
    """Errors on the test runs before and after, outputs in their standard deviations."""

    def error(values: Any) -> float:
        found = np.asarray(values, dtype=float).reshape(case.y_test.shape)
        return float(np.sqrt(np.mean(((found - case.y_test) / case.scale) ** 2)))

    simulator = case.question.simulator
    runs = [simulator.simulate(U, x0=x) for U, x in zip(case.question.X_test, case.question.x0_test)]
    before, after = error(runs), error(answer["predicted"])
    finite = math.isfinite(after)
    shrink = 1.0 - after / before if before > 1e-6 and finite else None
    read = float(np.mean((case.noise / case.scale) ** 2))  # power of the noise in readings of the test runs
    acts = bool(case.facts["truths"]) and before > 1e-6
    return {
        "error_before": before, "error_after": after if finite else None, "shrink": shrink,
        "oracle": 1.0 - case.oracle / before if acts else None,
        "beside_oracle": math.sqrt((after**2 + read) / (case.oracle**2 + read)) if acts and finite else None,
    }  # fmt: skip
