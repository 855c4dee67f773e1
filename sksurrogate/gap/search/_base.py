"""What every search keeps: the candidates that were fitted, the latest evidence of each, and how they compare."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import KW_ONLY, dataclass, field, replace
from functools import partial
from typing import Any, Generic

import numpy as np

from sksurrogate._parallel._worker_process import WorkerProcess
from sksurrogate.effects._base_effect import BaseEffect
from sksurrogate.effects._catalogue import name_of
from sksurrogate.gap.fit._backend import Backend
from sksurrogate.gap.fit._closeness import FAR_BY_COST, HALF_THE_POWER
from sksurrogate.gap.fit._evidence import (
    FEW_STEPS,
    C,
    Evidence,
    estimate_noise,
    evidence_threshold,
    gain_by_size,
    gain_under_estimated_noise,
    judged_under,
)
from sksurrogate.gap.fit._prior import retuning_cost
from sksurrogate.gap.results._next_experiment import NATS_THAT_SETTLE
from sksurrogate.kernels.disturbance import Noise

#: 2 (L_best - L_candidate) below which two candidates count as equal (chi-squared of one parameter, about 1.4 %).
EQUAL = 2.0 * NATS_THAT_SETTLE
#: Fits that are compared when the time is up.
BEST_AT_TIME_OUT = 6


@dataclass(frozen=True, eq=False)
class Wanted:
    """Which candidates with one effect more are fitted."""

    #: by_white, by_forced: Effects that the screen puts first for white noise, and for noise with forces
    by_white: int
    by_forced: int
    among: Sequence[BaseEffect] | None = None  #: Instead of the whole library
    siblings: bool = False  #: Whether the effect of the nearest is fitted at other places too
    least: float = 0.0  #: Nothing is fitted of which the screen expects less
    best: float = np.inf  #: Cost; a fit that cannot come near it may be abandoned


@dataclass(eq=False)
class BaseSearch(ABC, Generic[C]):
    """Which effects: a search over sets of them."""

    problem: Backend
    library: list[BaseEffect]
    _: KW_ONLY
    tolerance: float = 0.1  #: Share of the gap (amplitude) that a model may leave
    n_jobs: int | None = None
    report: Callable[[str], None] = lambda message: None  #: Progress
    #: second, later: Processes for what is wanted at once, and for what is wanted later
    second: WorkerProcess = field(default_factory=partial(WorkerProcess, apart=False))
    later: WorkerProcess = field(default_factory=partial(WorkerProcess, apart=False))
    #: null, final: Filled as the search goes on, so that an interrupt leaves what is known
    null: Evidence[C] | None = None
    final: Evidence[C] | None = None
    first_round: list[C] = field(default_factory=list)  #: Single effects, best first
    #: The best fit of every set of effects so far, by its keys
    fitted: dict[frozenset, C] = field(default_factory=dict)
    #: The last set of each number of effects that stood
    stood: dict[int, C] = field(default_factory=dict)
    #: Evidence of every candidate that was looked at, the latest
    judged: dict[C, Evidence[C]] = field(default_factory=dict)
    #: Costs of the simulator as it is given, by the null
    nominal_costs: dict[C, float] = field(default_factory=dict)
    #: Richer forms that fit no better, by the key of the simpler one
    richer: dict[Any, list] = field(default_factory=dict)
    #: What a simulator raised, by its text: these candidates are lost
    lost: dict[str, None] = field(default_factory=dict)
    #: Signals of the law that explains the gap alone, where one does: then sets are made of what these signals drive
    of_signals: frozenset[str] | None = None
    #: Effects that had no fit beside some set, by their keys
    unfitted: dict[Any, BaseEffect] = field(default_factory=dict)

    @abstractmethod
    def fit_null(self) -> Evidence[C]:
        """No effect: initial states and free parameters only."""

    @abstractmethod
    def look_for_one(self) -> None:
        """The null and single effects."""

    @abstractmethod
    def look_for_more(self) -> Evidence[C]:
        """Further effects; returns what stands, the null where nothing passes."""

    @contextmanager
    def among_signals(self, law: Any) -> Iterator[None]:
        """Sets are made of what the ``signals`` of a law drive, where one is given."""
        self.of_signals = None if law is None else law.signals
        try:
            yield
        finally:
            self.of_signals = None

    @abstractmethod
    def with_effect(self, base: C, effect: BaseEffect, values: np.ndarray, path: np.ndarray | None) -> C | None:
        """A base with one effect more, fitted in the free run from its parameters and a path; None where it runs away."""

    def never_fitted(self) -> list[str]:
        """Names of the effects that had no fit beside any set, each once."""
        known = set().union(*self.fitted)
        return list(dict.fromkeys(name_of(effect) for key, effect in self.unfitted.items() if key not in known))

    def plausible(self, candidate: C) -> bool:
        """Whether the path of a candidate shows what makes each of its effects what it is."""
        return not self.not_shown(candidate)

    def not_shown(self, candidate: C) -> list[BaseEffect]:
        """The effects of a candidate whose typical form its path does not show."""
        return []

    def carries(self, law: BaseEffect) -> bool:
        """Whether the simulator can have this law."""
        return True

    @abstractmethod
    def in_place_of(self, final: Evidence[C], i: int) -> list[C]:
        """Candidates with another effect in the place of effect i, fitted as what stands is, and that itself again."""

    @abstractmethod
    def expected(self) -> Mapping[Any, float]:
        """What the screen expects of single effects, by key."""

    def keep_best(self) -> None:
        """What stands when the time is up: the best of all that is fitted."""
        null = self.fitted_null
        nearest = sorted(self.fitted.values(), key=lambda candidate: candidate.fit.cost)[:BEST_AT_TIME_OUT]
        for candidate in nearest:
            if candidate not in self.judged:
                self.judge(judged_under(candidate, [self.standing.noise, null.noise]))
        passing = [candidate for candidate in nearest if self.beats_null(candidate)]
        if passing:
            best, stands = max(passing, key=self.order(passing)), self.standing.candidate
            worth = self.order([best, stands])
            if best is not stands and worth(best) > worth(stands):
                self.judge(estimate_noise(best, self.judged[best].noise, max_iterations=FEW_STEPS))
                self.stand(best)

    def look_for_onsets(self) -> None:
        """Effects that begin or end within the runs, in the place of what stands; none are tried here."""

    def settle(self) -> None:
        """What stands, once more, after its candidates are known."""

    @property
    def positions(self) -> tuple[str, ...]:
        """States that are integrals of others, as far as they are known."""
        return ()

    def prior_cost(self, candidate: C) -> float:
        """How unlikely the values of a candidate are before any data, in units of -2 log p."""
        return retuning_cost(candidate)

    # ---- evidence ---------------------------------------------------------------------------------------------------
    @property
    def n_values(self) -> int:
        """Measured numbers."""
        return self.problem.record.n_values

    @property
    def noise_cost(self) -> float:
        """Squared error over the sensors' noise that this and noise on the inputs make up."""
        record = self.problem.record
        return self.n_values + float(np.sum(record.counts * (record.disturbance / self.problem.sd) ** 2))

    @property
    def gap_cost(self) -> float:
        """Squared error over the noise of the simulator as it is given: its free parameters at their nominal values.

        No gap counts as larger than what the outputs do.
        """
        null, record = self.fitted_null.candidate, self.problem.record
        if null not in self.nominal_costs:
            given = null.at_nominal() if self.problem.free else None
            self.nominal_costs[null] = null.fit.cost if given is None else max(given.fit.cost, null.fit.cost)
        moved = float(np.sum(record.counts * (record.spread / self.problem.sd) ** 2))
        return min(self.nominal_costs[null], moved)

    @property
    def retuned_gap_cost(self) -> float:
        """Squared error over the noise, and beyond it, of the simulator with its free parameters re-tuned."""
        return self.fitted_null.fit.cost - self.n_values

    @property
    def tolerated_cost(self) -> float:
        """Squared error over the noise that the tolerance allows a set to leave of the gap."""
        return self.tolerance**2 * self.gap_cost

    @property
    def most_left_cost(self) -> float:
        """Squared error over the noise that names may leave: half of the gap's (their certificate), or what is near the data."""
        return max(HALF_THE_POWER**2 * self.gap_cost, FAR_BY_COST * self.noise_cost)

    @property
    def fitted_null(self) -> Evidence[C]:
        """The null, once it is fitted."""
        if self.null is None:
            raise KeyboardInterrupt("interrupted before the first fit: nothing is known yet")
        return self.null

    @property
    def standing(self) -> Evidence[C]:
        """What stands: the null where no name passes."""
        return self.final or self.fitted_null

    def stand(self, candidate: C) -> Evidence[C]:
        """What an interrupt leaves."""
        self.final = self.judged[candidate]
        self.stood[len(candidate.effects)] = candidate
        return self.final

    def own(self, candidate: C) -> Evidence[C] | None:
        """A candidate under its own noise, or one that it was given; None where it was looked at under that of others."""
        known = self.judged.get(candidate)
        return None if known is None or known.quick else known

    def noise_of(self, candidate: C) -> Noise | None:
        """Its own, where it is known."""
        known = self.own(candidate)
        return None if known is None else known.noise

    def judge(self, found: Evidence[C]) -> Evidence[C]:
        """Keep the evidence of a candidate under its likeliest noise: a quick look under that of others takes nothing from it."""
        known = self.own(found.candidate)
        if found.quick and known is not None:
            found = known if known.log_likelihood >= found.log_likelihood else replace(found, quick=False)
        self.judged[found.candidate] = found
        return found

    def remember(self, candidates: Sequence[C]) -> None:
        """Keep the best fit of every set of effects."""
        for candidate in candidates:
            known = self.fitted.get(frozenset(candidate.keys))
            if known is None or self.cost_with_starts(candidate) < self.cost_with_starts(known):
                self.fitted[frozenset(candidate.keys)] = candidate

    def cost_with_starts(self, candidate: C) -> float:
        """Cost with ``ln N`` of every initial state that is free: of one set with memories at rest, and with free ones, the likelier has less."""
        return candidate.fit.cost + candidate.n_starts * float(np.log(self.n_values))

    # ---- comparisons ------------------------------------------------------------------------------------------------
    def threshold(self, k: int) -> float:
        """What twice the gain in log likelihood must exceed for k parameters."""
        return evidence_threshold(k, len(self.library), self.n_values)

    def evidence(self, candidate: C) -> float:
        """Log likelihood, with what it costs to move the free parameters: a far re-tuning must not imitate an effect."""
        known = self.judged.get(candidate)
        return -np.inf if known is None else known.log_likelihood - 0.5 * self.prior_cost(candidate)

    def gain(self, candidate: C) -> float:
        """2 (L_candidate - L_null), as far as it counts where the noise level is estimated from the same values."""
        gain = self.evidence(candidate) - self.evidence(self.fitted_null.candidate)
        return 2.0 * gain_under_estimated_noise(gain, candidate.n_fitted, self.n_values)

    def beats_null(self, candidate: C) -> bool:
        """Whether a set passes by itself."""
        return self.gain(candidate) > self.threshold(candidate.n_parameters)

    def score(self, candidate: C) -> float:
        """Evidence less ``k/2 ln N``: a form with more parameters must earn them."""
        return self.evidence(candidate) - self.price(candidate)

    def price(self, candidate: C) -> float:
        """``k/2 ln N`` of the numbers that its effects hold, and the choice of each out of the library."""
        numbers = 0.5 * (candidate.n_parameters + candidate.n_chosen) * float(np.log(self.n_values))
        return numbers + len(candidate.effects) * float(np.log(len(self.library)))

    def size_score(self, candidate: C) -> float:
        """Evidence by size, less ``k/2 ln N``.

        Far from the data no noise model holds, and the force that it allows would hide which candidate comes nearer.
        """
        return -gain_by_size(self.n_values, candidate.fit.cost) - self.price(candidate)

    def order(self, candidates: Sequence[C]) -> Callable[[C], float]:
        """By size where all are far from the data, by likelihood where one comes near."""
        return self.size_score if all(self.is_far(candidate) for candidate in candidates) else self.score

    def leads(self, one: C, other: C) -> bool:
        """Whether a set is better than another by more than a nat."""
        worth = self.order([one, other])
        return worth(one) > worth(other) + 1.0

    def is_far(self, candidate: C) -> bool:
        """Whether a candidate is so far from the data that sizes, not likelihoods, tell candidates apart."""
        return candidate.fit.cost > FAR_BY_COST * self.noise_cost
