"""Faults that act on whole runs: a zero, a scale, a tone or a clock that differs from run to run."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from sksurrogate.gap.faults._correction import BaseFault, Names, masked
from sksurrogate.gap.results._data_faults import DataFault
from sksurrogate.kernels.record import Record

__all__ = ["Gains", "Hum", "Offsets", "Shifts"]


@dataclass(frozen=True, eq=False)
class _OfRuns(BaseFault):
    """What differs from run to run, at one output or at all of them (None)."""

    kind: ClassVar[str]
    effect: ClassVar[str]
    remedy: ClassVar[str]

    output: int | None
    values: np.ndarray  #: (n_runs, ...): of every run; 0 in runs without the fault

    @property
    def key(self) -> tuple[Any, ...]:
        return (self.kind, self.output)

    @property
    def of_runs(self) -> np.ndarray:
        """One number a run (n_runs,)."""
        return self.values

    def and_also(self, other: Any) -> BaseFault:
        return replace(self, values=self.values + other.values)

    def described(self, record: Record, names: Names, share: float) -> DataFault:
        """With one value a run."""
        size = self.of_runs
        values = {names.labels[int(r)]: float(size[r]) for r in np.flatnonzero(size)}
        where = (None if self.output is None else names.outputs[self.output], "output", tuple(values), ())
        largest = float(np.max(np.abs(size)))
        return DataFault(self.kind, *where, largest, share, values, self.effect, self.remedy.format(fault=self))


@dataclass(frozen=True, eq=False)
class Offsets(_OfRuns):
    """The zero of one output differs from run to run: ``values`` are measured less true."""

    kind, effect = "offset", "sensor_bias"
    remedy = "Take the zero of the sensor before every run, or subtract these values."

    def corrected(self, record: Record) -> Record:
        """Without the offsets."""
        y = record.y.copy()
        y[self.output] -= self.values[record.run_of_row]
        return replace(record, y=y)


@dataclass(frozen=True, eq=False)
class Gains(_OfRuns):
    """The scale of one output differs from run to run: measured = (1 + value) true."""

    kind, effect = "gain", "sensor_gain"
    remedy = "Calibrate the sensor for every run, or divide by 1 + these values."

    def and_also(self, other: Any) -> BaseFault:
        return replace(self, values=(1.0 + self.values) * (1.0 + other.values) - 1.0)

    def corrected(self, record: Record) -> Record:
        """Every run by its own scale."""
        y = record.y.copy()
        y[self.output] /= 1.0 + self.values[record.run_of_row]
        return replace(record, y=y)


@dataclass(frozen=True, eq=False)
class Hum(_OfRuns):
    """A tone on one output, with a phase of its own in every run.

    Attributes
    ----------
    values : ndarray (n_runs, 2)
        Weights of sine and cosine of the time since the start of the run.
    angular_frequency : float
        Per unit of time.
    """

    angular_frequency: float

    kind, effect = "hum", "periodic_disturbance"
    remedy = (
        "The tone has {fault.cycles:.4g} cycles per unit of time: look for mains or a motor near the cable, and for "
        "aliasing; a notch filter removes it."
    )

    @property
    def key(self) -> tuple[Any, ...]:
        return (self.kind, self.output, self.angular_frequency)

    @property
    def of_runs(self) -> np.ndarray:
        """Amplitude in every run."""
        return np.asarray(np.hypot(*self.values.T))

    @property
    def cycles(self) -> float:
        """Per unit of time."""
        return self.angular_frequency / (2 * np.pi)

    def corrected(self, record: Record) -> Record:
        """Without the tone."""
        y, run = record.y.copy(), record.run_of_row
        phase = self.angular_frequency * (record.t - record.t[record.starts[run]])
        y[self.output] -= self.values[run, 0] * np.sin(phase) + self.values[run, 1] * np.cos(phase)
        return replace(record, y=y)


@dataclass(frozen=True, eq=False)
class Shifts(_OfRuns):
    """All outputs of a run come some samples later than its inputs say, or earlier: ``values`` are these samples."""

    kind, effect = "shift", "sensor_delay"
    remedy = "Give inputs and outputs one clock; shift the outputs of these runs by these samples."

    def corrected(self, record: Record) -> Record:
        """Outputs moved back; what is then missing at an end of the run was not measured."""
        rows, wrong = np.arange(record.n_samples), np.zeros(record.y.shape, bool)
        for (a, b), k in zip(record.spans, self.values):
            source = np.arange(a, b) + int(k)
            wrong[:, a:b] = (source < a) | (source >= b)
            rows[a:b] = np.clip(source, a, b - 1)
        known = None if record.known is None else record.known[:, rows]
        return masked(replace(record, y=record.y[:, rows], known=known), wrong)
