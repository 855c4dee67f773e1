"""Which effects: joint refits ordered by the screen, evidence under each candidate's own noise, forward and backward."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from sksurrogate._parallel._parallel_map import side_by_side
from sksurrogate.gap.fit._closed_loop import may_follow_noise
from sksurrogate.gap.fit._closeness import AT_THE_NOISE, FAR, JUDGED_BY_SIZE, NEARLY_WHITE, SETTLED
from sksurrogate.gap.fit._evidence import Evidence, arrived, estimate_noise, follow_null, judged_under
from sksurrogate.gap.fit._ode import Numerics, OdeBackend, OdeCandidate
from sksurrogate.gap.fit._prior import moved_far, prior_cost
from sksurrogate.gap.fit._rounding import names_steps
from sksurrogate.gap.search._base import CORRELATED, EQUAL
from sksurrogate.gap.search._expander import Expander
from sksurrogate.gap.search._fits import distinct, mean_start, numerics_matter, open_null
from sksurrogate.gap.search._line_search import scanned
from sksurrogate.gap.search._merged_pair import folded
from sksurrogate.gap.search._nested import NESTED, UNPOLISHED, hardly_more, related, simpler
from sksurrogate.gap.search._onsets import look_for_onsets
from sksurrogate.gap.search._plausible import plausible
from sksurrogate.gap.search._restart import revived
from sksurrogate.gap.search._stopping import closes_by_size, fewest_parameters, grows_in_vain, is_stack, leads_on

__all__ = ["Search"]

#: A further effect must beat the bar by this much more: a mismatch of numerics can pass the bar alone.
EXTRA = 10.0
#: A further effect must remove this share of the gap's power, or lead to the noise: less is a mismatch of numerics.
SMALLEST_SHARE = 1e-3
#: Near the noise the screen expects of a candidate nearly what its fit gains: with less than this share of what it must gain
#: it is not fitted.
SCREENED = 0.4
#: Sets of effects that are kept beside the best one, far from the data.
RUNNERS = 3
#: Pairs that are fitted because the screen expects most of them.
MOST_PAIRS = 10
#: A set of effects that was left is taken up again where it comes back with less than this share of its cost.
COMES_BACK = 0.9
#: A fit with so many times the cost of the null has diverged.
DIVERGED_COST = 100.0
#: Candidates fitted from where the others stand, with one effect of what stands taken out.
MOST_ANEW = 6
#: Most effects named at once.
MOST_EFFECTS = 4


@dataclass(eq=False)
class Search(Expander):
    """Forward and backward search over sets of effects.

    Attributes
    ----------
    runners : list of OdeCandidate
        The next best of the last round.
    least : float
        Share of the gap that a further effect must remove.
    """

    runners: list[OdeCandidate] = field(default_factory=list)
    least: float = SMALLEST_SHARE

    def prior_cost(self, candidate: OdeCandidate) -> float:
        """Of the free parameters, of steps of quantisation and of the initial states."""
        return prior_cost(candidate)

    # ---- the search -------------------------------------------------------------------------------------------------
    def fit_null(self) -> Evidence:
        """No effect: initial states and free parameters only."""
        problem, theta = self.problem, np.zeros(len(self.problem.free))
        tries = [problem.fit((), theta, self.x)]
        if tries[0] is None:
            # Strong noise in the first sample alone can send a plant into divergence.
            for n_mean in (4, 9):
                tries.append(problem.fit((), theta, mean_start(self.x, problem.record.starts, n_mean)))
        found = [candidate for candidate in tries if candidate is not None]
        if not found:
            found = [open_null(problem, theta, self.x)]
        nearest = min(found, key=lambda candidate: candidate.fit.cost)
        self.null = self.final = self.judge(follow_null(nearest, problem.first_noise(), second=self.second))
        return self.null

    def run(self) -> Evidence:
        """The whole search; returns the final candidate (the null where nothing passes)."""
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
            elif passed and closes_by_size(self.judged[best], self.gap_cost, self.tolerance):
                best = self.stand(fewest_parameters(self, best))
                if not leads_on(self, best, MOST_EFFECTS - len(best.effects)):
                    break
            better = self.one_more(best, passed)
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

    def look_for_onsets(self) -> None:
        """Effects that begin or end within the runs, in the place of what stands."""
        look_for_onsets(self)

    def further(self, best: OdeCandidate) -> OdeCandidate | None:
        """The best set with one effect more, however little of the gap it removes; None where the evidence is not for it."""
        self.least = 0.0
        better = self.one_more(best, True)
        self.least = SMALLEST_SHARE
        return better

    def singles(self, null: OdeCandidate) -> list[OdeCandidate]:
        """The null with one effect; where re-tuning went far, also from nominal parameters, the nearer fit of each kept."""
        candidates = self.expand(null, 16, 6, siblings=True)
        if not moved_far(null):
            return candidates
        best: dict = {}
        for candidate in [*candidates, *self.from_nominal(self.fitted_null, 16, 6)]:
            worth = candidate.fit.cost + prior_cost(candidate)
            if candidate.keys not in best or worth < best[candidate.keys][0]:
                best[candidate.keys] = worth, candidate
        return [candidate for _, candidate in best.values()]

    def one_more(self, best: OdeCandidate, passed: bool) -> OdeCandidate | None:
        """The best candidate with one effect more, None where it does not pass."""
        self.report(f"{len(best.effects)} effect(s): {', '.join(e.name for e in best.effects)}; looking for another")
        left = self.judged[best].left
        hopeless = SCREENED * self.needed_gain(1) if passed and left < AT_THE_NOISE else 0.0
        trial = self.ranked(self.expand(best, 8, 4, siblings=True, least=hopeless), best)
        if not trial and hopeless:
            return None
        settled = bool(trial) and passed and left < NEARLY_WHITE and not self.passes(trial[0], best, passed)
        if settled and left < SETTLED:
            return None
        if len(best.effects) == 1:
            trial.extend(self.ranked(self.pairs(self.fitted_null.candidate, MOST_PAIRS, best.fit.cost), best))
        nearest = self.own(max(trial, key=self.score)) if trial else None
        near = nearest is not None and nearest.left < AT_THE_NOISE
        for base in () if near or settled else self.beam(best):
            trial.extend(self.ranked(self.expand(base, 6, 3), base))
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

    def needed(self, candidate: OdeCandidate, best: OdeCandidate) -> OdeCandidate:
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

    def passes(self, candidate: OdeCandidate, best: OdeCandidate, passed: bool) -> bool:
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
        if candidate.fit.cost > JUDGED_BY_SIZE * self.n_values:
            extra = self.n_values / CORRELATED * float(np.log(best.fit.cost / candidate.fit.cost))
        return extra > self.needed_gain(candidate.n_parameters - best.n_parameters)

    def needed_gain(self, k: int) -> float:
        """2 (L_rival - L_best) that a further effect of k parameters must reach."""
        return self.bar(max(k, 1)) + EXTRA

    def beam(self, best: OdeCandidate) -> list[OdeCandidate]:
        """Other sets of this size worth one effect more.

        Of singles the next by likelihood and the next by cost; far from the data, where the first choice is often a
        surrogate for several effects, the runners-up of every round.
        """
        if len(best.effects) > 1:
            return self.runners if self.is_far(best) else []
        others = [candidate for candidate in self.first_round if candidate.keys != best.keys]
        by_cost = sorted(others, key=lambda candidate: candidate.fit.cost)
        return distinct([*others[:2], *by_cost[:2]], set(), 4)

    def swap(self, candidate: OdeCandidate) -> OdeCandidate:
        """Leave each effect out in turn and choose it again with the others kept; twice at most."""
        for _ in range(1 if self.is_far(candidate) else 2):
            start = candidate
            for i in range(len(start.effects)):
                if i >= len(candidate.effects):
                    break
                base = self.without(candidate, i)
                if base is None:
                    continue
                counts = (6, 3) if self.judged[candidate].left < AT_THE_NOISE or len(start.effects) > 2 else (12, 6)
                trial = self.ranked(self.expand(base, *counts), base)
                if not trial:
                    continue
                worth = self.order([trial[0], candidate])
                if worth(trial[0]) > worth(candidate) + 1.0:
                    swapped = self.polish(trial[0])
                    candidate = swapped if worth(swapped) > worth(candidate) else candidate
            if candidate is start:
                break
        return candidate

    def without(self, candidate: OdeCandidate, i: int) -> OdeCandidate | None:
        """The candidate refitted without effect i."""
        effects, theta = candidate.without_effect(i)
        base = candidate.problem.fit(effects, theta, candidate.fit.x[: candidate.model.n_nominal])
        if base is not None:  # a step may have been off, and effect i have made up for it
            for j in range(len(effects)):
                base = scanned(base, j)
        if base is None and self.null is not None and not effects:
            base = self.null.candidate
        noise = self.noise_of(candidate)
        if base is not None and noise is not None and self.own(base) is None:
            self.judge(replace(judged_under(base, [noise]), quick=False))
        return base

    # ---- steps ------------------------------------------------------------------------------------------------------
    def ranked(self, candidates: Iterable[OdeCandidate], base: OdeCandidate) -> list[OdeCandidate]:
        """Candidates by penalised likelihood, the best under their own noise, the others by a quick look."""
        candidates = [
            candidate
            for candidate in candidates
            if candidate.fit.cost < DIVERGED_COST * self.fitted_null.fit.cost and plausible(candidate)
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

    def first_choice(self, singles: Sequence[OdeCandidate]) -> OdeCandidate:
        """The best single effect; the steps on which readings stand, where these are the likeliest: nothing else makes them."""
        likeliest = max(singles, key=self.score)
        return self.polish(likeliest) if names_steps(likeliest) else self.best_polished(singles)

    def best_polished(self, candidates: Sequence[OdeCandidate], most: int = 4) -> OdeCandidate:
        """The best of the first few after each was polished: coarse steps and soft kinks must not choose between them."""
        least = min(candidate.fit.cost for candidate in candidates[:most])
        near = [
            candidate
            for candidate in candidates[:most]
            if candidate is candidates[0] or candidate.fit.cost < 3.0 * least + 50.0
        ]
        polished = [self.polish(candidate) for candidate in near]
        return max(polished, key=self.order(polished))

    def polish(self, candidate: OdeCandidate) -> OdeCandidate:
        """Refit with kinks sharper and steps shorter where that matters."""
        best = candidate if self.is_far(candidate) else revived(candidate)
        for n_sub, sharpness in ((4, 150.0), (8, 500.0)):
            finer = best.problem.at(Numerics(max(n_sub, 2 * best.problem.numerics.n_sub), sharpness))
            if not numerics_matter(finer, best):
                break
            fitted = finer.fit(best.effects, best.fit.theta, best.fit.x, open_steps=0, settled=True)
            if fitted is None or fitted.fit.cost > best.fit.cost + 2.0:
                break
            best = fitted
        if self.own(best) is None:
            noise, _, curvature = (self.own(candidate) or replace(self.fitted_null, curvature=None)).judgement
            self.judge(estimate_noise(best, noise, curvature))
        return best

    def simplify(self, candidate: OdeCandidate, far: bool = False) -> OdeCandidate:
        """Name the simpler form where the richer one that nests it removes hardly more; the richer stays in its class.

        Far from the data the search goes on with the richer form and ends with this question. Two forms of one law are one.
        """
        one = folded(candidate)
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

    def enrich(self, candidate: OdeCandidate) -> OdeCandidate:
        """The richer form of an effect where it removes more of the gap and no fit has looked at it yet."""
        for i, effect in enumerate(candidate.effects):
            others = {key for j, key in enumerate(candidate.keys) if j != i}
            richer = [e for e in self.library if effect.name in NESTED.get(e.name, ())]
            richer = [e for e in richer if e.location == effect.location and effect.variable in (e.variable, None)]
            richer = [e for e in richer if frozenset((*others, e.key)) not in self.fitted]
            base = self.without(candidate, i) if richer else None
            for other in self.ranked(self.expand(base, 2, 1, richer), base)[:1] if base is not None else ():
                fitted = self.polish(other)
                if self.score(fitted) > self.score(candidate) + 1.0 and not self.as_good(candidate, fitted):
                    return self.enrich(fitted)
        return candidate

    def merge(self, candidate: OdeCandidate) -> OdeCandidate:
        """One effect fewer where a relative of another takes over its part (friction and an offset are one friction)."""
        if len(candidate.effects) < 3:
            return candidate
        for j in range(len(candidate.effects)):
            fewer = self.without(candidate, j)
            for i in range(len(candidate.effects) - 1 if fewer is not None else 0):
                assert fewer is not None
                kin = [e for e in self.library if related(e, fewer.effects[i]) and e.key not in candidate.keys]
                base = self.without(fewer, i) if kin else None
                for other in self.ranked(self.expand(base, 3, 1, kin), base)[:1] if base is not None else ():
                    fitted = self.polish(other)
                    if self.score(fitted) > self.score(candidate):
                        return self.merge(fitted)
        return candidate

    def most_left(self, rich: OdeCandidate) -> float:
        """Cost up to which a simpler form leaves hardly more of the gap."""
        return hardly_more(rich.fit.cost, self.fitted_null.fit.cost - self.n_values)

    def as_good(self, simple: OdeCandidate, rich: OdeCandidate) -> bool:
        """Whether a simpler form does as well: hardly more gap left, or far from the data no evidence by size."""
        if self.is_far(rich):
            return 2.0 * (self.size_score(rich) - self.size_score(simple)) < EQUAL
        return simple.fit.cost < self.most_left(rich) and not arrived(self.own(rich), simple)

    # ---- what could stand in the place of a name --------------------------------------------------------------------
    def in_place_of(self, final: Evidence[OdeCandidate], i: int) -> list[OdeCandidate]:
        """Candidates with another effect in the place of effect i, with the numerics of what stands, and that itself again."""
        named, single = final.candidate, len(final.effects) == 1
        base = self.fitted_null.candidate if single else self.without(named, i)
        if base is None:
            return []
        few = self.is_far(named) or is_stack(final)
        if few:
            candidates = self.expand(base, 8, 2, thorough=False)
        else:
            candidates = self.expand(base, 24, 10, siblings=True, best=final.fit.cost)
        if single:  # those of the search may have started at other re-tuned parameters
            candidates.extend(self.first_round)
        if not few and (not single or self.problem.free):
            rest = named.taken_out(i)  # the others and the free parameters, fitted again alone, may have run away
            candidates.extend([] if rest is None else self.anew(rest, final.noise, MOST_ANEW, 0, final.fit.cost))
        candidates = list(
            {candidate.keys: candidate for candidate in sorted(candidates, key=lambda r: -r.fit.cost)}.values()
        )
        mine = [r.fit.cost for r in candidates if r.effects[-1].key == final.effects[i].key]
        fine = named.problem
        same_numerics = self.searching(base).numerics == fine.numerics
        reach = min([final.fit.cost, *mine]) if same_numerics else max([final.fit.cost, *mine])
        near = [candidate for candidate in candidates if candidate.fit.cost <= 1.5 * reach + 50.0 * EQUAL]
        return near if same_numerics else [self.again(fine, candidate) for candidate in near]

    @staticmethod
    def again(fine: OdeBackend, candidate: OdeCandidate) -> OdeCandidate:
        """A candidate fitted on with finer numerics."""
        return (
            fine.fit(candidate.effects, candidate.fit.theta, candidate.fit.x, open_steps=0, max_steps=8, settled=True)
            or candidate
        )
