"""The search around a simulator that only gives trajectories: every simulation counts, so a linear surrogate orders it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from joblib import Parallel, delayed

from sksurrogate.effects._effect import BaseEffect, Probe
from sksurrogate.gap.fit._closeness import CLOSED
from sksurrogate.gap.fit._evidence import Evidence, estimate_noise, judged_under
from sksurrogate.gap.fit._normal_equations import eliminate_rows, scores
from sksurrogate.gap.fit._trajectory import TrajectoryBackend, TrajectoryCandidate, TrajectoryFit
from sksurrogate.gap.search._set_search import SetSearch

__all__ = ["TrajectorySearch"]

#: Candidates fitted in a round: so many by white noise, so many by the noise with forces.
BY_WHITE, BY_FORCED = 10, 6
#: Candidates that the screen expects to gain less than this share of the bar are not fitted.
HOPELESS = 0.15


@dataclass(eq=False)
class TrajectorySearch(SetSearch[TrajectoryCandidate]):
    """The search around a simulator that only gives trajectories.

    Attributes
    ----------
    problem : TrajectoryBackend
    screened_gains : dict
        Key of an effect -> what the screen expects of it.
    """

    frugal = True

    problem: TrajectoryBackend
    screened_gains: dict[Any, float] = field(default_factory=dict)

    def is_far(self, candidate: TrajectoryCandidate) -> bool:
        """Never: the surrogate's noise model holds far from the data too."""
        return False

    def expected(self) -> Mapping[Any, float]:
        """What the screen expects of single effects, by key."""
        return self.screened_gains

    def fit_null(self) -> Evidence[TrajectoryCandidate]:
        """The simulator with initial states and free parameters only."""
        for _ in range(2 if self.problem.x0 is not None else 0):
            self.problem = self.problem.begun_again()
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

    def run(self) -> Evidence[TrajectoryCandidate]:
        """The whole search; an interrupt is passed on once what is fitted is compared."""
        try:
            super().run()
            if self.begins_elsewhere():
                self.report(
                    "the runs start elsewhere than the simulator: their initial states are fitted as transients"
                )
                self.fitted.clear()
                self.fit_null()
                super().run()
        except KeyboardInterrupt:
            self.keep_best()
            raise
        return self.final or self.fitted_null

    def begins_elsewhere(self) -> bool:
        """Whether transients explain much of what is left: then the simulator starts elsewhere, and they become unknowns."""
        problem, final = self.problem, self.final or self.fitted_null
        if problem.free_starts or final.left < CLOSED:
            return False
        free = replace(problem, free_starts=True)
        before = judged_under(final.candidate, [final.noise]).log_likelihood
        after = estimate_noise(replace(final.candidate, problem=free), final.noise, max_iterations=8).log_likelihood
        count = problem.transients.shape[1] * len(problem.record.starts)
        if 2.0 * (after - before) < 2.0 * self.bar(count):
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
            problem = problem.renewed(effects, theta).begun_again(effects, theta)
            again = problem.fit(effects, theta)
            if again is None or again.fit.cost > 1.01 * final.fit.cost:
                return
            final = again
        self.problem = problem  # the others are compared from the same initial states
        self.final = self.judge(estimate_noise(final, self.final.noise, max_iterations=8))
        null = self.fitted_null
        self.null = self.judge(replace(null, candidate=replace(null.candidate, problem=problem)))

    def refitted_without(self, candidate: TrajectoryCandidate, i: int) -> TrajectoryCandidate | None:
        """Without effect i, from the slopes that are known."""
        effects, theta = candidate.without_effect(i)
        if not effects:
            return self.fitted_null.candidate
        known = np.delete(candidate.fit.J, np.arange(len(candidate.fit.theta))[candidate.slice_of(i)], axis=1)
        return self.problem.fit(effects, theta, known.transpose(1, 0, 2))

    def in_place_of(self, final: Evidence[TrajectoryCandidate], i: int) -> list[TrajectoryCandidate]:
        """Candidates with another effect in the place of effect i, and that itself again."""
        if len(final.effects) == 1:
            return self.first_round
        rest = self.without(final.candidate, i)
        return self.ranked(self.expand(rest, BY_WHITE, BY_FORCED), rest) if rest is not None else []

    # ---- one round --------------------------------------------------------------------------------------------------
    def expand(
        self,
        base: TrajectoryCandidate,
        n_white: int,
        n_forced: int,
        among: Sequence[BaseEffect] | None = None,
        siblings: bool = False,
        least: float = 0.0,
        best: float = np.inf,
        thorough: bool = True,
    ) -> list[TrajectoryCandidate]:
        """The base with one effect more: the few that the screen puts first."""
        library = self.library if among is None else among
        counts = min(n_white, BY_WHITE), min(n_forced, BY_FORCED)
        starts = self.screened(base, library, *counts, max(least, HOPELESS * self.bar(1)))
        self.report(f"fitting {len(starts)} of {len(library)} candidates")
        work = Parallel(n_jobs=self.n_jobs, return_as="generator")
        found: list[TrajectoryCandidate] = []
        for candidate in work(delayed(_fit)(self.problem, base, *start) for start in starts):
            if candidate is not None:
                found.append(candidate)
                self.remember([candidate])  # an interrupt leaves what is fitted by now
        return found

    def screened(
        self, base: TrajectoryCandidate, library: Sequence[BaseEffect], n_white: int, n_forced: int, least: float
    ) -> list[tuple[BaseEffect, np.ndarray, np.ndarray]]:
        """Effect, start and expected change of the outputs, of those that a linear look puts first."""
        taken = set(base.keys)
        looked = [
            (effect, start, change)
            for effect in library
            if effect.key not in taken
            for start in (np.asarray(given, dtype=float) for given in effect.starts(_probe(self.problem, effect)))
            if (change := self.change(base, effect, start)) is not None
            and np.all(np.isfinite(change))
            and np.any(change)
        ]
        if not looked:
            return []
        effects, values, changes = zip(*looked)
        columns = np.stack(changes)
        white, amplitude = self._white(base, effects, columns)
        forced = self._forced(base, effects, columns)
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
        problem, n = self.problem, base.n_parameters
        theta = np.concatenate([base.fit.theta[:n], start, base.fit.theta[n:]])
        effects = (*base.effects, effect)
        if effect.kind == "input":
            acting = problem.simulations.acting
            du = acting(effects, theta) - acting(base.effects, base.fit.theta)
            return problem.surrogate.respond(du[None])[0] if np.any(du) else None
        return problem.outputs(effects, theta) - base.fit.y

    def _white(
        self, base: TrajectoryCandidate, effects: Sequence[BaseEffect], columns: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Drop of the sum of squares by every column, and its amplitude."""
        r, J = self.problem.record.residual(base.fit.y)[None], base.fit.J.transpose(1, 0, 2)
        white = self.problem.without_starts(np.concatenate([r, J, columns]))
        flat = white.reshape(len(white), -1)
        k = 1 + len(J)
        if len(J):
            q, _ = np.linalg.qr(flat[1:k].T)
            flat = flat - (flat @ q) @ q.T
        return _drop(flat[k:] @ flat[0], np.sum(flat[k:] ** 2, axis=1), effects)

    def _forced(self, base: TrajectoryCandidate, effects: Sequence[BaseEffect], columns: np.ndarray) -> np.ndarray:
        """The same under the noise of the base."""
        r, J, precision, _ = base.columns()
        whole = np.concatenate([r[None], J.transpose(1, 0, 2), columns])
        rows, diagonal = base.disturbance.gram_rows(whole, self.judged[base].noise, 1 + J.shape[1])
        return _drop(*eliminate_rows(rows, diagonal, precision, np.zeros(len(precision))), effects)[0]


def _probe(problem: TrajectoryBackend, effect: BaseEffect) -> Probe:
    """What an effect sees of the data."""
    record, plant = problem.record, problem.plant

    def signal(name: str) -> np.ndarray:
        if name in plant.inputs:
            return record.u[plant.inputs.index(name)]
        return record.measured(plant.outputs.index(name))

    where = signal(str(effect.location)) if effect.kind in ("input", "output") else np.zeros(record.n_samples)
    v = signal(effect.variable) if effect.variable else where
    return Probe(v, where, 0.0, record.dt, record.dt * int(record.lengths.max()), record.starts)


def _fit(
    problem: TrajectoryBackend, base: TrajectoryCandidate, effect: BaseEffect, start: np.ndarray, change: np.ndarray
) -> TrajectoryCandidate | None:
    """The base with one effect more, fitted."""
    n = base.n_parameters
    theta = np.concatenate([base.fit.theta[:n], start, base.fit.theta[n:]])
    known, own = base.fit.J.transpose(1, 0, 2), np.full((len(start), *base.fit.y.shape), np.nan)
    if effect.linear and len(start) == 1 and effect.kind != "input" and start[0] != effect.parameters[0].null:
        own[0] = change / (start[0] - effect.parameters[0].null)
    try:
        return problem.fit((*base.effects, effect), theta, np.concatenate([known[:n], own, known[n:]]))
    except np.linalg.LinAlgError:  # slopes beyond the arithmetic: this candidate is lost
        return None


def _drop(g: np.ndarray, h: np.ndarray, effects: Sequence[BaseEffect]) -> tuple[np.ndarray, np.ndarray]:
    """Drop and amplitude of every column: free where the effect is linear, within 0..3 of the start where not."""
    linear = np.array([effect.linear for effect in effects])
    return scores(g, h, np.where(linear, -np.inf, 0.0), np.where(linear, np.inf, 3.0))
