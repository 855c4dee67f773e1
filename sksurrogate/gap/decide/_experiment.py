"""The experiment that would tell apart what these data cannot: variations of the inputs, and the one that separates best."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any

import numpy as np

from sksurrogate.effects._catalogue import name_of
from sksurrogate.gap.decide._equivalence import EquivalenceClass
from sksurrogate.gap.decide._separations import Separations
from sksurrogate.gap.fit._evidence import Evidence
from sksurrogate.gap.results._next_experiment import ENOUGH, NATS_THAT_SETTLE, NextExperiment
from sksurrogate.gap.results._table import Table
from sksurrogate.gap.search._nested import richer as richer_form
from sksurrogate.kernels.record import Record


def leaves_the_range(u: np.ndarray, recorded: np.ndarray) -> bool:
    """Whether inputs (n_inputs, n_samples) go where no recorded input was.

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

    ``apart`` (n_candidates,): for every experiment the nats that part the named effect from each candidate; nan where
        they are not known.
    ``names``: the named effect, then its candidates.
    ``beyond``: experiments whose inputs leave the recorded range.
    """
    nats = np.array(list(apart.values()))
    most = np.max(np.where(np.isfinite(nats), nats, -1.0), axis=0)
    settled = np.flatnonzero(most >= NATS_THAT_SETTLE) if np.any(most >= NATS_THAT_SETTLE) else np.arange(len(most))
    rows: list[dict[str, Any]] = []
    for experiment, values in apart.items():
        known = [int(k) for k in settled if np.isfinite(values[k])]
        hardest = min(known, key=lambda k: values[k], default=None)
        if hardest is not None:
            pair = {"between": f"{names[0]} and {names[1 + hardest]}", "within": experiment not in beyond}
            rows.append({"experiment": experiment, "gain": float(values[hardest]), **pair})
    rows.sort(key=lambda row: (not (row["within"] and row["gain"] >= NATS_THAT_SETTLE), -row["gain"]))
    best = rows[0]
    if best["gain"] < NATS_THAT_SETTLE:
        sentence = (
            f"No variation of the inputs tried here separates {', '.join(names)}: they predict the same. "
            "Only another sensor or knowledge of the plant can decide."
        )
        return NextExperiment(sentence, Table(tuple(rows)), names[0])
    gain = f"{best['gain']:.0f}" if best["gain"] < 1000 else "more than 1000"
    sentence = f"To tell {best['between']} apart, record {best['experiment']}: expected log-likelihood difference {gain} ({ENOUGH})."
    if not best["within"]:
        sentence += " Its inputs leave the recorded range: make sure that the plant allows them."
    same = [names[1 + k] for k in range(len(most)) if k not in settled]
    if same:
        sentence += f" None of the simulated experiments separates {', '.join(same)} from {names[0]}."
    parted = tuple(names[1 + int(k)] for k in settled if apart[best["experiment"]][k] >= NATS_THAT_SETTLE)
    return NextExperiment(sentence, Table(tuple(rows)), names[0], parted)


#: Samples of an experiment, and tied candidates that are compared.
LONGEST_EXPERIMENT, MOST_TIED = 400, 5


def next_experiment(
    final: Evidence, classes: Sequence[EquivalenceClass], separations: Callable[..., Separations]
) -> NextExperiment | None:
    """Which experiment separates the tied candidates best, in expected nats of log likelihood (``separations``).

    Richer forms are not needed, and no experiment tells parameters of one factor apart.
    """

    def rivals_of(one: EquivalenceClass) -> list[Any]:
        own = final.effects[one.index]
        return [twin.candidate for twin in one.twins if not (twin.one_factor or richer_form(twin.effect, own))]

    rivals = [(one, rivals_of(one)) for one in classes]
    its_class, tied = max(rivals, key=lambda pair: len(pair[1]), default=(None, []))
    if its_class is None or not tied:
        return None
    record, tied = final.candidate.problem.record, tied[:MOST_TIED]
    varied = variations(record, final.candidate.problem.plant.inputs)
    apart = {name: value for name, value in separations(final, tied, varied).items() if np.isfinite(value).any()}
    if not apart:
        return None
    names = [name_of(final.effects[its_class.index]), *(name_of(candidate.effects[-1]) for candidate in tied)]
    beyond = {name for name, u in varied.items() if leaves_the_range(u, record.u)}
    return suggestion(apart, names, beyond)


def variations(record: Record, names: Sequence[str]) -> dict[str, np.ndarray]:
    """Inputs (n_inputs, n_samples) that a user could apply instead of those of the first run."""
    a, n = int(record.starts[0]), int(min(record.lengths[0], LONGEST_EXPERIMENT))
    u, index = record.u[:, a : a + n], np.arange(n)
    mean = u.mean(axis=1, keepdims=True)
    spread = np.max(np.abs(u - mean), axis=1, keepdims=True)
    varied = {
        "the same run again": u,
        "a run with inputs twice as far from their mean": mean + 2 * (u - mean),
        "a run with inputs half as far from their mean": mean + 0.5 * (u - mean),
        "a run with inputs shifted up by their amplitude": u + spread,
        "a run with inputs twice as fast": u[:, (2 * index) % n],
        "a run with inputs half as fast": u[:, index // 2],
        "a run with a step in every input": np.where(index < n // 4, mean - 0.5 * spread, mean + spread),
    }
    for i, name in enumerate(names if len(names) > 1 else ()):
        only = np.repeat(mean, n, axis=1)
        only[i] = u[i]
        varied[f"a run in which only {name} moves"] = only
    return varied
