"""Which effects: joint refits ordered by the screen, evidence under each rival's own noise, forward and backward."""

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
from sksurrogate.gap.search._stopping import grows_in_vain, is_stack

__all__ = ["Search"]

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
#: A set of effects that was left is taken up again where it comes back with less than this share of its cost.
COMES_BACK = 0.9
#: A fit with so many times the cost of the null has gone astray.
ASTRAY = 100.0
#: Rivals fitted from where the others stand, with one effect of what stands taken out.
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
    nominal_costs: dict[OdeCandidate, float] = field(default_factory=dict)
    least: float = SMALLEST_SHARE

    def prior_cost(self, rival: OdeCandidate) -> float:
        """Of the free parameters, of steps of quantisation and of the initial states."""
        return prior_cost(rival)

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
        rivals = self.expand(null, 16, 6, siblings=True)
        if not moved_far(null):
            return rivals
        best: dict = {}
        for rival in [*rivals, *self.from_nominal(self.begun, 16, 6)]:
            worth = rival.fit.cost + prior_cost(rival)
            if rival.keys not in best or worth < best[rival.keys][0]:
                best[rival.keys] = worth, rival
        return [rival for _, rival in best.values()]

    def one_more(self, best: OdeCandidate, passed: bool) -> OdeCandidate | None:
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

    def needed(self, rival: OdeCandidate, best: OdeCandidate) -> OdeCandidate:
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

    def passes(self, rival: OdeCandidate, best: OdeCandidate, passed: bool) -> bool:
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

    def beam(self, best: OdeCandidate) -> list[OdeCandidate]:
        """Other sets of this size worth one effect more.

        Of singles the next by likelihood and the next by cost; far from the data, where the first choice is often a
        stand-in for several effects, the runners-up of every round.
        """
        if len(best.effects) > 1:
            return self.runners if self.is_far(best) else []
        others = [rival for rival in self.first_round if rival.keys != best.keys]
        by_cost = sorted(others, key=lambda rival: rival.fit.cost)
        return distinct([*others[:2], *by_cost[:2]], set(), 4)

    def swap(self, rival: OdeCandidate) -> OdeCandidate:
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

    def without(self, rival: OdeCandidate, i: int) -> OdeCandidate | None:
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
    def ranked(self, rivals: Iterable[OdeCandidate], base: OdeCandidate) -> list[OdeCandidate]:
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
                if not self.is_far(rival) and self.score(rival) < self.score(base) - 0.5 * self.bar(1):
                    # It holds the base: what it loses to it, it loses to a noise that was made for others.
                    self.judge(estimate_noise(rival, noise, curvature, max_iterations=8))
        rivals.sort(key=self.score, reverse=True)
        if self.own(rivals[0]) is None:
            self.judge(estimate_noise(rivals[0], start, shape, max_iterations=8))
        near = [r for r in rivals[1:6] if self.score(r) > self.score(rivals[0]) - 30.0 and self.own(r) is None]
        tops = side_by_side(lambda r: estimate_noise(r, start, shape, max_iterations=8).judgement, near, self.second)
        for rival, top in zip(near, tops):
            self.judge(Evidence(rival, *top))
        rivals.sort(key=self.order(rivals), reverse=True)
        return rivals

    def first_choice(self, singles: Sequence[OdeCandidate]) -> OdeCandidate:
        """The best single effect; the steps on which readings stand, where these are the likeliest: nothing else makes them."""
        likeliest = max(singles, key=self.score)
        return self.polish(likeliest) if names_steps(likeliest) else self.best_polished(singles)

    def best_polished(self, rivals: Sequence[OdeCandidate], most: int = 4) -> OdeCandidate:
        """The best of the first few after each was polished: coarse steps and soft kinks must not choose between them."""
        least = min(rival.fit.cost for rival in rivals[:most])
        near = [rival for rival in rivals[:most] if rival is rivals[0] or rival.fit.cost < 3.0 * least + 50.0]
        polished = [self.polish(rival) for rival in near]
        return max(polished, key=self.order(polished))

    def polish(self, rival: OdeCandidate) -> OdeCandidate:
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

    def simplify(self, rival: OdeCandidate, far: bool = False) -> OdeCandidate:
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

    def enrich(self, rival: OdeCandidate) -> OdeCandidate:
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

    def merge(self, rival: OdeCandidate) -> OdeCandidate:
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

    def most_left(self, rich: OdeCandidate) -> float:
        """Cost up to which a simpler form leaves hardly more of the gap."""
        return hardly_more(rich.fit.cost, self.begun.fit.cost - self.n_values)

    def as_good(self, simple: OdeCandidate, rich: OdeCandidate) -> bool:
        """Whether a simpler form does as well: hardly more gap left, or far from the data no evidence by size."""
        if self.is_far(rich):
            return 2.0 * (self.size_score(rich) - self.size_score(simple)) < EQUAL
        return simple.fit.cost < self.most_left(rich) and not arrived(self.own(rich), simple)

    # ---- what could stand in the place of a name --------------------------------------------------------------------
    def in_place_of(self, final: Evidence[OdeCandidate], i: int) -> list[OdeCandidate]:
        """Rivals with another effect in the place of effect i, with the numerics of what stands, and that itself again."""
        named, single = final.candidate, len(final.effects) == 1
        base = self.begun.candidate if single else self.without(named, i)
        if base is None:
            return []
        few = self.is_far(named) or is_stack(final)
        if few:
            rivals = self.expand(base, 8, 2, thorough=False)
        else:
            rivals = self.expand(base, 24, 10, siblings=True, best=final.fit.cost)
        if single:  # those of the search may have begun at other re-tuned parameters
            rivals.extend(self.first_round)
        if not few and (not single or self.problem.free):
            rest = named.taken_out(i)  # the others and the free parameters, fitted again alone, may have run away
            rivals.extend([] if rest is None else self.anew(rest, final.noise, MOST_ANEW, 0, final.fit.cost))
        rivals = list({rival.keys: rival for rival in sorted(rivals, key=lambda r: -r.fit.cost)}.values())
        mine = [r.fit.cost for r in rivals if r.effects[-1].key == final.effects[i].key]
        fine = named.problem
        same_numerics = self.searching(base).numerics == fine.numerics
        reach = min([final.fit.cost, *mine]) if same_numerics else max([final.fit.cost, *mine])
        near = [rival for rival in rivals if rival.fit.cost <= 1.5 * reach + 50.0 * EQUAL]
        return near if same_numerics else [self.again(fine, rival) for rival in near]

    @staticmethod
    def again(fine: OdeBackend, rival: OdeCandidate) -> OdeCandidate:
        """A rival fitted on with finer numerics."""
        return fine.fit(rival.effects, rival.fit.theta, rival.fit.x, open_steps=0, max_steps=8, settled=True) or rival
