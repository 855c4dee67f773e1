"""Effects that act in some of the runs: where the simulator alone agrees with the others, these are diagnosed by themselves."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, TypeAlias

import numpy as np

from sksurrogate.exceptions import SurrogateError
from sksurrogate.gap._pipeline import DiagnosisPipeline
from sksurrogate.gap._progress import SOON, Progress
from sksurrogate.gap.fit._closeness import AT_THE_NOISE, BEYOND_CHANCE
from sksurrogate.gap.render._report import GapReport
from sksurrogate.gap.results._data_faults import runs_text
from sksurrogate.gap.results._next_experiment import NATS_THAT_SETTLE
from sksurrogate.kernels.record import Record
from sksurrogate.runs import Runs

#: The diagnosis of some runs.
Begin: TypeAlias = Callable[[Runs, Record], DiagnosisPipeline[Any]]
#: A diagnosis, and its report.
Answer: TypeAlias = tuple[DiagnosisPipeline[Any], GapReport]


def in_some_runs(begin: Begin, runs: Runs, record: Record, whole: Answer, progress: Progress) -> Answer | None:
    """The diagnosis of the runs that the simulator alone does not explain; None where all runs are alike.

    What is named there must be absent from runs that would show it: their likelihood with it, initial states free, is below
    that without it by more than the choice of the runs costs.

    ``record``: of all of them.
    ``whole``: the diagnosis of all runs.
    """
    pipeline, report = whole
    settled = report.verdict == "none" or (report.verdict == "explained" and len(report.effects) == 1)
    on_own_clock = record.steps is not None or record.offset is not None
    if settled or on_own_clock or not report.complete or is_late(pipeline, progress):
        return None
    run = record.run_of_row[pipeline.rows]
    quiet = _at_the_noise(pipeline, run)
    some = np.setdiff1d(run, quiet)
    if not len(quiet) or not len(some):
        return None
    pipeline.search.report(f"{runs_text([runs[r].label for r in some])} by themselves")
    chosen = replace(runs, runs=tuple(runs[r] for r in some)), record.select(some.tolist())
    answer = asked_again(partial(begin, *chosen), progress)
    if answer is None:
        return None
    part, said = answer
    nats = _nats_without(pipeline, run, quiet, part.augmented())
    absent, shown = quiet[nats > NATS_THAT_SETTLE], quiet[nats < -NATS_THAT_SETTLE]
    if np.sum(nats) < NATS_THAT_SETTLE + len(runs) * np.log(2.0) or not len(absent):
        return None
    acting = np.union1d(some, shown)
    silent = np.setdiff1d(np.arange(len(runs)), np.union1d(acting, absent))
    here, *others = ([runs[r].label for r in which] for which in (acting, some, absent, silent))
    part.acts_in, part.rows = tuple(here), np.flatnonzero(np.isin(record.run_of_row, some))[part.rows]
    effects = [replace(effect, runs=part.acts_in) for effect in said.effects]
    said = replace(said, effects=effects, notes=(_said(here, *others), *said.notes), data=report.data)
    return part, said


def is_late(pipeline: DiagnosisPipeline[Any], progress: Progress) -> bool:
    """Whether there is no time for another diagnosis."""
    return pipeline.time_limit is not None and progress.elapsed > SOON * pipeline.time_limit


def asked_again(begin: Callable[[], DiagnosisPipeline[Any]], progress: Progress) -> Answer | None:
    """Another diagnosis of the same plant; None where it names nothing, or cannot be made: the first is known."""
    try:
        part = begin()
        said = part.run(progress)
    except (SurrogateError, FloatingPointError, np.linalg.LinAlgError):
        return None
    named = said is not None and said.complete and said.effects and said.verdict in ("explained", "partial")
    return (part, said) if said is not None and named else None


def _said(acting: Sequence[Any], seen: Sequence[Any], absent: Sequence[Any], silent: Sequence[Any]) -> str:
    """Where it acts, which of these runs were diagnosed, where it does not act, and where nobody knows."""
    of = "this run" if len(seen) == 1 else "these runs"
    return (
        f"What was found acts in {runs_text(acting)} alone, and the figures are of {of if acting == seen else runs_text(seen)}; "
        f"{runs_text(absent)} would show it, and agree{'s' if len(absent) == 1 else ''} with the simulator without it."
        + (f" Whether it acts in {runs_text(silent)} does not show." if silent else "")
    )


def _at_the_noise(pipeline: DiagnosisPipeline[Any], run: np.ndarray) -> np.ndarray:
    """Runs in which the simulator alone is at the noise in every output."""
    null = pipeline.null.candidate
    squares = null.without_starts(null.residual[None])[0] ** 2  # in units of the noise
    seen = null.problem.record.seen(np.ones_like(squares))
    found = []
    for r in np.unique(run):
        counts = seen[:, run == r].sum(axis=1)
        left = np.sqrt(squares[:, run == r].sum(axis=1) / np.maximum(counts, 1))
        if np.all(left < AT_THE_NOISE + BEYOND_CHANCE / np.sqrt(2.0 * np.maximum(counts, 1))) and np.any(counts):
            found.append(r)
    return np.array(found, dtype=int)


def _nats_without(pipeline: DiagnosisPipeline[Any], run: np.ndarray, quiet: np.ndarray, augmented: Any) -> np.ndarray:
    """How much likelier some runs are without the effects than with them, in nats; initial states free in both."""
    null = pipeline.null.candidate
    own, at_start = null.problem.record, null.initial_states()
    moved = own.y - null.residual
    for start, (a, b) in zip(at_start, own.spans):
        if run[a] in quiet:
            x0 = start if np.all(np.isfinite(start)) else None
            moved[:, a:b] = np.reshape(augmented.simulate(own.u[:, a:b].T, x0, own.t[a:b]), (b - a, -1)).T
    both = null.without_starts(np.stack([own.residual(moved), null.residual]))
    squares = np.sum(both**2, axis=1)
    return np.array([0.5 * np.sum(squares[0, run == r] - squares[1, run == r]) for r in quiet])
