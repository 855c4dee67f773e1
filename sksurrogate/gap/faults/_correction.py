"""Faults of a record as corrections of it: each gives the record without the fault."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sksurrogate.gap.results._data_faults import DataFault
from sksurrogate.kernels.record import Record, bridged

__all__ = ["BaseFault", "Names", "WrongReadings", "masked"]


@dataclass(frozen=True)
class Names:
    """What the signals and runs of a record are called."""

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    labels: Sequence[Any]  #: Of the runs
    first_rows: np.ndarray  #: int (n_runs,): row of the user's data at which every run begins

    def user_rows(self, record: Record, rows: np.ndarray) -> tuple[int, ...]:
        """Rows of the user's data."""
        run = record.run_of_row[rows]
        return tuple((self.first_rows[run] + rows - record.starts[run]).tolist())


class BaseFault(ABC):
    """One fault of a record."""

    @abstractmethod
    def corrected(self, record: Record) -> Record:
        """The record without the fault."""

    def and_also(self, other: Any) -> BaseFault:
        """With what another fault of the same key found on top."""
        return self

    @abstractmethod
    def described(self, record: Record, names: Names, share: float) -> DataFault:
        """For the report."""

    @property
    @abstractmethod
    def key(self) -> tuple[Any, ...]:
        """Faults of one key are one fault."""


@dataclass(frozen=True, eq=False)
class WrongReadings(BaseFault):
    """Single readings or stretches of one output that were not measured."""

    kind: str  #: {"spikes", "dropouts", "stuck"}
    output: int
    rows: np.ndarray  #: Of the record
    size: float  #: Largest deviation

    @property
    def key(self) -> tuple[Any, ...]:
        return (self.kind, self.output)

    def and_also(self, other: WrongReadings) -> WrongReadings:
        """With these and those."""
        return replace(self, rows=np.union1d(self.rows, other.rows), size=max(self.size, other.size))

    def corrected(self, record: Record) -> Record:
        """Without these readings."""
        wrong = np.zeros(record.y.shape, bool)
        wrong[self.output, self.rows] = True
        return masked(record, wrong)

    def described(self, record: Record, names: Names, share: float) -> DataFault:
        """With rows and runs."""
        remedy = {
            "spikes": "Look at the wiring; OutlierFilter removes them before the data are used elsewhere.",
            "dropouts": "Set these readings to nan (not measured), and look at the connection.",
            "stuck": "Set these readings to nan (not measured), and look at the sensor and the logger.",
        }[self.kind]
        return DataFault(
            self.kind,
            names.outputs[self.output],
            "output",
            tuple(names.labels[run] for run in np.unique(record.run_of_row[self.rows])),
            names.user_rows(record, self.rows),
            self.size,
            share,
            remedy=remedy,
        )


def masked(record: Record, wrong: np.ndarray) -> Record:
    """A record some of whose readings (n_outputs, n_samples) were not measured."""
    known = ~wrong if record.known is None else record.known & ~wrong
    return replace(record, y=bridged(record.y, known, record.starts), known=known)
