"""Tied candidates in words: the experiment that parts them, and the sentence beside each name that says when they part."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np

from sksurrogate.effects._effect import BaseEffect
from sksurrogate.gap.results._next_experiment import NATS_THAT_SETTLE, NextExperiment
from sksurrogate.gap.results._table import Table

__all__ = ["name_of", "suggestion", "when_they_part"]

#: Tied candidates that a sentence lists.
EXPERIMENTS_LISTED = 4


def name_of(effect: BaseEffect) -> str:
    """Readable name of an effect."""
    window = f" with an {effect.key[3]}" if len(effect.key) > 3 else ""
    return f"{effect.name} at {effect.location}" + (f" in {effect.variable}" if effect.variable else "") + window


def leaves_the_range(u: np.ndarray, recorded: np.ndarray) -> bool:
    """Whether inputs (n_inputs, n_samples) go where no recorded input was.

    Examples
    --------
    >>> recorded = np.array([[0.0, 1.0, 0.5]])
    >>> leaves_the_range(0.5 * recorded, recorded), leaves_the_range(2.0 * recorded, recorded)
    (False, True)
    """
    low, high = recorded.min(axis=1, keepdims=True), recorded.max(axis=1, keepdims=True)
    room = 1e-9 * (high - low)
    return bool(np.any(u < low - room) or np.any(u > high + room))


def suggestion(apart: Mapping[str, np.ndarray], names: Sequence[str], beyond: Collection[str] = ()) -> NextExperiment:
    """The experiment that parts a named effect best from the tied candidate that is hardest to tell.

    Twins that none parts are left out where another can be determined. Of experiments that settle it those come first whose inputs
    stay where inputs were recorded.

    Parameters
    ----------
    apart : dict of ndarray (n_rivals,)
        For every experiment the nats that part the named effect from each candidate; nan where they are not known.
    names : sequence of str
        The named effect, then its candidates.
    beyond : collection of str
        Experiments whose inputs leave the recorded range.
    """
    most = np.nanmax(np.where(np.isfinite(list(apart.values())), list(apart.values()), -1.0), axis=0)
    settled = np.flatnonzero(most >= NATS_THAT_SETTLE) if np.any(most >= NATS_THAT_SETTLE) else np.arange(len(most))
    rows: list[dict[str, Any]] = []
    for experiment, values in apart.items():
        known = [int(k) for k in settled if np.isfinite(values[k])]
        hardest = min(known, key=lambda k: values[k], default=None)
        if hardest is not None:
            between = f"{names[0]} and {names[1 + hardest]}"
            within = experiment not in beyond
            rows.append(
                {"experiment": experiment, "gain": float(values[hardest]), "between": between, "within": within}
            )
    rows.sort(key=lambda row: (not (row["within"] and row["gain"] >= NATS_THAT_SETTLE), -row["gain"]))
    best = rows[0]
    if best["gain"] < NATS_THAT_SETTLE:
        sentence = (
            f"No variation of the inputs tried here separates {', '.join(names)}: they predict the same. "
            "Only another sensor or knowledge of the plant can decide."
        )
        return NextExperiment(sentence, Table(tuple(rows)), names[0])
    gain = f"{best['gain']:.0f}" if best["gain"] < 1000 else "more than 1000"
    sentence = (
        f"To tell {best['between']} apart, record {best['experiment']}: expected separation {gain} nats (3 are enough)."
    )
    if not best["within"]:
        sentence += " Its inputs leave the recorded range: make sure that the plant allows them."
    same = [names[1 + k] for k in range(len(most)) if k not in settled]
    if same:
        sentence += f" None of the simulated experiments separates {', '.join(same)} from {names[0]}."
    parted = tuple(names[1 + int(k)] for k in settled if apart[best["experiment"]][k] >= NATS_THAT_SETTLE)
    return NextExperiment(sentence, Table(tuple(rows)), names[0], parted)


def when_they_part(
    named: str,
    tied: Sequence[str],
    same: bool,
    experiment: NextExperiment | None,
    richer: Sequence[str] = (),
    among: str = "of the catalogue",
) -> str:
    """The sentence beside a name.

    Parameters
    ----------
    named : str
    tied : sequence of str
        Candidates that these data cannot tell from it.
    same : bool
        Whether all of them predict the same.
    experiment : NextExperiment or None
        What was computed to part the effect that it is about.
    richer : sequence of str
        Forms that contain the named one and fit no better.
    among : str
        Which effects were compared.
    """
    if not tied and richer:
        return f"Only richer forms ({', '.join(richer)}) explain these data as well; nothing in the data needs them."
    if not tied:
        return f"No other effect {among} explains these data as well."
    listed = _first(tied)
    how = "predict the same" if same else "explain these data equally well"
    return f"{named} and {listed} {how} on the range that was reached; {_part(named, tied, experiment)}."


def _part(named: str, tied: Sequence[str], experiment: NextExperiment | None) -> str:
    """What parts them, of those that were asked for."""
    if experiment is None:
        return "no experiment that parts them was found"
    if experiment.named != named:
        return f"no experiment was computed for this pair (the suggested one concerns {experiment.named})"
    if not experiment.parted:
        return "they part in none of the experiments tried here"
    record = experiment.options[0]["experiment"]
    if set(tied) <= set(experiment.parted):
        return f"they part with {record}"
    return f"with {record} it parts from {_first(experiment.parted)}; nothing is known to part the rest"


def _first(names: Sequence[str]) -> str:
    """The first of some names."""
    return ", ".join(names[:EXPERIMENTS_LISTED]) + (" and more" if len(names) > EXPERIMENTS_LISTED else "")
