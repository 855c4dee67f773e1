"""The verdict in plain words, with what to do next."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sksurrogate.gap._report import EffectEstimate, MissingTerm, NextExperiment, Shrink, Where

__all__ = ["sentence_of"]


def _list(names: Sequence[str]) -> str:
    """ "a, b and c"."""
    return names[0] if len(names) == 1 else ", ".join(names[:-1]) + " and " + names[-1]


def _described(effect: EffectEstimate) -> str:
    magnitude = next(iter(effect.params.items()), None)
    value = f" ({magnitude[0].replace('_', ' ')} {magnitude[1]:.3g})" if magnitude else ""
    driver = f" in {effect.variable}" if effect.variable else ""
    return f"{effect.name.replace('_', ' ')} at {effect.location}{driver}{value}"


def sentence_of(
    verdict: str,
    effects: Sequence[EffectEstimate],
    where: Where,
    shrink: Shrink,
    experiment: NextExperiment | None,
    term: MissingTerm | None,
) -> str:
    """One to three sentences."""
    closed = f"{100 * shrink.fraction:.1f} %" if np.isfinite(shrink.fraction) else "an unknown share"
    if verdict == "none":
        return (
            "The simulator agrees with the data to within noise and disturbance: no effect is missing that these runs could show. "
            "To look further, excite the plant harder or over a wider range."
        )
    if verdict == "explained":
        named = _list([_described(e) for e in effects]) if effects else "re-tuned parameters"
        text = f"The gap is explained by {named}; with it the simulator closes {closed} of the gap on runs left out."
        if experiment is not None and any(e.equivalents for e in effects):
            text += f" {experiment.sentence}"
        return text + (
            ""
            if experiment is not None and any(e.equivalents for e in effects)
            else " Use augmented_ as the new simulator."
        )
    place = f"the balance of {where.location}" if where.kind == "state" else f"the {where.kind} {where.location}"
    text = f"Something that is not in the catalogue is missing, most likely at {place}."
    if effects:
        verbs = ("help", "leave") if len(effects) > 1 else ("helps", "leaves")
        text += (
            f" {_list([_described(e) for e in effects]).capitalize()} {verbs[0]} ({closed} of the gap closed on runs "
            f"left out) but {verbs[1]} too much."
        )
    if term is not None and term.candidates:
        text += f" Closest simple law: {term.candidates[0]}."
    return text + " Look at missing_term, add such a term as an effect of your own, or use a hybrid model."
