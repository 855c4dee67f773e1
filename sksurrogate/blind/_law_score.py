"""What a law that was found is worth: its effect on held-out runs, within and beyond the range, and its structure."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from sksurrogate.blind._cases import Case
from sksurrogate.blind._laws import WITHHELD


def effect_r2(plain: np.ndarray, predicted: np.ndarray, truth: np.ndarray, scale: np.ndarray) -> float | None:
    """R2 of the missing term's effect on the outputs: what the truth differs by from the plain simulator.

    >>> y = np.arange(4.0).reshape(1, 4, 1)
    >>> effect_r2(0.0 * y, 0.9 * y, y, np.ones(1))
    0.99
    """
    moved = float(np.sum(((truth - plain) / scale) ** 2))
    missed = float(np.sum(((truth - predicted) / scale) ** 2))
    return round(1.0 - missed / moved, 12) if moved > 0 and np.isfinite(missed) else None


def law_score(case: Case, answer: Mapping[str, Any]) -> dict[str, Any]:
    """Of a case of the arm ``law``: R2 of its effect, also at 1.5 times the range, its place and its structure; else empty."""
    if case.arm != "law":
        return {}
    truth, law = case.truths[0], answer.get("law") or {}
    found: dict[str, Any] = {"law": law.get("text"), "law_certified": bool(law.get("certified"))}
    for name, predicted, X, x0, y in (
        ("law_r2", "predicted", case.question.X_test, case.question.x0_test, case.y_test),
        ("law_r2_far", "predicted_far", case.question.X_far, case.question.x0_far, case.y_far),
    ):
        found[name] = None
        if y is not None and X is not None and x0 is not None and answer.get(predicted) is not None:
            plain = np.array([case.question.simulator.simulate(U, x0=start) for U, start in zip(X, x0)])
            values = np.asarray(answer[predicted], dtype=float).reshape(y.shape)
            found[name] = effect_r2(plain, values, y, case.scale)
    kind = WITHHELD[truth.name]
    drivers = set((truth.variable or truth.location).split("*"))
    shapes = [[set(term["drivers"]), set(term["shapes"])] for term in law.get("terms", [])]
    main = [s for d, s in shapes if d == drivers]
    place = {"balance": "state", "hidden": "state", "input": "input", "sensor": "output"}[kind.place]
    found["law_place"] = (law.get("location"), law.get("kind")) == (truth.location, place)
    found["law_structure"] = bool(found["law_place"] and any(s & set(kind.marks) for s in main) and len(shapes) <= 2)
    return found
