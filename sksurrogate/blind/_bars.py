"""Figures with their uncertainty beside the bars they have to clear, and what grows with the size of the gap."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from sksurrogate.blind._limits import mean, median, share, wilson
from sksurrogate.blind._plants import PLANTS

__all__ = [
    "bars",
    "detection",
    "experiments",
    "misplaced",
    "misses",
    "place_up_to_twins",
    "stated",
    "unknown_scores",
]

Row = Mapping[str, Any]

#: Arms whose intervals are counted, and arms whose right answer is "unknown".
NAMED_ARMS = ("effect", "two", "weak", "sizes", "detuned", "effect_disturbed", "region", "time")
UNKNOWN = ("outside", "novel", "outside_disturbed")
#: Arms in which the true effect and its twins are taken out of the catalogue; the others are asked with the whole of it.
PARTIAL_CATALOGUE_ARMS = ("outside", "outside_disturbed")
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
    joined = PLANTS[row["plant"]].twin_places if row["plant"] in PLANTS else {}
    places |= {b for a, b in joined.items() if a in places} | {a for a, b in joined.items() if b in places}
    return row["accused"] in places


def bars(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """One line for each bar.

    Parameters
    ----------
    rows : sequence of dict
        Rows of a blind check.

    Returns
    -------
    list of dict
        question, bar, figure, cases, low, high (90 %: Wilson's for shares, order statistics for medians, normal for
        means), cleared ("yes" or "no", with ", open" where the interval holds the bar: more cases would tell).
    """
    by: dict[str, list[Row]] = {}
    for row in rows:
        if row.get("right") is not None:
            by.setdefault(row["arm"], []).append(row)
    every: Mapping[str, list[Row]] = by
    found = [*_named_bars(every), *_control_bars(every), *_unknown_bars(every), *_size_bars(every)]
    return [line for line in found if line["cases"]]


def _of(by: Mapping[str, list[Row]], *arms: str) -> list[Row]:
    """Rows of some arms."""
    return [row for arm in arms for row in by.get(arm, [])]


def _answered(rows: Iterable[Row]) -> list[Row]:
    """Rows with an answer."""
    return [row for row in rows if "error" not in row]


def _named_bars(by: Mapping[str, list[Row]]) -> list[dict[str, Any]]:
    """Names, classes and places."""
    one, weak = _of(by, "effect"), _of(by, "weak")
    known = all("gap_beyond_retuning" in r for r in _of(by, "detuned"))
    seen = [r for r in _of(by, "detuned") if known and r["gap_beyond_retuning"] >= 4.0]
    return [
        share("one effect: named, nothing else", [bool(r["right"]) for r in one], 0.98),
        mean("one effect: mean size of the class", [n for r in _answered(one) for n in r["classes"]], 2.5),
        share("one effect: its place or an exact twin's", ["error" not in r and place_up_to_twins(r) for r in one], 0.98),
        share("one effect in a region: named, nothing else", [bool(r["right"]) for r in _of(by, "region")], 0.98),
        share("one effect from some time on: named, nothing else", [bool(r["right"]) for r in _of(by, "time")], 0.98),
        share("two effects: both named, nothing else", [bool(r["right"]) for r in _of(by, "two")], 0.93),
        share("weak effect: in the class", ["error" not in r and r["named"] > 0 for r in weak], 0.95),
        mean("weak effect: mean size of the class", [n for r in _answered(weak) for n in r["classes"]], 4.0),
        share("parameters off by 8 %: named, nothing else", [bool(r["right"]) for r in _of(by, "detuned")], 0.95),
        share("the same, where re-tuning leaves a gap of 4 x noise", [bool(r["right"]) for r in seen], 0.95),
        share("beside a disturbance: named, nothing else", [bool(r["right"]) for r in _of(by, "effect_disturbed")], 0.95),
    ]  # fmt: skip


def _control_bars(by: Mapping[str, list[Row]]) -> list[dict[str, Any]]:
    """False names where there is nothing."""
    asked = (
        ("no effect, white noise: false names", "none", 0.02),
        ("no effect, coloured disturbance: false names", "disturbed", 0.03),
        ("no effect, coloured sensor noise: false names", "coloured", 0.05),
        ("effect never reached: false names", "unexcited", 0.02),
    )
    return [
        share(text, ["error" in r or bool(r["effects"]) for r in _of(by, arm)], most, at_most=True)
        for text, arm, most in asked
    ]


def _unknown_bars(by: Mapping[str, list[Row]]) -> list[dict[str, Any]]:
    """Effects outside the catalogue."""
    plain = _of(by, "outside", "novel")
    return [
        share("outside the catalogue: unknown", [bool(r["right"]) for r in plain], 0.97),
        share(
            "outside the catalogue: its place or an exact twin's",
            ["error" not in r and place_up_to_twins(r) for r in plain],
            0.95,
        ),
        share(
            "outside the catalogue, beside a disturbance: unknown",
            [bool(r["right"]) for r in _of(by, "outside_disturbed")],
            0.95,
        ),
    ]


def _size_bars(by: Mapping[str, list[Row]]) -> list[dict[str, Any]]:
    """Intervals, shrink, seconds."""
    covered = [bool(v) for r in _answered(_of(by, *NAMED_ARMS)) for v in r["covered"]]
    inside = share("90 % intervals that hold the truth", covered, 0.85)
    low, high, figure = inside["low"], inside["high"], inside["figure"]
    inside["bar"] = "85 to 95 %"
    sure = (low >= 0.85 and high <= 0.95) or low > 0.95 or high < 0.85
    inside["cleared"] = ("yes" if 0.85 <= figure <= 0.95 else "no") + ("" if sure else ", open")
    one = [r for r in _answered(_of(by, "effect")) if r["shrink"] is not None]
    against = [r["shrink"] / r["oracle"] for r in one if (r.get("oracle") or 0) > 0.1]
    timed = [r for r in _answered(_of(by, *by)) if r["n_runs"] == 6 and r.get("n_states", 2) >= 2]
    timed = [r for r in timed if r.get("abreast") == 1] or timed  # one diagnosis at a time has the machine's cores
    timed = [r for r in timed if r["seconds"] is not None]
    whole = [r for r in timed if r["arm"] not in PARTIAL_CATALOGUE_ARMS]
    part = [r["seconds"] for r in timed if r["arm"] in PARTIAL_CATALOGUE_ARMS]
    busy = [r["processor_seconds"] for r in whole if r.get("processor_seconds") is not None]
    return [
        inside,
        median("shrink on runs nobody fitted (the true effect with its true parameters: 1)", [r["shrink"] for r in one], 0.98),
        median("shrink over that of the true effect refitted", against, 0.98),
        median("seconds, 2 to 4 states, 6 x 300 samples, the whole catalogue", [r["seconds"] for r in whole], 3.0, at_most=True),
        median("processor seconds of two cores, the same", busy, 6.0, at_most=True),
        median("seconds where the true effect is taken out of the catalogue", part, 3.0, at_most=True),
    ]  # fmt: skip


def detection(rows: Sequence[Row], edges: Sequence[float] = EDGES) -> list[dict[str, Any]]:
    """How often the true effect is in the class named, over the size of the gap; arms with one effect, no detuning.

    Parameters
    ----------
    rows : sequence of dict
    edges : sequence of float
        Of the bins of gap / noise.

    Returns
    -------
    list of dict
        gap/noise (text), middle (geometric mean of the cases), cases, named (share), low, high (Wilson, 90 %), false
        (share with a false name), class (mean size).
    """
    some = [r for r in _answered(rows) if r["arm"] in ("effect", "weak", "sizes", "region", "time")]
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
    some = _answered(rows)
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
    tied = [r for r in _answered(rows) if "class_after" in r]
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
        _pair("lead of the true effect before, nats (median)", lead, "lead_before", "lead_before", np.median),
        _pair("lead of the true effect after, nats (median)", lead, "lead_after", "lead_repeated", np.median),
        {"next experiment": "gain expected, nats (median)", "same run again": "", "cases": len(held),
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

    Parameters
    ----------
    groups : iterable of (kind, rows)
        As :meth:`BlindResult.failures` gives them.

    Returns
    -------
    list of dict
        kind, arm, seed, plant, runs (number x samples), truth, said, likely (place), gap (over the noise), share (closed
        on test runs), oracle (the same of the true effect), left (error on test runs over the noise).
    """
    return [_miss(kind, row) for kind, rows in groups for row in rows]


def stated(row: Row) -> list[tuple[float, bool]]:
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


def misplaced(rows: Sequence[Row]) -> list[Row]:
    """Right answers that accuse another place (no twin's)."""
    return [r for r in _answered(rows) if r["right"] and r["expected"] in ("explained", "unknown") and not place_up_to_twins(r)]  # fmt: skip


def _miss(kind: str, row: Row) -> dict[str, Any]:
    """A missed case."""
    if "error" in row:
        empty = dict.fromkeys(("plant", "runs", "truth"), "")
        return {"kind": kind, "arm": row["arm"], "seed": str(row["seed"]), **empty, "said": row["error"], "accused": "",
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
        "accused": row["accused"] or "-",
        "gap": row["gap_over_noise"],
        "share": none if row["shrink"] is None else row["shrink"],
        "oracle": none if row["oracle"] is None else row["oracle"],
        "left": none if row.get("error_after") is None else row["error_after"] / row["noise"],
    }


def _name(effect: Row) -> str:
    """An effect in words."""
    return f"{effect['name']} at {effect['location']}" + (f" in {effect['variable']}" if effect["variable"] else "")
