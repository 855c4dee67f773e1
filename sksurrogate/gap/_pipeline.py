"""The questions of a diagnosis in their order, and the report made of their answers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from sksurrogate.effects._simulator import AugmentedSimulator
from sksurrogate.gap.decide._baseline import WithoutNames
from sksurrogate.gap.decide._budget import budget_of, remainder_of
from sksurrogate.gap.decide._choice_by_fold import names_by_fold
from sksurrogate.gap.decide._equivalence import equivalents, next_experiment
from sksurrogate.gap.decide._estimates import estimates
from sksurrogate.gap.decide._experiment import name_of
from sksurrogate.gap.decide._features import DecisionFeatures, certified, left_over, share_left
from sksurrogate.gap.decide._held_out import (
    HeldOut,
    held_out,
    measure,
    notes_on_names,
    same_names,
    shares,
    traces,
)
from sksurrogate.gap.decide._intervals import intervals, parameter_errors
from sksurrogate.gap.decide._partial_results import Found
from sksurrogate.gap.decide._posterior import Posterior, law_beside_none, stands
from sksurrogate.gap.decide._probability import probabilities
from sksurrogate.gap.decide._ranking import ranking_of
from sksurrogate.gap.decide._retuning_imitates import imitated_by_retuning
from sksurrogate.gap.decide._rules import ROUNDING, decide
from sksurrogate.gap.fit._closed_loop import LOOP, closed_loop
from sksurrogate.gap.fit._closeness import FAR, NEAR, NEARLY_WHITE
from sksurrogate.gap.fit._evidence import Evidence, estimate_noise
from sksurrogate.gap.fit._excerpt import FITTED_SAMPLES, excerpt
from sksurrogate.gap.fit._problem import Problem, build_problem
from sksurrogate.gap.fit._retuned import retuned_table, value_of
from sksurrogate.gap.fit._rounding import GRID_NOTE, Rounding, unnamed_rounding
from sksurrogate.gap.render._report import GapReport
from sksurrogate.gap.render._sentences import note_on_none, sentence_of
from sksurrogate.gap.results._effect_estimate import EffectEstimate
from sksurrogate.gap.results._reasons import UNDECIDED, Reasons
from sksurrogate.gap.results._remainder import NOTHING_KNOWN, Remainder
from sksurrogate.gap.results._shrink import NOT_KNOWN
from sksurrogate.gap.results._table import EMPTY, Table
from sksurrogate.gap.results._where import Where
from sksurrogate.gap.search._search import Search
from sksurrogate.gap.search._stopping import STACK
from sksurrogate.gap.unnamed import _where
from sksurrogate.gap.unnamed._curve_shapes import CERTAIN
from sksurrogate.gap.unnamed._disturbance_channel import Channels, missing_term, where_and_when
from sksurrogate.gap.unnamed._free_curve import free_curve
from sksurrogate.gap.unnamed._law_rival import LawRival, law_rival
from sksurrogate.gap.unnamed._location import accused, told_by, told_by_law
from sksurrogate.gap.unnamed._residual_analysis import Remaining, law_left
from sksurrogate.kernels.record import Record
from sksurrogate.runs import Runs

__all__ = ["Questions"]

_NAN = float("nan")
#: White noise is at most so many times what differences of the outputs show.
MOST_NOISE = 1.1


class Questions:
    """Asks the questions in order; an interrupt leaves what is known."""

    def __init__(
        self,
        problem: Problem,
        search: Search,
        runs: Runs,
        whole: Record,
        *,
        correction: Any,
        tolerance: float,
        seed: int,
        say: Callable[[str], None],
    ):
        self.problem, self.search, self.whole = problem, search, whole
        self.labels = [run.label for run in runs]
        self.correction, self.tolerance, self.seed, self.say = correction, tolerance, seed, say
        self.found = Found([])
        self.complete = True
        self.uncertified = ""

    @property
    def final(self) -> Evidence:
        """The rival that stands."""
        return self.search.final or self.null

    @property
    def null(self) -> Evidence:
        """No effect."""
        return self.search.begun

    def begin(self) -> None:
        """Ask what needs no name, while names are looked for."""
        self.channels = Channels(self.null.candidate)
        self.without = WithoutNames(self.null, self.correction, self.search.later)

    def ask(self) -> None:
        say, problem, search = self.say, self.problem, self.search
        final, found = self.final, self.found
        remaining = Remaining(search.later, self.null, self.channels, final, self.seed)
        found.curve = free_curve(final)
        few = 0 < len(final.effects) < STACK
        if few and final.left < NEAR and found.curve is not None and found.curve.gain > CERTAIN:
            self.name_what_is_seen()
            final = self.final
        if final.effects:
            say("whether a law without a name does as well")
            final, found.posterior = stands(search, final, self.tolerance)
        found.retuned = self._retuning_counts()
        say("what these data cannot tell apart")
        found.slots = equivalents(search, final)
        say("how far the gap shrinks on runs left out")
        experiment = search.second.ask(partial(next_experiment, final, found.slots))
        found.finals = names_by_fold(search, final, found.slots)
        without = self.without.held(self.null, bool(final.effects))
        found.held = held_out(found.finals, without, same_names(found.finals, final.candidate))
        say("what is left")
        found.remains = remaining.of(final)
        found.shrink = measure(found.held, self.floor(), problem.plant.outputs, self.seed)
        if final.effects and not certified(found.shrink, final.left):
            self.say_uncertified()
            final = self.final
        if final.effects:
            found.shares, found.retuning = shares(final.candidate, found.shrink.fraction_power)
            weights = found.posterior.probabilities if found.posterior is not None else ()
            found.probabilities = probabilities(search, final.candidate, found.slots, weights)
        else:
            found.retuning = found.shrink.fraction_power if found.retuned else 0.0
            found.posterior = Posterior((), law_beside_none(search, self.tolerance))
        if final.effects or problem.free:
            found.fitted = self.fitted(final)
            found.bounds = intervals(found.fitted)
        if not self.uncertified:
            found.experiment = experiment.answer()

    def name_what_is_seen(self) -> None:
        """A law is certain on top of what is named: an effect more, however small, where none is left on top of that."""
        search = self.search
        other = search.further(self.final.candidate)
        curve = free_curve(search.judged[other]) if other is not None else None
        if other is not None and curve is not None and curve.gain < CERTAIN:
            search.stand(other)
            self.found.curve = curve

    def law_rival(self, of_names: bool) -> LawRival | None:
        """One law without a name, in the place of all names or of nothing."""
        final, search, found = self.final, self.search, self.found
        named = bool(final.effects) and of_names
        if named not in found.rivals and self.complete and search.null is not None:
            rival, x = (final, final.fit.x) if named else (self.null, search.x)
            x = x[: len(self.problem.plant.states)]
            found.rivals[named] = law_rival(rival, x, len(search.candidates), search.second)
        return found.rivals.get(named)

    def fitted(self, final: Evidence) -> Evidence:
        """The rival that stands, fitted on more of a long record."""
        at = final.candidate.problem
        if self.whole.n_samples == at.record.n_samples:
            return final
        self.say("fitting what was named on more of the record")
        record, _ = excerpt(self.whole, FITTED_SAMPLES)
        larger, smoothed = build_problem(at.plant, at.model, record, at.free, at.balances)
        larger = replace(larger, numerics=at.numerics, scale=at.scale, caps=at.caps)
        rival = larger.fit(final.effects, final.fit.theta, smoothed.x)
        return final if rival is None else estimate_noise(rival, final.noise, final.curvature, max_iterations=5)

    def say_uncertified(self) -> None:
        """The named effects close too little on runs left out: no name is given; the null stands."""
        found, search = self.found, self.search
        null = self.null
        assert found.held is not None
        names = ", ".join(effect.name for effect in self.final.effects)
        self.uncertified = (
            f"{names} passed the evidence but closed too little of the gap on runs left out; no name is given."
        )
        search.final, found.slots, found.finals = null, [], []
        assert found.remains is not None
        latent, law = law_left(null, self.seed)
        found.remains = replace(found.remains, latent=latent, law=law)
        found.experiment = next_experiment(null, found.slots)
        found.curve = free_curve(null)
        found.rivals = {}
        held = found.held
        after = held.before if not self.problem.free else held.retuned
        found.held = HeldOut(held.record, held.before, after, held.retuned, held.corrected)
        found.shrink = measure(found.held, self.floor(), self.problem.plant.outputs, self.seed)

    def floor(self) -> np.ndarray:
        """Sensor noise: of the final fit and of the latent force the larger, and no more than the outputs' differences show.

        A wrong fit leaves its coloured noise to take the white one's part; the force of the latent fit does so rarely.
        """
        final, left_over = self.final, self.found.remains
        fits = [final.noise.sigma, *([left_over.latent.noise.sigma] if left_over is not None else [])]
        most = MOST_NOISE * self.problem.sd
        return np.max([np.minimum(sigma, most) for sigma in fits], axis=0)

    def _retuning_counts(self) -> bool:
        """Whether the free parameters at other values than the nominal ones are worth their number."""
        problem, null = self.problem, self.null
        if not problem.free:
            return False
        alone = replace(problem, free=()).fit((), np.zeros(0), null.fit.x)
        if alone is None:
            return True
        nominal = estimate_noise(alone, null.noise)
        return bool(2.0 * (null.log_likelihood - nominal.log_likelihood) > self.search.bar(len(problem.free)))

    # ---- the report -------------------------------------------------------------------------------------------------
    def decided(self) -> tuple[str, Reasons]:
        """The verdict, and the rule that gave it."""
        found, final = self.found, self.final
        if found.shrink is None or found.remains is None:
            return "unknown", UNDECIDED
        return decide(
            DecisionFeatures(
                names=len(final.effects),
                probability=min(found.probabilities, default=1.0),
                retuned=found.retuned,
                share_left=share_left(found.shrink),
                left=self.over_noise(),
                lawful=self.lawful(),
                after=found.shrink.after,
                error=found.shrink.before if np.isfinite(found.shrink.before) else np.inf,
                law=float(np.max(found.remains.law, initial=0.0)),
                curve=found.curve.gain if found.curve is not None else -np.inf,
                curve_moved=found.curve.deviation if found.curve is not None else 0.0,
                rounding=rounding.share if (rounding := self.rounding()) is not None else 0.0,
                n_samples=self.problem.record.n_samples,
                tolerance=self.tolerance,
            )
        )

    def over_noise(self) -> float:
        """Free-run error that is left, in units of the noise."""
        found = self.found
        assert found.remains is not None
        return left_over(self.final, found.remains.latent, MOST_NOISE * self.problem.sd, found.retuned)

    def lawful(self) -> float:
        """Share of the gap (amplitude) that a law without a name makes up beside what is named."""
        posterior = self.found.posterior
        return posterior.law.size if posterior is not None and posterior.law is not None else 0.0

    def rounding(self) -> Rounding | None:
        """A grid of readings that nothing named explains, where it is coarse enough to matter."""
        found = unnamed_rounding(self.final.candidate)
        return found if found is not None and found.share > ROUNDING else None

    def effects(self, verdict: str) -> list[EffectEstimate]:
        found = self.found
        out = estimates(self.search, self.final, found)
        if not out and verdict == "explained":
            share = found.shrink.fraction_power if found.shrink else _NAN
            out = parameter_errors(self.retuned(), share, self.imitated())
        return sorted(out, key=lambda e: -e.share if np.isfinite(e.share) else 0.0)

    def imitated(self) -> list[tuple[str, str, str | None]]:
        """Effects that the re-tuning would hide."""
        null, screen = self.search.null, self.search.first_screen
        found = imitated_by_retuning(screen, null.fit.theta) if null is not None and screen is not None else []
        return [(effect.name, str(effect.location), effect.variable) for effect in found]

    def retuned(self) -> Table:
        final = self.found.fitted or self.final
        bounds = self.found.bounds or (final.fit.theta, final.fit.theta)
        own = slice(final.candidate.n_parameters, None)
        return retuned_table(
            self.problem.plant.params, self.problem.free, final.fit.theta[own], bounds[0][own], bounds[1][own]
        )

    def where(self, verdict: str, effects: list[EffectEstimate]) -> Where:
        found, left_over = self.found, self.found.remains
        accusable = left_over.places if left_over is not None else []
        location, kind = None, None
        named = _where.named_places(
            effects if verdict in ("explained", "partial") else [], {e.key: e.kind for e in self.final.effects}
        )
        if named:
            location, kind, _ = named[0]
        elif verdict == "unknown" and (rounding := self.rounding()) is not None and self.final.left < NEARLY_WHITE:
            location, kind = rounding.sensor, "output"
        elif verdict == "unknown" and (
            told := told_by_law(self.law_rival(self.final.left < NEAR), accusable, self.problem.plant.inputs)
        ):
            location, kind = told
        elif verdict == "unknown" and (curved := self.curved_input()) is not None:
            location, kind = curved, "input"
        elif verdict == "unknown" and left_over is not None and accusable:
            location, kind = accused(accusable, lambda b, u: told_by(self.problem, left_over.gap, b, u, self.seed))
        if found.shrink is None or left_over is None or found.held is None:
            return Where(location, kind)
        return Where(
            location,
            kind,
            _where.by_output(found.shrink),
            _where.by_location(accusable, named),
            *where_and_when(self.channels, left_over.gap, location, kind),
            _where.by_frequency(found.held.record, found.held.before, self.floor()),
        )

    def curved_input(self) -> str | None:
        """The input whose own curve is likelier than all others, where nothing is named."""
        curve = self.found.curve
        certain = curve is not None and not self.final.effects and curve.gain > CERTAIN
        return curve.location if curve and certain and curve.location in self.problem.plant.inputs else None

    def answer(self, seconds: float) -> GapReport:
        """The report of what is known."""
        found, final, problem = self.found, self.final, self.problem
        verdict, reasons = self.decided()
        effects = self.effects(verdict) if verdict != "none" else []
        place = self.where(verdict, effects)
        shrink = found.shrink or NOT_KNOWN
        term = None
        if verdict in ("partial", "unknown") and found.remains is not None and place.location is not None:
            term = missing_term(self.channels, place.location, str(place.kind))
        notes = self.notes(verdict)
        sentence = sentence_of(verdict, effects, place, shrink, found.experiment, term, self.remainder())
        return GapReport(
            verdict,
            sentence,
            effects,
            ranking_of(self.search, final),
            self.retuned(),
            place,
            shrink,
            term,
            found.experiment,
            self.complete,
            tuple(notes),
            (),
            problem.plant.outputs,
            problem.plant.states,
            problem.plant.inputs,
            traces(found.held, self.labels),
            seconds,
            reasons,
            self.budget(),
            self.remainder(),
        )

    def budget(self) -> Table:
        """Shares of the gap's power."""
        found = self.found
        if found.shrink is None or not found.shrink.measurable:
            return EMPTY
        names = [name_of(effect) for effect in self.final.effects]
        law = found.posterior.law if found.posterior is not None else None
        return budget_of(names, found.shares or [], found.retuning, found.shrink, law)

    def remainder(self) -> Remainder:
        """What is left beside everything that is named."""
        found = self.found
        if found.shrink is None or found.remains is None:
            return NOTHING_KNOWN
        law = found.posterior.law if found.posterior is not None else None
        return remainder_of(found.shrink, share_left(found.shrink), self.over_noise(), law)

    def notes(self, verdict: str) -> list[str]:
        """What a careful reader should know."""
        notes = []
        if not self.complete:
            notes.append("The diagnosis was interrupted: questions after that point are not answered.")
        if self.uncertified:
            notes.append(self.uncertified)
        found = self.found
        notes += notes_on_names([rival.effects for rival in found.finals], self.final.effects, found.held, self.labels)
        if verdict == "none" and found.shrink is not None and found.shrink.measurable:
            notes.append(note_on_none(found.shrink))
        rounding = self.rounding()
        if verdict == "unknown" and rounding is not None:
            notes.append(GRID_NOTE.format(name=rounding.sensor, step=rounding.step))
        if self.whole.n_samples > self.problem.record.n_samples:
            notes.append(
                f"The rivals were compared on {self.problem.record.n_samples} of {self.whole.n_samples} samples, in pieces "
                "spread over the record; what is named was fitted on more of them."
            )
        loop = closed_loop(self.problem.record, self.final.fit.y, self.problem.plant.inputs)
        if loop is not None and self.final.left < FAR:  # what is left must be noise, not the gap itself
            notes.append(LOOP.format(name=loop))
        for i, name in enumerate(self.problem.plant.inputs):
            if np.ptp(self.problem.record.u[i]) == 0:
                notes.append(f"Input {name!r} never moves: these data say nothing about its effects.")
        return notes

    def augmented(self) -> AugmentedSimulator:
        """The simulator with what was found."""
        final, plant = self.found.fitted or self.final, self.problem.plant
        values = [
            {p.name: float(v) for p, v in zip(effect.parameters, final.candidate.theta_of(i))}
            for i, effect in enumerate(final.effects)
        ]

        tuned = {
            name: value_of(plant.params[name], final.fit.theta[final.candidate.n_parameters + i])
            for i, name in enumerate(self.problem.free)
        }
        return AugmentedSimulator(plant.simulator, list(final.effects), values, tuned or None, scale=self.problem.scale)
