"""The verdict in one sentence, and what to do next, one line each."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sksurrogate.gap.render._values import change_of, confidence, number, percent, place_of, readable
from sksurrogate.gap.results._effect_estimate import EffectEstimate
from sksurrogate.gap.results._next_experiment import NATS_THAT_SETTLE
from sksurrogate.gap.results._report_data import ReportData

__all__ = [
    "changes",
    "first_of",
    "headline",
    "joined",
    "next_steps",
    "not_identified",
    "richer_forms",
    "separating",
]

#: Candidates that a line lists.
LISTED = 4
#: Below this error (share of the outputs' deviation) a gap is said to be small.
SMALL = 0.005
#: A formula longer than this (characters) is not read in a sentence.
LONGEST_LINE = 80


def joined(names: Sequence[str]) -> str:
    """ "a, b and c"."""
    return names[0] if len(names) == 1 else ", ".join(names[:-1]) + " and " + names[-1]


def changes(report: ReportData) -> list[tuple[str, list[str], str]]:
    """Every named effect and every parameter that was re-tuned: what it is, its lines, how sure it is."""
    out = []
    for effect in report.effects:
        what = "parameter" if effect.name == "parameter_error" else place_of(effect)
        share = "" if np.isnan(effect.share) else f", {percent(effect.share)} of the gap"
        out.append((what, change_of(effect, report.nominal, report.units), confidence(effect.probability) + share))
    named = {effect.location for effect in report.effects if effect.name == "parameter_error"}
    moved = [row for row in report.retuned if row.get("moved") and row["parameter"] not in named]
    if moved:
        out.append(("re-tuned", [_retuned(row, report) for row in moved], ""))
    return out


def _retuned(row: object, report: ReportData) -> str:
    """``name: before -> after unit [low, high]``."""
    wrong = EffectEstimate(
        "parameter_error", row["parameter"], None, 1.0, {"relative_error": row["value"]},  # type: ignore[index]
        {"relative_error": (row["low"], row["high"])}, 1.0,  # type: ignore[index]
    )  # fmt: skip
    line = change_of(wrong, {wrong.location: 0.0}, report.units)[0]
    return line.replace(": 0 ->", f": {number(row['nominal'])} ->", 1)  # type: ignore[index]


def headline(report: ReportData) -> str:
    """The verdict in one sentence.

    Parameters
    ----------
    report : GapReport

    Returns
    -------
    str
    """
    shrink, where = report.shrink, report.where
    closed = f"{percent(shrink.fraction)} of the gap on runs left out" if np.isfinite(shrink.fraction) else ""
    if not report.complete and report.verdict == "unknown" and where.location is None:
        return "The diagnosis was interrupted before its verdict."
    if report.verdict == "none":
        if shrink.measurable and shrink.before < SMALL:
            return f"The simulator misses the outputs by {percent(shrink.before)} of their deviation, too little to matter."
        return "The simulator agrees with the data to within noise and disturbance."
    named = joined([_short(effect, report) for effect in report.effects]) if report.effects else "re-tuned parameters"
    if report.verdict == "explained":
        text = f"The gap is explained by {named}"
        return f"{text}, which closes {closed}." if closed else f"{text}."
    if report.verdict == "partial":
        rest = f"; {percent(report.remainder.share)} remains" if np.isfinite(report.remainder.share) else ""
        return f"The gap is explained in part by {named}: {closed or 'an unknown share'} is closed{rest}{_with_law(report)}."
    if where.location is None:
        return "Something is missing, and these data do not show where."
    place = f"the balance of {where.location}" if where.kind == "state" else f"the {where.kind} {where.location}"
    text = f"Something that is not in the catalogue is missing, most likely at {place}"
    return f"{text}{_with_law(report)}."


def _with_law(report: ReportData) -> str:
    """The certified law, and what it closes; empty without one."""
    law = None if report.missing_term is None else report.missing_term.law
    if law is None or not law.certified:
        return ""
    form = str(law) if len(str(law)) <= LONGEST_LINE else "a law (below)"
    closed = report.shrink.fraction_law
    return f": {form}" + (f" closes {percent(closed)} of the gap on runs left out" if np.isfinite(closed) else "")


def _short(effect: EffectEstimate, report: ReportData) -> str:
    """An effect with what it changes, in a few words."""
    line = change_of(effect, report.nominal, report.units)[0] if effect.params else ""
    change, _, _ = line.partition(" [")
    if effect.name == "parameter_error":
        return f"the parameter {change}"
    return f"{place_of(effect)} ({change})" if change else place_of(effect)


def richer_forms(effect: EffectEstimate) -> list[str]:
    """Effects that contain the named one and fit no better."""
    return [_key(key) for key in effect.richer]


def not_identified(effect: EffectEstimate) -> list[str]:
    """Other effects that these data cannot tell from the named one, without its richer forms."""
    richer = set(map(tuple, effect.richer))
    return [_key(key) for key in effect.equivalents if tuple(key) not in richer]


def first_of(names: Sequence[str]) -> str:
    """The first names of a list, and how many more there are.

    Examples
    --------
    >>> first_of(["drag", "friction", "hysteresis", "lag", "bias", "gain"])
    'drag; friction; hysteresis; lag; and 2 more'
    """
    more = len(names) - LISTED
    return "; ".join([*names[:LISTED], *([f"and {more} more"] if more > 0 else [])])


def _key(key: Sequence[str | None]) -> str:
    driven = f", driven by {key[2]}" if key[2] and key[2] != key[1] else ""
    return f"{readable(str(key[0]))} at {key[1]}{driven}"


def separating(report: ReportData) -> list[dict]:
    """The experiments that separate what is tied, the best first."""
    experiment = report.next_experiment
    rows = [] if experiment is None else [dict(row) for row in experiment.options]
    return [row for row in rows if row.get("gain", 0.0) >= NATS_THAT_SETTLE]


def next_steps(report: ReportData) -> list[str]:
    """What to do next, one line each."""
    steps = [f"{fault.location or 'Record'}: {fault.remedy}" for fault in report.data if fault.remedy]
    if not report.complete:
        steps.append(
            "Run the diagnosis again for a verdict: fewer candidates (effects=[...]) or n_jobs=2 make it faster."
        )
    if report.verdict == "none":
        return [*steps, "To look further, excite the plant harder or over a wider range, and record again."]
    tied = [effect for effect in report.effects if not_identified(effect)]
    best = separating(report)
    if tied and best:
        nats = number(best[0]["gain"], 2) if best[0]["gain"] < 1000 else "more than 1000"
        beyond = "" if best[0].get("within", True) else "; its inputs leave the recorded range"
        steps.append(
            f"Record {best[0]['experiment']} to separate {best[0]['between']} ({nats} nats expected, 3 are enough{beyond})."
        )
    elif tied and report.next_experiment is not None:
        others = joined([place_of(tied[0]), *not_identified(tied[0])[:LISTED]])
        steps.append(f"Measure another signal, or use knowledge of the plant, to decide between {others}.")
    if report.verdict in ("explained", "partial"):
        steps.append("Use diagnoser.augmented_ as the new simulator.")
    if report.verdict in ("partial", "unknown"):
        steps += _unexplained(report)
    return steps


def _unexplained(report: ReportData) -> list[str]:
    """What to do about what remains."""
    term = report.missing_term
    if term is not None and term.law is not None and term.law.certified:
        return [
            "Check the law of the missing term (below) against physics; diagnoser.augmented_ carries it unless include_law=False."
        ]
    if term is not None and term.effects:
        return [
            "Compare the laws below with the catalogue: GapDiagnoser(simulator, effects=[*CATALOGUE.values(), *report.missing_term.effects])."
        ]
    if term is not None and term.curves:
        return [
            "Look at the shape of the missing term below; add an effect of your own, or learn it: HybridRegressor(simulator)."
        ]
    return ["Add an effect of your own to the catalogue, or learn the rest: HybridRegressor(simulator)."]
