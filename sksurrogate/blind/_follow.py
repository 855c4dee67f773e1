"""The suggested next experiment, carried out: does it separate what was tied?"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from sksurrogate.blind._cases import Case, Question
from sksurrogate.blind._march import march

__all__ = ["CONTROL", "experiment", "follow"]

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
        "with inputs of twice the amplitude": middle + 2 * (u - middle),
        "with inputs of half the amplitude": middle + 0.5 * (u - middle),
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
    """The question with one more run: that of the experiment suggested, or of the one named.

    Parameters
    ----------
    case : Case
    answer : dict
        With ``next_experiment``: ``{"best": words}``.
    name : str, optional
        Another experiment in its place.

    Returns
    -------
    Question or None
        None where nothing was suggested, or it cannot be done.
    """
    suggested = name or ((answer.get("next_experiment") or {}).get("best"))
    if not suggested:
        return None
    question, rng = case.question, np.random.default_rng([case.facts["seed"], 17])
    read = [case.plant.outputs.index(output) for output in question.simulator.outputs]
    sensor = re.fullmatch(r"a sensor for (\w+), inputs as they were", suggested)
    if sensor:
        return _with_sensor(case, sensor[1], rng)
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


def _with_sensor(case: Case, state: str, rng: np.random.Generator) -> Question | None:
    """The same runs with one more state measured."""
    question, plant = case.question, case.plant
    outputs = [*question.simulator.outputs, state]
    if state not in plant.outputs:
        return None
    column = case.states[:, plant.states.index(state)]
    column = column + case.facts["noise"] * column.std() * rng.normal(size=len(column))
    simulator = plant.simulator(question.simulator.params, outputs, counting=True)
    return replace(question, simulator=simulator, y=np.column_stack([question.y, column]))
