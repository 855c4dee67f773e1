"""The record as it came, the faults that were found in it, and the record without them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from sksurrogate.gap.faults._correction import BaseFault, Names
from sksurrogate.gap.faults._readings import wrong_readings
from sksurrogate.gap.fit._backend import BaseCandidate
from sksurrogate.gap.results._data_faults import DataFaults
from sksurrogate.kernels.record import Record
from sksurrogate.physics._simulator import Plant
from sksurrogate.runs import Runs

__all__ = ["RecordBook", "first_look"]


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
    """

    raw: Record
    names: Names
    faults: tuple[BaseFault, ...] = ()

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

    def with_faults(self, faults: Sequence[BaseFault]) -> RecordBook:
        """With other faults."""
        return replace(self, faults=tuple(faults))


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
