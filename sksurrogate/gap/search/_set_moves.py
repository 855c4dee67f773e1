"""Sets of effects compared, polished, and changed by one effect: what is asked of every kind of access, and how sets are ranked."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from sksurrogate._parallel._parallel_map import side_by_side
from sksurrogate.effects._base_effect import BaseEffect
from sksurrogate.gap.fit._backend import BaseCandidate
from sksurrogate.gap.fit._closeness import AT_THE_NOISE
from sksurrogate.gap.fit._evidence import FEW_STEPS, C, Evidence, estimate_noise, judged_under
from sksurrogate.gap.fit._rounding import names_steps
from sksurrogate.gap.search._base import BaseSearch, Wanted
from sksurrogate.kernels.disturbance import Noise

#: A fit with so many times the cost of the null has diverged.
DIVERGED_COST = 100.0
#: A set that comes so many times nearer in the same few steps may be the nearer one in the end.
NEARER_AGAIN = 2.0
#: Candidates of a round that are polished before the best of them is chosen.
MOST_POLISHED = 4


@dataclass(eq=False)
class SetMoves(BaseSearch[C]):
    """Steps from one set of effects to others."""

    #: Whether simulations are dear: then no other sets of effects are extended beside the best one.
    frugal: ClassVar[bool] = False

    @property
    def gap_over_noise(self) -> float:
        """RMS of the gap of the simulator over the noise."""
        return float(np.sqrt(max(self.gap_cost / self.n_values - 1.0, 1e-6)))

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

    def from_nominal(self, wanted: Wanted) -> list[C]:
        """Single effects fitted from nominal parameters, where fits hang on where they start."""
        return []

    def pairs(self, base: C, best: float) -> list[C]:
        """Two effects at once, added to a base, where the screen sees pairs."""
        return []

    def left_beside(self, base: C, n: int) -> float:
        """Squares over the noise that n effects more are expected to leave, where the screen sees sets."""
        return np.inf

    def formed(self, base: C, effects: Sequence[BaseEffect], shape: tuple[float, ...] | None, best: float) -> list[C]:
        """Effects of one form, added to a base."""
        return self.expand(base, Wanted(2, 0, effects, best=best))

    def diverged(self, candidate: C) -> bool:
        """Whether a fit has left the data."""
        return not candidate.fit.cost < DIVERGED_COST * self.fitted_null.fit.cost

    # ---- steps ------------------------------------------------------------------------------------------------------
    def ranked(self, candidates: Iterable[C], base: C) -> list[C]:
        """Candidates by penalised likelihood, the best under their own noise, the others by a quick look."""
        candidates = [one for one in candidates if not self.diverged(one) and self.plausible(one) and acts(one)]
        if not candidates:
            return []
        noise, curvature = self.start_of_noise(base)
        nearest = min(candidates, key=lambda candidate: candidate.fit.cost)
        start, _, shape = self.judge(estimate_noise(nearest, noise, curvature)).judgement
        for candidate in candidates:
            if candidate is not nearest:
                self.judge(judged_under(candidate, [noise, start]))
                if not self.is_far(candidate) and self.score(candidate) < self.score(base) - 0.5 * self.threshold(1):
                    # It holds the base: what it loses to it, it loses to a noise that was made for others.
                    self.judge(estimate_noise(candidate, noise, curvature, max_iterations=FEW_STEPS))
        candidates.sort(key=self.score, reverse=True)
        if self.own(candidates[0]) is None:
            self.judge(estimate_noise(candidates[0], start, shape, max_iterations=FEW_STEPS))
        near = [r for r in candidates[1:6] if self.score(r) > self.score(candidates[0]) - 30.0 and self.own(r) is None]
        tops = side_by_side(
            lambda r: estimate_noise(r, start, shape, max_iterations=FEW_STEPS).judgement, near, self.second
        )
        for candidate, top in zip(near, tops):
            self.judge(Evidence(candidate, *top))
        candidates.sort(key=self.order(candidates), reverse=True)
        return candidates

    def first_choice(self, singles: Sequence[C]) -> C:
        """The best single effect; the steps on which readings stand, where these are the likeliest: nothing else makes them."""
        likeliest = max(singles, key=self.score)
        return self.polish(likeliest) if names_steps(likeliest) else self.best_polished(singles)

    def best_polished(self, candidates: Sequence[C]) -> C:
        """The best of the first few after each was polished: coarse steps and soft kinks must not choose between them.

        What a fit with finer steps has made implausible does not stand, where another is plausible.
        """
        first = candidates[:MOST_POLISHED]
        most = 3.0 * min(one.fit.cost for one in first) + 50.0
        polished = [self.polish(one) for one in first if one is first[0] or one.fit.cost < most]
        polished = [one for one in polished if self.plausible(one)] or polished
        return max(polished, key=self.order(polished))

    def polish(self, candidate: C) -> C:
        """A candidate as exactly as it can be simulated, under its own noise."""
        best = self.refined(candidate)
        if self.own(best) is None:
            self.judge(estimate_noise(best, *self.start_of_noise(candidate)))
        return best

    def start_of_noise(self, near: C) -> tuple[Noise, np.ndarray | None]:
        """Noise and curvature that a noise fit begins at: those of a candidate nearby where they are known, else the noise of the null."""
        known = self.own(near)
        return (self.fitted_null.noise, None) if known is None else (known.noise, known.curvature)

    def without(self, candidate: C, i: int) -> C | None:
        """The candidate refitted without effect i; None where the others run away."""
        base = self.refitted_without(candidate, i)
        if base is None or self.diverged(base):
            base = self.fitted_null.candidate if len(candidate.effects) == 1 else None
        noise = self.noise_of(candidate)
        if base is not None and noise is not None and self.own(base) is None:
            self.judge(replace(judged_under(base, [noise]), quick=False))
        return base

    def swap(self, candidate: C) -> C:
        """Every effect chosen again with the others kept; once more where that changed a set and it is near the data."""
        swapped = self.swapped_once(candidate)
        done = swapped is candidate or self.is_far(swapped) or self.frugal
        return swapped if done else self.swapped_once(swapped)

    def swapped_once(self, candidate: C) -> C:
        """Leave each effect out in turn and choose it again with the others kept."""
        several = len(candidate.effects) > 2
        for key in candidate.keys:
            base = self.without(candidate, candidate.keys.index(key))
            if base is None:
                continue
            counts = (6, 3) if several or self.judged[candidate].left < AT_THE_NOISE else (12, 6)
            trial = self.ranked(self.expand(base, Wanted(*counts)), base)
            if not trial:
                continue
            nearer = self.leads(trial[0], candidate)
            if nearer or self.leads_its_place(trial, candidate):
                swapped = self.polish(trial[0]) if nearer else self.best_polished(trial)
                worth = self.order([trial[0], candidate])
                better = worth(swapped) > worth(candidate) and self.plausible(swapped)
                candidate = swapped if better else candidate
        return candidate

    def leads_its_place(self, trial: Sequence[C], candidate: C) -> bool:
        """Whether another set came nearer to the data than a candidate near the noise did, where both were fitted again in a few steps."""
        again = min((one.fit.cost for one in trial if set(one.keys) == set(candidate.keys)), default=np.inf)
        return bool(not self.is_far(candidate) and again > NEARER_AGAIN * trial[0].fit.cost)


def acts(candidate: BaseCandidate) -> bool:
    """Whether no effect has the magnitude at which it does nothing: such a set is a smaller one at the price of a parameter."""
    magnitudes = ((effect.parameters, candidate.theta_of(i)) for i, effect in enumerate(candidate.effects))
    return all(not parameters or theta[0] != parameters[0].null for parameters, theta in magnitudes)
