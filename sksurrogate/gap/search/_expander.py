"""Candidates with one effect more than a base: the screen orders them, the best are fitted, in worker processes where asked."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import islice
from typing import Any, TypeAlias
from weakref import WeakKeyDictionary

import numpy as np
from joblib import delayed, effective_n_jobs

from sksurrogate._parallel._interrupts import workers
from sksurrogate._parallel._parallel_map import side_by_side
from sksurrogate._printed import silent_in_worker
from sksurrogate.effects._base_effect import BaseEffect
from sksurrogate.exceptions import SurrogateError
from sksurrogate.gap.fit._closeness import AT_THE_NOISE, FAR_BY_COST, OUT_OF_SIGHT, is_at_noise
from sksurrogate.gap.fit._ode import Numerics, OdeBackend, OdeCandidate
from sksurrogate.gap.fit._prior import price_of_step
from sksurrogate.gap.screen._pairs import beside, best_pairs
from sksurrogate.gap.screen._screen import Screen, Start, screen
from sksurrogate.gap.screen._twins import Twin
from sksurrogate.gap.search._base import Wanted
from sksurrogate.gap.search._fit_from_starts import best_starts, cheapest, fit_added, fit_pair
from sksurrogate.gap.search._nested import may_be_of
from sksurrogate.gap.search._set_search import AS_NEAR, SetSearch
from sksurrogate.gap.search._shapes import in_first_shape
from sksurrogate.kernels.clock import check_time, limited
from sksurrogate.kernels.output_error import Fit

#: What travels between processes: a fit with its numerics, nothing, or what a simulator raised.
Message: TypeAlias = tuple[Fit, Numerics] | str | None
#: Numerics of the search; what it finds is polished with finer ones.
SEARCH_SUBSTEPS, SEARCH_SHARPNESS = 4, 150.0
#: Screens that are kept beside that of the null.
MOST_SCREENS = 4
#: Effects of which the fits from each start are made apart, where there are no more of them.
FITTED_APART = 2
#: Effects that are fitted at once under a time limit.
PORTION = 4
#: Pairs that are fitted because the screen expects most of them; beside other effects those that are expected to leave less than
#: this share of what one effect more leaves.
MOST_PAIRS, PROMISING = 10, 0.5
#: Other places and variables of the nearest effect that are fitted from its shape.
MOST_SIBLINGS = 8


@dataclass(eq=False)
class Expander(SetSearch[OdeCandidate]):
    """Fits candidates added to a base, and remembers every fit."""

    problem: OdeBackend
    x: np.ndarray  #: (n_states, n_samples): smoothed nominal trajectory
    screens: dict[Any, Screen] = field(default_factory=dict)  #: Of every base
    first_screen: Screen | None = None  #: What the screen expects of single effects
    #: What was fitted from each screen, by the key of the effect: from the same starts a fit leads to the same place
    tried: WeakKeyDictionary[Screen, dict[Any, OdeCandidate]] = field(default_factory=WeakKeyDictionary)
    #: Effects of the library that are asked only where something without a name remains, by key
    later_asked: dict[Any, BaseEffect] = field(default_factory=dict)
    last_twins: tuple[OdeCandidate, list[Twin]] | None = None  #: Of the last set that was asked for its twins

    @property
    def asked(self) -> list[BaseEffect]:
        """The effects that are asked now."""
        return [effect for effect in self.library if effect.key not in self.later_asked]

    def searching(self, base: OdeCandidate) -> OdeBackend:
        """The problem with the numerics of a base, but no finer than the search needs."""
        numerics, least = base.problem.numerics, self.problem.numerics.n_sub
        n_sub = min(numerics.n_sub, max(SEARCH_SUBSTEPS, least))
        return self.problem.at(replace(numerics, n_sub=n_sub, sharpness=min(numerics.sharpness, SEARCH_SHARPNESS)))

    def as_searched(self, base: OdeCandidate) -> OdeCandidate:
        """A base with the numerics of the search."""
        problem = self.searching(base)
        same = base.problem.numerics == problem.numerics
        return base if same else problem.candidate(base.effects, base.fit)

    def expand(self, base: OdeCandidate, wanted: Wanted) -> list[OdeCandidate]:
        base, found = self.base_and_screen(base, wanted.among)
        able = [one for one in found.starts if wanted.among is not None or self.may_be_beside(one.effect)]
        starts = [one for one in able if one.promises > 0.0 and (one.evident or self.earns(one, wanted.least))]
        chosen = best_starts(starts, wanted.by_white, wanted.by_forced, self.n_values)
        self.report(f"fitting {len(chosen)} candidates")
        wanted_keys, tried = [c[0].effect.key for c in chosen], self.tried.setdefault(found, {})
        again = {one.effects[-1].key: one for one in self.known(base, [c[0].effect for c in chosen])}
        again = {key: tried[key] for key in wanted_keys if key in tried} | again
        new = self.fit_all(base, [c for c in chosen if c[0].effect.key not in again], wanted.best)
        new = [in_first_shape(one, self.threshold(1)) for one in new]
        tried.update((one.effects[-1].key, one) for one in new)
        candidates = [*again.values(), *new]
        self.remember(candidates)
        return candidates + self.siblings(candidates, base) if wanted.siblings and candidates else candidates

    def may_be_beside(self, effect: BaseEffect) -> bool:
        """Whether sets are made of an effect: of all, unless one law explains the gap."""
        return self.of_signals is None or may_be_of(effect, self.of_signals)

    def earns(self, start: Start, least: float) -> bool:
        """Whether the screen expects so much of a start, and of a step of quantisation its price in addition."""
        steps = start.promises >= least and bool(start.effect.scan(tuple(start.theta)))
        price = price_of_step(self.problem, start.effect, start.theta) if steps else 0.0
        return start.promises >= least + price

    def base_and_screen(
        self, base: OdeCandidate, among: Sequence[BaseEffect] | None = None
    ) -> tuple[OdeCandidate, Screen]:
        """The base with the numerics of the search, and its screen; one of all candidates is made once."""
        taken = set(base.keys)
        library = [e for e in (self.asked if among is None else among) if e.key not in taken]
        guess, noise, base = self.guess(base), self.noise_of(base), self.as_searched(base)
        if among is not None:
            return base, screen(library, base, guess, noise, second=self.second)
        near = bool(base.effects) and base.fit.cost < OUT_OF_SIGHT * self.n_values
        key = (base.keys, base.problem.numerics, noise is None, near)
        known = self.screens.get(key)
        if known is None:
            first = self.first_screen if near else None
            known = self.screens[key] = screen(library, base, guess, noise, first=first, second=self.second)
            for old in [k for k in self.screens if k[0]][:-MOST_SCREENS]:
                del self.screens[old]
        if not base.effects and self.first_screen is None:
            self.first_screen = known
        return base, known

    def from_nominal(self, wanted: Wanted) -> list[OdeCandidate]:
        """Single effects fitted from nominal parameters: from re-tuned ones that imitate an effect none leads back."""
        null = self.fitted_null
        base = null.candidate.at_nominal()
        if base is None:
            return []
        starts = screen(self.asked, base, self.guess(base), null.noise, second=self.second).starts
        return self.fit_best(base, starts, wanted.by_white, wanted.by_forced, np.inf)

    def fit_best(
        self, base: OdeCandidate, starts: Sequence[Start], n_white: int, n_forced: int, best: float
    ) -> list[OdeCandidate]:
        """One effect more, fitted from the best starts by either score."""
        found = self.fit_all(base, best_starts(starts, n_white, n_forced, self.n_values), best)
        self.remember(found)
        return found

    def guess(self, base: OdeCandidate) -> np.ndarray:
        """Trajectory to start the smoother from: measured where nothing was added, with the hidden states of the base."""
        n = len(self.problem.plant.states)
        x = self.x if not base.effects else base.fit.x[:n]
        return np.concatenate([x, base.fit.x[n:]]) if len(base.fit.x) > n else x

    def siblings(self, candidates: Sequence[OdeCandidate], base: OdeCandidate) -> list[OdeCandidate]:
        """The nearest candidate's effect at other places and in other variables, from its shape.

        A memory that fits in one place is found again in another, where the screen's starting values may be too far off.
        """
        nearest = min(candidates, key=lambda candidate: candidate.fit.cost)
        effect, theta = nearest.effects[-1], nearest.theta_of(len(nearest.effects) - 1)
        have = {*base.keys, *(candidate.effects[-1].key for candidate in candidates)}
        alike = (e for e in self.library if e.name == effect.name and len(e.parameters) == len(theta))  # or in a window
        others = [e for e in alike if e.key not in have and self.may_be_beside(e)]
        if len(theta) < 2 or not others:
            return []
        again = self.known(self.as_searched(base), others)
        new = {e.key for e in others}.difference(candidate.keys[-1] for candidate in again)
        unknown, shape = [e for e in others if e.key in new], tuple(float(v) for v in theta[1:])
        return again + self.shaped(base, unknown, shape, nearest.fit.cost)

    def formed(
        self, base: OdeCandidate, effects: Sequence[BaseEffect], shape: tuple[float, ...] | None, best: float
    ) -> list[OdeCandidate]:
        """Effects of one form, added to a base: of its shape where that is known."""
        return super().formed(base, effects, shape, best) if shape is None else self.shaped(base, effects, shape, best)

    def shaped(
        self, base: OdeCandidate, effects: Sequence[BaseEffect], shape: tuple[float, ...], best: float
    ) -> list[OdeCandidate]:
        """Effects of one shape (all parameters but the first), added to a base."""
        if not effects:
            return []
        guess, base = self.guess(base), self.as_searched(base)
        return self.fit_best(base, screen(effects, base, guess, None, shape).starts, MOST_SIBLINGS, 0, best)

    def expected(self) -> dict[Any, float]:
        out: dict[Any, float] = {}
        for start in self.first_screen.starts if self.first_screen is not None else ():
            out[start.effect.key] = max(out.get(start.effect.key, -np.inf), start.white)
        return out

    def pairs(self, base: OdeCandidate, best: float) -> list[OdeCandidate]:
        """Two effects at once, added to a base: those of which the screen expects most. Two that cancel each other do not show one by one.

        Beside other effects only pairs that promise to leave the noise, or less than :data:`PROMISING` of the ``best`` cost.
        """
        if self.first_screen is None:
            return []
        if base.effects:
            base, about = self.base_and_screen(base)
            found = best_pairs(beside(self.first_screen, about, base.keys), MOST_PAIRS)
            most = max(PROMISING * best, AT_THE_NOISE**2 * self.n_values)
            found = [pair for pair in found if about.left_by[0] - pair.drop < most]
        else:
            base, found = self.as_searched(base), best_pairs(self.first_screen, MOST_PAIRS)
        x, known = self.guess(base), frozenset(base.keys)
        able = [pair for pair in found if all(map(self.may_be_beside, pair.effects))]
        new = [pair for pair in able if known.union(one.key for one in pair.effects) not in self.fitted]
        messages = side_by_side(
            lambda pair: to_message(base.problem, partial(fit_pair, base, pair, x, best)), new, self.second
        )
        tries = [self.from_message(base, pair.effects, message) for pair, message in zip(new, messages)]
        fits = [candidate for candidate in tries if candidate is not None]
        self.remember(fits)
        return fits

    def left_beside(self, base: OdeCandidate, n: int) -> float:
        return float(self.base_and_screen(base)[1].left_by[n])

    def known(self, base: OdeCandidate, effects: Sequence[BaseEffect]) -> list[OdeCandidate]:
        """A base with each of these effects, where it was fitted before with the same numerics; not far from the data, where
        another start may lead elsewhere."""
        if base.effects and base.fit.cost > OUT_OF_SIGHT * self.n_values:
            return []
        all_keys = [(*base.keys, effect.key) for effect in effects]
        found = [(keys, self.fitted[frozenset(keys)]) for keys in all_keys if frozenset(keys) in self.fitted]
        return [r for keys, r in found if r.keys == keys and r.problem.numerics == base.problem.numerics]

    def fit_all(self, base: OdeCandidate, chosen: Sequence[list[Start]], best: float = np.inf) -> list[OdeCandidate]:
        """Fit candidates, best first; under a time limit in portions, each of which is kept."""
        if not limited():
            return self.fit_together(base, chosen, best)
        found: list[OdeCandidate] = []
        portion = PORTION * max(effective_n_jobs(self.n_jobs), 1)
        for a in range(0, len(chosen), portion):
            check_time()
            new = self.fit_together(base, chosen[a : a + portion], best)
            self.remember(new)
            found += new
            best = min([best, *(candidate.fit.cost for candidate in new)])
        return found

    def fit_together(self, base: OdeCandidate, chosen: Sequence[list[Start]], best: float) -> list[OdeCandidate]:
        """Fit candidates, the best first: its cost is what the others must come near to.

        Where that is the noise, only those are fitted that may come near: as much as the screen expected the first to leave, it may
        be wrong about others. One that is not plausible, as a friction that is no larger at rest for a name that says so, keeps no other out.
        """
        best = min(base.fit.cost, best)
        n = len(chosen) if len(chosen) <= FITTED_APART else 1
        tries = iter(self.fit_apart(base, [[one] for starts in chosen[:n] for one in starts], best))
        first = [cheapest(list(islice(tries, len(starts)))) for starts in chosen[:n]]
        costs = [np.inf if one is None or not self.plausible(one) else one.fit.cost for one in first]
        best = min([best, *costs])
        expected = [least_left(starts) for starts, cost in zip(chosen, costs) if is_at_noise(cost, self.n_values)]
        most = max([FAR_BY_COST * self.n_values, *(AS_NEAR * left for left in expected)])
        others = [one for one in chosen[n:] if not is_at_noise(best, self.n_values) or may_lead_near(one, most)]
        found = [*first, *self.fit_apart(base, others, best)]
        return [candidate for candidate in found if candidate is not None]

    def fit_apart(self, base: OdeCandidate, chosen: Sequence[list[Start]], best: float) -> list[OdeCandidate | None]:
        """Fits that know nothing of each other: in the workers that ``n_jobs`` or joblib's own setting asks for, else in two processes."""
        if effective_n_jobs(self.n_jobs) > 1:
            spread = workers(self.n_jobs, batch_size=max(1, len(chosen) // 8))
            found = spread(delayed(fit_in_worker)(base, starts, best) for starts in chosen)
        else:
            found = side_by_side(partial(fit_here, base, best=best), chosen, self.second)
        return [self.from_message(base, [starts[0].effect], message) for starts, message in zip(chosen, found)]

    def from_message(self, base: OdeCandidate, added: Sequence[BaseEffect], message: Message) -> OdeCandidate | None:
        """A base with these effects added, as its message says; None where it has no fit, or the simulator failed."""
        if isinstance(message, str):
            self.lost[message] = None
            self.unfitted.update((effect.key, effect) for effect in added)
        if message is None or isinstance(message, str):
            return None
        fit, numerics = message
        return base.problem.at(numerics).candidate((*base.effects, *added), fit)


def least_left(starts: Sequence[Start]) -> float:
    """The least cost that the screen expects from the starts of one candidate."""
    return min(start.left for start in starts)


def may_lead_near(starts: Sequence[Start], most: float) -> bool:
    """Whether a candidate may come near the data: the screen expects no more than ``most``, or the measurements show it."""
    return least_left(starts) < most or any(start.evident for start in starts)


def to_message(problem: OdeBackend, fit: Callable[[], OdeCandidate | None]) -> Message:
    """A candidate without its model, which cannot travel between processes; where the simulator raises, what it said."""
    before = len(problem.model.raised)
    try:
        candidate = fit()
        if candidate is None and len(problem.model.raised) == before:
            with problem.model.watched():  # it has no finite run: the simulator's doing, or the effect's own?
                fit()
    except (ArithmeticError, ValueError, SurrogateError) as error:
        return f"{type(error).__name__}: {error}"
    if candidate is None and len(problem.model.raised) > before:
        return list(problem.model.raised)[-1]
    return None if candidate is None else (candidate.fit, candidate.problem.numerics)


def fit_here(base: OdeCandidate, starts: Sequence[Start], best: float) -> Message:
    """One effect more, fitted from its starts."""
    return to_message(base.problem, partial(fit_added, base, starts, best))


def fit_in_worker(base: OdeCandidate, starts: Sequence[Start], best: float) -> Message:
    """The same in a process of joblib."""
    with silent_in_worker():
        return fit_here(base, starts, best)
