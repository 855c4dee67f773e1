"""Which effects: joint refits ordered by a screen, evidence under each candidate's own noise, forward and backward.

One search for every kind of access. What differs is how a base is extended by one effect and how one is taken out of it.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from sksurrogate._parallel._parallel_map import side_by_side
from sksurrogate.effects._effect import BaseEffect
from sksurrogate.gap.fit._closed_loop import may_follow_noise
from sksurrogate.gap.fit._closeness import AT_THE_NOISE, FAR, JUDGED_BY_SIZE, NEARLY_WHITE, SETTLED
from sksurrogate.gap.fit._evidence import C, Evidence, arrived, estimate_noise, follow_null, judged_under
from sksurrogate.gap.fit._prior import moved_far
from sksurrogate.gap.fit._rounding import names_steps
from sksurrogate.gap.search._base import CORRELATED, EQUAL, EXTRA, BaseSearch, Wanted
from sksurrogate.gap.search._nested import NESTED, UNPOLISHED, hardly_more, related, richer, simpler
from sksurrogate.gap.search._stopping import closes_by_size, fewest_parameters, grows_in_vain, leads_on

#: A further effect must remove this share of the gap's power, or lead to the noise: less is a mismatch of numerics.
SMALLEST_SHARE = 1e-3
#: Near the noise the screen expects of a candidate nearly what its fit gains: with less than this share of what it must gain
#: it is not fitted.
SCREENED = 0.4
#: Sets of effects that are kept beside the best one, far from the data.
RUNNERS = 3
#: A set of effects that was left is taken up again where it comes back with less than this share of its cost.
COMES_BACK = 0.9
#: A fit with so many times the cost of the null has diverged.
DIVERGED_COST = 100.0
#: Candidates of a round that are polished before the best of them is chosen.
MOST_POLISHED = 4
#: Sets with a relative of an effect that are searched once more; such a set takes the place of another with less than this
#: share of its cost.
MOST_REFORMED, REFORMED = 2, 0.5
#: Most effects named at once.
MOST_EFFECTS = 4


@dataclass(eq=False)
class SetSearch(BaseSearch[C]):
    """Forward and backward search over sets of effects."""

    #: Whether every simulation counts: then no other sets of effects are extended beside the best one.
    frugal: ClassVar[bool] = False

    runners: list[C] = field(default_factory=list, kw_only=True)  #: The next best of the last round
    least: float = field(default=SMALLEST_SHARE, kw_only=True)  #: Share of the gap that a further effect must remove
    nominal_costs: dict[C, float] = field(default_factory=dict, kw_only=True)

    @property
    def gap_cost(self) -> float:
        """Squared error over the noise of the simulator as it is given: its free parameters at their nominal values."""
        null = self.fitted_null.candidate
        if not self.problem.free:
            return null.fit.cost
        if null not in self.nominal_costs:
            given = null.at_nominal()
            self.nominal_costs[null] = null.fit.cost if given is None else max(given.fit.cost, null.fit.cost)
        return self.nominal_costs[null]

    # ---- what a kind of access adds ---------------------------------------------------------------------------------
    @abstractmethod
    def expand(self, base: C, wanted: Wanted) -> list[C]:
        """Fit the candidates with one effect more that the screen puts first."""

    @abstractmethod
    def refitted_without(self, candidate: C, i: int) -> C | None:
        """A candidate without effect i, the others fitted again."""

    def refined(self, candidate: C) -> C:
        """A candidate fitted with the best numerics that matter; here there is one."""
        return candidate

    def from_nominal(self, null: Evidence[C], n_white: int, n_forced: int) -> list[C]:
        """Single effects fitted from nominal parameters, where fits hang on where they start."""
        return []

    def pairs(self, best: float) -> list[C]:
        """Two effects at once, where the screen sees pairs."""
        return []

    def formed(self, base: C, effects: Sequence[BaseEffect], shape: tuple[float, ...] | None, best: float) -> list[C]:
        """Effects of one form, added to a base."""
        return self.expand(base, Wanted(2, 0, effects, best=best))

    def folded(self, candidate: C) -> C | None:
        """A candidate with two of its effects as one, where they are one law."""
        return None

    def plausible(self, candidate: C) -> bool:
        """Whether the path of a candidate shows what makes each of its effects what it is."""
        return True

    # ---- the search -------------------------------------------------------------------------------------------------
    def run(self) -> Evidence:
        null = (self.null or self.fit_null()).candidate
        self.first_round = self.ranked(self.singles(null), null)
        if not self.first_round:
            return self.fitted_null
        if self.gain(self.first_round[0]) > self.bar(self.first_round[0].n_parameters):
            self.stand(self.first_round[0])
        best = self.simplify(self.first_choice(self.first_round))
        if self.gain(best) < 20.0 * self.bar(best.n_parameters):
            # A weak gain must not be what the null's noise fit left on the table.
            self.null = self.judge(follow_null(null, self.judged[best].noise, self.null, self.second))
        passed = self.gain(best) > self.bar(best.n_parameters) and not may_follow_noise(best, null)
        self.stand(best if passed else null)
        if not passed and self.fitted_null.left < FAR:
            return self.fitted_null
        left_behind: dict = {}
        while len(best.effects) < MOST_EFFECTS:
            if passed and not self.is_far(best):
                best = self.stand(self.enrich(best))
            elif passed and closes_by_size(self.judged[best], self.gap_cost, self.tolerance) and len(best.effects) > 1:
                # Of one name a second may show that it was the wrong one.
                best = self.stand(fewest_parameters(self, best))
                if not leads_on(self, best, MOST_EFFECTS - len(best.effects)):
                    break
            better = self.one_more(best, passed) or (self.reformed(best) if passed else None)
            left_behind[frozenset(best.keys)] = best.fit.cost
            # One set may beat another by likelihood and lose to it by size: a ring, unless it comes back nearer to the data.
            if better is None or better.fit.cost > COMES_BACK * left_behind.get(frozenset(better.keys), np.inf):
                break
            given_up = passed and self.is_far(better) and grows_in_vain(better, best, null)
            best, passed = self.stand(better), True
            if given_up:
                break
        stood = (self.final or self.fitted_null).candidate
        self.stand(self.simplify(stood, far=True) if self.is_far(stood) else self.merge(stood))
        return self.final or self.fitted_null

    def further(self, best: C) -> C | None:
        """The best set with one effect more, however little of the gap it removes; None where the evidence is not for it."""
        self.least = 0.0
        better = self.one_more(best, True)
        self.least = SMALLEST_SHARE
        return better

    def singles(self, null: C) -> list[C]:
        """The null with one effect; where re-tuning went far, also from nominal parameters, the nearer fit of each kept."""
        candidates = self.expand(null, Wanted(16, 6, siblings=True))
        if not moved_far(null):
            return candidates
        best: dict = {}
        for candidate in [*candidates, *self.from_nominal(self.fitted_null, 16, 6)]:
            worth = candidate.fit.cost + self.prior_cost(candidate)
            if candidate.keys not in best or worth < best[candidate.keys][0]:
                best[candidate.keys] = worth, candidate
        return [candidate for _, candidate in best.values()]

    def one_more(self, best: C, passed: bool) -> C | None:
        """The best candidate with one effect more, None where it does not pass."""
        self.report(f"{len(best.effects)} effect(s): {', '.join(e.name for e in best.effects)}; looking for another")
        left = self.judged[best].left
        hopeless = SCREENED * self.needed_gain(1) if passed and left < AT_THE_NOISE else 0.0
        trial = self.ranked(self.expand(best, Wanted(8, 4, siblings=True, least=hopeless)), best)
        if not trial and hopeless:
            return None
        settled = bool(trial) and passed and left < NEARLY_WHITE and not self.passes(trial[0], best, passed)
        if settled and left < SETTLED:
            return None
        if len(best.effects) == 1:
            trial.extend(self.ranked(self.pairs(best.fit.cost), best))
        nearest = self.own(max(trial, key=self.score)) if trial else None
        near = nearest is not None and nearest.left < AT_THE_NOISE
        for base in () if near or settled else self.beam(best):
            trial.extend(self.ranked(self.expand(base, Wanted(6, 3)), base))
        if not trial:
            return None
        trial.sort(key=self.order(trial), reverse=True)
        top = self.best_polished(trial)
        self.runners = distinct(
            [candidate for candidate in trial if candidate is not top], {frozenset(top.keys)}, RUNNERS
        )
        if not self.passes(top, best, passed):
            return None
        top = self.simplify(self.swap(top))
        return self.needed(top, best) if self.passes(top, best, passed) else None

    def needed(self, candidate: C, best: C) -> C:
        """The candidate, or what is left without an effect that only repaired a wrong first choice."""
        for i in range(len(candidate.effects)):
            smaller = self.without(candidate, i)
            if smaller is None or not smaller.effects:
                continue
            own = self.judged[candidate]
            self.judge(estimate_noise(smaller, own.noise, own.curvature))
            better = self.score(smaller) > self.score(best) + 1.0 and self.gain(smaller) > self.bar(
                smaller.n_parameters
            )
            if better and not self.passes(candidate, smaller, True):
                return self.needed(smaller, best)
        return candidate

    def passes(self, candidate: C, best: C, passed: bool) -> bool:
        """Whether an effect more is worth it: over the best smaller set, or over nothing where none passed alone."""
        if may_follow_noise(candidate, best):
            return False
        if not passed:
            return self.gain(candidate) > self.bar(candidate.n_parameters) + 2.0 * np.log(len(self.library))
        removed = best.fit.cost - candidate.fit.cost
        if removed < self.least * (self.fitted_null.fit.cost - self.n_values) and not arrived(
            self.own(candidate), best
        ):
            return False
        extra = 2.0 * (self.evidence(candidate) - self.evidence(best))
        if self.is_far(candidate) and candidate.fit.cost > JUDGED_BY_SIZE * self.n_values:
            extra = self.n_values / CORRELATED * float(np.log(best.fit.cost / candidate.fit.cost))
        return extra > self.needed_gain(candidate.n_parameters - best.n_parameters)

    def needed_gain(self, k: int) -> float:
        """2 (L_candidate - L_best) that a further effect of k parameters must reach."""
        return self.bar(max(k, 1)) + EXTRA

    def beam(self, best: C) -> list[C]:
        """Other sets of this size worth one effect more.

        Of singles the next by likelihood and the next by cost; far from the data, where the first choice is often a
        surrogate for several effects, the runners-up of every round.
        """
        if len(best.effects) > 1:
            return self.runners if self.is_far(best) else []
        if self.frugal:
            return []
        others = [candidate for candidate in self.first_round if candidate.keys != best.keys]
        by_cost = sorted(others, key=lambda candidate: candidate.fit.cost)
        return distinct([*others[:2], *by_cost[:2]], set(), 4)

    def swap(self, candidate: C) -> C:
        """Leave each effect out in turn and choose it again with the others kept; twice at most."""
        for _ in range(1 if self.is_far(candidate) or self.frugal else 2):
            start = candidate
            for i in range(len(start.effects)):
                if i >= len(candidate.effects):
                    break
                base = self.without(candidate, i)
                if base is None:
                    continue
                counts = (6, 3) if self.judged[candidate].left < AT_THE_NOISE or len(start.effects) > 2 else (12, 6)
                trial = self.ranked(self.expand(base, Wanted(*counts)), base)
                if not trial:
                    continue
                worth = self.order([trial[0], candidate])
                if worth(trial[0]) > worth(candidate) + 1.0:
                    swapped = self.polish(trial[0])
                    candidate = swapped if worth(swapped) > worth(candidate) else candidate
            if candidate is start:
                break
        return candidate

    def without(self, candidate: C, i: int) -> C | None:
        """The candidate refitted without effect i."""
        base = self.refitted_without(candidate, i)
        if base is None and self.null is not None and len(candidate.effects) == 1:
            base = self.null.candidate
        noise = self.noise_of(candidate)
        if base is not None and noise is not None and self.own(base) is None:
            self.judge(replace(judged_under(base, [noise]), quick=False))
        return base

    # ---- steps ------------------------------------------------------------------------------------------------------
    def ranked(self, candidates: Iterable[C], base: C) -> list[C]:
        """Candidates by penalised likelihood, the best under their own noise, the others by a quick look."""
        candidates = [
            candidate
            for candidate in candidates
            if candidate.fit.cost < DIVERGED_COST * self.fitted_null.fit.cost and self.plausible(candidate)
        ]
        if not candidates:
            return []
        noise, _, curvature = (self.own(base) or replace(self.fitted_null, curvature=None)).judgement
        nearest = min(candidates, key=lambda candidate: candidate.fit.cost)
        start, _, shape = self.judge(estimate_noise(nearest, noise, curvature)).judgement
        for candidate in candidates:
            if candidate is not nearest:
                self.judge(judged_under(candidate, [noise, start]))
                if not self.is_far(candidate) and self.score(candidate) < self.score(base) - 0.5 * self.bar(1):
                    # It holds the base: what it loses to it, it loses to a noise that was made for others.
                    self.judge(estimate_noise(candidate, noise, curvature, max_iterations=8))
        candidates.sort(key=self.score, reverse=True)
        if self.own(candidates[0]) is None:
            self.judge(estimate_noise(candidates[0], start, shape, max_iterations=8))
        near = [r for r in candidates[1:6] if self.score(r) > self.score(candidates[0]) - 30.0 and self.own(r) is None]
        tops = side_by_side(lambda r: estimate_noise(r, start, shape, max_iterations=8).judgement, near, self.second)
        for candidate, top in zip(near, tops):
            self.judge(Evidence(candidate, *top))
        candidates.sort(key=self.order(candidates), reverse=True)
        return candidates

    def first_choice(self, singles: Sequence[C]) -> C:
        """The best single effect; the steps on which readings stand, where these are the likeliest: nothing else makes them."""
        likeliest = max(singles, key=self.score)
        return self.polish(likeliest) if names_steps(likeliest) else self.best_polished(singles)

    def best_polished(self, candidates: Sequence[C]) -> C:
        """The best of the first few after each was polished: coarse steps and soft kinks must not choose between them."""
        least = min(candidate.fit.cost for candidate in candidates[:MOST_POLISHED])
        near = [
            candidate
            for candidate in candidates[:MOST_POLISHED]
            if candidate is candidates[0] or candidate.fit.cost < 3.0 * least + 50.0
        ]
        polished = [self.polish(candidate) for candidate in near]
        return max(polished, key=self.order(polished))

    def polish(self, candidate: C) -> C:
        """A candidate as exactly as it can be simulated, under its own noise."""
        best = self.refined(candidate)
        if self.own(best) is None:
            noise, _, curvature = (self.own(candidate) or replace(self.fitted_null, curvature=None)).judgement
            self.judge(estimate_noise(best, noise, curvature))
        return best

    def simplify(self, candidate: C, far: bool = False) -> C:
        """Name the simpler form where the richer one that nests it removes hardly more; the richer stays in its class.

        Far from the data the search goes on with the richer form and ends with this question. Two forms of one law are one.
        """
        one = self.folded(candidate)
        if one is not None:
            return self.simplify(self.polish(one), far)
        if self.is_far(candidate) and not far:
            return candidate
        for i, effect in enumerate(candidate.effects):
            shapes = effect.simpler(tuple(candidate.theta_of(i)))
            for name in (*NESTED.get(effect.name, ()), *shapes):
                simple = simpler(effect, name, self.library)
                base = self.without(candidate, i) if simple else None
                if base is None:
                    continue
                others = self.formed(base, simple, shapes.get(name), candidate.fit.cost)
                near = [other for other in others if other.fit.cost < UNPOLISHED * self.most_left(candidate)]
                for other in self.ranked(near, base)[:1]:
                    fitted = self.polish(other)
                    if self.as_good(fitted, candidate):
                        self.richer.setdefault(fitted.effects[-1].key, []).append(effect.key)
                        return self.simplify(fitted, far)
        return candidate

    def enrich(self, candidate: C) -> C:
        """The richer form of an effect where it removes more of the gap and no fit has looked at it yet."""
        for i, effect in enumerate(candidate.effects):
            others = {key for j, key in enumerate(candidate.keys) if j != i}
            forms = [e for e in self.library if richer(e, effect) and frozenset((*others, e.key)) not in self.fitted]
            base = self.without(candidate, i) if forms else None
            for other in self.ranked(self.expand(base, Wanted(2, 1, forms)), base)[:1] if base is not None else ():
                fitted = self.polish(other)
                if self.score(fitted) > self.score(candidate) + 1.0 and not self.as_good(candidate, fitted):
                    return self.enrich(fitted)
        return candidate

    def reformed(self, candidate: C) -> C | None:
        """The set with a relative in the place of one effect and the others chosen again; None where that is not nearer to the data.

        A wrong form beside a right one (a symmetric friction for one with an offset) keeps every other effect from being seen.
        """
        if self.frugal or len(candidate.effects) < 2 or self.judged[candidate].left < SETTLED:
            return None
        kin = [sibling for i in range(len(candidate.effects)) for sibling in self.with_relatives(candidate, i)]
        for other in sorted(kin, key=lambda one: one.fit.cost)[:MOST_REFORMED]:
            swapped = self.swap(self.polish(other))
            worth = self.order([swapped, candidate])
            if swapped.fit.cost < REFORMED * candidate.fit.cost and worth(swapped) > worth(candidate) + 1.0:
                return swapped
        return None

    def with_relatives(self, candidate: C, i: int) -> list[C]:
        """A relative of effect i in its place, those that are fitted already too."""
        others = [key for j, key in enumerate(candidate.keys) if j != i]
        kin = [e for e in self.library if related(e, candidate.effects[i]) and e.key not in candidate.keys]
        new = [e for e in kin if frozenset((*others, e.key)) not in self.fitted]
        base = self.without(candidate, i) if new else None
        if base is not None:
            self.ranked(self.expand(base, Wanted(2, 1, new)), base)
        known = (self.fitted.get(frozenset((*others, e.key))) for e in kin)
        return [one for one in known if one is not None and self.plausible(one)]

    def merge(self, candidate: C) -> C:
        """One effect fewer where a relative of another takes over its part (friction and an offset are one friction)."""
        if len(candidate.effects) < 3:
            return candidate
        for j in range(len(candidate.effects)):
            fewer = self.without(candidate, j)
            for i in range(len(candidate.effects) - 1 if fewer is not None else 0):
                assert fewer is not None
                kin = [e for e in self.library if related(e, fewer.effects[i]) and e.key not in candidate.keys]
                base = self.without(fewer, i) if kin else None
                for other in self.ranked(self.expand(base, Wanted(3, 1, kin)), base)[:1] if base is not None else ():
                    fitted = self.polish(other)
                    if self.score(fitted) > self.score(candidate):
                        return self.merge(fitted)
        return candidate

    def most_left(self, rich: C) -> float:
        """Cost up to which a simpler form leaves hardly more of the gap."""
        return hardly_more(rich.fit.cost, self.fitted_null.fit.cost - self.n_values)

    def as_good(self, simple: C, rich: C) -> bool:
        """Whether a simpler form does as well: hardly more gap left, or far from the data no evidence by size."""
        if self.is_far(rich):
            return 2.0 * (self.size_score(rich) - self.size_score(simple)) < EQUAL
        return simple.fit.cost < self.most_left(rich) and not arrived(self.own(rich), simple)


def distinct(candidates: Sequence[C], taken: set, most: int) -> list[C]:
    """The first candidates with different sets of effects."""
    chosen: list[C] = []
    for candidate in candidates:
        key = frozenset(candidate.keys)
        if key not in taken and len(chosen) < most:
            taken = taken | {key}
            chosen.append(candidate)
    return chosen
