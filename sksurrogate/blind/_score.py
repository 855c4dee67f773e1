"""What an answer is worth: the opened truth against what was said."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from sksurrogate.blind._cases import ARMS, Case
from sksurrogate.blind._law_score import law_score
from sksurrogate.blind._march import march
from sksurrogate.blind._shape import active, region_score, shape_curve, shape_score
from sksurrogate.blind._truths import KINDS, NOVEL, Truth

Key = tuple[str, str, str | None]
#: Share of the gap (amplitude) on held-out runs from which other names imitate the withheld one.
IMITATED = 0.95
#: What a row keeps of each effect that was named.
KEPT_OF_EFFECTS = ("name", "location", "variable", "share", "params", "intervals", "probability", "equivalents")


def score(case: Case, answer: Mapping[str, Any], *, oracle: bool = True) -> dict[str, Any]:
    """One row of results.

    ``answer``: what the other process gave.
    ``oracle``: whether the shrink of the true effect, refitted, is computed too.
    Returns dict: plain data. ``right``: the verdict is the right one, every true effect is named up to twins, nothing
        false is named. ``named``, ``false_names``: counts. ``exact``: truths named by their own name. ``place``: the
        location likely is that of a true effect. ``classes``: sizes of the classes reported. ``covered``: whether each
        true parameter lies in its interval. ``shrink``, ``oracle``: by which share the error on held-out runs
        fell, without their noise. ``imitated``: no true effect is named, and the names that are close 95 %
        of the gap on held-out runs.
    """
    row: dict[str, Any] = {**case.facts, "expected": ARMS[case.arm][1]}
    if "error" in answer:
        return {**row, "error": answer["error"], "right": False}
    truths = [(t.name, t.location, t.variable) for t in case.truths] if case.arm != "unexcited" else []
    classes = [_class(effect) for effect in answer["effects"]]
    named = [any(truth in group for group in classes) for truth in truths]
    false = sum(not any(truth in group for truth in truths) for group in classes)
    row |= {
        "verdict": answer["verdict"],
        "effects": [
            {k: e.get(k) for k in KEPT_OF_EFFECTS}
            for e in answer["effects"]
        ],
        "remainder": answer.get("remainder"),
        "named": sum(named),
        "exact": sum(any(truth == group[0] for group in classes) for truth in truths),
        "false_names": false,
        "classes": [len(group) for group in classes],
        "likely_place": answer.get("where", {}).get("location"),
        "noted": bool(answer.get("notes")),
        "predicted_shrink": _number(answer.get("shrink", {}).get("fraction")),
        "predicted_retuning": _number(answer.get("shrink", {}).get("retuning")),
        "predicted_correction": _number(answer.get("shrink", {}).get("correction")),
        "sentence": answer.get("sentence"),
        "reasons": answer.get("reasons"),
        "seconds": _number(answer.get("seconds")),
        "processor_seconds": _number(answer.get("processor_seconds")),
    }  # fmt: skip
    places = [truth[1] for truth in truths]
    row["place"] = row["likely_place"] in places if places else row["likely_place"] is None
    row["covered"] = _covered(case.truths, answer["effects"]) if truths else []
    row |= _shrinks(case, answer, oracle)
    row |= _regions(case, answer)
    row |= law_score(case, answer)
    row["calls"] = _calls(case, answer)
    row["imitated"] = bool(
        answer["verdict"] in ("explained", "partial")
        and truths
        and not sum(named)
        and row["shrink"] is not None
        and row["shrink"] >= IMITATED
    )
    row["right"] = _right(case.arm, row, len(truths))
    return row


def _class(effect: Mapping[str, Any]) -> list[Key]:
    """A name with the names that the data cannot tell from it."""
    own = (effect["name"], effect["location"], effect["variable"])
    return [own, *((e[0], e[1], e[2]) for e in effect.get("equivalents") or [])]


def _right(arm: str, row: Mapping[str, Any], n_truths: int) -> bool:
    """Whether the answer is the right one."""
    verdict = ARMS[arm][1]
    if verdict == "explained":
        return row["verdict"] == "explained" and row["named"] == n_truths and not row["false_names"]
    if verdict == "named":
        return row["verdict"] in ("explained", "partial") and row["named"] == n_truths and not row["false_names"]
    if verdict == "either":
        return not row["false_names"] and row["verdict"] != "unknown"
    if verdict == "unknown":
        return (
            row["verdict"] == "unknown" or row["imitated"] or (row["verdict"] == "partial" and not row["false_names"])
        )
    if verdict == "sensor":
        sensors = [any(key[0].startswith("sensor_") for key in _class(effect)) for effect in row["effects"]]
        return all(sensors) and row["verdict"] != "unknown"
    return row["verdict"] == "none" and not row["effects"]


def _number(value: Any) -> float | None:
    """A finite float or None, which JSON can hold."""
    return float(value) if value is not None and math.isfinite(value) else None


def _covered(truths: Sequence[Truth], effects: Sequence[Mapping[str, Any]]) -> list[bool]:
    """Whether intervals hold the true values, where an effect goes by its own name."""
    found = []
    for truth in truths:
        for effect in effects:
            if (effect["name"], effect["location"], effect["variable"]) == truth.key:
                for name, (low, high) in effect["intervals"].items():
                    if name in truth.params and name != "phase":
                        low = -math.inf if low is None else low
                        high = math.inf if high is None else high
                        found.append(bool(low <= float(truth.params[name]) <= high))
    return found


def _error(case: Case, predicted: Any) -> float:
    """Root mean square of the free-run error on the test runs, outputs in their standard deviations."""
    values = np.asarray(predicted, dtype=float).reshape(case.y_test.shape)
    return float(np.sqrt(np.mean(((values - case.y_test) / case.scale) ** 2)))


def _shrinks(case: Case, answer: Mapping[str, Any], oracle: bool) -> dict[str, Any]:
    """Shrink achieved, and by the refitted truth."""
    before = _error(
        case, [case.question.simulator.simulate(U, x0=x) for U, x in zip(case.question.X_test, case.question.x0_test)]
    )
    found: dict[str, Any] = {"error_before": before, "error_after": None, "shrink": None, "oracle": None}
    if not before > 1e-6:
        return found
    found["error_after"] = _number(_error(case, answer["predicted"]))
    if found["error_after"] is not None:
        found["shrink"] = 1.0 - found["error_after"] / before
    if oracle and case.truths and case.arm != "unexcited" and not any(t.name in NOVEL for t in case.truths):
        found["oracle"] = _number(1.0 - oracle_error(case) / before)
    return found  # fmt: skip


def oracle_error(case: Case) -> float:
    """Test error of the true effects refitted to the recorded runs: one Gauss-Newton step from the truth.

    The initial states are known to the oracle.
    """
    keys = [(i, name) for i, truth in enumerate(case.truths) for name in truth.params]
    if not keys:
        return 0.0
    U, recorded = _side_by_side(case.question.X, case.question.groups)
    steps = [max(abs(float(case.truths[i].params[name])) * 1e-3, 1e-9) for i, name in keys]
    train = [run[recorded] for run in _columns(case, U, case.starts, keys, steps)]
    test = _columns(case, case.question.X_test, case.question.x0_test, keys, steps)
    noise = ((case.question.y - train[0]) / case.noise).ravel()
    J = np.stack([((a - train[0]) / case.noise).ravel() / h for a, h in zip(train[1:], steps)], axis=1)
    J_test = np.stack([((a - test[0]) / case.scale).ravel() / h for a, h in zip(test[1:], steps)], axis=1)
    usable = np.isfinite(J).all(axis=1) & np.isfinite(noise)
    size = np.linalg.norm(J[usable], axis=0) + 1e-300
    step = np.linalg.lstsq(J[usable] / size, noise[usable], rcond=1e-8)[0] / size
    return float(np.sqrt(np.mean((J_test @ step) ** 2)))  # fmt: skip


def _side_by_side(X: np.ndarray, groups: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Runs as (n_runs, longest, n_inputs), shorter ones held at their last row, and a mask of the recorded rows."""
    lengths = np.bincount(groups)
    runs = np.split(X, np.cumsum(lengths)[:-1])
    held = [np.pad(run, ((0, int(lengths.max()) - len(run)), (0, 0)), mode="edge") for run in runs]
    return np.stack(held), np.arange(lengths.max()) < lengths[:, None]


def _columns(
    case: Case, U: np.ndarray, X0: np.ndarray, keys: list[tuple[int, str]], steps: list[float]
) -> list[np.ndarray]:
    """Measured outputs with the true parameters, and with each of them moved; all at once."""
    times, n_runs = 1 + len(keys), len(U)
    moved = []
    for i, truth in enumerate(case.truths):
        params = {name: np.full(times * n_runs, float(value)) for name, value in truth.params.items()}
        for c, ((j, name), h) in enumerate(zip(keys, steps), start=1):
            if i == j:
                params[name][c * n_runs : (c + 1) * n_runs] += h
        moved.append(Truth(truth.name, truth.location, truth.variable, params, truth.width))
    course = march(case.plant, np.tile(U, (times, 1, 1)), np.tile(X0, (times, 1)), moved, substeps=8)
    read = [case.plant.outputs.index(name) for name in case.question.simulator.outputs]
    return list(course.outputs[..., read].reshape(times, n_runs, U.shape[1], -1))  # fmt: skip


def _regions(case: Case, answer: Mapping[str, Any]) -> dict[str, Any]:
    """Errors of the edge of a region (in standard deviations of its signal) and of a moment (share of a run)."""
    found: dict[str, Any] = {"edge_error": None, "time_error": None, "region_share": None}
    found["region_f1"] = region_score(case, answer.get("where", {}).get("by_region") or [])
    found["curve"] = shape_curve(case, answer.get("missing_term"))
    found["shape"] = shape_score(found["curve"])
    mask = active(case)
    if mask is not None:
        found["region_share"] = float(mask.mean())
    for truth in case.truths:
        for effect in answer["effects"]:
            if (effect["name"], effect["location"], effect["variable"]) != truth.key:
                continue
            for name in ("edge", "limit"):
                if name in truth.params and name in effect["params"] and effect["params"][name] is not None:
                    spread = _spread(case, truth)
                    found["edge_error"] = _number(abs(effect["params"][name] - truth.params[name]) / spread)
            for name in ("time", "onset", "end"):
                if name in truth.params and effect["params"].get(name) is not None:
                    run = case.facts["n_samples"] * case.plant.dt
                    found["time_error"] = _number(abs(effect["params"][name] - truth.params[name]) / run)
    return found


def _spread(case: Case, truth: Truth) -> float:
    """Standard deviation of the signal that a limit cuts."""
    plant = case.plant
    if truth.location in plant.inputs:
        return float(np.std(case.question.X[:, plant.inputs.index(truth.location)])) + 1e-12
    if KINDS[truth.name].place == "sensor":
        return float(case.scale[list(case.question.simulator.outputs).index(truth.location)])
    name = truth.variable if truth.name == "end_stop" and truth.variable in plant.states else truth.location
    return float(np.std(case.states[:, plant.states.index(name)])) + 1e-12


def _calls(case: Case, answer: Mapping[str, Any]) -> float | None:
    """Work of the diagnosis in simulations of the recorded data by the plain simulator."""
    rhs = case.question.simulator.rhs
    if not hasattr(rhs, "columns") or not answer.get("columns"):
        return None
    before = rhs.columns
    groups = case.question.groups
    for r in range(int(groups.max()) + 1):
        case.question.simulator.simulate(case.question.X[groups == r], x0=case.starts[r])
    one = rhs.columns - before
    return float(answer["columns"]) / one if one else None
