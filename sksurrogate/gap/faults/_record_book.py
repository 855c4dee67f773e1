"""The record as it came, the faults that were found in it, and the record without them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from sksurrogate.gap.faults._corrections import BaseFault, Names, NoisyInput
from sksurrogate.gap.faults._fault_left import Alternative, fault_left, tone_left
from sksurrogate.gap.faults._input_timing import MOST_SINGLES, JoinedInputs, input_timing
from sksurrogate.gap.faults._wrong_readings import outlying_beside, wrong_readings
from sksurrogate.gap.fit._backend import BaseCandidate
from sksurrogate.gap.fit._closeness import AT_THE_NOISE, SETTLED
from sksurrogate.gap.fit._evidence import Evidence
from sksurrogate.gap.results._data_faults import NO_FAULTS, DataFaults
from sksurrogate.gap.search._base import BaseSearch
from sksurrogate.gap.unnamed._law_left import LawLeft
from sksurrogate.kernels.record import Record
from sksurrogate.physics._simulator import Plant
from sksurrogate.runs import Runs

#: Faults of runs that are taken out one after another.
MOST_ROUNDS = 4


@dataclass(frozen=True, eq=False)
class RecordBook:
    """A record with its faults."""

    raw: Record  #: As it came
    names: Names
    faults: tuple[BaseFault, ...] = ()  #: In the order in which they are taken out
    earlier: RecordBook | None = None  #: Before the last fault was found
    left: float = np.inf  #: RMS over the noise that the diagnosis left with that one
    score: float = -np.inf  #: What the names had with that one, where the fault is one of likelihood only
    closed: bool = False  #: Whether no further fault is looked for

    @cached_property
    def record(self) -> Record:
        """Without the faults."""
        return self.versions[-1]

    @cached_property
    def versions(self) -> list[Record]:
        """As it came, without the first fault, without the first two, ..."""
        out = [self.raw]
        for fault in self.faults:
            out.append(fault.corrected(out[-1]))
        return out

    def described(self, null: BaseCandidate, rows: np.ndarray) -> DataFaults:
        """For the report; shares by what the simulator alone misses in the versions of the record.

        ``null``: the simulator alone, fitted to the record without faults.
        ``rows``: rows of the record that it was fitted to.
        """
        spread, own = self.record.spread, null.problem.record
        fitted = own.y - null.residual
        fitted = fitted if own.known is None else np.where(own.known, fitted, null.fit.y)
        power = []
        for version in self.versions:
            part = version.rows(rows, own.starts)
            power.append(float(np.sum((part.residual(fitted) / spread[:, None]) ** 2)))
        gap = power[0] - len(rows) * float(np.sum((null.problem.sd / spread) ** 2))
        shares = [float(np.clip(drop / gap, 0.0, 1.0)) if gap > 0 else np.nan for drop in -np.diff(power)]
        return DataFaults(
            tuple(fault.described(self.raw, self.names, share) for fault, share in zip(self.faults, shares))
        )

    def with_fault(self, fault: BaseFault, left: float, score: float = -np.inf) -> RecordBook:
        """With one more, after a diagnosis that left so much without it, or had that score."""
        known = {one.key: one for one in self.faults}
        known[fault.key] = known[fault.key].and_also(fault) if fault.key in known else fault
        return replace(self, faults=tuple(known.values()), earlier=self, left=left, score=score)

    def with_next_fault(
        self,
        search: BaseSearch[Any],
        rows: np.ndarray,
        law_left: Callable[[Any], LawLeft | None],
        of_the_gap: LawLeft | None = None,
    ) -> RecordBook:
        """With the likeliest fault on top of what was named, or of nothing; itself where none is the reason of what is left.

        ``search``: after it has named effects.
        ``rows``: rows of the record that it saw.
        ``law_left``: the likeliest law beside what was named: a fault must gain more.
        ``of_the_gap``: the law that explains the gap alone, where one does: another timing of the inputs must leave as little.
        """
        final = search.standing
        if self.earlier is not None and (final.left > self.left or search.score(final.candidate) < self.score):
            return replace(self.earlier, closed=True)  # in the record as it came the names leave less, or are likelier
        if self.closed or self.depth >= MOST_ROUNDS:
            return self
        if final.effects or final.left > AT_THE_NOISE:
            timing = input_timing(search, len(self.raw.starts), np.inf if of_the_gap is None else of_the_gap.left)
            if isinstance(timing, JoinedInputs):  # their noise is another one, in whose units the names may leave more
                return self.with_fault(timing, np.inf, search.score(final.candidate))
            if timing is not None:
                return self.with_fault(timing, SETTLED)  # a shift is exact: with it the names come to the noise
        odd = outlying_beside(final, search.fitted_null.candidate)
        if odd is not None:
            return self.with_fault(replace(odd, rows=rows[odd.rows]), np.inf)
        if final.left < AT_THE_NOISE or search.fitted_null.left < AT_THE_NOISE:
            near = final if final.left < AT_THE_NOISE else search.fitted_null
            hum = tone_left(near, self.raw.run_of_row[rows])
            return self if hum is None else self.with_fault(hum, np.inf)

        def with_effect() -> Alternative:
            law, score = law_left(final), search.score(final.candidate)
            if law is None:
                return Alternative(score, final.left)
            return Alternative(score + 0.5 * max(law.gain, 0.0), law.left)

        fault = fault_left(_bases(search, final), self.raw.run_of_row[rows], search, with_effect)
        if fault is None:
            return self
        if isinstance(fault, NoisyInput) and fault.slow is not None:  # it stays in the record
            return self.with_fault(fault, np.inf, search.score(final.candidate))
        return self.with_fault(fault, final.left)

    @property
    def noisy_inputs(self) -> set[str]:
        """Inputs whose noise stays in the record and is the gap."""
        noisy = [fault for fault in self.faults if isinstance(fault, NoisyInput)]
        return {self.names.inputs[one.input] for one in noisy if one.slow is not None and one.slow.is_the_gap}

    @property
    def depth(self) -> int:
        """Rounds that led to this book."""
        return 0 if self.earlier is None else 1 + self.earlier.depth


def _bases(search: BaseSearch[Any], final: Evidence) -> list[Evidence]:
    """What stands, the simulator alone, and the best single effects where what stands is far from the noise."""
    out = {final.candidate: final, search.fitted_null.candidate: search.fitted_null}
    singles = search.first_round if final.left > SETTLED else []
    for candidate in [*singles[:MOST_SINGLES], *sorted(singles, key=lambda one: one.fit.cost)[:MOST_SINGLES]]:
        out.setdefault(candidate, search.judged.get(candidate, Evidence(candidate, search.fitted_null.noise, -np.inf)))
    return list(out.values())


def record_book(plant: Plant, runs: Runs, whole: Record) -> RecordBook:
    """The record with readings that are wrong by themselves."""
    names = Names(
        plant.inputs, plant.outputs, [run.label for run in runs], np.array([run.start for run in runs], dtype=int)
    )

    def expected() -> np.ndarray | None:
        """Outputs of the simulator alone; None where it gives none."""
        try:
            with np.errstate(all="ignore"):
                found = [np.asarray(plant.simulator.simulate(run.X), dtype=float) for run in runs]
            return np.concatenate([y.reshape(len(run), -1) for y, run in zip(found, runs)]).T
        except Exception:  # a simulator may raise anything here; the diagnosis asks again, and says what it raised
            return None

    return RecordBook(whole, names, tuple(wrong_readings(whole, expected)))


def faults_of(book: RecordBook | None, null: BaseCandidate, rows: np.ndarray) -> DataFaults:
    """For the report; none where nothing was looked at."""
    return book.described(null, rows) if book is not None and book.faults else NO_FAULTS
