"""What a diagnosis knows so far, and what follows from it: how far the gap shrinks, the parts of each effect, the verdict."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any, Generic, Protocol

import numpy as np

from sksurrogate._parallel._worker_process import PendingAnswer
from sksurrogate.gap.decide._access import BaseAccess
from sksurrogate.gap.decide._equivalence import probabilities
from sksurrogate.gap.decide._held_out import HeldOut, measure, shares
from sksurrogate.gap.decide._intervals import intervals, is_sized
from sksurrogate.gap.decide._law_certificate import certified_law, closes_clearly_more
from sksurrogate.gap.decide._partial_results import PartialResults, Parts, WithIntervals
from sksurrogate.gap.decide._posterior import Posterior
from sksurrogate.gap.decide._retuning import retuned_table
from sksurrogate.gap.decide._rules import DecisionFeatures, decide, share_left
from sksurrogate.gap.faults._record_book import RecordBook
from sksurrogate.gap.fit._evidence import C, Evidence
from sksurrogate.gap.results._next_experiment import NextExperiment
from sksurrogate.gap.results._reasons import UNDECIDED, Reasons
from sksurrogate.gap.results._shrink import Shrink
from sksurrogate.gap.results._table import Table
from sksurrogate.gap.search._base import BaseSearch


class Settings(Protocol):
    """Parameters of a diagnoser, as :class:`~sksurrogate.gap.GapDiagnoser` describes them."""

    simulator: Any
    effects: Any
    exclude: Any
    plausible: Any
    clock_offset: float
    tolerance: float
    correction: Any
    include_law: bool
    time_limit: float | None
    n_jobs: int | None


class DiagnosisState(Generic[C]):
    """What the stages share.

    ``settings``: of the diagnoser. A stage that is not over at its share of the ``time_limit`` is cut, and the next ones answer what
        they can.
    ``access``: the questions that only some kinds of access answer.
    ``labels``: of the runs.
    ``rows``: rows of the whole record that the search sees.
    ``untestable``: effects that were asked for and cannot be tested.
    """

    #: Labels of the runs in which what was found acts; None for all.
    acts_in: tuple[Any, ...] | None = None

    def __init__(
        self,
        settings: Settings,
        search: BaseSearch[C],
        access: BaseAccess[C],
        labels: Sequence[Any],
        rows: np.ndarray,
        untestable: Sequence[str],
    ):
        self.problem, self.search, self.access = search.problem, search, access
        self.labels, self.rows = labels, rows
        self.learner, self.untestable = settings.correction, tuple(untestable)
        self.posterior = Posterior((), None)
        self.found = PartialResults()
        self.complete, self.time_limit, self.cut = True, settings.time_limit, dict[str, None]()
        self.failed: dict[str, str] = {}
        self.started_at, self.include_law = time.perf_counter(), bool(settings.include_law)
        self.experiment: PendingAnswer[NextExperiment | None] | None = None
        self.book: RecordBook | None = None
        self.asked = 0  #: Stages that are over

    @property
    def final(self) -> Evidence:
        """What stands."""
        return self.search.standing

    @property
    def null(self) -> Evidence:
        """No effect."""
        return self.search.fitted_null

    @property
    def noisy_inputs(self) -> set[str]:
        """Inputs the noise of whose measurement is the gap."""
        return set() if self.book is None else self.book.noisy_inputs

    def moment(self, share: float) -> float:
        """When a share of the time limit is over, on the clock of ``time.perf_counter``; never without a limit."""
        return self.started_at + share * (self.time_limit or np.inf)

    def measure(self) -> None:
        """How far the gap shrinks on runs left out."""
        assert self.found.held is not None
        self.found.shrink = self.measured(self.found.held)

    def measured(self, held: HeldOut) -> Shrink:
        """How far the gap shrinks in these free runs."""
        return measure(held, self.floor(), self.problem.plant.outputs, self.access.seed)

    def floor(self) -> np.ndarray:
        """Sensor noise of what stands, with its law where one is certified, and what noise on inputs moves the outputs by."""
        law, beside = self.found.law, self.found.beside
        stands: Evidence = self.final
        if law is not None and law.certified and beside is not None:
            stands = beside.law.found
        return np.hypot(self.access.sensor_noise(stands), self.problem.record.disturbance)

    def share_the_gap(self) -> None:
        """What of the gap each effect closes, how probable it is, and the intervals of all parameters."""
        found, final = self.found, self.final
        if found.shrink is None:
            return
        if final.effects:
            own, retuning = shares(final.candidate, found.shrink.fraction_power)
            classes = [found.class_of(i) for i in range(len(final.effects))]
            chances = probabilities(self.search, final.candidate, classes, self.posterior)
            found.parts = Parts(tuple(own), retuning, tuple(chances))
        else:
            found.parts = Parts(retuning=found.shrink.fraction_power if found.retuned else 0.0)
            self.access.weigh_none()
        if final.effects or self.problem.free:
            larger = self.access.fitted_on_more(final)
            found.values = WithIntervals(larger, *intervals(larger))

    def retuned(self) -> Table:
        """Free parameters with their intervals; one that depends on a signal is told there, and is here as it was."""
        values, theta = self.found.values, self.final.fit.theta
        final = self.final if values is None else values.fitted
        low, high = (theta, theta) if values is None else (values.low, values.high)
        own = slice(final.candidate.n_parameters, None)
        least, most = self.problem.bounds(final.effects)
        moved = np.isin(self.problem.free, list(self.problem.known.held(final.effects)), invert=True)
        ends = *(moved * end[own] for end in (final.fit.theta, low, high)), (least[own], most[own])
        return retuned_table(self.problem.plant.params, self.problem.free, *ends)

    def withdraw(self, why: str) -> HeldOut:
        """The names are withdrawn: the null stands. Its free runs on runs left out."""
        found, null, held = self.found, self.null, self.found.held
        assert held is not None
        found.uncertified = why
        self.search.final, found.classes, found.finals = null, [], []
        found.parts, found.values, found.experiment = Parts(), None, None
        self.access.withdraw(null)
        after = held.retuned if self.problem.free else held.before
        found.held = HeldOut(held.record, held.before, after, held.retuned, held.corrected)
        self.measure()
        return found.held

    def decided(self) -> tuple[str, Reasons]:
        """The verdict, and the rule that gave it."""
        features = self.features()
        return ("unknown", UNDECIDED) if features is None else decide(features)

    def features(self) -> DecisionFeatures | None:
        """What the verdict is decided on; None where not all of it is known."""
        found, final, shrink, access = self.found, self.final, self.found.shrink, self.access
        if shrink is None or access.places is None or (final.effects and not found.parts.probabilities):
            return None
        law, rounding = access.beside, access.rounding(final)
        return DecisionFeatures(
            names=len(final.effects),
            probability=min(found.parts.probabilities, default=1.0),
            sized=found.values is None or is_sized(final.effects, found.values.low, found.values.high),
            shown=self.search.plausible(final.candidate),
            retuned=found.retuned,
            share_left=share_left(shrink),
            left=access.over_noise(final, found.retuned),
            lawful=law.size if law is not None else 0.0,
            after=shrink.after,
            error=shrink.before if np.isfinite(shrink.before) else np.inf,
            curve=law.gain if law is not None else -np.inf,
            curve_moved=law.deviation if law is not None else 0.0,
            correction_closes_more=closes_clearly_more(shrink.fraction_correction, shrink.fraction),
            repeats=len(self.labels) < 2 or not np.isfinite(shrink.fraction_law) or certified_law(shrink),
            rounding=rounding.share if rounding is not None else 0.0,
            noisy_input=bool(self.noisy_inputs),
            other_unit=bool(access.other_unit.sentence),
            at_bound=any(row["at_bound"] for row in self.retuned()),
            tolerance=self.search.tolerance,
        )
