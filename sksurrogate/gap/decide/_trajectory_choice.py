"""Which names the other runs choose, around a simulator that only gives trajectories."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sksurrogate.gap.decide._choice_by_fold import MOST_RIVALS, ByRun, chosen_without
from sksurrogate.gap.fit._folds import blocked, run_folds
from sksurrogate.gap.fit._trajectory import Around, Trial
from sksurrogate.gap.search._trajectory_search import AroundSearch
from sksurrogate.kernels.disturbance import Noise

__all__ = ["names_by_fold"]


def names_by_fold(search: AroundSearch, final: Trial, slots: Sequence[Sequence[tuple[Trial, bool]]]) -> list[Trial]:
    """The trial that the runs outside each fold choose: the final one, or another set of as many effects.

    Parameters
    ----------
    search : AroundSearch
    final : Trial
        What all runs choose.
    slots : sequence of sequence of (Trial, bool)
        The class of every effect: its members count as the same names.
    """
    record = blocked(search.around.record)
    fold = run_folds(record)
    same = {frozenset(final.keys), *(frozenset(trial.keys) for slot in slots for trial, _ in slot)}
    others = [
        trial
        for trial in search.rivals
        if frozenset(trial.keys) not in same and len(trial.effects) == len(final.effects)
    ]
    others = sorted(others, key=search.score, reverse=True)[:MOST_RIVALS]
    n_folds = len(np.unique(fold))
    if not others or n_folds < 2 or final.noise is None:
        return [final] * n_folds
    around = search.around
    own, *against = [_by_run(around, trial, trial.noise or final.noise, record.starts) for trial in (final, *others)]
    picks = chosen_without(own, against, fold, record.lengths * len(record.y), len(search.candidates))
    return [final if pick is None else others[pick] for pick in picks]


def _by_run(around: Around, trial: Trial, noise: Noise, starts: np.ndarray) -> ByRun:
    """Likelihood of a trial over runs (or blocks) that begin at ``starts``."""
    columns, precision = around.columns(trial)
    grams, log_dets = around.disturbance().begun_at(starts).gram_by_run(columns, noise)
    pull, bounds = -precision * trial.theta, around.bounds(trial.effects)
    return ByRun(grams, log_dets, precision, pull, trial.theta, bounds, 0.0, trial.n_parameters)
