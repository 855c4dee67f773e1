"""The search around a simulator that only gives trajectories: every simulation counts, so a linear surrogate orders it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from joblib import delayed

from sksurrogate._parallel._interrupts import workers
from sksurrogate._printed import silent_in_worker
from sksurrogate.effects._base_effect import BaseEffect
from sksurrogate.gap.fit._closeness import SETTLED
from sksurrogate.gap.fit._evidence import FEW_STEPS, Evidence, estimate_noise, judged_under
from sksurrogate.gap.fit._linear_set import linear_set
from sksurrogate.gap.fit._normal_equations import eliminate_rows, scores
from sksurrogate.gap.fit._probe import probe_of
from sksurrogate.gap.fit._trajectory import TrajectoryBackend, TrajectoryCandidate, TrajectoryFit
from sksurrogate.gap.screen._screen import LOST_TO_ROUNDING
from sksurrogate.gap.search._base import Wanted
from sksurrogate.gap.search._set_search import SetSearch
from sksurrogate.gap.search._shapes import in_shape
from sksurrogate.gap.search._soft_limits import soft_where_nearer

#: Candidates fitted in a round: so many by white noise, so many by the noise with forces.
BY_WHITE, BY_FORCED = 10, 6
#: Candidates that the screen expects to gain less than this share of the threshold are not fitted.
HOPELESS = 0.15
NO_STATES = np.zeros(0)


@dataclass(eq=False)
class TrajectorySearch(SetSearch[TrajectoryCandidate]):
    """The search around a simulator that only gives trajectories."""

    frugal = True

    problem: TrajectoryBackend
    screened_gains: dict[Any, float] = field(default_factory=dict)  #: Key of an effect -> what the screen expects of it

    def is_far(self, candidate: TrajectoryCandidate) -> bool:
        """Never: the surrogate's noise model holds far from the data too."""
        return False

    def expected(self) -> Mapping[Any, float]:
        return self.screened_gains

    def fit_null(self) -> Evidence[TrajectoryCandidate]:
        for _ in range(2):
            self.problem = self.problem.with_starts_fitted()
        theta = np.zeros(len(self.problem.free))
        null = self.problem.fit((), theta)
        if null is None:
            y = np.zeros_like(self.problem.record.y)
            null = TrajectoryCandidate(
                (), TrajectoryFit(theta, y, np.zeros((len(y), len(theta), y.shape[1])), np.inf), self.problem
            )
        self.null = self.final = self.judge(estimate_noise(null, self.problem.first_noise()))
        self.report("how far the simulator is from the data: the null is fitted")
        return self.null

    def look_for_more(self) -> Evidence[TrajectoryCandidate]:
        """Further effects; all once more, initial states free, where the runs begin elsewhere than the simulator."""
        super().look_for_more()
        if self.begins_elsewhere():
            self.report("the runs start elsewhere than the simulator: their initial states are fitted as transients")
            self.fitted.clear()
            self.fit_null()
            self.look_for_one()
            super().look_for_more()
        return self.standing

    def begins_elsewhere(self) -> bool:
        """Whether transients explain much of what is left: then the simulator starts elsewhere, and they become unknowns."""
        problem, final = self.problem, self.standing
        if problem.free_starts or final.left < SETTLED:
            return False
        free = replace(problem, free_starts=True)
        before = judged_under(final.candidate, [final.noise]).log_likelihood
        after = estimate_noise(
            replace(final.candidate, problem=free), final.noise, max_iterations=FEW_STEPS
        ).log_likelihood
        count = problem.transients.shape[1] * len(problem.record.starts)
        if 2.0 * (after - before) < 2.0 * self.threshold(count):
            return False
        self.problem = free
        return True

    def settle(self) -> None:
        """What stands again, with the transients of the initial states at its own values."""
        if self.final is None or self.problem.x0 is None or not len(self.final.fit.theta):
            return
        final, problem = self.final.candidate, self.problem
        for _ in range(2):
            effects, theta = final.effects, final.fit.theta
            problem = problem.renewed(effects, theta).with_starts_fitted(effects, theta)
            again = problem.fit(effects, theta)
            if again is None or again.fit.cost > 1.01 * final.fit.cost:
                return
            final = again
        self.problem = problem  # the others are compared from the same initial states
        self.final = self.judge(estimate_noise(final, self.final.noise, max_iterations=FEW_STEPS))
        null = self.fitted_null
        self.null = self.judge(replace(null, candidate=replace(null.candidate, problem=problem)))

    def refitted_without(self, candidate: TrajectoryCandidate, i: int) -> TrajectoryCandidate | None:
        """Without effect i, from the slopes that are known."""
        effects, theta = candidate.without_effect(i)
        if not effects:
            return self.fitted_null.candidate
        known = np.delete(candidate.fit.J, candidate.slice_of(i), axis=1)
        return self.problem.fit(effects, theta, known.transpose(1, 0, 2))

    def refined(self, candidate: TrajectoryCandidate) -> TrajectoryCandidate:
        """With its effects in the shape that the data show."""
        return in_shape(candidate, self.threshold(1))

    def with_effect(
        self, base: TrajectoryCandidate, law: BaseEffect, values: np.ndarray, path: np.ndarray | None
    ) -> TrajectoryCandidate | None:
        return self.problem.fit_added(base, law, values)

    def carries(self, law: BaseEffect) -> bool:
        """At an input a law of inputs, at a sensor one of readings."""
        plant = self.problem.plant
        own = {"input": plant.inputs, "output": plant.outputs}.get(law.kind, ())
        return law.access == "trajectory" and set(law.signals) <= set(own)

    def in_place_of(self, final: Evidence[TrajectoryCandidate], i: int) -> list[TrajectoryCandidate]:
        if len(final.effects) == 1:
            return self.first_round
        rest = self.without(final.candidate, i)
        return self.ranked(self.expand(rest, Wanted(BY_WHITE, BY_FORCED)), rest) if rest is not None else []

    # ---- one round --------------------------------------------------------------------------------------------------
    def expand(self, base: TrajectoryCandidate, wanted: Wanted) -> list[TrajectoryCandidate]:
        """The base with one effect more: the few that the screen puts first."""
        library = self.library if wanted.among is None else wanted.among
        counts = min(wanted.by_white, BY_WHITE), min(wanted.by_forced, BY_FORCED)
        starts = self.screened(base, library, *counts, max(wanted.least, HOPELESS * self.threshold(1)))
        self.report(f"fitting {len(starts)} of {len(library)} candidates")
        work = workers(self.n_jobs, return_as="generator")
        found: list[TrajectoryCandidate] = []
        tries = work(delayed(_fit)(self.problem, base, *start) for start in starts)
        for candidate, (effect, *_) in zip(tries, starts):
            if candidate is None:
                self.unfitted[effect.key] = effect
            else:
                found.append(candidate)
                self.remember([candidate])  # an interrupt leaves what is fitted by now
        return found

    def screened(
        self, base: TrajectoryCandidate, library: Sequence[BaseEffect], n_white: int, n_forced: int, least: float
    ) -> list[tuple[BaseEffect, np.ndarray, np.ndarray]]:
        """Effect, start and expected change of the outputs, of those that a linear look puts first."""
        taken = set(base.keys)
        looked = []
        for effect in (one for one in library if one.key not in taken):
            for given in effect.starts(probe_of(self.problem, effect, NO_STATES, NO_STATES)):
                start = np.asarray(given, dtype=float)
                change = self.change(base, effect, start)
                if change is not None and np.all(np.isfinite(change)) and np.any(change):
                    looked.append((effect, start, change))
        if not looked:
            return []
        effects, values, changes = zip(*looked)
        columns = np.stack(changes)
        white, amplitude, forced = self.expectations(base, effects, columns)
        chosen: dict[int, None] = {}
        for gains, most in ((white, n_white), (forced, n_forced)):
            seen: set = set()
            for i in np.argsort(-gains):
                if gains[i] < least or len(seen) == most:
                    break
                if effects[i].key not in seen:
                    seen.add(effects[i].key)
                    chosen.setdefault(int(i))
        if not base.effects:
            for effect, gain in zip(effects, white):
                self.screened_gains[effect.key] = max(self.screened_gains.get(effect.key, -np.inf), float(gain))
        out = []
        for i in chosen:
            start = values[i].copy()
            if effects[i].linear and len(start):
                null = effects[i].parameters[0].null
                start[0] = null + amplitude[i] * (start[0] - null)
            out.append((effects[i], start, columns[i]))
        return out

    def change(self, base: TrajectoryCandidate, effect: BaseEffect, start: np.ndarray) -> np.ndarray | None:
        """Change of the outputs by an effect at a start: inputs through the surrogate, the rest as it is."""
        problem, theta = self.problem, base.theta_with(start)
        effects = (*base.effects, effect)
        if effect.kind == "input":
            acting = problem.simulations.acting
            du = acting(effects, theta) - acting(base.effects, base.fit.theta)
            return problem.surrogate.respond(du[None])[0] if np.any(du) else None
        return problem.outputs(effects, theta) - base.fit.y

    def expectations(
        self, base: TrajectoryCandidate, effects: Sequence[BaseEffect], columns: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Drop of -2 log likelihood by every column for white noise, its amplitude, and the drop under the noise of the base.

        Free where the effect is linear, within 0..3 of the start where not.
        """
        known = linear_set(base).known.transpose(1, 0, 2)
        whole, few = np.concatenate([known, columns]), len(known)
        flat = base.without_starts(whole).reshape(len(whole), -1)
        white = flat[:few] @ flat.T, np.einsum("kn,kn->k", flat, flat)
        forced = base.disturbance.gram_rows(whole, self.judged[base].noise, few)
        linear = np.array([effect.linear for effect in effects])
        reach = np.where(linear, -np.inf, 0.0), np.where(linear, np.inf, 3.0)
        (drop, amplitude), (under_noise, _) = (
            scores(*_seen(*eliminate_rows(rows, size, *base.step_prior), size[few:]), *reach)
            for rows, size in (white, forced)
        )
        return drop, amplitude, under_noise


def _seen(g: np.ndarray, h: np.ndarray, size: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Columns of which something is left beside what is known already; the others remove nothing."""
    seen = h > LOST_TO_ROUNDING * size
    return np.where(seen, g, 0.0), np.where(seen, h, size)


def _fit(
    problem: TrajectoryBackend, base: TrajectoryCandidate, effect: BaseEffect, start: np.ndarray, change: np.ndarray
) -> TrajectoryCandidate | None:
    """The base with one effect more, fitted."""
    proportional = effect.linear and len(start) == 1 and effect.kind != "input"
    moved = start[0] - effect.parameters[0].null if proportional else 0.0
    try:
        with silent_in_worker():
            found = problem.fit_added(base, effect, start, change[None] / moved if moved else None)
            return found and soft_where_nearer(found)
    except np.linalg.LinAlgError:  # slopes beyond the arithmetic: this candidate is lost
        return None
