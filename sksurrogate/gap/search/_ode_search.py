"""The search along a right-hand side: starts, numerics, two effects at once, windows of time."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sksurrogate.effects._base_effect import BaseEffect
from sksurrogate.effects._law import AnyLaw
from sksurrogate.effects._smooth import KINK_SHARPNESS
from sksurrogate.effects._whole_step import has_own_steps
from sksurrogate.gap.fit._closeness import MOST_LEFT, SETTLED
from sksurrogate.gap.fit._evidence import Evidence, follow_null
from sksurrogate.gap.fit._ode import FIT_STEPS, OdeCandidate
from sksurrogate.gap.fit._prior import prior_cost
from sksurrogate.gap.fit._probe import probe_of
from sksurrogate.gap.screen._screen import screen
from sksurrogate.gap.screen._shortlist import MOST_LISTED
from sksurrogate.gap.search._base import Wanted
from sksurrogate.gap.search._expander import SEARCH_SHARPNESS, SEARCH_SUBSTEPS, Expander
from sksurrogate.gap.search._fit_from_starts import (
    NEARER,
    best_starts,
    cheapest,
    fit_given,
    fit_last,
    fit_part,
    mean_start,
    numerics_matter,
    open_null,
)
from sksurrogate.gap.search._kink_width import rounded
from sksurrogate.gap.search._met_twins import MOST_MET, about_as_much, met_twins, twins_of, with_twin
from sksurrogate.gap.search._onsets import look_for_onsets, twins_with_onset
from sksurrogate.gap.search._related_forms import simplify
from sksurrogate.gap.search._restart import line_searched
from sksurrogate.gap.search._set_search import COMES_BACK
from sksurrogate.gap.search._shapes import in_shape
from sksurrogate.gap.search._stopping import is_stack
from sksurrogate.gap.search._windowed_grids import look_for_windowed_grids

#: Steps a sample and sharpness of kinks that a candidate is refined with, one after the other.
FINER = ((SEARCH_SUBSTEPS, SEARCH_SHARPNESS), (8, KINK_SHARPNESS))

#: Effects left for later that are fitted where a law of their signals is likelier than all that was asked.
MOST_OF_SIGNALS = 3


@dataclass(eq=False)
class OdeSearch(Expander):
    """The search around a simulator with a right-hand side or a step."""

    #: Sets without one of their effects, by the set, its place and the best fit of the others that was known then
    smaller: dict[Any, OdeCandidate | None] = field(default_factory=dict)
    #: Laws that were asked for beside sets, with what they were asked for
    laws: list[tuple[Any, Any]] = field(default_factory=list)

    @property
    def frugal(self) -> bool:  # type: ignore[override]
        """A simulator that takes steps of its own within a sample is asked for them one by one."""
        return has_own_steps(self.problem.plant)

    @property
    def positions(self) -> tuple[str, ...]:
        return tuple(name for name in self.problem.plant.states if name not in self.problem.balances)

    def prior_cost(self, candidate: OdeCandidate) -> float:
        """Of the free parameters, of steps of quantisation, of a fitted width of kinks and of the initial states."""
        return prior_cost(candidate)

    def not_shown(self, candidate: OdeCandidate) -> list[BaseEffect]:
        """The effects whose typical form its path does not show; a path that breaks shows nothing else."""
        problem, x = candidate.problem, candidate.states
        if not np.isfinite(x).all():
            return []
        pairs = ((effect, candidate.theta_of(i)) for i, effect in enumerate(candidate.effects))
        return [e for e, theta in pairs if not e.plausible(tuple(theta), probe_of(problem, e, x, problem.rate))]

    def fit_null(self) -> Evidence:
        problem, theta = self.problem, np.zeros(len(self.problem.free))
        nearest = problem.fit((), theta, self.x)
        if nearest is None:  # strong noise in the first sample alone can send a plant into divergence
            starts = (mean_start(self.x, problem.record.starts, n_mean) for n_mean in (4, 9))
            nearest = cheapest([problem.fit((), theta, x) for x in starts]) or open_null(problem, theta, self.x)
        self.null = self.final = self.judge(follow_null(nearest, problem.first_noise(), second=self.second))
        return self.null

    def look_for_more(self) -> Evidence:
        """Further effects; then the effects left for later that are expected to close most of what the named ones leave.

        Names meet those that do what some of them do; where simulations are dear, only several names.
        """
        found = super().look_for_more()
        if found.effects and not (self.frugal and len(found.effects) == 1):
            found = met_twins(self, found)
        if not self.later_asked or not found.effects:
            return found
        found = self.paired_with_late(found)
        if len(found.effects) > 1 or (found.left >= SETTLED and found.effects[0].late):
            found = self.one_late(found)
        if found.left < SETTLED:
            return found
        likely = self.late_ones(found.candidate, found.candidate.fit.cost)
        if likely:
            self.report("effects that were left for later")
            self.ask_now(likely)
            self.grow(found.candidate, True, self.fitted_null.candidate)
        return self.standing

    def one_late(self, found: Evidence[OdeCandidate]) -> Evidence[OdeCandidate]:
        """What stands once effects left for later were fitted alone: one in the place of several names, or of one of its kind.

        To first order nothing tells of a parameter that changes by much.
        """
        null, late = self.fitted_null.candidate, [effect for effect in self.later_asked.values() if effect.late]
        alone = self.expand(null, Wanted(2, 0, late, best=found.candidate.fit.cost))
        for one in self.ranked(alone, null):
            if not self.passes(found.candidate, one, True):
                del self.later_asked[one.effects[0].key]
                return self.stand(self.polish(one))
        return found

    def paired_with_late(self, found: Evidence[OdeCandidate]) -> Evidence[OdeCandidate]:
        """What stands once effects left for later were paired with all: two names in the place of a stack above the noise.

        A stack is often an imitation of few effects of which one has not been asked.
        """
        late, named = [effect.key for effect in self.later_asked.values() if effect.late], found.candidate
        if not late or self.frugal or not is_stack(found):
            return found
        null = self.fitted_null.candidate
        left_for_later = self.later_asked
        self.ask_now(late)
        self.base_and_screen(null)
        two = self.ranked(self.pairs(null, named.fit.cost), null)
        chosen = simplify(self, self.swap(self.polish(two[0]))) if two else named
        if chosen is named or self.passes(named, chosen, True):
            self.later_asked = left_for_later  # they may still be asked beside what stands
            return found
        return self.stand(chosen)

    def singles(self, null: OdeCandidate) -> list[OdeCandidate]:
        """The null with one effect; those left for later too that are expected to close most of what the best of the others leaves."""
        found = super().singles(null)
        least = min((candidate.fit.cost for candidate in found), default=0.0)
        if not self.later_asked or least < SETTLED**2 * self.n_values:
            return found
        leading = self.late_ones(null, least)
        if not leading:
            return found
        self.ask_now(leading)
        return super().singles(null)

    def ask_late_of(self, signals: Collection[str], likelihood: float) -> bool:
        """Whether an effect left for later that signals drive, alone, is nearer to a law of them than to the best single effect: then it leads.

        What flows through an element has the name of its parameter: then what this depends on is asked. Where one element has another
        curve, others may have it: all that was left for later is asked from then on.

        ``likelihood``: the logarithm of that of the law, its price paid.
        """
        assert self.leading is not None
        null, (best, _) = self.fitted_null.candidate, self.leading
        late = [e for e in self.later_asked.values() if e.late and not {*e.signals, e.location}.isdisjoint(signals)]
        alone = self.ranked(self.expand(null, Wanted(MOST_OF_SIGNALS, 0, late)), null) if late else []
        if not alone or 2.0 * self.score(alone[0]) < likelihood + self.score(best):
            for one in alone:
                self.fitted.pop(frozenset(one.keys), None)
            return False
        self.ask_now([effect.key for effect in self.later_asked.values() if effect.late])
        self.first_round = self.ranked([*self.first_round, *alone], null)
        self.leading = self.first_name(null)
        return True

    def late_ones(self, base: OdeCandidate, left: float) -> list[Any]:
        """Keys of the effects left for later that the screen expects to close, beside a base, most of what is ``left``, or to reach the noise.

        A base that is at the noise by its cost hides in other outputs what one of them leaves: there they must gain what a name needs.
        """
        later, noise = list(self.later_asked.values()), self.noise_of(base)
        starts = screen(later, self.as_searched(base), self.guess(base), noise, second=self.second).starts
        best = [group[0] for group in best_starts(starts, MOST_LISTED, MOST_LISTED, self.n_values)]
        noise_cost = SETTLED**2 * self.n_values
        if base.effects and left < noise_cost:
            return [one.effect.key for one in best if one.white > self.needed_gain(len(one.theta))]
        return [one.effect.key for one in best if one.left < max(MOST_LEFT**2 * left, noise_cost)]

    def ask_now(self, keys: Sequence[Any]) -> None:
        """Effects that were left for later are candidates from now on."""
        self.later_asked = {key: effect for key, effect in self.later_asked.items() if key not in keys}
        self.screens.clear()
        self.first_screen = None

    def refitted_without(self, candidate: OdeCandidate, i: int) -> OdeCandidate | None:
        """Without effect i; a step may have been off, and effect i have made up for it: then from where this set was nearer to the data."""
        effects, theta = candidate.without_effect(i)
        known = self.fitted.get(frozenset(effect.key for effect in effects))
        asked = candidate, i, known
        if asked in self.smaller:
            return self.smaller[asked]
        base = candidate.problem.fit(effects, theta, candidate.states)
        for j in range(len(effects)):
            base = base and line_searched(base, j)
        if known is not None and (base is None or known.fit.cost <= COMES_BACK * base.fit.cost):
            base = cheapest([base, candidate.problem.fit(known.effects, known.fit.theta, known.fit.x, open_steps=0)])
        self.smaller[asked] = base
        return base

    def refined(self, candidate: OdeCandidate) -> OdeCandidate:
        """Fitted to the end, with kinks as wide as the plant's, and steps shorter and kinks sharper where that matters."""
        done = candidate.fit.converged
        best = candidate if done else candidate.resumed(candidate.problem, max_steps=FIT_STEPS) or candidate
        if best.fit.cost < self.most_left_cost:
            best = rounded(in_shape(best, self.threshold(1)), self.threshold(1))
        for n_sub, sharpness in FINER:
            own = best.problem.numerics
            finer = best.problem.at(own.finer(max(n_sub, 2 * own.n_sub), sharpness))
            if not numerics_matter(finer, best):
                break
            fitted = best.resumed(finer, max_steps=FIT_STEPS)
            if fitted is None or (fitted.fit.cost > best.fit.cost + 2.0 and not fitted.fit.converged):
                break  # what long steps alone brought nearer to the data does not stand
            best = fitted
        return best

    def look_for_onsets(self) -> None:
        look_for_windowed_grids(self)
        look_for_onsets(self)

    # ---- what could stand in the place of a name --------------------------------------------------------------------
    def with_effect(
        self, base: OdeCandidate, law: BaseEffect, values: np.ndarray, path: np.ndarray | None
    ) -> OdeCandidate | None:
        assert path is not None
        states = path[: base.model.n_nominal]  # hidden states of effects and laws settle along it
        problem, effects = self.searching(base), (*base.effects, law)
        found = fit_last(problem, effects, base.theta_with(values), states, base.fit, np.inf)
        if not isinstance(law, AnyLaw) or (found is not None and found.fit.cost < base.fit.cost):
            return found
        tried = found is None or found.fit.fell_back  # along the run of the base, with all of its coefficients
        return cheapest([found, fit_part(problem, base, law, values, NEARER[tried:])])

    def in_place_of(self, final: Evidence[OdeCandidate], i: int) -> list[OdeCandidate]:
        named, single = final.candidate, len(final.effects) == 1
        base = self.fitted_null.candidate if single else self.without(named, i) or named.taken_out(i)
        if base is None:
            return []
        few = self.is_far(named) or is_stack(final)
        wanted = Wanted(8, 2) if few else Wanted(24, 10, siblings=True, best=final.fit.cost)
        candidates = self.expand(base, wanted)
        # those of the search may have started at other re-tuned parameters
        known = [one for one in self.fitted.values() if one.keys[:-1] == base.keys]
        candidates.extend(one for one in known if self.plausible(one))
        if self.first_screen is not None:
            starting = twins_with_onset(self.first_screen, final.effects[i], named.theta_of(i))
            candidates.extend(fit_given(base, starting, named))
        if not few and (not single or self.problem.free):
            # the others and the free parameters, fitted again alone, may have run away
            alike = [twin for twin in twins_of(self, named) if twin.places == (i,)]
            candidates.extend(one for twin in alike[:MOST_MET] if (one := with_twin(self, named, twin)) is not None)
        nearest = {one.keys: one for one in sorted(candidates, key=lambda one: -one.fit.cost)}.values()
        mine = [one.fit.cost for one in nearest if one.effects[-1].key == final.effects[i].key]
        same_numerics = self.searching(base).numerics == named.problem.numerics
        reach = (min if same_numerics else max)([final.fit.cost, *mine])
        near = [one for one in nearest if one.fit.cost <= about_as_much(reach)]
        return near if same_numerics else [one.resumed(named.problem) or one for one in near]
