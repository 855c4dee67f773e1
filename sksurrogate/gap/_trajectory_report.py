"""Simulators that only give trajectories: input, sensor and parameter effects around ``simulate``.

The same questions in the same order as for a simulator with a right-hand side; what lies inside the simulator is seen
through a linear stand-in, as the input or output at which an equivalent disturbance would enter.
"""

from __future__ import annotations

import time
import warnings
from typing import Any

import numpy as np

from sksurrogate.effects._catalogue import left_out
from sksurrogate.effects._simulator import AugmentedSimulator
from sksurrogate.gap._trajectory_pipeline import AroundQuestions
from sksurrogate.gap.decide._budget import budget_of, remainder_of
from sksurrogate.gap.decide._experiment import name_of, when_they_part
from sksurrogate.gap.decide._features import DecisionFeatures, share_left
from sksurrogate.gap.decide._held_out import notes_on_names, traces
from sksurrogate.gap.decide._intervals import parameter_errors
from sksurrogate.gap.decide._ranking import ranking
from sksurrogate.gap.decide._reported import reported
from sksurrogate.gap.decide._rules import decide
from sksurrogate.gap.fit._closed_loop import LOOP, closed_loop
from sksurrogate.gap.fit._retuned import retuned_table
from sksurrogate.gap.fit._trajectory import Trial
from sksurrogate.gap.render._report import GapReport
from sksurrogate.gap.render._sentences import sentence_of
from sksurrogate.gap.results._effect_estimate import EffectEstimate
from sksurrogate.gap.results._reasons import UNDECIDED, Reasons
from sksurrogate.gap.results._shrink import NOT_KNOWN, Shrink
from sksurrogate.gap.results._table import Table
from sksurrogate.gap.results._where import Where
from sksurrogate.gap.search._search import EQUAL
from sksurrogate.gap.unnamed._law_evidence import LawBeside
from sksurrogate.gap.unnamed._shape import shape_of
from sksurrogate.gap.unnamed._trajectory_location import channel_of, left_of
from sksurrogate.gap.unnamed._where import by_frequency, by_location, by_output, named_places, regions, times
from sksurrogate.physics._simulator import Plant
from sksurrogate.runs import Runs

__all__ = ["diagnose_trajectory"]

_NAN = float("nan")
NOTE = (
    "The simulator gives trajectories only: effects inside its balances, and parameters that drift or jump, cannot be tested; "
    "where one is missing shows as an equivalent disturbance at an input or output. Give it rhs or step to test the whole "
    "catalogue."
)


def diagnose_trajectory(
    diagnoser: Any, plant: Plant, runs: Runs, free: tuple[str, ...], seed: int, begun: float
) -> tuple[GapReport, AugmentedSimulator]:
    """The diagnosis of a simulator with ``simulate`` alone.

    Returns
    -------
    report : GapReport
    augmented : AugmentedSimulator
    """
    questions = _Answers(diagnoser, plant, runs, free, seed)
    try:
        with np.errstate(all="ignore"):
            questions.ask()
    except KeyboardInterrupt:
        warnings.warn(
            "interrupted: the report holds what was known by then (report_.complete is False)",
            UserWarning,
            stacklevel=3,
        )
        questions.complete = False
    with np.errstate(all="ignore"):
        return questions.answer(time.perf_counter() - begun), questions.augmented()


class _Answers(AroundQuestions):
    """The report made of the answers."""

    def decided(self) -> tuple[str, Reasons]:
        """The verdict, and the rule that gave it."""
        final, shrink = self.final, self.shrink
        if shrink is None:
            return "unknown", UNDECIDED
        return decide(
            DecisionFeatures(
                names=len(final.effects),
                probability=min((self.probability(final, i) for i in range(len(final.effects))), default=1.0),
                retuned=self.moved(),
                share_left=share_left(shrink),
                left=left_of(self.around, final),
                lawful=self.lawful(shrink),
                after=shrink.after,
                error=shrink.before if np.isfinite(shrink.before) else np.inf,
                law=float(np.max(self.law, initial=0.0)),
                n_samples=self.around.record.n_samples,
                tolerance=self.tolerance,
            )
        )

    def lawful(self, shrink: Shrink) -> float:
        """Share of the gap (amplitude) that states and inputs repeat of what is left."""
        return share_left(shrink) * float(np.sqrt(max(np.max(self.law, initial=0.0), 0.0)))

    def probability(self, final: Trial, i: int) -> float:
        """That effect i, or one of its class, acts: by likelihood among the rivals in its place."""
        slot = self.slots[i] if i < len(self.slots) else []
        same = {final.effects[i].key, *(trial.effects[-1].key for trial, _ in slot)}
        beside = {key for k, key in enumerate(final.keys) if k != i}
        others = [
            min(self.search.score(trial) - self.search.score(final), -0.5 * EQUAL)
            for trial in self.search.rivals
            if len(trial.keys) == len(final.keys) and beside < set(trial.keys) and not set(trial.keys) - beside <= same
        ]
        ours = [0.0, *(min(t.log_likelihood - final.log_likelihood, 0.0) for t, _ in slot)]
        against = float(np.sum(np.exp([value for value in others if np.isfinite(value)])))
        own = float(np.sum(np.exp(ours)))
        return own / (own + against)

    def moved(self) -> bool:
        """Whether free parameters at other values are worth their number."""
        null = self.search.null
        if not self.around.free or null is None or null.noise is None:
            return False
        nominal = Trial((), np.zeros(0), self.around.nominal, null.J[:, :0], np.inf)
        free, self.around.free = self.around.free, ()
        try:
            value = self.around.estimate(nominal, null.noise, 8).log_likelihood
        finally:
            self.around.free = free
        return bool(2.0 * (null.log_likelihood - value) > self.search.bar(len(free)))

    def answer(self, seconds: float) -> GapReport:
        """The report of what is known."""
        final, around = self.final, self.around
        verdict, reasons = self.decided()
        low, high = self.intervals(final)
        effects = self.estimates(low, high) if verdict != "none" else []
        own = slice(final.n_parameters, None)
        retuned = retuned_table(self.plant.params, around.free, final.theta[own], low[own], high[own])
        if not effects and verdict == "explained":
            effects = parameter_errors(retuned, self.shrink.fraction_power if self.shrink is not None else _NAN)
        where, term = self.where(verdict, effects), None
        if verdict in ("partial", "unknown") and self.shrink is not None and where.location is not None:
            assert self.search.null is not None
            term = shape_of(channel_of(around, self.search.null, where.location), where.location, str(where.kind))
        shrink = self.shrink or NOT_KNOWN
        return GapReport(
            verdict,
            sentence_of(
                verdict,
                effects,
                where,
                shrink,
                self.experiment,
                term,
                remainder_of(shrink, share_left(shrink), left_of(around, final), None),
            ),
            effects,
            self.ranking(),
            retuned,
            where,
            shrink,
            term,
            self.experiment,
            self.complete,
            tuple(self.notes(verdict)),
            tuple(left_out(self.effects, self.search.candidates)),
            self.plant.outputs,
            self.plant.states,
            self.plant.inputs,
            traces(self.held, self.labels()),
            seconds,
            reasons,
            self.budget(shrink),
            remainder_of(shrink, share_left(shrink), left_of(around, final), None),
        )

    def intervals(self, final: Trial) -> tuple[np.ndarray, np.ndarray]:
        """90 %: the sandwich of the white fit under the fit's own noise."""
        around, k = self.around, len(final.theta)
        if not k:
            return np.zeros(0), np.zeros(0)
        white = 1.0 / around.sd[:, None]
        J = around.without_starts(final.J.transpose(1, 0, 2))
        flat = J.reshape(k, -1)
        H = flat @ flat.T + np.diag(around.precision(final.effects, final.theta))
        scale = np.sqrt(np.maximum(np.diag(H), 1e-300))
        inverse = np.linalg.pinv(H / np.outer(scale, scale), rcond=1e-10, hermitian=True) / np.outer(scale, scale)
        noise = final.noise or around.first_noise()
        pull = around.disturbance().spread((J * white).transpose(1, 0, 2), noise)
        half = 1.645 * np.sqrt(np.maximum(np.diag(inverse @ pull @ inverse), 0.0)) + 1e-3 * np.abs(final.theta)
        low, high = around.bounds(final.effects)
        return np.maximum(final.theta - half, low), np.minimum(final.theta + half, high)

    def estimates(self, low: np.ndarray, high: np.ndarray) -> list[EffectEstimate]:
        final, out = self.final, []
        total = self.shrink.fraction_power if self.shrink is not None else _NAN
        for i, effect in enumerate(final.effects):
            rows = final.slice_of(i)
            params, ends = reported(effect, final.theta[rows], low[rows], high[rows])
            slot = self.slots[i] if i < len(self.slots) else []
            out.append(
                EffectEstimate(
                    effect.name,
                    str(effect.location),
                    effect.variable,
                    float(self.shares[i]) if self.shares else float(total),
                    params,
                    ends,
                    self.probability(final, i),
                    [(str(k[0]), str(k[1]), k[2]) for k in dict.fromkeys(t.effects[-1].key for t, _ in slot)],
                    when_they_part(
                        name_of(effect),
                        [name_of(t.effects[-1]) for t, _ in slot],
                        all(same for _, same in slot),
                        self.experiment,
                        among="that can be tested here",
                    ),
                )
            )
        return sorted(out, key=lambda e: -e.share if np.isfinite(e.share) else 0.0)

    def where(self, verdict: str, effects: list[EffectEstimate]) -> Where:
        location, kind = None, None
        named = named_places(
            effects if verdict in ("explained", "partial") else [], {e.key: e.kind for e in self.final.effects}
        )
        if named:
            location, kind, _ = named[0]
        elif verdict == "unknown" and self.places:
            location, kind = self.places[0].location, self.places[0].kind
        if self.shrink is None or self.held is None or self.search.null is None:
            return Where(location, kind)
        null = self.search.null
        at = location if kind in ("input", "output") else (self.places[0].location if self.places else None)
        channel = channel_of(self.around, null, at)
        w, Z, names = channel.force(), channel.Z, channel.names
        return Where(
            location,
            kind,
            by_output(self.shrink),
            by_location(self.places, named),
            regions(self.around.record, Z, names, w),
            times(self.around.record, w),
            by_frequency(self.held.record, self.held.before, self.floor()),
        )

    def ranking(self) -> Table:
        """All rivals with their evidence."""
        search, null = self.search, self.search.null
        fitted = {} if null is None else {trial.keys[-1]: trial for trial in reversed(search.first_round)}
        return ranking(
            search.candidates,
            fitted,
            lambda trial: search.gain(trial, null) if null is not None else _NAN,
            lambda trial: trial.cost,
            search.bar,
            search.expected,
            self.final.keys,
        )

    def budget(self, shrink: Shrink) -> Table:
        """Shares of the gap's power."""
        final, law = self.final, self.lawful(shrink)
        retuning = (
            0.0
            if final.effects or not self.around.free or not np.isfinite(shrink.fraction_power)
            else shrink.fraction_power
        )
        place = self.places[0] if self.places else None
        beside = (
            LawBeside(0.0, 0.0, place.location, place.kind, "", law, law, (0, 0, self.around.first_noise()))
            if place is not None
            else None
        )
        return budget_of([name_of(e) for e in final.effects], list(self.shares), retuning, shrink, beside)

    def notes(self, verdict: str) -> list[str]:
        """What a careful reader should know."""
        notes = [NOTE]
        if not self.complete:
            notes.append("The diagnosis was interrupted: questions after that point are not answered.")
        if self.uncertified:
            notes.append(self.uncertified)
        if self.blind:
            notes.append(
                "The simulator does not answer other inputs than those in X: no effect on an input could be tested."
            )
        if self.around.free_starts and self.around.x0 is None:
            notes.append(
                "The runs start elsewhere than the simulator does: their initial states were fitted as transients of a "
                "linear model of it. Give the simulator the initial states, or let it take x0, for a sharper answer."
            )
        if verdict == "none" and self.shrink is not None and self.shrink.measurable:
            notes.append(
                "The free run lies above the noise floor, but no repeatable law explains it better than a disturbance: "
                "repeat a run with the same inputs to tell a disturbance from an effect."
            )
        notes += notes_on_names([trial.effects for trial in self.finals], self.final.effects, self.held, self.labels())
        loop = closed_loop(self.around.record, self.final.y, self.plant.inputs)
        if loop is not None:
            notes.append(LOOP.format(name=loop))
        for i, name in enumerate(self.plant.inputs):
            if np.ptp(self.around.record.u[i]) == 0:
                notes.append(f"Input {name!r} never moves: these data say nothing about its effects.")
        return notes

    def labels(self) -> list[Any]:
        """Labels of the runs."""
        return [run.label for run in self.runs]

    def augmented(self) -> AugmentedSimulator:
        """The simulator with what was found."""
        final, around = self.final, self.around
        values = [
            {p.name: float(v) for p, v in zip(effect.parameters, final.theta[final.slice_of(i)])}
            for i, effect in enumerate(final.effects)
        ]
        n = final.n_parameters
        tuned = {
            name: float(phi if self.plant.params[name] == 0 else self.plant.params[name] * np.exp(phi))
            for name, phi in zip(around.free, final.theta[n:])
        }
        return AugmentedSimulator(self.plant.simulator, list(final.effects), values, tuned or None)
