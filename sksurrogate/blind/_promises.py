"""What a diagnosis promises, asked of scored cases: each promise as data, its figure with 90 % limits."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sksurrogate.blind._limits import line, median, share

__all__ = ["PROMISES", "Promise", "class_stated", "promises", "reliability_points"]

Row = Mapping[str, Any]

#: A right name that closes more than this share of the gap (amplitude) on unseen runs is never called unknown.
CLOSES = 0.95
#: Stated probabilities from here on are counted as certain; edges of the bins in which stated and true shares are compared.
CERTAIN = 0.99
BINS = (0.0, 0.5, 0.8, 0.9, 0.95, 0.99, 1.0)


@dataclass(frozen=True)
class Promise:
    """A question about the cases of some arms, and the share of good answers that is promised."""

    question: str
    arms: tuple[str, ...]
    bar: float
    good: Callable[[Row], bool] = lambda row: bool(row["right"])
    at_most: bool = False  #: The bar is an upper one, and ``good`` says which answers are bad


def false_name(row: Row) -> bool:
    """A name where nothing acts; no answer counts as one."""
    return "error" in row or row["false_names"] > 0


PROMISES: tuple[Promise, ...] = (
    Promise("one effect, in all runs, a region or a time: named, nothing else", ("effect", "region", "time", "onset"), 0.98),
    Promise("one effect, runs of unequal lengths: named, nothing else", ("unequal",), 0.98),
    Promise("one effect, parameters 20 % off: named, nothing else", ("far",), 0.95),
    Promise("two effects: both named, nothing else", ("two",), 0.94),
    Promise("three effects: all named, nothing else", ("three",), 0.90),
    Promise("a form that is not the catalogue's: its name, explained or partial, nothing else", ("inexact",), 0.95),
    Promise(
        "no effect (white, coloured, disturbed, spikes, tails, unreached): false names",
        ("none", "coloured", "disturbed", "spikes", "tails", "unexcited"),
        0.01,
        false_name,
        at_most=True,
    ),
    Promise("sensors that drift or differ from run to run: none, or the sensor's name", ("trends",), 0.99),
    Promise(
        "taken out of the catalogue: unknown, partial without a false name, or imitated",
        ("outside", "novel", "outside_disturbed"),
        0.95,
    ),
)  # fmt: skip


def promises(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """One line for each promise of which there are cases.

    Parameters
    ----------
    rows : sequence of dict
        Rows of a blind check.

    Returns
    -------
    list of dict
        question, bar, figure, cases, low, high (90 %), cleared, as :func:`sksurrogate.blind._bars.bars` gives them.
    """
    judged = [row for row in rows if row.get("right") is not None]
    found = [
        share(one.question, [one.good(row) for row in judged if row["arm"] in one.arms], one.bar, one.at_most)
        for one in PROMISES
    ]
    answered = [row for row in judged if "error" not in row]
    return [
        one
        for one in (*found, *_of_probabilities(answered), _of_the_budget(answered), _of_closing(answered))
        if one["cases"]
    ]


def class_stated(row: Row) -> list[tuple[float, bool]]:
    """Probability of each name that is given, and whether it, or a member of its class, acts.

    Where sensors drift or differ the sensor's name is true. Parameters that the arm moved are not counted.
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
            of_sensor = row["expected"] == "sensor" and effect["name"].startswith("sensor_")
            pairs.append((float(effect["probability"]), of_sensor or bool(truths & set(members))))
    return pairs


def _of_probabilities(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """How far stated probabilities are from the shares that are true."""
    pairs = [pair for row in rows for pair in class_stated(row)]
    certain = [true for chance, true in pairs if chance >= CERTAIN]
    error, low, high = calibration_error(pairs)
    return [
        line("stated probability: error of calibration", "at most 0.02", error, len(pairs), low, high, error <= 0.02, not low < 0.02 < high),
        share("stated 0.99 and more: true", certain, 0.985),
    ]  # fmt: skip


def reliability_points(rows: Sequence[Row]) -> list[tuple[float, float, int]]:
    """Mean stated probability, share that acts and count of the names in every bin of :data:`BINS` that holds some."""
    pairs = [pair for row in rows if "error" not in row for pair in class_stated(row)]
    if not pairs:
        return []
    stated, true = np.array(pairs, dtype=float).T
    place = _bins(stated)
    groups = [place == k for k in range(1, len(BINS))]
    return [(float(stated[g].mean()), float(true[g].mean()), int(g.sum())) for g in groups if g.any()]


def _bins(stated: np.ndarray) -> np.ndarray:
    """Bin of every probability, 1 to the number of bins."""
    return np.clip(np.searchsorted(BINS, stated, side="right"), 1, len(BINS) - 1)


def calibration_error(pairs: Sequence[tuple[float, bool]], draws: int = 400) -> tuple[float, float, float]:
    """Mean distance between stated and true shares over :data:`BINS`, and its 90 % limits by resampling the names.

    Examples
    --------
    >>> round(calibration_error([(0.9, True)] * 9 + [(0.9, False)])[0], 6)
    0.0
    """
    if not pairs:
        return np.nan, np.nan, np.nan
    stated, true = np.array(pairs, dtype=float).T
    place = _bins(stated)

    def error(some: np.ndarray) -> float:
        apart = np.bincount(place[some], stated[some] - true[some], len(BINS))
        return float(np.sum(np.abs(apart)) / len(some))

    rng = np.random.default_rng(0)
    again = [error(rng.integers(len(stated), size=len(stated))) for _ in range(draws)]
    low, high = np.quantile(again, [0.05, 0.95])
    return error(np.arange(len(stated))), float(low), float(high)


def _of_the_budget(rows: Sequence[Row]) -> dict[str, Any]:
    """Share of the gap that the report says is closed, beside the share that is closed on unseen runs without their noise."""
    apart = [
        abs(row["predicted_shrink"] - row["shrink"])
        for row in rows
        if row["effects"] and row.get("predicted_shrink") is not None and row.get("shrink") is not None
    ]
    return median("budget: closed share stated less closed on unseen runs", apart, 0.05, at_most=True)


def _of_closing(rows: Sequence[Row]) -> dict[str, Any]:
    """Right names that close nearly all of the gap."""
    closing = [row for row in rows if row["named"] and not row["false_names"] and (row["shrink"] or 0.0) > CLOSES]
    known = [row["verdict"] != "unknown" for row in closing]
    return share("right names that close more than 95 % on unseen runs: not called unknown", known, 1.0)
