"""Scores of where and of what shape: regions against the rows where an effect acts, learned curves against true terms."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from sksurrogate.blind._cases import Case
from sksurrogate.blind._laws import family
from sksurrogate.blind._truths import KINDS, Truth


def active(case: Case) -> np.ndarray | None:
    """Rows in which a regional effect acts, (n_rows,); None where there is none."""
    for truth in case.truths:
        if "region" not in getattr(KINDS.get(truth.name), "marks", ()):
            continue
        plant, p = case.plant, truth.params
        if truth.name == "input_saturation":
            return np.asarray(np.abs(case.question.X[:, plant.inputs.index(truth.location)]) > p["limit"])
        if truth.name == "sensor_saturation":
            column = list(case.question.simulator.outputs).index(truth.location)
            return np.asarray(case.question.y[:, column] > p["limit"] - 2 * case.noise[column])
        name = truth.variable if truth.name == "end_stop" and truth.variable else truth.location
        if name not in plant.states:
            return None
        level = p["edge"] if truth.name == "end_stop" else p["limit"] * (1 - 1e-9)
        return np.asarray(case.states[:, plant.states.index(name)] >= level)
    return None


def rows_of_rule(rule: str, signals: Mapping[str, np.ndarray]) -> np.ndarray | None:
    """Rows that a readable rule speaks of; None where it is not understood.

    >>> rows_of_rule("level > 2 and flow <= 1", {"level": np.array([1, 3, 3]), "flow": np.array([0, 0, 2])})
    array([False,  True, False])
    """
    inside = np.ones(len(next(iter(signals.values()))), dtype=bool)
    for part in [] if rule == "everywhere" else rule.split(" and "):
        found = re.fullmatch(r"(\w+) (<=|>) (\S+)", part.strip())
        if found is None or found[1] not in signals:
            return None
        value = signals[found[1]]
        inside &= value <= float(found[3]) if found[2] == "<=" else value > float(found[3])
    return inside


def region_score(case: Case, rules: Sequence[Mapping[str, Any]]) -> float | None:
    """F1 of the rows flagged (rules that hold more than their part of the gap) against those where the effect acts."""
    mask = active(case)
    if mask is None or not mask.any() or not rules:
        return None
    signals = {name: case.states[:, i] for i, name in enumerate(case.plant.states)}
    signals |= {name: case.question.X[:, j] for j, name in enumerate(case.plant.inputs)}
    likely_place = np.zeros(len(mask), dtype=bool)
    for row in rules:
        inside = rows_of_rule(str(row["rule"]), signals)
        if inside is not None and row["share"] > 1.5 * row["samples"]:
            likely_place |= inside
    both = float(np.sum(likely_place & mask))
    return 2 * both / float(likely_place.sum() + mask.sum())


def true_curve(truth: Truth, at: np.ndarray) -> np.ndarray | None:
    """The missing term over its variable; None where it is not a function of one variable."""
    kind = family(truth.name)
    if kind.form is None or kind.variable in ("product", "other", "gate", "input", "output"):
        return None
    if kind.place == "balance" and truth.variable is not None and "*" not in truth.variable:
        width = truth.width or 1e-9
        return np.asarray(kind.form(0.0, np.zeros_like(at), at, 1.0, truth.params, width), dtype=float)
    if kind.place in ("input", "sensor"):
        return np.asarray(kind.form(0.0, at, at, 1.0, truth.params, truth.width) - at, dtype=float)
    return None


def shape_curve(case: Case, missing: Mapping[str, Any] | None) -> dict[str, Any] | None:
    """The learned curve over the true term's own variable, with the true term; None where there is no such curve.

    A constant is not given: it belongs to the balance as well as to the term. Both curves have mean zero.
    """
    if not missing:
        return None
    for truth in case.truths:
        own = truth.variable or truth.location
        for curve in missing["curves"]:
            if curve["variable"] != own or missing["location"] != truth.location:
                continue
            at, value = np.asarray(curve["at"], dtype=float), np.asarray(curve["value"], dtype=float)
            true = true_curve(truth, at)
            if true is not None and len(at) > 3 and np.std(true) > 0 and np.std(value) > 0:
                drawn = {"at": at, "value": value - value.mean(), "true": true - true.mean()}
                short = {key: [float(f"{v:.4g}") for v in values] for key, values in drawn.items()}
                return {"location": truth.location, "variable": own, **short}
    return None


def shape_score(curve: Mapping[str, Any] | None) -> float | None:
    """Correlation of a learned curve with the true one."""
    return float(np.corrcoef(curve["true"], curve["value"])[0, 1]) if curve else None
