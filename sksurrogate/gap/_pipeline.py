"""The stages of a diagnosis in their order, and the report made of their answers."""

from __future__ import annotations

import time
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import cached_property, partial

import numpy as np

from sksurrogate._parallel._worker_process import PendingAnswer
from sksurrogate.effects._catalogue import name_of
from sksurrogate.effects._parameter import constant_in_time
from sksurrogate.effects._ports import kind_at
from sksurrogate.gap._law_stage import LawStage
from sksurrogate.gap._progress import INTERRUPTED, SOON, Progress, Stage, quiet
from sksurrogate.gap.decide._budget import budget_of, remainder_of
from sksurrogate.gap.decide._calibration import with_stated
from sksurrogate.gap.decide._choice_by_fold import names_by_fold
from sksurrogate.gap.decide._equivalence import canonical_classes
from sksurrogate.gap.decide._estimates import estimates, ranking
from sksurrogate.gap.decide._experiment import next_experiment
from sksurrogate.gap.decide._held_out import (
    HeldOut,
    held_out,
    likelier_held_out,
    notes_on_names,
    same_names,
    traces,
    without_names,
)
from sksurrogate.gap.decide._one_curve import nearest_name
from sksurrogate.gap.decide._retuning import parameter_errors
from sksurrogate.gap.decide._rules import certified, share_left
from sksurrogate.gap.decide._run_to_run import differs, run_to_run
from sksurrogate.gap.faults._record_book import faults_of
from sksurrogate.gap.fit._closed_loop import LOOP, closed_loop
from sksurrogate.gap.fit._closeness import AT_THE_NOISE, NEARLY_WHITE
from sksurrogate.gap.fit._evidence import C, estimate_noise
from sksurrogate.gap.fit._explained import MOST_UNEXPLAINED, NOTHING_HELPS, share_explained
from sksurrogate.gap.render import _notes
from sksurrogate.gap.render._report import GapReport
from sksurrogate.gap.results._effect_estimate import EffectEstimate
from sksurrogate.gap.results._missing_term import MissingTerm
from sksurrogate.gap.results._remainder import NOTHING_KNOWN, Remainder
from sksurrogate.gap.results._shrink import NOT_KNOWN
from sksurrogate.gap.results._table import EMPTY, Table
from sksurrogate.gap.results._where import Where
from sksurrogate.gap.unnamed import _where
from sksurrogate.kernels.clock import TimeIsUp, time_left, time_until


class DiagnosisPipeline(LawStage[C]):
    """Goes through the stages; an interrupt leaves what is known."""

    def run(self, progress: Progress) -> GapReport | None:
        """All stages that were not asked yet, and the report of what is known after them; None where ``book`` has another record by then."""
        self.started_at, came = progress.started_at, self.book
        progress.begin(sum(stage.share for stage in STAGES[: self.asked]))
        with self.search.second, self.search.later:
            try:
                for stage in STAGES[self.asked :]:
                    progress.stage(stage.share)
                    with quiet(), time_until(self.moment(stage.until)):
                        self.ask(stage)
                    self.asked += 1
                    if self.book is not came:
                        return None
            except KeyboardInterrupt:
                warnings.warn(INTERRUPTED, UserWarning, stacklevel=3)
                self.complete = self.access.complete = False
            with quiet():
                return self.answer()

    def ask(self, stage: Stage) -> None:
        """One stage, as far as there is time."""
        if time_left() <= 0.0:
            self.cut[stage.name], self.complete = None, False
            return
        if stage.summary:
            self.search.report(stage.summary)
        with self.answered(stage.name, needed=bool(np.isinf(stage.until))):
            stage.ask(self)

    @contextmanager
    def answered(self, question: str, needed: bool = False) -> Iterator[None]:
        """A question that the end of the time, or linear algebra that breaks, leaves open; an error where the answer is ``needed``."""
        try:
            yield
        except TimeIsUp:
            self.cut[question], self.complete = None, False
        except (np.linalg.LinAlgError, FloatingPointError) as error:
            if needed:  # nothing can be said without it
                raise
            self.failed[question] = str(error)

    @cached_property
    def baseline(self) -> PendingAnswer[HeldOut]:
        """Free runs on runs left out of what needs no name; a learner of the user's own stays in this process.

        A correction has nothing to learn where the simulator as it is given, not as it is re-tuned, is at the noise.
        """
        off = self.null.left >= AT_THE_NOISE or self.problem.free
        correction = self.access.correction(self.learner) if off else None
        ask = self.search.later.ask if self.learner is None else PendingAnswer[HeldOut]
        return ask(partial(without_names, self.null.candidate, correction))

    # ---- the stages -------------------------------------------------------------------------------------------------
    def fit_null(self) -> None:
        """The simulator alone; what can be asked in the second process while names are looked for."""
        self.search.fit_null()
        with self.answered("whether the record has another unit"), time_until(self.moment(SOON)):
            self.access.ask_for_another_unit()
        if self.access.asks_early:
            _ = self.baseline

    def look_for_names(self) -> None:
        """The search, and effects that begin or end within the runs.

        Nothing where the simulator alone explains the record in another unit, or more of it than the names do in its own.
        """
        unit = self.access.other_unit
        if unit.share > 1.0 - MOST_UNEXPLAINED:
            return
        try:
            self.search.look_for_one()
            self.access.ask_for_the_law_of_the_gap()
            with self.search.among_signals(self.access.law_of_the_gap):
                self.search.look_for_more()
                self.search.look_for_onsets()
        except KeyboardInterrupt:
            self.search.keep_best()
            raise
        if unit.sentence and share_explained(self.problem.record, self.final.fit.y) <= unit.share:
            self.search.final = self.null
        else:
            self.access.other_unit = NOTHING_HELPS

    def look_at_the_record(self) -> None:
        """What is seen on top of the names, and whether what they leave is a fault of the record."""
        self.access.ask_for_places(self.final)
        if self.access.other_unit.sentence:
            return
        if self.book is not None and time.perf_counter() < self.moment(SOON):
            self.book = self.book.with_next_fault(
                self.search, self.rows, self.access.law_left, self.access.law_of_the_gap
            )

    def weigh_names(self) -> None:
        """Whether a law without a name does as well as what was named."""
        self.posterior = self.access.weigh(self.final)
        if self.posterior.too_far:
            self.found.uncertified = _notes.too_little(self.posterior.too_far)

    def ask_whether_retuning_counts(self) -> None:
        """Whether the free parameters at other values than the nominal ones are worth their number."""
        if not self.problem.free:
            return
        null, alone = self.null, self.null.candidate.untuned()
        nominal = None if alone is None else estimate_noise(alone, null.noise)
        gain = np.inf if nominal is None else 2.0 * (null.log_likelihood - nominal.log_likelihood)
        self.found.retuned = bool(gain > self.search.threshold(len(self.problem.free)))

    def find_equivalents(self) -> None:
        """What could stand in the place of each name; then what stands is settled."""
        self.found.classes, self.posterior = canonical_classes(self.search, self.posterior)

    def leave_runs_out(self) -> None:
        """Names chosen and fitted without each fold of runs, and what needs no name; the next experiment in the second process."""
        found, final = self.found, self.final
        self.experiment = self.search.second.ask(
            partial(next_experiment, final, found.classes, self.access.separations)
        )
        found.finals = names_by_fold(self.search, final, found.classes)
        found.held = held_out(found.finals, self.baseline.answer(), same_names(found.finals, final.candidate))

    def look_at_what_is_left(self) -> None:
        """The force that the names leave, and how far the gap shrinks above the noise."""
        if self.found.held is None:
            return
        self.access.look_at_what_is_left(self.final)
        self.measure()

    def certify(self) -> None:
        """Names that close too little on runs left out are withdrawn: the null stands.

        So are names of an actuator alone where the noise of its measured input is the gap: a bounded input whose noise is smoothed looks like
        one that saturates.
        """
        found, final, held = self.found, self.final, self.found.held
        if not final.effects or held is None or found.shrink is None:
            return
        where, noisy = "on runs left out", self.noisy_inputs
        if all(effect.kind == "input" and effect.location in noisy for effect in final.effects):
            where = "beyond what the noise of an input makes up"
        elif certified(found.shrink, partial(likelier_held_out, final, held)):
            return
        self.withdraw(_notes.too_little([name_of(effect) for effect in final.effects], where))

    def suggest_an_experiment(self) -> None:
        """The experiment that would tell apart what these data cannot."""
        if self.experiment is not None and not self.found.uncertified:
            self.found.experiment = self.experiment.answer()

    # ---- the report -------------------------------------------------------------------------------------------------
    def effects(self, verdict: str) -> list[EffectEstimate]:
        """The named effects, by their share, as probable as such names are; where re-tuning alone closes the gap the parameters that moved."""
        found = self.found
        out = estimates(self.search, self.final, found, self.access.among)
        if not out and verdict == "explained":
            share = found.shrink.fraction_power if found.shrink else float("nan")
            out = parameter_errors(self.retuned(), share, self.access.imitated_by_retuning())
        out = with_stated(out, self.remainder(), self.search.tolerance)
        return sorted(out, key=lambda e: -e.share if np.isfinite(e.share) else 0.0)

    def where(self, verdict: str, effects: list[EffectEstimate]) -> Where:
        """The place of the named effects where these explain the gap, else the likely one."""
        found, final = self.found, self.final
        explained = effects if verdict in ("explained", "partial") else []
        named = _where.named_places(explained, {e.key[:3]: kind_at(e, self.problem.plant) for e in final.effects})
        location, kind = None, None
        if named:
            location, kind, _ = named[0]
        elif verdict == "unknown":
            law = found.law if found.law is not None and found.law.tells_the_place else None
            location, kind = (law.location, law.kind) if law is not None else self.access.likely_place(final)
        places = self.access.places
        if found.shrink is None or places is None or found.held is None:
            return Where(location, kind)
        return Where(
            location,
            kind,
            _where.by_output(found.shrink),
            _where.by_location(places, named),
            *(self.access.where_and_when(location, kind) if found.shrink.measurable else (EMPTY, EMPTY)),
            _where.by_frequency(found.held.record, found.held.before, self.floor()),
        )

    def answer(self) -> GapReport:
        """The report of what is known."""
        found, final, problem = self.found, self.final, self.problem
        verdict, reasons = self.decided()
        effects = self.effects(verdict) if verdict != "none" else []
        place, term = self.place_and_term(verdict, effects)
        return GapReport(
            verdict,
            "",  # written when units and nominal values are known
            effects,
            ranking(self.search, final),
            self.retuned(),
            place,
            found.shrink or NOT_KNOWN,
            missing_term=term,
            next_experiment=found.experiment,
            complete=self.complete,
            notes=tuple(self.notes(verdict)),
            untestable=self.untestable,
            outputs=problem.plant.outputs,
            states=problem.plant.states,
            inputs=problem.plant.inputs,
            traces=traces(found.held, self.labels, self.carried_law is not None),
            reasons=reasons,
            budget=self.budget(),
            remainder=self.remainder(),
            data=faults_of(self.book, self.null.candidate, self.rows),
            scale=() if self.access.scale is None else tuple(map(float, self.access.scale)),
            sharpness=final.candidate.problem.sharpness,
            mistakes=_notes.mistakes(list(self.search.lost)),
        )

    def place_and_term(self, verdict: str, effects: list[EffectEstimate]) -> tuple[Where, MissingTerm | None]:
        """Where the gap lies and the shape of what is missing there, as far as there is time."""
        place, term = Where(None, None), None
        with self.answered("the place of the gap"), time_until(self.moment(1.0)):
            if time_left() > 0.0:
                place = self.where(verdict, effects)
            if verdict in ("partial", "unknown") and self.access.places is not None and place.location is not None:
                term = self.access.channels.missing_term(place.location, str(place.kind))
                term = replace(term, law=self.found.law)
        return place, term

    def budget(self) -> Table:
        """Shares of the gap's power."""
        found, shrink = self.found, self.found.shrink
        if shrink is None or not shrink.measurable:
            return EMPTY
        names = [name_of(effect) for effect in self.final.effects]
        return budget_of(names, found.parts.shares, found.parts.retuning, shrink, self.access.beside, found.law)

    def remainder(self) -> Remainder:
        """What is left beside everything that is named."""
        found, shrink = self.found, self.found.shrink
        if shrink is None or self.access.places is None:
            return NOTHING_KNOWN
        over_noise = self.access.over_noise(self.final, found.retuned)
        return remainder_of(shrink, share_left(shrink), over_noise, self.access.beside)

    def from_run_to_run(self) -> list[str]:
        """Whether one cause has another size in every run: said, since a name has one size."""
        whole = len(self.labels) == len(self.problem.record.starts)
        with self.answered("whether the gap differs from run to run"):
            found = run_to_run(self.search, self.carried()) if whole else None
            return [] if found is None else [differs(found, self.labels)]
        return []

    def nearest_name(self) -> list[str]:
        """Which effect is the most like the law that has no name, or closes more than it."""
        law = self.found.law
        if self.found.nearer is not None:
            rejected, closed = self.found.nearer
            by_law = self.found.shrink.fraction_law if self.found.shrink is not None else float("nan")
            return [
                _notes.nearer(rejected.effects[0], list(map(float, rejected.candidate.theta_of(0))), closed, by_law)
            ]
        one = None if law is None or self.final.effects else nearest_name(self.search, law)
        if one is None:
            return []
        left = float(np.sqrt(one.fit.cost / self.search.gap_cost))
        return [_notes.nearest(one.effects[0], list(map(float, one.theta_of(0))), left)]

    def notes(self, verdict: str) -> list[str]:
        """What a careful reader should know."""
        found, final, problem = self.found, self.final, self.problem
        notes = [
            *_notes.interruption(self.complete, self.time_limit, list(self.cut)),
            *_notes.failed_stages(self.failed),
        ]
        if found.uncertified:
            notes.append(found.uncertified)
        notes += notes_on_names(
            [candidate.effects for candidate in found.finals], final.effects, found.held, self.labels
        )
        if verdict == "none" and found.shrink is not None:
            notes += _notes.on_none(found.shrink)
        notes += self.nearest_name() if verdict == "unknown" else []
        notes += _notes.not_shown(self.search.not_shown(final.candidate)) if verdict == "unknown" else []
        notes += self.access.notes(final, verdict)
        notes += self.from_run_to_run() if verdict != "none" else []
        notes += [
            *_notes.at_a_bound(self.retuned()),
            *_notes.lost_candidates(list(self.search.lost), self.search.never_fitted()),
        ]
        wrong = [i for i, effect in enumerate(final.effects) if constant_in_time(effect)]
        errors = {str(final.effects[i].location): float(final.candidate.theta_of(i)[0]) for i in wrong}
        notes += _notes.changed_signs(problem.plant.params, errors)
        loop = closed_loop(problem.record, final.fit.y, problem.plant.inputs)
        if loop is not None and final.left < NEARLY_WHITE:  # what is left must be noise, not the gap itself
            notes.append(LOOP.format(name=loop))
        return [*notes, *_notes.of_the_inputs(problem.plant.inputs, problem.record.u)]


#: Shares of the time as on recordings of a thousand samples. The search may take most of a time limit, for a name comes first;
#: what judges it keeps the rest.
STAGES = (
    Stage("null", DiagnosisPipeline.fit_null, "the simulator alone", 0.05, np.inf),
    Stage("names", DiagnosisPipeline.look_for_names, "", 0.45, 0.5),
    Stage("record", DiagnosisPipeline.look_at_the_record, "", 0.02, 0.6),
    Stage("law beside the names", DiagnosisPipeline.weigh_names, "", 0.18, 0.75),
    Stage("re-tuning", DiagnosisPipeline.ask_whether_retuning_counts),
    Stage("equivalents", DiagnosisPipeline.find_equivalents, "what these data cannot tell apart", 0.1, 0.82),
    Stage("held-out runs", DiagnosisPipeline.leave_runs_out, "how far the gap shrinks on runs left out", 0.09, 0.9),
    Stage("what is left", DiagnosisPipeline.look_at_what_is_left, "what is left", 0.05, 0.94),
    Stage("certificate", DiagnosisPipeline.certify),
    Stage("shares and intervals", DiagnosisPipeline.share_the_gap, "shares and intervals", 0.01),
    Stage("next experiment", DiagnosisPipeline.suggest_an_experiment, "the next experiment", 0.04),
    Stage("law", DiagnosisPipeline.look_for_a_law, "a formula for what no name explains", 0.1, 0.98),
)
