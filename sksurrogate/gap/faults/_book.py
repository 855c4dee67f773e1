"""The record as it came, the faults that were found in it, and the record without them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from sksurrogate.gap.faults._correction import BaseFault, Names
from sksurrogate.gap.faults._look import fault_left
from sksurrogate.gap.faults._readings import wrong_readings
from sksurrogate.gap.fit._backend import BaseCandidate
from sksurrogate.gap.fit._evidence import Evidence
from sksurrogate.gap.results._data_faults import DataFaults
from sksurrogate.kernels.record import Record
from sksurrogate.physics._simulator import Plant
from sksurrogate.runs import Runs

__all__ = ["RecordBook", "first_look"]

#: Faults of runs that are taken out one after another.
MOST_ROUNDS = 4


@dataclass(frozen=True, eq=False)
class RecordBook:
    """A record with its faults.

    Attributes
    ----------
    raw : Record
        As it came.
    names : Names
    faults : tuple of BaseFault
        In the order in which they are taken out.
    earlier : RecordBook or None
        Before the last fault was found.
    left : float
        RMS over the noise that the diagnosis left with that one.
    closed : bool
        Whether no further fault is looked for.
    """

    raw: Record
    names: Names
    faults: tuple[BaseFault, ...] = ()
    earlier: RecordBook | None = None
    left: float = np.inf
    closed: bool = False

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

        Parameters
        ----------
        null : BaseCandidate
            The simulator alone, fitted to the record without faults.
        rows : ndarray of int
            Rows of the record that it was fitted to.
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

    def with_fault(self, fault: BaseFault, left: float) -> RecordBook:
        """With one more, after a diagnosis that left so much without it."""
        known = {one.key: one for one in self.faults}
        known[fault.key] = known[fault.key].and_also(fault) if fault.key in known else fault
        return replace(self, faults=tuple(known.values()), earlier=self, left=left)

    def looked_at(self, bases: Sequence[Evidence], rows: np.ndarray, score: float) -> RecordBook:
        """With the likeliest fault on top of one of several models; itself where none is the reason of what they leave.

        Parameters
        ----------
        bases : sequence of Evidence
            What was named first.
        rows : ndarray of int
            Rows of the record that they were fitted to.
        score : float
            What a fault must reach: the score of what was named beside a free curve.
        """
        if self.earlier is not None and bases[0].left > self.left:
            return replace(self.earlier, closed=True)  # names find less without the fault than with it
        if self.closed or self.depth >= MOST_ROUNDS:
            return self
        found = fault_left(bases, self.raw.run_of_row[rows])
        if found is None or found.score < score:
            return self
        return self.with_fault(found.fault, bases[0].left)

    @property
    def depth(self) -> int:
        """Rounds that led to this book."""
        return 0 if self.earlier is None else 1 + self.earlier.depth


def first_look(plant: Plant, runs: Runs, whole: Record) -> RecordBook:
    """The record with readings that are wrong by themselves."""
    names = Names(
        plant.inputs, plant.outputs, [run.label for run in runs], np.array([run.start for run in runs], dtype=int)
    )

    def expected() -> np.ndarray | None:
        """Outputs of the simulator alone; None where it gives none."""
        try:
            with np.errstate(all="ignore"):
                return np.concatenate([_outputs(plant.simulator, run) for run in runs]).T
        except Exception:  # a simulator may raise anything here; the diagnosis asks again, and says what it raised
            return None

    return RecordBook(whole, names, tuple(wrong_readings(whole, expected)))


def _outputs(simulator: Any, run: Any) -> np.ndarray:
    """Outputs (n_samples, n_outputs) along one run."""
    return np.asarray(simulator.simulate(run.X), dtype=float).reshape(len(run), -1)
