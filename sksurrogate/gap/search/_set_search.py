"""Which effects: joint refits ordered by a screen, evidence under each candidate's own noise, forward and backward.

One search for every kind of access. What differs is how a base is extended by one effect and how one is taken out of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from sksurrogate.gap.fit._backend import BaseCandidate
from sksurrogate.gap.fit._closeness import (
    AT_THE_NOISE,
    FAR,
    FAR_BY_COST,
    NEARLY_WHITE,
    SETTLED,
    below_noise,
    is_at_noise,
)
from sksurrogate.gap.fit._evidence import CERTAIN, C, Evidence, arrived, estimate_noise, follow_null, gain_by_size
from sksurrogate.gap.fit._prior import moved_far
from sksurrogate.gap.search._base import Wanted
from sksurrogate.gap.search._related_forms import enriched, hardly_more, simplify, with_fewer_parameters
from sksurrogate.gap.search._set_moves import SetMoves
from sksurrogate.gap.search._stopping import closes_by_size, grows_in_vain

#: A further effect must remove this share of the gap's power, or lead to the noise: less is a mismatch of numerics.
SMALLEST_SHARE = 1e-3
#: Near the noise the screen expects of a candidate nearly what its fit gains: with less than this share of what it must gain
#: it is not fitted.
SCREENED = 0.4
#: Sets of effects that are kept beside the best one, far from the data.
RUNNERS = 3
#: Another set comes as near as the nearest where it leaves less than so many times as much: with fewer parameters it may be likelier.
AS_NEAR = 2.0
#: A set of effects that was left is taken up again where it comes back with less than this share of its cost.
COMES_BACK = 0.9
#: Errors with a cosine above this are those of one law.
ALIKE = 0.9
#: Sets with fewer parameters that are asked whether they lead to the noise.
MOST_LEANER = 2
#: Most effects named at once.
MOST_EFFECTS = 4


@dataclass(eq=False)
class SetSearch(SetMoves[C]):
    """Forward and backward search over sets of effects."""

    runners: list[C] = field(default_factory=list, kw_only=True)  #: The next best of the last round
    leading: tuple[C, bool] | None = field(default=None, kw_only=True)  #: The best single effect, and whether it passes

    def look_for_one(self) -> None:
        """The null and single effects."""
        null = (self.null or self.fit_null()).candidate
        self.first_round = self.ranked(self.singles(null), null)
        self.leading = self.first_name(null) if self.first_round else None

    def look_for_more(self) -> Evidence:
        """Effects beside the best single one; returns what stands."""
        if self.leading is None:
            return self.fitted_null
        best, passed = self.leading
        if passed or self.fitted_null.left >= FAR:
            self.grow(best, passed, self.fitted_null.candidate)
            stood = self.standing.candidate
            self.stand(simplify(self, stood, far=True) if self.is_far(stood) else stood)
        return self.standing

    def first_name(self, null: C) -> tuple[C, bool]:
        """The best single effect, and whether it passes; it stands where it does."""
        if self.beats_null(self.first_round[0]):
            self.stand(self.first_round[0])
        best = simplify(self, self.first_choice(self.first_round))
        if self.gain(best) < 20.0 * self.threshold(best.n_parameters):
            # A weak gain must not be what the null's noise fit left on the table.
            self.null = self.judge(follow_null(null, self.judged[best].noise, self.null, self.second))
        passed = self.beats_null(best)
        self.stand(best if passed else null)
        return best, passed

    def grow(self, best: C, passed: bool, null: C) -> None:
        """Effects one by one, or two at once, as long as they pass; what passes stands."""
        left_behind: dict[frozenset, float] = {}
        while len(best.effects) < MOST_EFFECTS:
            far = passed and len(best.effects) > 1 and self.is_far(best)
            if far and closes_by_size(self.judged[best], self.tolerated_cost):
                best, leads = self.leanest_that_leads_on(best)
                if not leads:
                    break
            if not self.may_be_extended(best):
                break
            better = (self.richer_form(best) if passed else None) or self.one_more(best, passed)
            left_behind[frozenset(best.keys)] = best.fit.cost
            # One set may beat another by likelihood and lose to it by size: a ring, unless it comes back nearer to the data.
            if better is None or better.fit.cost > COMES_BACK * left_behind.get(frozenset(better.keys), np.inf):
                break
            # a richer form in the place of one is no name more
            grown = passed and len(better.effects) > len(best.effects)
            given_up = grown and self.is_far(better) and grows_in_vain(better, best, null)
            best, passed = self.stand(better).candidate, True
            if given_up:
                break

    def leanest_that_leads_on(self, best: C) -> tuple[C, bool]:
        """Of a set that closes the gap up to the tolerance, and those with fewer parameters that do, one that further names lead to the
        noise, which stands; the one with the fewest that leaves hardly more, and False, where none is.

        Of one name a second may show that it was the wrong one. A flexible form follows a part of what another effect does, and leaves
        less than the right forms do until that one is beside them.
        """
        as_near = with_fewer_parameters(self, best, hardly_more(best.fit.cost, self.gap_cost))
        fewest, n = self.polish(as_near[0]) if as_near else best, MOST_EFFECTS - len(best.effects)
        leaner = with_fewer_parameters(self, best, self.tolerated_cost)[:MOST_LEANER]
        leading = next((one for one in dict.fromkeys((fewest, best, *leaner)) if self.leads_on(one, n)), None)
        return self.stand(leading or fewest).candidate, leading is not None

    def may_be_extended(self, best: C) -> bool:
        """Whether further names may be beside a set: far from the data they must close as much as names must, and several parts of one
        function are an expansion of it, unless the next leads to the noise."""
        if self.of_signals is not None and len(best.effects) > 1 and not self.leads_on(best, 1):
            return False
        return not self.is_far(best) or self.may_be_named(best)

    def richer_form(self, best: C) -> C | None:
        """The set with a richer form in the place of one effect; None where none is worth its parameters.

        Of one effect alone every form has been fitted. Where simulations are dear, none is asked.
        """
        if self.frugal or len(best.effects) < 2 or self.judged[best].left < SETTLED:
            return None
        trial = enriched(self, best)
        top = self.best_polished(sorted(trial, key=self.order(trial), reverse=True)) if trial else None
        return top if top is not None and self.passes(top, best, True) else None

    def leads_on(self, best: C, n: int) -> bool:
        """Whether the screen expects n names more to close what a set leaves up to the tolerance, or to come near the noise.

        Of a set that closes the gap up to the tolerance further names are named only where they lead to the noise.
        """
        return self.left_beside(best, n) < max(self.tolerance**2 * best.fit.cost, FAR_BY_COST * self.n_values)

    def may_be_named(self, base: C) -> bool:
        """Whether the screen expects further names beside a base to close as much as names must; else these would fall in the end."""
        return self.left_beside(base, MOST_EFFECTS - len(base.effects)) < self.most_left_cost

    def singles(self, null: C) -> list[C]:
        """The null with one effect; where re-tuning went far, also from nominal parameters, the nearer fit of each kept.

        Beside a null at the noise only what the screen expects to pass, and the likeliest for the ranking.
        """
        hopeless = self.hopeless if is_at_noise(null.fit.cost, self.n_values) else 0.0
        first = Wanted(16, 6, siblings=True, least=hopeless)
        candidates = self.expand(null, first) or self.expand(null, Wanted(2, 0))
        if not moved_far(null):
            return candidates
        best: dict = {}
        for candidate in [*candidates, *self.from_nominal(first)]:
            worth = self.cost_with_starts(candidate) + self.prior_cost(candidate)
            if candidate.keys not in best or worth < best[candidate.keys][0]:
                best[candidate.keys] = worth, candidate
        return [candidate for _, candidate in best.values()]

    def one_more(self, best: C, passed: bool) -> C | None:
        """The best candidate with one effect more, or with two at once; None where none passes.

        ``passed`` says whether the set is better than no effect.
        """
        self.report(f"{len(best.effects)} effect(s): {', '.join(e.name for e in best.effects)}; looking for another")
        trial = self.larger_sets(best, passed)
        if not trial:
            return None
        trial.sort(key=self.order(trial), reverse=True)
        top = self.best_polished(trial)
        self.runners = unlike(gaining(trial, best), [top], RUNNERS)
        if not self.passes(top, best, passed):
            return None
        tops = [simplify(self, self.swap(one)) for one in (top, *self.near_beside_far(trial, top))]
        top = max(tops, key=self.order(tops))
        return self.needed(top, best) if self.passes(top, best, passed) else None

    def near_beside_far(self, trial: Sequence[C], top: C) -> list[C]:
        """The nearest set, where it comes near the data and the likeliest does not: under the forces that a far one needs, likelihoods
        do not tell which of them leads on."""
        nearest = min(trial, key=lambda candidate: candidate.fit.cost)
        return [self.polish(nearest)] if self.is_far(top) and not self.is_far(nearest) else []

    def larger_sets(self, best: C, passed: bool) -> list[C]:
        """The set with one effect more, where that is not near the noise with two, and other sets of its size with as many more.

        Others are extended where the screen expects them to come as near as the nearest. None where none can pass.
        """
        left = self.judged[best].left
        if passed and below_noise(left, self.n_values):
            return []
        hopeless = self.hopeless if passed and left < AT_THE_NOISE else 0.0
        wanted = Wanted(4, 2, least=hopeless) if self.frugal else Wanted(8, 4, siblings=True, least=hopeless)
        trial = self.ranked(self.expand(best, wanted), best)
        settled = bool(trial) and passed and left < NEARLY_WHITE and not self.passes(trial[0], best, passed)
        if (settled and left < SETTLED) or (hopeless and not trial):
            return []
        if len(best.effects) == 1:
            trial += self.ranked(self.pairs(self.fitted_null.candidate, best.fit.cost), best)
        nearest = self.own(max(trial, key=self.score)) if trial else None
        if settled or (nearest is not None and nearest.left < AT_THE_NOISE):
            return trial
        nearest_cost = min((candidate.fit.cost for candidate in trial), default=best.fit.cost)
        most, two = AS_NEAR * nearest_cost, passed and len(best.effects) <= MOST_EFFECTS - 2
        others = [one for one in self.beam(best) if self.left_beside(one, 1 + two) < most]
        if two:
            for base in (best, *others):
                trial += self.ranked(self.pairs(base, nearest_cost), base)
        for base in others:
            if self.left_beside(base, 1) < most:
                trial += self.ranked(self.expand(base, Wanted(6, 3)), base)
        return trial

    def needed(self, candidate: C, best: C) -> C:
        """The candidate, or what is left without an effect that only repaired a wrong first choice."""
        for i in range(len(candidate.effects)):
            smaller = self.without(candidate, i)
            if smaller is None or not smaller.effects or not self.plausible(smaller):
                continue
            own = self.judged[candidate]
            self.judge(estimate_noise(smaller, own.noise, own.curvature))
            better = self.score(smaller) > self.score(best) + 1.0 and self.beats_null(smaller)
            if better and not self.passes(candidate, smaller, True):
                return self.needed(smaller, best)
        return candidate

    def passes(self, candidate: C, best: C, passed: bool) -> bool:
        """Whether an effect more is worth it: over the best smaller set, or over nothing where none passed alone."""
        if not passed:
            return self.gain(candidate) > self.threshold(candidate.n_parameters) + 2.0 * np.log(len(self.library))
        removed = best.fit.cost - candidate.fit.cost
        if removed < SMALLEST_SHARE * self.retuned_gap_cost and not arrived(self.own(candidate), best):
            return False
        extra = 2.0 * (self.evidence(candidate) - self.evidence(best))
        if self.is_far(candidate):
            extra = 2.0 * gain_by_size(self.n_values, best.fit.cost / candidate.fit.cost)
        return extra > self.needed_gain(candidate.n_parameters - best.n_parameters)

    def needed_gain(self, k: int) -> float:
        """2 (L_candidate - L_best) that a further effect of k parameters must reach."""
        return self.threshold(max(k, 1)) + CERTAIN

    @property
    def hopeless(self) -> float:
        """The drop that the screen must expect of an effect at the noise, where it expects nearly what the fit gains."""
        return SCREENED * self.needed_gain(1)

    def beam(self, best: C) -> list[C]:
        """Other sets of this size worth one effect more.

        Of singles the next by likelihood and the next by cost; far from the data, where the first choice is often a
        surrogate for several effects, the runners-up of every round.
        """
        if len(best.effects) > 1:
            return self.runners if self.is_far(best) else []
        if self.frugal:
            return []
        others = [one for one in gaining(self.first_round, self.fitted_null.candidate) if one.keys != best.keys]
        by_cost = sorted(others, key=lambda candidate: candidate.fit.cost)
        return unlike([*unlike(others, [best], 2), *unlike(by_cost, [best], 2)], [best], 4)


def gaining(candidates: Sequence[C], smaller: C) -> list[C]:
    """Those that leave less than a smaller set: one that leaves more, with an effect that no fit could shrink, leads nowhere."""
    return [candidate for candidate in candidates if candidate.fit.cost < smaller.fit.cost]


def unlike(candidates: Sequence[C], taken: Sequence[C], most: int) -> list[C]:
    """The first candidates whose errors are not those of one before: all forms of one law count once."""
    chosen: list[C] = []
    errors = [_direction(one) for one in taken]
    for candidate in candidates:
        own = _direction(candidate)
        if len(chosen) < most and all(abs(own @ other) < ALIKE for other in errors):
            chosen.append(candidate)
            errors.append(own)
    return chosen


def _direction(candidate: BaseCandidate) -> np.ndarray:
    """Errors of a candidate over the sensor noise, as a vector of length one."""
    out = np.ravel(candidate.residual / candidate.problem.sd[:, None])
    return np.asarray(out / max(float(np.linalg.norm(out)), 1e-300))
