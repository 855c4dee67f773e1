"""Which effects: joint refits ordered by the screen, evidence under each rival's own noise, forward and backward."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from sksurrogate._parallel._parallel_map import side_by_side
from sksurrogate.gap.fit._closed_loop import may_follow_noise
from sksurrogate.gap.fit._closeness import AT_THE_NOISE, FAR, FAR_BY_COST, JUDGED_BY_SIZE, NEARLY_WHITE, SETTLED
from sksurrogate.gap.fit._evidence import Evidence, arrived, bar, estimate_noise, follow_null, judged_under
from sksurrogate.gap.fit._prior import prior_cost, retuning_cost
from sksurrogate.gap.fit._problem import Candidate, Numerics
from sksurrogate.gap.fit._rounding import names_steps
from sksurrogate.gap.search._expander import Expander
from sksurrogate.gap.search._fits import distinct, mean_start, numerics_matter, open_null
from sksurrogate.gap.search._line_search import scanned
from sksurrogate.gap.search._merged_pair import folded
from sksurrogate.gap.search._nested import NESTED, UNPOLISHED, hardly_more, related, simpler
from sksurrogate.gap.search._plausible import plausible
from sksurrogate.gap.search._restart import revived
from sksurrogate.gap.search._stopping import grows_in_vain

__all__ = ["EQUAL", "Search"]

#: A further effect must beat the bar by this much more: a mismatch of numerics can pass the bar alone.
EXTRA = 10.0
#: A further effect must remove this share of the gap's power, or lead to the noise: less is a mismatch of numerics.
SMALLEST_SHARE = 1e-3
#: Near the noise the screen expects of a rival nearly what its fit gains: with less than this share of what it must gain
#: it is not fitted.
SCREENED = 0.4
#: Sets of effects that are kept beside the best one, far from the data.
RUNNERS = 3
#: Pairs that are fitted because the screen expects most of them.
MOST_PAIRS = 10
#: 2 (L_best - L_rival) below which two rivals count as equal (chi-squared of one parameter, about 1.4 %).
EQUAL = 6.0
#: Re-tuning that costs this much (-2 log of the prior) may imitate an effect.
FAR_RETUNED = 6.0
#: Samples of a structural error that count as one.
CORRELATED = 10.0
#: A set of effects that was left is taken up again where it comes back with less than this share of its cost.
COMES_BACK = 0.9
#: A fit with so many times the cost of the null has gone astray.
ASTRAY = 100.0
#: Most effects named at once.
MOST_EFFECTS = 4


@dataclass
class Search(Expander):
    """Forward and backward search over sets of effects.

    Attributes
    ----------
    null, final : Evidence or None
        Filled as the search goes on, so that an interrupt leaves what is known.
    first_round : list of Candidate
        Single effects, best first.
    """

    null: Evidence | None = None
    final: Evidence | None = None
    first_round: list[Candidate] = field(default_factory=list)
    runners: list[Candidate] = field(default_factory=list)
    richer: dict = field(default_factory=dict)
    least: float = SMALLEST_SHARE

    def bar(self, k: int) -> float:
        return bar(k, len(self.candidates), self.n_values)

    def evidence(self, rival: Candidate) -> float:
        """Log likelihood, with what it costs to move the free parameters: a far re-tuning must not imitate an effect."""
        known = self.judged.get(rival)
        return -np.inf if known is None else known.log_likelihood - 0.5 * prior_cost(rival)

    @property
    def begun(self) -> Evidence:
        """The null, once it is fitted."""
        if self.null is None:
            raise KeyboardInterrupt("interrupted before the first fit: nothing is known yet")
        return self.null

    def stand(self, rival: Candidate) -> Candidate:
        """What an interrupt leaves."""
        self.final = self.judged[rival]
        return rival

    def gain(self, rival: Candidate) -> float:
        """2 (L_rival - L_null)."""
        return 2.0 * (self.evidence(rival) - self.evidence(self.begun.candidate))

    def score(self, rival: Candidate) -> float:
        """Evidence less ``k/2 ln N``: a form with more parameters must earn them."""
        return self.evidence(rival) - 0.5 * rival.n_parameters * np.log(self.n_values)

    def size_score(self, rival: Candidate) -> float:
        """Evidence by size: white errors with one independent value in :data:`CORRELATED`, less ``k/2 ln N``.

        Far from the data no noise model holds, and the force that it allows would hide which rival comes nearer.
        """
        return -0.5 * self.n_values / CORRELATED * np.log(rival.fit.cost) - 0.5 * rival.n_parameters * np.log(
            self.n_values
        )

    def order(self, rivals: Sequence[Candidate]) -> Callable[[Candidate], float]:
        """By size where all are far from the data, by likelihood where one comes near."""
        return self.size_score if all(self.is_far(rival) for rival in rivals) else self.score

    # ---- the search -------------------------------------------------------------------------------------------------
    def fit_null(self) -> Evidence:
        """No effect: initial states and free parameters only."""
        problem, theta = self.problem, np.zeros(len(self.problem.free))
        tries = [problem.fit((), theta, self.x)]
        if tries[0] is None:
            # Strong noise in the first sample alone can send a plant into divergence.
            for n_mean in (4, 9):
                tries.append(problem.fit((), theta, mean_start(self.x, problem.record.starts, n_mean)))
        found = [rival for rival in tries if rival is not None]
        if not found:
            found = [open_null(problem, theta, self.x)]
        nearest = min(found, key=lambda rival: rival.fit.cost)
        self.null = self.final = self.judge(follow_null(nearest, problem.first_noise(), second=self.second))
        return self.null

    def run(self) -> Evidence:
        """The whole search; returns the final rival (the null where nothing passes)."""
        null = (self.null or self.fit_null()).candidate
        self.first_round = self.ranked(self.singles(null), null)
        if not self.first_round:
            return self.begun
        if self.gain(self.first_round[0]) > self.bar(self.first_round[0].n_parameters):
            self.stand(self.first_round[0])
        best = self.simplify(self.first_choice(self.first_round))
        if self.gain(best) < 20.0 * self.bar(best.n_parameters):
            # A weak gain must not be what the null's noise fit left on the table.
            self.null = self.judge(follow_null(null, self.judged[best].noise, self.null, self.second))
        passed = self.gain(best) > self.bar(best.n_parameters) and not may_follow_noise(best, null)
        self.stand(best if passed else null)
        if not passed and self.begun.left < FAR:
            return self.begun
        left_behind: dict = {}
        while len(best.effects) < MOST_EFFECTS:
            if passed and not self.is_far(best):
                best = self.stand(self.enrich(best))
            better = self.one_more(best, passed)
            left_behind[frozenset(best.keys)] = best.fit.cost
            # One set may beat another by likelihood and lose to it by size: a ring, unless it comes back nearer to the data.
            if better is None or better.fit.cost > COMES_BACK * left_behind.get(frozenset(better.keys), np.inf):
                break
            given_up = passed and self.is_far(better) and grows_in_vain(better, best, null)
            best, passed = self.stand(better), True
            if given_up:
                break
        stood = (self.final or self.begun).candidate
        self.stand(self.simplify(stood, far=True) if self.is_far(stood) else self.merge(stood))
        return self.final or self.begun

    def further(self, best: Candidate) -> Candidate | None:
        """The best set with one effect more, however little of the gap it removes; None where the evidence is not for it."""
        self.least = 0.0
        better = self.one_more(best, True)
        self.least = SMALLEST_SHARE
        return better

    def singles(self, null: Candidate) -> list[Candidate]:
        """The null with one effect; where re-tuning went far, also from nominal parameters, the nearer fit of each kept."""
        rivals = self.expand(null, 16, 6, siblings=True)
        if retuning_cost(null) < FAR_RETUNED:
            return rivals
        best: dict = {}
        for rival in [*rivals, *self.from_nominal(self.begun, 16, 6)]:
            worth = rival.fit.cost + prior_cost(rival)
            if rival.keys not in best or worth < best[rival.keys][0]:
                best[rival.keys] = worth, rival
        return [rival for _, rival in best.values()]

    def one_more(self, best: Candidate, passed: bool) -> Candidate | None:
        """The best rival with one effect more, None where it does not pass."""
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
            trial.extend(self.ranked(self.pairs(self.begun.candidate, MOST_PAIRS, best.fit.cost), best))
        nearest = self.own(max(trial, key=self.score)) if trial else None
        near = nearest is not None and nearest.left < AT_THE_NOISE
        for base in () if near or settled else self.beam(best):
            trial.extend(self.ranked(self.expand(base, 6, 3), base))
        if not trial:
            return None
        trial.sort(key=self.order(trial), reverse=True)
        top = self.best_polished(trial)
        self.runners = distinct([rival for rival in trial if rival is not top], {frozenset(top.keys)}, RUNNERS)
        if not self.passes(top, best, passed):
            return None
        top = self.simplify(self.swap(top))
        return self.needed(top, best) if self.passes(top, best, passed) else None

    def needed(self, rival: Candidate, best: Candidate) -> Candidate:
        """The rival, or what is left without an effect that only repaired a wrong first choice."""
        for i in range(len(rival.effects)):
            smaller = self.without(rival, i)
            if smaller is None or not smaller.effects:
                continue
            own = self.judged[rival]
            self.judge(estimate_noise(smaller, own.noise, own.curvature))
            better = self.score(smaller) > self.score(best) + 1.0 and self.gain(smaller) > self.bar(
                smaller.n_parameters
            )
            if better and not self.passes(rival, smaller, True):
                return self.needed(smaller, best)
        return rival

    def passes(self, rival: Candidate, best: Candidate, passed: bool) -> bool:
        """Whether an effect more is worth it: over the best smaller set, or over nothing where none passed alone."""
        if may_follow_noise(rival, best):
            return False
        if not passed:
            return self.gain(rival) > self.bar(rival.n_parameters) + 2.0 * np.log(len(self.candidates))
        removed = best.fit.cost - rival.fit.cost
        if removed < self.least * (self.begun.fit.cost - self.n_values) and not arrived(self.own(rival), best):
            return False
        extra = 2.0 * (self.evidence(rival) - self.evidence(best))
        if rival.fit.cost > JUDGED_BY_SIZE * self.n_values:
            extra = self.n_values / CORRELATED * float(np.log(best.fit.cost / rival.fit.cost))
        return extra > self.needed_gain(rival.n_parameters - best.n_parameters)

    def needed_gain(self, k: int) -> float:
        """2 (L_rival - L_best) that a further effect of k parameters must reach."""
        return self.bar(max(k, 1)) + EXTRA

    def beam(self, best: Candidate) -> list[Candidate]:
        """Other sets of this size worth one effect more.

        Of singles the next by likelihood and the next by cost; far from the data, where the first choice is often a
        stand-in for several effects, the runners-up of every round.
        """
        if len(best.effects) > 1:
            return self.runners if self.is_far(best) else []
        others = [rival for rival in self.first_round if rival.keys != best.keys]
        by_cost = sorted(others, key=lambda rival: rival.fit.cost)
        return distinct([*others[:2], *by_cost[:2]], set(), 4)

    def swap(self, rival: Candidate) -> Candidate:
        """Leave each effect out in turn and choose it again with the others kept; twice at most."""
        for _ in range(1 if self.is_far(rival) else 2):
            start = rival
            for i in range(len(start.effects)):
                if i >= len(rival.effects):
                    break
                base = self.without(rival, i)
                if base is None:
                    continue
                counts = (6, 3) if self.judged[rival].left < AT_THE_NOISE or len(start.effects) > 2 else (12, 6)
                trial = self.ranked(self.expand(base, *counts), base)
                if not trial:
                    continue
                worth = self.order([trial[0], rival])
                if worth(trial[0]) > worth(rival) + 1.0:
                    swapped = self.polish(trial[0])
                    rival = swapped if worth(swapped) > worth(rival) else rival
            if rival is start:
                break
        return rival

    def without(self, rival: Candidate, i: int) -> Candidate | None:
        """The rival refitted without effect i."""
        effects, theta = rival.without_effect(i)
        base = rival.problem.fit(effects, theta, rival.fit.x[: rival.model.n_nominal])
        if base is not None:  # a step may have been off, and effect i have made up for it
            for j in range(len(effects)):
                base = scanned(base, j)
        if base is None and self.null is not None and not effects:
            base = self.null.candidate
        noise = self.noise_of(rival)
        if base is not None and noise is not None and self.own(base) is None:
            self.judge(replace(judged_under(base, [noise]), quick=False))
        return base

    # ---- steps ------------------------------------------------------------------------------------------------------
    def ranked(self, rivals: Iterable[Candidate], base: Candidate) -> list[Candidate]:
        """Rivals by penalised likelihood, the best under their own noise, the others by a quick look."""
        rivals = [rival for rival in rivals if rival.fit.cost < ASTRAY * self.begun.fit.cost and plausible(rival)]
        if not rivals:
            return []
        noise, _, curvature = (self.own(base) or replace(self.begun, curvature=None)).judgement
        nearest = min(rivals, key=lambda rival: rival.fit.cost)
        start, _, shape = self.judge(estimate_noise(nearest, noise, curvature)).judgement
        for rival in rivals:
            if rival is not nearest:
                self.judge(judged_under(rival, [noise, start]))
        rivals.sort(key=self.score, reverse=True)
        if self.own(rivals[0]) is None:
            self.judge(estimate_noise(rivals[0], start, shape, max_iterations=8))
        near = [r for r in rivals[1:6] if self.score(r) > self.score(rivals[0]) - 30.0 and self.own(r) is None]
        tops = side_by_side(lambda r: estimate_noise(r, start, shape, max_iterations=8).judgement, near, self.second)
        for rival, top in zip(near, tops):
            self.judge(Evidence(rival, *top))
        rivals.sort(key=self.order(rivals), reverse=True)
        return rivals

    def first_choice(self, singles: Sequence[Candidate]) -> Candidate:
        """The best single effect; the steps on which readings stand, where these are the likeliest: nothing else makes them."""
        likeliest = max(singles, key=self.score)
        return self.polish(likeliest) if names_steps(likeliest) else self.best_polished(singles)

    def best_polished(self, rivals: Sequence[Candidate], most: int = 4) -> Candidate:
        """The best of the first few after each was polished: coarse steps and soft kinks must not choose between them."""
        least = min(rival.fit.cost for rival in rivals[:most])
        near = [rival for rival in rivals[:most] if rival is rivals[0] or rival.fit.cost < 3.0 * least + 50.0]
        polished = [self.polish(rival) for rival in near]
        return max(polished, key=self.order(polished))

    def is_far(self, rival: Candidate) -> bool:
        """Whether a rival is so far from the data that sizes, not likelihoods, tell rivals apart."""
        return rival.fit.cost > FAR_BY_COST * self.n_values

    def polish(self, rival: Candidate) -> Candidate:
        """Refit with kinks sharper and steps shorter where that matters."""
        best = rival if self.is_far(rival) else revived(rival)
        for n_sub, sharpness in ((4, 150.0), (8, 500.0)):
            finer = best.problem.at(Numerics(max(n_sub, 2 * best.problem.numerics.n_sub), sharpness))
            if not numerics_matter(finer, best):
                break
            fitted = finer.fit(best.effects, best.fit.theta, best.fit.x, open_steps=0, settled=True)
            if fitted is None or fitted.fit.cost > best.fit.cost + 2.0:
                break
            best = fitted
        if self.own(best) is None:
            noise, _, curvature = (self.own(rival) or replace(self.begun, curvature=None)).judgement
            self.judge(estimate_noise(best, noise, curvature))
        return best

    def simplify(self, rival: Candidate, far: bool = False) -> Candidate:
        """Name the simpler form where the richer one that nests it removes hardly more; the richer stays in its class.

        Far from the data the search goes on with the richer form and ends with this question. Two forms of one law are one.
        """
        one = folded(rival)
        if one is not None:
            return self.simplify(self.polish(one), far)
        if self.is_far(rival) and not far:
            return rival
        for i, effect in enumerate(rival.effects):
            shapes = effect.simpler(tuple(rival.theta_of(i)))
            for name in (*NESTED.get(effect.name, ()), *shapes):
                simple = simpler(effect, name, self.candidates)
                base = self.without(rival, i) if simple else None
                if base is None:
                    continue
                others = self.formed(base, simple, shapes.get(name), rival.fit.cost)
                near = [other for other in others if other.fit.cost < UNPOLISHED * self.most_left(rival)]
                for other in self.ranked(near, base)[:1]:
                    fitted = self.polish(other)
                    if self.as_good(fitted, rival):
                        self.richer.setdefault(fitted.effects[-1].key, []).append(effect.key)
                        return self.simplify(fitted, far)
        return rival

    def enrich(self, rival: Candidate) -> Candidate:
        """The richer form of an effect where it removes more of the gap and no fit has looked at it yet."""
        for i, effect in enumerate(rival.effects):
            others = {key for j, key in enumerate(rival.keys) if j != i}
            richer = [e for e in self.candidates if effect.name in NESTED.get(e.name, ())]
            richer = [e for e in richer if e.location == effect.location and effect.variable in (e.variable, None)]
            richer = [e for e in richer if frozenset((*others, e.key)) not in self.fitted]
            base = self.without(rival, i) if richer else None
            for other in self.ranked(self.expand(base, 2, 1, richer), base)[:1] if base is not None else ():
                fitted = self.polish(other)
                if self.score(fitted) > self.score(rival) + 1.0 and not self.as_good(rival, fitted):
                    return self.enrich(fitted)
        return rival

    def merge(self, rival: Candidate) -> Candidate:
        """One effect fewer where a relative of another takes over its part (friction and an offset are one friction)."""
        if len(rival.effects) < 3:
            return rival
        for j in range(len(rival.effects)):
            fewer = self.without(rival, j)
            for i in range(len(rival.effects) - 1 if fewer is not None else 0):
                assert fewer is not None
                kin = [e for e in self.candidates if related(e, fewer.effects[i]) and e.key not in rival.keys]
                base = self.without(fewer, i) if kin else None
                for other in self.ranked(self.expand(base, 3, 1, kin), base)[:1] if base is not None else ():
                    fitted = self.polish(other)
                    if self.score(fitted) > self.score(rival):
                        return self.merge(fitted)
        return rival

    def most_left(self, rich: Candidate) -> float:
        """Cost up to which a simpler form leaves hardly more of the gap."""
        return hardly_more(rich.fit.cost, self.begun.fit.cost - self.n_values)

    def as_good(self, simple: Candidate, rich: Candidate) -> bool:
        """Whether a simpler form does as well: hardly more gap left, or far from the data no evidence by size."""
        if self.is_far(rich):
            return 2.0 * (self.size_score(rich) - self.size_score(simple)) < EQUAL
        return simple.fit.cost < self.most_left(rich) and not arrived(self.own(rich), simple)
