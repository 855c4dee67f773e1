"""The suggested next experiment, carried out: does it separate what was tied?"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from sksurrogate.blind._cases import Case, Question
from sksurrogate.blind._march import march

#: The experiment that the suggested one has to beat.
CONTROL = "the same run again"


def experiment(case: Case, name: str) -> tuple[np.ndarray, np.ndarray] | None:
    """Inputs (1, n_samples, n_inputs) and initial state (1, n_states) of an experiment by its words; None if unknown."""
    rows = case.question.groups == 0
    u = case.question.X[rows][:400]
    n = len(u)
    x0 = case.starts[0].copy()
    middle = u.mean(axis=0)
    spread = np.abs(u - middle).max(axis=0)
    index = np.arange(n)
    name = name.removeprefix("a run ").strip()
    made = {
        CONTROL: u,
        "with inputs twice as far from their mean": middle + 2 * (u - middle),
        "with inputs half as far from their mean": middle + 0.5 * (u - middle),
        "with inputs shifted up by their amplitude": u + spread,
        "with inputs twice as fast": u[(2 * index) % n],
        "with inputs half as fast": u[index // 2],
        "with a step in every input": np.where((index < n // 4)[:, None], middle - 0.5 * spread, middle + spread),
        "without input, from a large initial state": np.broadcast_to(middle, u.shape),
    }
    if name.startswith("without input"):
        x0 = x0 + 2 * case.states.std(axis=0)
    only = re.fullmatch(r"in which only (\w+) moves", name)
    if only and only[1] in case.plant.inputs:
        j = case.plant.inputs.index(only[1])
        alone = np.repeat(middle[None], n, axis=0)
        alone[:, j] = u[:, j]
        return alone[None], x0[None]
    return (made[name][None], x0[None]) if name in made else None


def follow(case: Case, answer: Mapping[str, Any], name: str | None = None) -> Question | None:
    """The question among the tied names with one more run: that of the experiment suggested, or of the one named.

    ``answer``: with ``next_experiment``: ``{"best": words}``.
    ``name``: another experiment in its place.
    Returns None where nothing was suggested, or it cannot be done.
    """
    suggested = name or ((answer.get("next_experiment") or {}).get("best"))
    if not suggested:
        return None
    question, rng = case.question, np.random.default_rng([case.facts["seed"], 17])
    question = replace(question, effects=_tied_names(answer) or question.effects)
    read = [case.plant.outputs.index(output) for output in question.simulator.outputs]
    sensor = re.fullmatch(r"the same runs with (\w+) measured too", suggested)
    if sensor:
        return _with_sensor(case, question, sensor[1], rng)
    found = experiment(case, suggested)
    if found is None:
        return None
    course = march(case.plant, *found, case.truths)
    if not np.isfinite(course.outputs).all():
        return None
    y = course.outputs[0][:, read]
    y = y + case.noise * rng.normal(size=y.shape)
    return replace(
        question,
        X=np.vstack([question.X, found[0][0]]),
        y=np.vstack([question.y, y]),
        groups=np.append(question.groups, np.full(len(y), question.groups.max() + 1)),
    )


def _with_sensor(case: Case, question: Question, state: str, rng: np.random.Generator) -> Question | None:
    """The same runs with one more state measured."""
    plant = case.plant
    outputs = [*question.simulator.outputs, state]
    if state not in plant.outputs:
        return None
    column = case.states[:, plant.states.index(state)]
    column = column + case.facts["noise"] * column.std() * rng.normal(size=len(column))
    simulator = plant.simulator(question.simulator.params, outputs, counting=True)
    return replace(question, simulator=simulator, y=np.column_stack([question.y, column]))


def _tied_names(answer: Mapping[str, Any]) -> list[str]:
    """Names of all classes of an answer."""
    return sorted({name for e in answer.get("effects") or [] for name, *_ in [[e["name"]], *e["equivalents"]]})


def followed(
    case: Case, answer: Mapping[str, Any], row: Mapping[str, Any], ask: Callable[[Question], dict[str, Any]]
) -> dict[str, Any]:
    """What the suggested experiment is worth where names are tied, and what the first run once more is worth.

    ``answer``: the answer whose experiment is done.
    ``row``: its scores.
    ``ask``: gives the answer to a :class:`Question`.
    Returns dict: empty without a tie. ``experiment``: words, None where nothing was suggested. ``gain_expected``: nats
        promised. With suffix _before, _after, _repeated: ``class``: size of the largest class; ``truth``: whether all
        true effects are in the classes named; ``lead``: nats between the true effect and the best other member of its
        class (one effect only).
    """
    if "error" in row or max(row["classes"], default=1) < 2:
        return {}
    suggested = answer.get("next_experiment") or {}
    found: dict[str, Any] = {"experiment": suggested.get("best"), "gain_expected": suggested.get("gain")}
    members = [_members(e) for e in answer["effects"]]
    answers: dict[str, Mapping[str, Any]] = {"before": answer}
    for key, name in (("after", None), ("repeated", CONTROL)):
        question = follow(case, answer, name) if found["experiment"] else None
        answers[key] = ask(question) if question is not None else {"error": "not done"}
    for key, given in answers.items():
        classes = [_members(e) for e in given.get("effects") or []]
        done = "error" not in given
        found[f"class_{key}"] = max(map(len, classes), default=0) if done else None
        found[f"truth_{key}"] = all(any(t.key in c for c in classes) for t in case.truths) if done else None
        found[f"lead_{key}"] = (
            _lead(case, given, members[0]) if done and len(members) == len(case.truths) == 1 else None
        )
    return found


def _members(effect: Mapping[str, Any]) -> list[tuple[str, str, str | None]]:
    """A class: the name and its equivalents."""
    return [(effect["name"], effect["location"], effect["variable"]), *(tuple(e[:3]) for e in effect["equivalents"])]


def _lead(case: Case, answer: Mapping[str, Any], members: list[tuple[str, str, str | None]]) -> float | None:
    """Log likelihood of the true effect over that of the best other member of its class, in nats."""
    fitted = {(n, p, v): 0.5 * float(value) for n, p, v, value in answer.get("evidence") or []}
    others = [fitted[key] for key in members if key != case.truths[0].key and key in fitted]
    own = fitted.get(case.truths[0].key)
    return own - max(others) if own is not None and others and case.truths[0].key in members else None
