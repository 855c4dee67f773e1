"""The verdict in plain words, with what to do next."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sksurrogate.gap.decide._rules import PRACTICAL
from sksurrogate.gap.results._effect_estimate import EffectEstimate
from sksurrogate.gap.results._law import Law
from sksurrogate.gap.results._missing_term import MissingTerm
from sksurrogate.gap.results._next_experiment import NextExperiment
from sksurrogate.gap.results._remainder import NOTHING_KNOWN, Remainder
from sksurrogate.gap.results._shrink import Shrink
from sksurrogate.gap.results._where import Where

__all__ = ["note_on_none", "sentence_of", "undecided_sentence"]

#: A law longer than this (characters) is not read in a sentence.
LONGEST_LAW = 80


def _list(names: Sequence[str]) -> str:
    """ "a, b and c"."""
    return names[0] if len(names) == 1 else ", ".join(names[:-1]) + " and " + names[-1]


def _described(effect: EffectEstimate) -> str:
    magnitude = next(iter(effect.params.items()), None)
    value = f" ({magnitude[0].replace('_', ' ')} {magnitude[1]:.3g})" if magnitude else ""
    driver = f" in {effect.variable}" if effect.variable else ""
    window = "".join(
        f", {word} t = {effect.params[name]:.4g}"
        for name, word in (("onset", "from"), ("end", "until"))
        if name in effect.params
    )
    return f"{effect.name.replace('_', ' ')} at {effect.location}{driver}{value}{window}"


def note_on_none(shrink: Shrink) -> str:
    """Why a gap above the noise floor has no name: it is below the practical bar, or no law explains it."""
    if shrink.before < PRACTICAL:
        return (
            f"The free run lies above the noise floor, but misses the outputs by {100 * shrink.before:.2g} % of their deviation only, "
            f"less than the practical bar of {100 * PRACTICAL:g} %."
        )
    return (
        "The free run lies above the noise floor, but no repeatable law explains it better than a disturbance: "
        "repeat a run with the same inputs to tell a disturbance from an effect."
    )


def sentence_of(
    verdict: str,
    effects: Sequence[EffectEstimate],
    where: Where,
    shrink: Shrink,
    experiment: NextExperiment | None,
    term: MissingTerm | None,
    remainder: Remainder = NOTHING_KNOWN,
    include_law: bool = True,
) -> str:
    """One to three sentences; ``include_law``: whether augmented_ carries a certified law."""
    closed = f"{100 * shrink.fraction:.1f} %" if np.isfinite(shrink.fraction) else "an unknown share"
    if verdict == "none" and shrink.measurable and shrink.before < PRACTICAL:
        return (
            f"The simulator is within {100 * PRACTICAL:g} % of the outputs' deviation: what it misses beyond the noise is too small "
            "to matter in practice, and no name is given for it."
        )
    if verdict == "none":
        return (
            "The simulator agrees with the data to within noise and disturbance: no effect is missing that these runs could show. "
            "To look further, excite the plant harder or over a wider range."
        )
    if verdict == "explained":
        named = _list([_described(e) for e in effects]) if effects else "re-tuned parameters"
        text = f"The gap is explained by {named}; with {'them' if len(effects) > 1 else 'it'} the simulator closes {closed} of the gap on runs left out."
        if not np.isfinite(shrink.fraction):
            text = f"The gap is explained by {named}; how far it shrinks on runs left out is not known."
        tied = any(set(map(tuple, e.equivalents)) - set(map(tuple, e.richer)) for e in effects)
        if experiment is not None and tied:
            return f"{text} {experiment.sentence}"
        return f"{text} Use augmented_ as the new simulator."
    if verdict == "partial":
        return partial_sentence(effects, shrink, remainder, closed, term, include_law)
    if where.location is None:
        return undecided_sentence(effects)
    place = f"the balance of {where.location}" if where.kind == "state" else f"the {where.kind} {where.location}"
    text = f"Something that is not in the catalogue is missing, most likely at {place}."
    if effects:
        verbs = ("help", "leave") if len(effects) > 1 else ("helps", "leaves")
        text += (
            f" {_list([_described(e) for e in effects]).capitalize()} {verbs[0]} ({closed} of the gap closed on runs "
            f"left out) but {verbs[1]} too much."
        )
    if term is not None and term.law is not None and term.law.certified:
        return text + law_sentence(term.law, shrink, include_law)
    law = next((c for c in term.candidates if len(c) < LONGEST_LAW), None) if term is not None else None
    if law is not None:
        form, _, share = law.partition("  (explains ")
        text += f" A simple law comes close: {form} explains {share.rstrip(')')} of what is missing on runs left out."
    ready = term is not None and term.effects
    return text + (
        " Look at missing_term; try its laws (missing_term.effects) or an effect of your own beside the catalogue, or use a "
        "hybrid model."
        if ready
        else " Look at missing_term, try an effect of your own beside the catalogue, or use a hybrid model."
    )


def undecided_sentence(effects: Sequence[EffectEstimate]) -> str:
    """Of a diagnosis that was stopped before its verdict, with what stood by then."""
    by_then = "The ranking holds what was compared by then"
    if effects:
        by_then = (
            f"By then {_list([_described(e) for e in effects])} stood, not yet judged; the ranking holds the others"
        )
    return (
        f"The diagnosis stopped before it had an answer: nothing is decided yet. {by_then}; run it again for a verdict, with "
        "more time, fewer candidates (effects=[...]) or more workers (n_jobs=2)."
    )


def law_sentence(law: Law, shrink: Shrink, include_law: bool, beside: str = "") -> str:
    """A certified law, how far it goes, and whether augmented_ carries it."""
    what = "The free curve" if law.is_curve else "The law"
    form = str(law).removeprefix("curve ") if len(str(law)) < LONGEST_LAW else "of missing_term.law"
    own = "augmented_ carries it" if include_law else "augmented_ leaves it out (include_law=False)"
    beyond = "; beyond its range it fades to nothing" if law.is_curve else ""
    closed = f"{100 * shrink.fraction_law:.1f} %"
    return f" {what} {form} in {law.place}{beside} closes {closed} of the gap on runs left out; {own}{beyond}."


def partial_sentence(
    effects: Sequence[EffectEstimate],
    shrink: Shrink,
    remainder: Remainder,
    closed: str,
    term: MissingTerm | None = None,
    include_law: bool = True,
) -> str:
    """What is certain, and what remains."""
    named = _list([_described(effect) for effect in effects])
    verb = "close" if len(effects) > 1 else "closes"
    text = f"{named[0].upper()}{named[1:]} {verb} {closed} of the gap on runs left out; {100 * remainder.share:.0f} % remains (RMS)."
    if term is not None and term.law is not None and term.law.certified:
        return text + law_sentence(term.law, shrink, include_law, " beside them" if len(effects) > 1 else " beside it")
    if remainder.location is not None and remainder.lawful > 0:
        place = (
            f"the balance of {remainder.location}"
            if remainder.kind == "state"
            else f"the {remainder.kind} {remainder.location}"
        )
        text += f" The likeliest place of what remains is {place}, as a function of {remainder.variable}."
    return text + " Use augmented_ as the better simulator; look at missing_term for the shape of what remains."
