"""What many cases show: detection over the size of the gap, unknown effects, suggested experiments, every miss."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from sksurrogate.blind._big_plants import BIG_PLANTS
from sksurrogate.blind._limits import wilson
from sksurrogate.blind._plants import PLANTS

Row = Mapping[str, Any]

#: Edges of the bins of gap / noise.
EDGES = (0.0, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0, math.inf)


def place_up_to_twins(row: Row) -> bool:
    """Whether the likely place is that of a true effect, or an exact twin's.

    That is the place of a name that these data cannot tell from a true effect, and for an input of a built-in plant that
    pushes one balance and nothing else, that balance (or the other way round).
    """
    truths = [(t["name"], t["location"], t["variable"]) for t in row["truths"]]
    places = {place for _, place, _ in truths}
    for effect in row["effects"]:
        group = [(effect["name"], effect["location"], effect["variable"]), *(tuple(e) for e in effect["equivalents"])]
        if any(truth in group for truth in truths):
            places |= {place for _, place, _ in group}
    plant = {**PLANTS, **BIG_PLANTS}.get(row["plant"])
    joined = plant.twin_places if plant else {}
    places |= {b for a, b in joined.items() if a in places} | {a for a, b in joined.items() if b in places}
    return row["likely_place"] in places


def answered(rows: Iterable[Row]) -> list[Row]:
    """Rows with an answer."""
    return [row for row in rows if "error" not in row]


def detection(rows: Sequence[Row], edges: Sequence[float] = EDGES) -> list[dict[str, Any]]:
    """How often the true effect is in the class named, over the size of the gap; arms with one effect, no detuning.

    ``edges``: of the bins of gap / noise.
    Returns list of dict: gap/noise (text), middle (geometric mean of the cases), cases, named (share), low, high
        (Wilson, 90 %), false (share with a false name), class (mean size).
    """
    some = [r for r in answered(rows) if r["arm"] in ("effect", "weak", "sizes", "region", "time")]
    found = []
    for a, b in zip(edges[:-1], edges[1:]):
        inside = [r for r in some if a <= r["gap_over_noise"] < b]
        if not inside:
            continue
        hits = sum(r["named"] > 0 for r in inside)
        low, high = wilson(hits, len(inside))
        sizes = [n for r in inside for n in r["classes"]]
        found.append(
            {
                "gap/noise": f"{a:g} to {b:g}" if math.isfinite(b) else f"over {a:g}",
                "middle": float(np.exp(np.mean([math.log(max(r["gap_over_noise"], 1e-9)) for r in inside]))),
                "cases": len(inside),
                "named": hits / len(inside),
                "low": low,
                "high": high,
                "false": float(np.mean([r["false_names"] > 0 for r in inside])),
                "class": float(np.mean(sizes)) if sizes else math.nan,
            }
        )
    return found


def unknown_scores(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """Recall and precision of "unknown": score, figure, cases, low, high (Wilson, 90 %).

    Arms have about equal numbers of cases: the precision is that of such a mixture.
    """
    some = answered(rows)
    said = [r for r in some if r["verdict"] == "unknown"]
    due = [r for r in some if r["expected"] == "unknown"]
    found = []
    for name, group, hit in (
        ("recall: said where it is due", due, [r["verdict"] == "unknown" for r in due]),
        ("precision: due where it is said", said, [r["expected"] == "unknown" for r in said]),
        ("right place or an exact twin's, where it is due", due, [place_up_to_twins(r) for r in due]),
    ):
        if group:
            low, high = wilson(sum(hit), len(hit))
            found.append({"unknown": name, "figure": sum(hit) / len(hit), "cases": len(hit), "low": low, "high": high})
    return found


def experiments(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """What the suggested next experiment was worth: score, suggested, the same run again, cases."""
    tied = [r for r in answered(rows) if "class_after" in r]
    done = [r for r in tied if r["class_after"] is not None and r["class_repeated"] is not None]
    if not tied:
        return []
    found: list[dict[str, Any]] = [
        {"next experiment": "cases with tied names", "suggested": len(tied), "same run again": "", "cases": len(tied)},
        {"next experiment": "an experiment was suggested and done", "suggested": len(done), "same run again": "", "cases": len(tied)},
    ]  # fmt: skip
    held = [r for r in done if r["truth_before"]]
    if not held:
        return found
    lead = [r for r in held if None not in (r["lead_before"], r["lead_after"], r["lead_repeated"])]
    return found + [
        _pair("mean size of the class before", held, "class_before", "class_before", np.mean),
        _pair("mean size of the class after", held, "class_after", "class_repeated", np.mean),
        _pair("share with the true effect still named", held, "truth_after", "truth_repeated", np.mean),
        _alone(held),
        _pair("lead of the true effect before, log-likelihood difference (median)", lead, "lead_before", "lead_before", np.median),
        _pair("lead of the true effect after, log-likelihood difference (median)", lead, "lead_after", "lead_repeated", np.median),
        {"next experiment": "log-likelihood difference expected (median)", "same run again": "", "cases": len(held),
         "suggested": float(np.median([r["gain_expected"] for r in held if r["gain_expected"] is not None]))},
    ]  # fmt: skip


def _pair(name: str, rows: Sequence[Row], first: str, second: str, how: Any) -> dict[str, Any]:
    """A score of the experiment suggested and of the control."""
    a, b = ([float(r[key]) for r in rows] for key in (first, second))
    return {
        "next experiment": name, "suggested": float(how(a)) if a else math.nan,
        "same run again": float(how(b)) if b else math.nan, "cases": len(rows),
    }  # fmt: skip


def _alone(rows: Sequence[Row]) -> dict[str, Any]:
    """The true effect is the only name left."""
    shares = [
        float(np.mean([bool(r[f"truth_{key}"]) and r[f"class_{key}"] == 1 for r in rows]))
        for key in ("after", "repeated")
    ]
    return {"next experiment": "share with the true effect named alone", "suggested": shares[0],
            "same run again": shares[1], "cases": len(rows)}  # fmt: skip


def misses(groups: Iterable[tuple[str, Sequence[Row]]]) -> list[dict[str, Any]]:
    """All missed cases, grouped by kind.

    ``groups`` iterable of (kind, rows): as :meth:`BlindResult.failures` gives them.
    Returns list of dict: kind, arm, seed, plant, runs (number x samples), truth, said, likely (place), gap (over the
        noise), share (closed on test runs), oracle (the same of the true effect), left (error on test runs over the
        noise).
    """
    return [_miss(kind, row) for kind, rows in groups for row in rows]


def misplaced(rows: Sequence[Row]) -> list[Row]:
    """Right answers that accuse another place (no twin's)."""
    return [r for r in answered(rows) if r["right"] and r["expected"] in ("explained", "unknown") and not place_up_to_twins(r)]  # fmt: skip


def _miss(kind: str, row: Row) -> dict[str, Any]:
    """A missed case."""
    if "error" in row:
        empty = dict.fromkeys(("plant", "runs", "truth"), "")
        return {"kind": kind, "arm": row["arm"], "seed": str(row["seed"]), **empty, "said": row["error"], "likely_place": "",
                "gap": math.nan, "share": math.nan, "oracle": math.nan, "left": math.nan}  # fmt: skip
    none = math.nan
    return {
        "kind": kind,
        "arm": row["arm"],
        "seed": str(row["seed"]),
        "plant": row["plant"],
        "runs": f"{row['n_runs']} x {row['n_samples']} {row['excitation']}",
        "truth": " + ".join(_name(t) for t in row["truths"]) or "nothing",
        "said": f"{row['verdict']}: " + (" + ".join(_name(e) for e in row["effects"]) or "-"),
        "likely_place": row["likely_place"] or "-",
        "gap": row["gap_over_noise"],
        "share": none if row["shrink"] is None else row["shrink"],
        "oracle": none if row["oracle"] is None else row["oracle"],
        "left": none if row.get("error_after") is None else row["error_after"] / row["noise"],
    }


def _name(effect: Row) -> str:
    """An effect in words."""
    return f"{effect['name']} at {effect['location']}" + (f" in {effect['variable']}" if effect["variable"] else "")
