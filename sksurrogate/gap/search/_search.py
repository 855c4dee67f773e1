"""Which effects: joint refits ordered by the screen, evidence under each rival's own noise, forward and backward."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from sksurrogate._parallel._parallel_map import side_by_side
from sksurrogate.gap.fit._closed_loop import may_follow_noise
from sksurrogate.gap.fit._closeness import FAR
from sksurrogate.gap.fit._evidence import NEAR, arrived, bar, estimate_noise, follow_null, left, quick_likelihood, told
from sksurrogate.gap.fit._prior import prior_cost, retuning_cost
from sksurrogate.gap.fit._problem import Rival
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
#: Where no further effect passes none is looked for of sets that leave less than the first times the noise, up to the second pairs.
NO_MORE, PAIRS_UP_TO = 1.15, 1.5
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
#: Squared error over the noise from which an effect more is judged by size: a disturbance leaves less, and follows any effect.
BY_SIZE = 10.0
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
    null, final : Rival or None
        Filled as the search goes on, so that an interrupt leaves what is known.
    first_round : list of Rival
        Single effects, best first.
    """

    null: Rival | None = None
    final: Rival | None = None
    first_round: list[Rival] = field(default_factory=list)
    runners: list[Rival] = field(default_factory=list)
    richer: dict = field(default_factory=dict)
    nominal_left: float = float("nan")
    least: float = SMALLEST_SHARE

    def bar(self, k: int) -> float:
        return bar(k, len(self.candidates), self.n_values)

    def evidence(self, rival: Rival) -> float:
        """Log likelihood, with what it costs to move the free parameters: a far re-tuning must not imitate an effect."""
        return rival.log_likelihood - 0.5 * prior_cost(self.problem, rival)

    def gain(self, rival: Rival) -> float:
        """2 (L_rival - L_null)."""
        assert self.null is not None
        return 2.0 * (self.evidence(rival) - self.evidence(self.null))

    def score(self, rival: Rival) -> float:
        """Evidence less ``k/2 ln N``: a form with more parameters must earn them."""
        return self.evidence(rival) - 0.5 * rival.n_parameters * np.log(self.n_values)

    def size_score(self, rival: Rival) -> float:
        """Evidence by size: white errors with one independent value in :data:`CORRELATED`, less ``k/2 ln N``.

        Far from the data no noise model holds, and the force that it allows would hide which rival comes nearer.
        """
        return -0.5 * self.n_values / CORRELATED * np.log(rival.fit.cost) - 0.5 * rival.n_parameters * np.log(
            self.n_values
        )

    def order(self, rivals: Sequence[Rival]) -> Callable[[Rival], float]:
        """By size where all are far from the data, by likelihood where one comes near."""
        return self.size_score if all(self.is_far(rival) for rival in rivals) else self.score

    # ---- the search -------------------------------------------------------------------------------------------------
    def fit_null(self) -> Rival:
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
        self.null = min(found, key=lambda rival: rival.fit.cost)
        follow_null(problem, self.null, problem.first_noise(), self.second)
        self.final = self.null
        return self.null

    def run(self) -> Rival:
        """The whole search; returns the final rival (the null where nothing passes)."""
        null = self.null or self.fit_null()
        self.first_round = self.ranked(self.singles(null), null)
        if not self.first_round:
            return null
        if self.gain(self.first_round[0]) > self.bar(self.first_round[0].n_parameters):
            self.final = self.first_round[0]  # what an interrupt leaves
        best = self.simplify(self.first_choice(self.first_round))
        if best.noise is not None and self.gain(best) < 20.0 * self.bar(best.n_parameters):
            # A weak gain must not be what the null's noise fit left on the table.
            follow_null(self.problem, null, best.noise, self.second)
        passed = self.gain(best) > self.bar(best.n_parameters) and not may_follow_noise(self.at(best), best, null)
        if passed:
            self.final = best
        else:
            self.final = null
            if left(null) < FAR:
                return null
        left_behind: dict = {}
        while len(best.effects) < MOST_EFFECTS:
            if passed and not self.is_far(best):
                best = self.final = self.enrich(best)
            better = self.one_more(best, passed)
            left_behind[frozenset(best.keys)] = best.fit.cost
            # One set may beat another by likelihood and lose to it by size: a ring, unless it comes back nearer to the data.
            if better is None or better.fit.cost > COMES_BACK * left_behind.get(frozenset(better.keys), np.inf):
                break
            given_up = passed and self.is_far(better) and grows_in_vain(better, best, null)
            best, passed = better, True
            self.final = best
            if given_up:
                break
        if self.final is not None:
            self.final = self.simplify(self.final, far=True) if self.is_far(self.final) else self.merge(self.final)
        return self.final or null

    def further(self, best: Rival) -> Rival | None:
        """The best set with one effect more, however little of the gap it removes; None where the evidence is not for it."""
        self.least = 0.0
        better = self.one_more(best, True)
        self.least = SMALLEST_SHARE
        return better

    def singles(self, null: Rival) -> list[Rival]:
        """The null with one effect; where re-tuning went far, also from nominal parameters, the nearer fit of each kept."""
        rivals = self.expand(null, 16, 6, siblings=True)
        if retuning_cost(self.problem, null) < FAR_RETUNED:
            return rivals
        best: dict = {}
        for rival in [*rivals, *self.from_nominal(null, 16, 6)]:
            worth = rival.fit.cost + prior_cost(self.problem, rival)
            if rival.keys not in best or worth < best[rival.keys][0]:
                best[rival.keys] = worth, rival
        return [rival for _, rival in best.values()]

    def one_more(self, best: Rival, passed: bool) -> Rival | None:
        """The best rival with one effect more, None where it does not pass."""
        assert self.null is not None
        self.report(f"{len(best.effects)} effect(s): {', '.join(e.name for e in best.effects)}; looking for another")
        hopeless = SCREENED * self.needed_gain(1) if passed and left(best) < NEAR else 0.0
        trial = self.ranked(self.expand(best, 8, 4, siblings=True, least=hopeless), best)
        if not trial and hopeless:
            return None
        settled = bool(trial) and passed and left(best) < PAIRS_UP_TO and not self.passes(trial[0], best, passed)
        if settled and left(best) < NO_MORE:
            return None
        if len(best.effects) == 1:
            trial.extend(self.ranked(self.pairs(self.null, MOST_PAIRS, best.fit.cost), best))
        nearest = max(trial, key=self.score, default=None)
        near = nearest is not None and nearest.noise is not None and left(nearest) < NEAR
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

    def needed(self, rival: Rival, best: Rival) -> Rival:
        """The rival, or what is left without an effect that only repaired a wrong first choice."""
        for i in range(len(rival.effects)):
            smaller = self.without(rival, i)
            if smaller is None or not smaller.effects:
                continue
            assert rival.noise is not None
            estimate_noise(self.at(smaller), smaller, rival.noise, rival.curvature)
            better = self.score(smaller) > self.score(best) + 1.0 and self.gain(smaller) > self.bar(
                smaller.n_parameters
            )
            if better and not self.passes(rival, smaller, True):
                return self.needed(smaller, best)
        return rival

    def passes(self, rival: Rival, best: Rival, passed: bool) -> bool:
        """Whether an effect more is worth it: over the best smaller set, or over nothing where none passed alone."""
        if may_follow_noise(self.at(rival), rival, best):
            return False
        if not passed:
            return self.gain(rival) > self.bar(rival.n_parameters) + 2.0 * np.log(len(self.candidates))
        assert self.null is not None
        removed = best.fit.cost - rival.fit.cost
        if removed < self.least * (self.null.fit.cost - self.n_values) and not arrived(rival, best):
            return False
        extra = 2.0 * (self.evidence(rival) - self.evidence(best))
        if rival.fit.cost > BY_SIZE * self.n_values:
            extra = self.n_values / CORRELATED * float(np.log(best.fit.cost / rival.fit.cost))
        return extra > self.needed_gain(rival.n_parameters - best.n_parameters)

    def needed_gain(self, k: int) -> float:
        """2 (L_rival - L_best) that a further effect of k parameters must reach."""
        return self.bar(max(k, 1)) + EXTRA

    def beam(self, best: Rival) -> list[Rival]:
        """Other sets of this size worth one effect more.

        Of singles the next by likelihood and the next by cost; far from the data, where the first choice is often a
        stand-in for several effects, the runners-up of every round.
        """
        if len(best.effects) > 1:
            return self.runners if self.is_far(best) else []
        others = [rival for rival in self.first_round if rival.keys != best.keys]
        by_cost = sorted(others, key=lambda rival: rival.fit.cost)
        return distinct([*others[:2], *by_cost[:2]], set(), 4)

    def swap(self, rival: Rival) -> Rival:
        """Leave each effect out in turn and choose it again with the others kept; twice at most."""
        for _ in range(1 if self.is_far(rival) else 2):
            start = rival
            for i in range(len(start.effects)):
                if i >= len(rival.effects):
                    break
                base = self.without(rival, i)
                if base is None:
                    continue
                counts = (6, 3) if left(rival) < NEAR or len(start.effects) > 2 else (12, 6)
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

    def without(self, rival: Rival, i: int) -> Rival | None:
        """The rival refitted without effect i."""
        effects = tuple(e for j, e in enumerate(rival.effects) if j != i)
        keep = np.ones(len(rival.fit.theta), bool)
        keep[rival.model.slice_of(i)] = False
        problem = self.at(rival)
        n = self.problem.model.plant.states
        base = problem.fit(effects, rival.fit.theta[keep], rival.fit.x[: len(n)])
        if base is not None:  # a step may have been off, and effect i have made up for it
            for j in range(len(effects)):
                base = scanned(problem, base, j)
        if base is None and self.null is not None and not effects:
            base = self.null
        if base is not None and base.noise is None:
            base.noise = rival.noise
            base.log_likelihood = quick_likelihood(problem, base, [rival.noise]) if rival.noise else -np.inf
        return base

    # ---- steps ------------------------------------------------------------------------------------------------------
    def ranked(self, rivals: Iterable[Rival], base: Rival) -> list[Rival]:
        """Rivals by penalised likelihood, the best under their own noise, the others by a quick look."""
        assert self.null is not None and self.null.noise is not None
        rivals = [rival for rival in rivals if rival.fit.cost < ASTRAY * self.null.fit.cost]
        rivals = [rival for rival in rivals if plausible(self.problem, rival)]
        if not rivals:
            return []
        noise = base.noise or self.null.noise
        cheapest = min(rivals, key=lambda rival: rival.fit.cost)
        problem = self.searching(base)
        estimate_noise(problem, cheapest, noise, base.curvature)
        assert cheapest.noise is not None
        for rival in rivals:
            if rival is not cheapest:
                rival.log_likelihood = quick_likelihood(problem, rival, [noise, cheapest.noise])
        rivals.sort(key=self.score, reverse=True)
        if rivals[0].noise is None:
            estimate_noise(problem, rivals[0], cheapest.noise, cheapest.curvature, max_iterations=8)
        near = [r for r in rivals[1:6] if self.score(r) > self.score(rivals[0]) - 30.0 and r.noise is None]
        start, curvature = cheapest.noise, cheapest.curvature
        tops = side_by_side(
            lambda r: told(estimate_noise(problem, r, start, curvature, max_iterations=8)), near, self.second
        )
        for rival, top in zip(near, tops):
            rival.log_likelihood, rival.noise, rival.curvature = top
        rivals.sort(key=self.order(rivals), reverse=True)
        return rivals

    def first_choice(self, singles: Sequence[Rival]) -> Rival:
        """The best single effect; the steps on which readings stand, where these are the likeliest: nothing else makes them."""
        likeliest = max(singles, key=self.score)
        return self.polish(likeliest) if names_steps(likeliest) else self.best_polished(singles)

    def best_polished(self, rivals: Sequence[Rival], most: int = 4) -> Rival:
        """The best of the first few after each was polished: coarse steps and soft kinks must not choose between them."""
        least = min(rival.fit.cost for rival in rivals[:most])
        near = [rival for rival in rivals[:most] if rival is rivals[0] or rival.fit.cost < 3.0 * least + 50.0]
        polished = [self.polish(rival) for rival in near]
        return max(polished, key=self.order(polished))

    def is_far(self, rival: Rival) -> bool:
        """Whether a rival is so far from the data that sizes, not likelihoods, tell rivals apart."""
        return rival.fit.cost > 5.0 * self.n_values

    def polish(self, rival: Rival) -> Rival:
        """Refit with kinks sharper and steps shorter where that matters."""
        problem, far = self.at(rival), self.is_far(rival)
        best = rival if far else revived(problem, rival)
        for n_sub, sharpness in ((4, 150.0), (8, 500.0)):
            finer = replace(problem, n_sub=max(n_sub, 2 * best.model.n_sub), sharpness=sharpness)
            if not numerics_matter(finer, best):
                break
            fitted = finer.fit(best.effects, best.fit.theta, best.fit.x, open_steps=0, settled=True)
            if fitted is None or fitted.fit.cost > best.fit.cost + 2.0:
                break
            best = fitted
        if best.noise is None:
            assert self.null is not None and self.null.noise is not None
            estimate_noise(self.at(best), best, rival.noise or self.null.noise, rival.curvature)
        return best

    def simplify(self, rival: Rival, far: bool = False) -> Rival:
        """Name the simpler form where the richer one that nests it removes hardly more; the richer stays in its class.

        Far from the data the search goes on with the richer form and ends with this question. Two forms of one law are one.
        """
        one = folded(self.at(rival), rival)
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

    def enrich(self, rival: Rival) -> Rival:
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

    def merge(self, rival: Rival) -> Rival:
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

    def most_left(self, rich: Rival) -> float:
        """Cost up to which a simpler form leaves hardly more of the gap."""
        assert self.null is not None
        return hardly_more(rich.fit.cost, self.null.fit.cost - self.n_values)

    def as_good(self, simple: Rival, rich: Rival) -> bool:
        """Whether a simpler form does as well: hardly more gap left, or far from the data no evidence by size."""
        if self.is_far(rich):
            return 2.0 * (self.size_score(rich) - self.size_score(simple)) < EQUAL
        return simple.fit.cost < self.most_left(rich) and not arrived(rich, simple)
