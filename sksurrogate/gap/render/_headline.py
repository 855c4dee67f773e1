"""The verdict in one sentence, and what to do next, one line each: the same for terminal, page and ``report.sentence``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from sksurrogate.gap.decide._rules import PRACTICAL
from sksurrogate.gap.render._units import TIME
from sksurrogate.gap.render._values import (
    MORE_LIKELY_THAN_NOT,
    capitalised,
    change_of,
    confidence,
    effect_text,
    held_out,
    is_wrong_parameter,
    key_text,
    moved_text,
    number,
    percent,
    quantity,
)
from sksurrogate.gap.results._data_faults import DataFault
from sksurrogate.gap.results._effect_estimate import EffectEstimate
from sksurrogate.gap.results._next_experiment import ENOUGH, NATS_THAT_SETTLE, TIED_LISTED, first_of
from sksurrogate.gap.results._reasons import UNDECIDED
from sksurrogate.gap.results._report_data import ReportData
from sksurrogate.gap.results._where import place_in_words

#: What to do after a diagnosis that stopped early, and with the new simulator of a command.
AGAIN = "Run the diagnosis again: with more time, fewer candidates (effects=[...]) or more workers (n_jobs=2)."
AGAIN_BY_COMMAND = (
    "Run the diagnosis again: with more time (--time-limit), fewer candidates (--effects) or more workers (--jobs 2)."
)
SAVE_BY_COMMAND = (
    "Keep the new simulator with --save FILE.json; sksurrogate.effects.load_augmented(simulator, FILE.json) reads it."
)
#: What tells a disturbance from an effect.
REPEAT = "Repeat a run with the same inputs: what comes back is an effect, what does not is a disturbance."
#: A fault of the record that is less of the gap, "0 %", is the last thing to do.
SHOWN_AS_NOTHING = 0.005
#: A formula longer than this (characters) is not read in a sentence.
LONGEST_LINE = 80


def joined(names: Sequence[str]) -> str:
    """ "a, b and c"."""
    return names[0] if len(names) == 1 else ", ".join(names[:-1]) + " and " + names[-1]


def _lines(effect: EffectEstimate, report: ReportData) -> list[str]:
    """What an effect changes, one line a parameter."""
    retuned = {str(row["parameter"]): float(row["value"]) for row in report.retuned if "value" in row}
    return change_of(effect, report.nominal, report.units, report.ranges, retuned)


def changes(report: ReportData) -> list[tuple[str, list[str], str]]:
    """Every named effect and the re-tuned parameters: what it is, its lines, how sure it is."""
    out = []
    for effect in report.effects:
        what = f"parameter {effect.location}" if effect.name == "parameter_error" else effect_text(effect)
        out.append((what, _lines(effect, report), confidence(effect.probability)))
    named = {effect.location for effect in report.effects if is_wrong_parameter(effect)}
    rows = [row for row in report.retuned if "value" in row and row["parameter"] not in named]
    moved = [_retuned(row, report) for row in rows if row.get("moved")]
    as_before = [str(row["parameter"]) for row in rows if not row.get("moved")]
    if as_before:
        moved.append(f"90 % interval holds the value before: {', '.join(as_before)}")
    return [*out, ("re-tuned", moved, "")] if moved else out


def _retuned(row: Mapping[str, Any], report: ReportData) -> str:
    """A re-tuned parameter before and after."""
    name, ends = row["parameter"], (row["low"], row["high"])
    return moved_text(name, row["nominal"], row["value"], ends, report.units.get(name, ""))


def headline(report: ReportData) -> str:
    """The verdict in one sentence, or two, and what stands behind a reservation."""
    return f"{_verdict(report)}{_reservation(report)}"


def _reservation(report: ReportData) -> str:
    """That effects could not be tried; empty where all could."""
    if not report.mistakes:
        return ""
    return (
        f" But the simulator has a mistake, and effects that needed this part of it could not be tried: {report.mistakes[0].rstrip('.')}."
        " The right effect may be one of them: mend it and diagnose again."
    )


def _verdict(report: ReportData) -> str:
    """The verdict in one sentence, or two."""
    if _is_undecided(report):
        by_then = f" Found by then, not judged yet: {_named(report)}." if report.effects else ""
        return f"The diagnosis stopped before it had an answer.{by_then}"
    if report.verdict == "none":
        return _no_gap(report)
    if report.verdict in ("explained", "partial"):
        part, rest = (" in part", _what_remains(report)) if report.verdict == "partial" else ("", _disturbed(report))
        return f"The gap is explained{part} by {_named(report)}{_which_closes(report)}.{_doubtful(report)}{rest}"
    if report.reasons.rule == "other_unit":
        return "The record seems to be written otherwise than the simulator expects: in another unit, or with its columns in another order."
    return _uncertain(report) if report.reasons.rule == "uncertain_names" else _unknown(report)


def _is_undecided(report: ReportData) -> bool:
    """Whether the diagnosis stopped before its verdict."""
    return not report.complete and report.reasons.rule == UNDECIDED.rule


def _named(report: ReportData) -> str:
    """The effects with what they change, or the re-tuned parameters."""
    return joined([_short(effect, report) for effect in report.effects] or ["re-tuned parameters"])


def _closed(report: ReportData) -> str:
    """How much of the gap they close; empty where that is not known."""
    if not np.isfinite(report.shrink.fraction):
        return ""
    verb = "closes" if len(report.effects) == 1 else "close"
    return f"{verb} {percent(report.shrink.fraction)} of the gap on {held_out(report)}"


def _which_closes(report: ReportData) -> str:
    """The same as a relative clause."""
    closed = _closed(report)
    return f", which {closed}" if closed else ""


def _disturbed(report: ReportData) -> str:
    """That what an explained gap leaves is a disturbance, where it is more than the tolerance; or a law that no formula of holds."""
    if report.reasons.rule != "disturbance_left":
        return ""
    seen = report.reasons.features
    if seen.get("lawful", 0.0) > seen.get("tolerance", np.inf):
        return f" What is left looks like a law, but no formula of it was found that holds on {held_out(report)}."
    return " What is left follows no law that was found."


def _doubtful(report: ReportData) -> str:
    """That a name closes the gap, and yet something else is likelier to be its cause; empty where that is not so."""
    doubtful = [effect for effect in report.effects if effect.probability < MORE_LIKELY_THAN_NOT]
    if not doubtful:
        return ""
    names, it = joined([effect_text(effect) for effect in doubtful]), "it" if len(doubtful) == 1 else "them"
    whether = "The corrected simulator is good, but whether" if report.verdict == "explained" else "Whether"
    return f" {whether} {names} act{'s' if len(doubtful) == 1 else ''} is uncertain: another cause may look like {it} in these data."


def _no_gap(report: ReportData) -> str:
    """Too small to matter, or within noise and disturbance."""
    shrink = report.shrink
    if shrink.measurable and shrink.before < PRACTICAL:
        return f"The simulator misses the outputs by {percent(shrink.before)} of their deviation, too little to matter."
    cleaned = ", once the faults of the record are taken out" if any(fault.taken_out for fault in report.data) else ""
    return f"The simulator agrees with the data to within noise and disturbance{cleaned}."


def _uncertain(report: ReportData) -> str:
    """The likeliest effects, of which at least one is not certain."""
    weakest, features = min(report.effects, key=lambda effect: effect.probability), report.reasons.features
    likely = f"{effect_text(weakest)} is " * (len(report.effects) > 1) + confidence(weakest.probability)
    if not features.get("shown", True):
        likely = "the data do not show its form (see the note)"
    elif not features.get("sized", True):
        likely = "the interval of a magnitude includes the value at which it does nothing"
    be = "is" if len(report.effects) == 1 else "are"
    return f"There is no certain answer. The likeliest {be} {_named(report)}{_which_closes(report)}: {likely}.{_with_law(report)}"


def _unknown(report: ReportData) -> str:
    """The place of what is missing, and what is not enough."""
    named, closed = _named(report), _closed(report)
    not_enough = f" {capitalised(named)} {closed}, not enough." if report.effects and closed else ""
    if report.where.location is None:
        return f"Something is missing, and these data do not show where.{not_enough}"
    place = place_in_words(report.where.kind, report.where.location)
    text = f"Something that is not in the catalogue is missing, most likely at {place}."
    if _may_be_a_disturbance(report):
        text = f"No effect and no law explains the gap: a large disturbance, or something that is not in the catalogue, most likely at {place}."
    return f"{text}{not_enough}{_with_law(report) or _nearest_law(report)}"


def _may_be_a_disturbance(report: ReportData) -> bool:
    """Whether most of a gap without a name follows no law either."""
    shares = [row["share"] for row in report.budget if row["kind"] == "disturbance"]
    return report.reasons.rule == "unnamed_and_far" and sum(shares) > 0.5


def sentence_of(report: ReportData) -> str:
    """What ``report.sentence`` says: the headline, faults of the record, what to do next."""
    return " ".join(part for part in (headline(report), report.data.sentence, *_steps(report)) if part)


def _what_remains(report: ReportData) -> str:
    """The certified law, or the likeliest place of what remains."""
    rest = report.remainder
    if _with_law(report):
        return _with_law(report)
    if rest.location is None or not rest.lawful > 0:
        return ""
    driven = f", driven by {rest.variable}" if rest.variable and rest.kind != "parameter" else ""
    return f" What remains is most likely at {place_in_words(rest.kind, rest.location)}{driven}."


def _with_law(report: ReportData) -> str:
    """The certified law, and what it closes; empty without one."""
    law = report.certified_law
    if law is None:
        return ""
    what = "free curve" if law.is_curve else "law"
    elsewhere = " (below)" if report.provenance.command else " (report.missing_term.law)"
    form = f" {str(law).removeprefix('curve ')}" if len(str(law)) <= LONGEST_LINE else elsewhere
    closed, several = report.shrink.fraction_law, len(report.effects) > 1
    beside, instead = (" beside them", " in their place") if several else (" beside it", " in its place")
    where = (beside if report.verdict == "partial" else instead) if report.effects else ""
    how_far = f" closes {percent(closed)} of the gap on {held_out(report)}" if np.isfinite(closed) else " was found"
    return f" The {what}{form} in {law.place}{where}{how_far}."


def _nearest_law(report: ReportData) -> str:
    """The first formula of the missing term that is short."""
    term = report.missing_term
    text = next((c for c in term.candidates if len(c) < LONGEST_LINE), None) if term is not None else None
    if text is None:
        return ""
    form, _, share = text.partition("  (explains ")
    much = f" It explains {share.rstrip(')')} of what is missing on {held_out(report)}." if share else ""
    return f" A simple law comes close: {form}.{much}"


def _short(effect: EffectEstimate, report: ReportData) -> str:
    """An effect with what it changes and since when, in a few words."""
    line = _lines(effect, report)[0] if effect.params else ""
    change, _, _ = line.partition(" [")
    window = "".join(
        f", {word} t = {quantity(effect.params[name], report.units.get(TIME, ''))}"
        for name, word in (("onset", "from"), ("end", "until"))
        if name in effect.params
    )
    if effect.name == "parameter_error":
        return f"the parameter {change}{window}"
    return f"{effect_text(effect)} ({change}{window})" if change else effect_text(effect)


def related_forms(effect: EffectEstimate) -> list[str]:
    """Sentences about forms that contain the named one and fit no better, and about special cases that are as good up to the tolerance."""
    kinds = (
        ("Richer than {}, not needed", effect.richer),
        ("Simpler than {}, as good up to the tolerance", effect.simpler),
    )
    return [
        f"{text.format(key_text((effect.name, effect.location, effect.variable)))}: {first_of([key_text(k) for k in keys])}."
        for text, keys in kinds
        if keys
    ]


def not_identified(effect: EffectEstimate) -> list[str]:
    """Other effects that these data cannot tell from the named one, without its richer and simpler forms."""
    forms = set(map(tuple, [*effect.richer, *effect.simpler]))
    return [key_text(key) for key in effect.equivalents if tuple(key) not in forms]


def separating(report: ReportData) -> list[dict]:
    """The experiments that separate what is tied, the best first."""
    experiment = report.next_experiment
    rows = [] if experiment is None else [dict(row) for row in experiment.options]
    return [row for row in rows if row.get("gain", 0.0) >= NATS_THAT_SETTLE]


def next_steps(report: ReportData) -> list[str]:
    """What to do next, one line each."""
    return [
        *(_remedy(fault) for fault in report.data if fault.remedy and not fault.share < SHOWN_AS_NOTHING),
        *_steps(report),
        *(_remedy(fault) for fault in report.data if fault.remedy and fault.share < SHOWN_AS_NOTHING),
    ]


def _remedy(fault: DataFault) -> str:
    """What to do about a fault of the record."""
    return f"{fault.location}: {fault.remedy}" if fault.location else fault.remedy


def _steps(report: ReportData) -> list[str]:
    """What to do next beside the faults of the record."""
    if _is_undecided(report):
        return [AGAIN_BY_COMMAND if report.provenance.command else AGAIN]
    if report.reasons.rule == "other_unit":
        return [_written_right(report)]
    if report.verdict == "none":
        if report.shrink.measurable and report.shrink.before >= PRACTICAL:
            return [REPEAT]
        return ["To look further, excite the plant harder or over a wider range, and record again."]
    steps = [REPEAT] if _may_be_a_disturbance(report) else _to_separate(report)
    if report.verdict in ("explained", "partial"):
        steps.append(SAVE_BY_COMMAND if report.provenance.command else "Use diagnoser.augmented_ as the new simulator.")
    if report.verdict in ("partial", "unknown"):
        steps.append(_about_the_rest(report))
    return steps


def _written_right(report: ReportData) -> str:
    """The way of writing the record with which the simulator alone explains it, as the note on it says."""
    notes = (note.partition(" the simulator alone explains") for note in report.notes)
    how = next((before for before, said, _ in notes if said), "With dt and the data as the simulator has them")
    return f"Diagnose again {how[0].lower()}{how[1:]}."


def _to_separate(report: ReportData) -> list[str]:
    """The experiment that decides between effects that the data do not separate."""
    tied = [effect for effect in report.effects if not_identified(effect)]
    if not tied or report.next_experiment is None:
        return []
    best = separating(report)
    if not best:
        others = joined([effect_text(tied[0]), *not_identified(tied[0])[:TIED_LISTED]])
        return [f"Measure another signal, or use knowledge of the plant, to decide between {others}."]
    gain = number(best[0]["gain"], 2) if best[0]["gain"] < 1000 else "more than 1000"
    beyond = "" if best[0].get("within", True) else "; its inputs leave the recorded range"
    return [
        f"Record {best[0]['experiment']} to separate {best[0]['between']} (expected log-likelihood difference {gain}; {ENOUGH}{beyond})."
    ]


def _about_the_rest(report: ReportData) -> str:
    """What to do about what no name explains."""
    term = report.missing_term
    if report.certified_law is not None:
        kept = "carries it" if report.provenance.include_law else "leaves it out (include_law=False)"
        where = "the simulator that --save FILE.json keeps" if report.provenance.command else "diagnoser.augmented_"
        return f"Check the law of the missing term against physics; {where} {kept}."
    if term is not None and term.effects:
        return (
            "Compare the laws of the missing term with the catalogue: "
            "GapDiagnoser(simulator, effects=[*CATALOGUE.values(), *report.missing_term.effects])."
        )
    drawn = term is not None and term.curves
    look = "Look at the shape of what is missing: report.plot('missing_term'). " if drawn else ""
    return f"{look}Add an effect of your own to the catalogue, or learn the rest: HybridRegressor(simulator)."
