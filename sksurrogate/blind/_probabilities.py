"""Stated probabilities against the shares that are true."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from sksurrogate.blind._limits import line

Row = Mapping[str, Any]

#: Edges of the bins in which stated and true shares are compared.
PROBABILITY_BINS = (0.0, 0.5, 0.8, 0.9, 0.95, 0.99, 1.0)
#: Times that the names are drawn anew for the limits of the error of calibration.
RESAMPLED = 400


def name_stated(row: Row) -> list[tuple[float, bool]]:
    """Probability of each name that is to explain the gap, and whether this very name is true (equivalents share the rest).

    Parameters that were detuned are off: they are not counted.
    """
    if row["verdict"] != "explained":
        return []
    seen = row["truths"] if row["expected"] != "none" else []
    truths = [(t["name"], t["location"], t["variable"]) for t in seen]
    return [
        (e["probability"], (e["name"], e["location"], e["variable"]) in truths)
        for e in row["effects"]
        if e.get("probability") is not None and not (row["arm"] == "detuned" and e["name"] == "parameter_error")
    ]


def class_stated(row: Row) -> list[tuple[float, bool]]:
    """Probability of each name that is given, and whether it, or a member of its class, acts.

    Where sensors drift or differ every name of a sensor is true. Parameters that the arm moved are not counted.
    """
    if row["verdict"] not in ("explained", "partial"):
        return []
    truths = {(t["name"], t["location"], t["variable"]) for t in row["truths"]} if row["arm"] != "unexcited" else set()
    pairs = []
    for effect in row["effects"]:
        members = [
            (effect["name"], effect["location"], effect["variable"]),
            *(tuple(e[:3]) for e in effect["equivalents"]),
        ]
        moved = row["arm"] in ("detuned", "far") and any(name == "parameter_error" for name, _, _ in members)
        if effect.get("probability") is not None and not moved:
            of_sensor = row["expected"] == "sensor" and any(name.startswith("sensor_") for name, _, _ in members)
            pairs.append((float(effect["probability"]), of_sensor or bool(truths & set(members))))
    return pairs


def reliability_points(pairs: Sequence[tuple[float, bool]]) -> list[tuple[float, float, int]]:
    """Mean stated probability, share that acts and count of the names in every bin of :data:`PROBABILITY_BINS` that holds some.

    >>> reliability_points([(0.5, True), (0.75, False), (0.97, True)])
    [(0.625, 0.5, 2), (0.97, 1.0, 1)]
    """
    if not pairs:
        return []
    stated, true = np.array(pairs, dtype=float).T
    place = _bins(stated)
    groups = [place == k for k in range(1, len(PROBABILITY_BINS))]
    return [(float(stated[g].mean()), float(true[g].mean()), int(g.sum())) for g in groups if g.any()]


def calibration_error(pairs: Sequence[tuple[float, bool]]) -> tuple[float, float, float]:
    """Mean distance between stated and true shares over :data:`PROBABILITY_BINS`, and its 90 % limits by resampling the names.

    >>> round(calibration_error([(0.9, True)] * 9 + [(0.9, False)])[0], 6)
    0.0
    """
    if not pairs:
        return np.nan, np.nan, np.nan
    stated, true = np.array(pairs, dtype=float).T
    place = _bins(stated)

    def error(some: np.ndarray) -> float:
        apart = np.bincount(place[some], stated[some] - true[some], len(PROBABILITY_BINS))
        return float(np.sum(np.abs(apart)) / len(some))

    rng = np.random.default_rng(0)
    again = [error(rng.integers(len(stated), size=len(stated))) for _ in range(RESAMPLED)]
    low, high = np.quantile(again, [0.05, 0.95])
    return error(np.arange(len(stated))), float(low), float(high)


def calibration(question: str, pairs: Sequence[tuple[float, bool]], bar: float, at_most: bool = True) -> dict[str, Any]:
    """The error of calibration as a line of a table."""
    error, low, high = calibration_error(pairs)
    return line(question, f"at most {bar:g}", error, len(pairs), low, high, error <= bar, not low < bar < high)


def _bins(stated: np.ndarray) -> np.ndarray:
    """Bin of every probability, 1 to the number of bins."""
    return np.clip(np.searchsorted(PROBABILITY_BINS, stated, side="right"), 1, len(PROBABILITY_BINS) - 1)
