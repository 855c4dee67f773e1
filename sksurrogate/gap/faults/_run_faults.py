"""Faults that act on whole runs: a zero, a scale, a tone or a clock that differs from run to run."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sksurrogate.gap.faults._correction import BaseFault, Names, masked
from sksurrogate.gap.results._data_faults import DataFault
from sksurrogate.kernels.record import Record

__all__ = ["Gains", "Hum", "Offsets", "Shifts"]


def _of(names: Names, values: np.ndarray, scale: float = 1.0) -> dict[Any, float]:
    """Values of the runs that have one, by their labels."""
    return {names.labels[int(r)]: float(scale * values[r]) for r in np.flatnonzero(values)}


@dataclass(frozen=True, eq=False)
class Offsets(BaseFault):
    """The zero of one output differs from run to run.

    Attributes
    ----------
    output : int
    values : ndarray (n_runs,)
        Measured less true.
    """

    output: int
    values: np.ndarray

    @property
    def key(self) -> tuple[Any, ...]:
        return ("offset", self.output)

    @property
    def n_parameters(self) -> int:
        return int(np.count_nonzero(self.values))

    def and_also(self, other: Offsets) -> Offsets:
        """With what another one found on top."""
        return replace(self, values=self.values + other.values)

    def corrected(self, record: Record) -> Record:
        """Without the offsets."""
        y = record.y.copy()
        y[self.output] -= self.values[record.run_of_row]
        return replace(record, y=y)

    def described(self, record: Record, names: Names, share: float) -> DataFault:
        """With one value a run."""
        values = _of(names, self.values)
        size = float(np.max(np.abs(self.values)))
        remedy = "Take the zero of the sensor before every run, or subtract these values."
        where = (names.outputs[self.output], "output", tuple(values), ())
        return DataFault("offset", *where, size, share, values, "sensor_bias", remedy)


@dataclass(frozen=True, eq=False)
class Gains(BaseFault):
    """The scale of one output differs from run to run.

    Attributes
    ----------
    output : int
    values : ndarray (n_runs,)
        Relative errors: measured = (1 + value) true.
    """

    output: int
    values: np.ndarray

    @property
    def key(self) -> tuple[Any, ...]:
        return ("gain", self.output)

    @property
    def n_parameters(self) -> int:
        return int(np.count_nonzero(self.values))

    def and_also(self, other: Gains) -> Gains:
        """With what another one found on top."""
        return replace(self, values=(1.0 + self.values) * (1.0 + other.values) - 1.0)

    def corrected(self, record: Record) -> Record:
        """Every run by its own scale."""
        y = record.y.copy()
        y[self.output] /= 1.0 + self.values[record.run_of_row]
        return replace(record, y=y)

    def described(self, record: Record, names: Names, share: float) -> DataFault:
        """With one value a run."""
        values = _of(names, self.values)
        size = float(np.max(np.abs(self.values)))
        remedy = "Calibrate the sensor for every run, or divide by 1 + these values."
        where = (names.outputs[self.output], "output", tuple(values), ())
        return DataFault("gain", *where, size, share, values, "sensor_gain", remedy)


@dataclass(frozen=True, eq=False)
class Hum(BaseFault):
    """A tone on one output, with a phase of its own in every run.

    Attributes
    ----------
    output : int
    angular_frequency : float
        Per unit of time.
    weights : ndarray (n_runs, 2)
        Of sine and cosine of the time since the start of the run.
    """

    output: int
    angular_frequency: float
    weights: np.ndarray

    @property
    def key(self) -> tuple[Any, ...]:
        return ("hum", self.output, self.angular_frequency)

    @property
    def n_parameters(self) -> int:
        return self.weights.size + 1

    def and_also(self, other: Hum) -> Hum:
        """With what another one of this frequency found on top."""
        return replace(self, weights=self.weights + other.weights)

    def corrected(self, record: Record) -> Record:
        """Without the tone."""
        y, run = record.y.copy(), record.run_of_row
        phase = self.angular_frequency * (record.t - record.t[record.starts[run]])
        y[self.output] -= self.weights[run, 0] * np.sin(phase) + self.weights[run, 1] * np.cos(phase)
        return replace(record, y=y)

    def described(self, record: Record, names: Names, share: float) -> DataFault:
        """With the amplitude of every run."""
        amplitude = np.hypot(*self.weights.T)
        values = _of(names, amplitude)
        remedy = (
            f"The tone has {self.angular_frequency / (2 * np.pi):.4g} cycles per unit of time: look for mains or a "
            "motor near the cable, and for aliasing; a notch filter removes it."
        )
        where = (names.outputs[self.output], "output", tuple(values), ())
        return DataFault("hum", *where, float(np.max(amplitude)), share, values, "periodic_disturbance", remedy)


@dataclass(frozen=True, eq=False)
class Shifts(BaseFault):
    """All outputs of a run come some samples later than its inputs say, or earlier.

    Attributes
    ----------
    values : ndarray of int (n_runs,)
        Samples by which the outputs come late.
    """

    values: np.ndarray

    @property
    def key(self) -> tuple[Any, ...]:
        return ("shift",)

    @property
    def n_parameters(self) -> int:
        return int(np.count_nonzero(self.values))

    def and_also(self, other: Shifts) -> Shifts:
        """With what another one found on top."""
        return replace(self, values=self.values + other.values)

    def corrected(self, record: Record) -> Record:
        """Outputs moved back; what is then missing at an end of the run was not measured."""
        rows, wrong = np.arange(record.n_samples), np.zeros(record.y.shape, bool)
        edges = np.r_[record.starts, record.n_samples]
        for a, b, k in zip(edges[:-1], edges[1:], self.values):
            source = np.arange(a, b) + int(k)
            wrong[:, a:b] = (source < a) | (source >= b)
            rows[a:b] = np.clip(source, a, b - 1)
        known = None if record.known is None else record.known[:, rows]
        return masked(replace(record, y=record.y[:, rows], known=known), wrong)

    def described(self, record: Record, names: Names, share: float) -> DataFault:
        """With the samples of every run."""
        values = _of(names, self.values)
        size = float(np.max(np.abs(self.values)))
        remedy = "Give inputs and outputs one clock; shift the outputs of these runs by these samples."
        return DataFault("shift", None, "output", tuple(values), (), size, share, values, "sensor_delay", remedy)
