"""Which names the other runs choose: the choice, repeated without each fold of runs, by likelihood run by run."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from sksurrogate.gap.decide._contenders import swaps
from sksurrogate.gap.decide._equivalence import EquivalenceClass
from sksurrogate.gap.fit._backend import BaseCandidate
from sksurrogate.gap.fit._evidence import C, Evidence, evidence_threshold, gain_by_size, judged_under
from sksurrogate.gap.fit._linear_set import linear_set
from sksurrogate.gap.fit._record_parts import blocked, run_folds
from sksurrogate.gap.search._base import BaseSearch
from sksurrogate.kernels.disturbance import Noise
from sksurrogate.kernels.run_columns import grams_of_pieces

#: Candidates that are compared again in every fold, the best on all runs.
MOST_CHOICES = 8


@dataclass(frozen=True, eq=False)
class ByRun:
    """Log likelihood of one candidate run by run, to first order in its parameters about the fit to all runs."""

    #: (n_runs, 1 + n_theta, 1 + n_theta): of the residual and its sensitivities, under the candidate's noise
    grams: np.ndarray
    log_dets: np.ndarray  #: (n_runs,)
    #: Log likelihood of a Gram and a log determinant, parameters at their best
    likelihood: Callable[[np.ndarray, float], float]
    prior: float  #: What its values cost before any data (-2 log p)
    n_parameters: int

    def evidence(self, kept: np.ndarray) -> float:
        """Log likelihood of the runs kept, at the parameters that these runs alone would choose."""
        G, log_det = self.grams[kept].sum(axis=0), float(self.log_dets[kept].sum())
        return self.likelihood(G, log_det) - 0.5 * self.prior

    def worth(self, kept: np.ndarray, n_values: int, by_size: bool) -> float:
        """Evidence of the runs kept; ``by_size`` that of white errors."""
        value = self.evidence(kept)
        return -gain_by_size(n_values, max(-2.0 * value, 1e-300)) if by_size else value


def white_grams(candidate: BaseCandidate, starts: np.ndarray) -> np.ndarray:
    """Of residual over the noise and sensitivities, initial states taken out, over runs (or blocks) that begin at ``starts``."""
    known = linear_set(candidate).known.transpose(1, 0, 2)
    return grams_of_pieces(candidate.without_starts(known, starts), starts)


def by_run(candidate: BaseCandidate, noises: Sequence[Noise], starts: np.ndarray, by_size: bool, prior: float) -> ByRun:
    """Likelihood of a candidate over runs (or blocks) that begin at ``starts``: under the likeliest of some noises, white by size."""
    linear = linear_set(candidate)
    if by_size:
        grams, log_dets = white_grams(candidate, starts), np.zeros(len(starts))
    else:
        noise = judged_under(candidate, noises).noise
        grams, log_dets = linear.D.in_runs_from(starts).gram_by_run(linear.known, noise)
    return ByRun(grams, log_dets, linear.within_bounds, prior, candidate.n_parameters)


def chosen_without(
    own: ByRun,
    candidates: Sequence[ByRun],
    fold: np.ndarray,
    lengths: np.ndarray,
    n_candidates: int,
    by_size: bool = False,
) -> list[int | None]:
    """For every fold the candidate that the other runs choose in place of the named one; None where they keep it.

    They reject a name where a candidate gains over it what an effect must gain over none. A simpler candidate gains nothing for that:
    where the effect acts in the runs left out alone, the others need no parameters at all. A candidate that all runs together
    prefer by likelihood was rejected for another reason, such as a law beside it. That reason holds in every fold: there it must gain as much more.

    ``own``: what is named.
    ``fold`` (n_runs,).
    ``lengths`` (n_runs,): measured values of every run.
    ``n_candidates``: effects that were compared.
    ``by_size``: far from the data.
    """

    def gains(kept: np.ndarray) -> np.ndarray:
        """Of each candidate over the named one, beyond what it must gain."""
        n_values = int(lengths[kept].sum())
        level = own.worth(kept, n_values, by_size) if kept.any() else np.inf
        return np.array([
            2.0 * (candidate.worth(kept, n_values, by_size) - level)
            - evidence_threshold(1 + max(candidate.n_parameters - own.n_parameters, 0), n_candidates, n_values)
            for candidate in candidates
        ])  # fmt: skip

    out: list[int | None] = [None] * len(np.unique(fold))
    if not candidates:
        return out
    held_against = np.maximum(gains(np.full(len(fold), True)), 0.0)
    for k, left_out in enumerate(np.unique(fold)):
        more = gains(fold != left_out) - held_against
        if more.max() > 0:
            out[k] = int(more.argmax())
    return out


def names_by_fold(search: BaseSearch[C], final: Evidence[C], classes: Sequence[EquivalenceClass[C]]) -> list[C]:
    """The candidate that the runs outside each fold choose: the final one, or another set of as many effects.

    ``final``: what all runs choose.
    ``classes``: of its effects: their members count as the same names.
    """
    named = final.candidate
    choices: list[tuple[C, list[Noise], float]] = [(named, [final.noise], 0.0)]
    for one in _other_choices(search, named, classes):
        own = search.noise_of(one)
        choices.append((one, [final.noise] if own is None else [own, final.noise], 0.0))
    return choices_by_fold(search, choices)


def choices_by_fold(search: BaseSearch[C], choices: Sequence[tuple[C, Sequence[Noise], float]]) -> list[C]:
    """Of each fold of runs the candidate that the others choose; the first stands unless they reject it.

    ``choices`` are candidates with the noises that they may have, and a price (-2 log p) beside that of their values.
    """
    record = blocked(search.problem.record)
    fold, candidates = run_folds(record), [candidate for candidate, _, _ in choices]
    n_folds = int(fold.max()) + 1
    if len(candidates) < 2 or n_folds < 2:
        return [candidates[0]] * n_folds
    by_size = all(search.is_far(candidate) for candidate in candidates)
    runs = [by_run(c, noises, record.starts, by_size, search.prior_cost(c) + price) for c, noises, price in choices]
    picks = chosen_without(runs[0], runs[1:], fold, record.counts.sum(axis=1), len(search.library), by_size)
    return [candidates[0 if pick is None else 1 + pick] for pick in picks]


def _other_choices(search: BaseSearch[C], final: C, classes: Sequence[EquivalenceClass[C]]) -> list[C]:
    """Candidates that differ from the final one in one effect, outside of its class; the best on all runs."""
    keys = frozenset(final.keys)
    same = set()
    for its_class in classes:
        own = final.effects[its_class.index].key
        kin = its_class.keys | set(search.richer.get(own, []))
        same |= {(keys - {own}) | {key} for key in kin}
    found = [one for one in swaps(search, final) if frozenset(one.keys) not in same and np.isfinite(search.score(one))]
    return sorted(found, key=search.order([final, *found]), reverse=True)[:MOST_CHOICES]
