"""Faults of a record as corrections of it, each of which gives the record without the fault: wrong readings, noisy inputs, runs."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, ClassVar

import numpy as np
from scipy.ndimage import median_filter

from sksurrogate.gap.fit._backend import BaseCandidate
from sksurrogate.gap.fit._closeness import BEYOND_CHANCE
from sksurrogate.gap.results._data_faults import DataFault
from sksurrogate.kernels.noisy_signals import held_levels, smooth_path
from sksurrogate.kernels.record import Record, bridged


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

    def log_stretch(self, record: Record) -> float:
        """Log of what the correction stretches the readings by, all together: a density after it is one before it divided by this factor."""
        return 0.0

    @abstractmethod
    def described(self, record: Record, names: Names, share: float) -> DataFault:
        """For the report."""

    @property
    @abstractmethod
    def key(self) -> tuple[Any, ...]:
        """Faults of one key are one fault."""

    @property
    def differs(self) -> bool:
        """Whether it is one of some runs: what all runs share is an effect, or part of one."""
        return True


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


#: What an input without its noise may be: (n_samples,) of one run to the same. The last is a running median of five rows.
SMOOTHINGS: tuple[Callable[[np.ndarray], np.ndarray], ...] = (
    held_levels,
    smooth_path,
    partial(median_filter, size=5, mode="nearest"),
)


@dataclass(frozen=True, eq=False)
class SlowNoise:
    """What such noise as an input has moves the outputs by: slow beside the plant it cannot be distinguished from the input."""

    share: float  #: Of the power of the gap that it makes up on average
    spread: float  #: Standard deviation of this share from one draw of the noise to another
    moved: np.ndarray  #: (n_outputs,): RMS

    @property
    def is_the_gap(self) -> bool:
        """Whether the gap is no larger than such noise makes one."""
        return self.share + BEYOND_CHANCE * self.spread > 1.0

    @property
    def is_possible(self) -> bool:
        """Whether such noise would not make a larger gap than there is."""
        return self.share - BEYOND_CHANCE * self.spread < 1.0


@dataclass(frozen=True, eq=False)
class NoisyInput(BaseFault):
    """The measurement of an input is noisy; the plant got a smoother one."""

    input: int
    way: int  #: Of :data:`SMOOTHINGS`
    removed: float = np.nan  #: Share of the gap that the smoother input removes
    slow: SlowNoise | None = None  #: What stays, where the smoother input does not remove most of the gap

    @property
    def key(self) -> tuple[Any, ...]:
        return ("input_noise", self.input)

    def and_also(self, other: NoisyInput) -> NoisyInput:
        """The latest."""
        return other

    def corrected(self, record: Record) -> Record:
        """With the smoother input."""
        u = record.u.copy()
        for a, b in record.spans:
            u[self.input, a:b] = SMOOTHINGS[self.way](record.u[self.input, a:b])
        stays = record.disturbance if self.slow is None else np.hypot(record.disturbance, self.slow.moved)
        return replace(record.with_inputs(u), disturbance=stays)

    def noisier(self, record: Record, draw: int) -> Record:
        """The record with as much white noise once more on the input."""
        u, rng = record.u.copy(), np.random.default_rng(draw)
        u[self.input] += self.deviation(record) * rng.normal(size=record.n_samples)
        return record.with_inputs(u)

    def deviation(self, record: Record) -> float:
        """Of the noise: no larger than what smoothing removes, nor than what is white in the input."""
        u = record.u[self.input]
        removed = float(np.std(u - self.corrected(record).u[self.input]))
        return min(removed, white_deviation([u[a:b] for a, b in record.spans]))

    def described(self, record: Record, names: Names, share: float) -> DataFault:
        """With the deviation of the noise."""
        size, stays = self.deviation(record), self.slow is not None
        share = self.removed if self.slow is None else min(self.slow.share, 1.0)
        remedy = "Record the input that the actuator is given, or filter its measurement forwards and backwards."
        where = (names.inputs[self.input], "input", tuple(names.labels), ())
        return DataFault("input_noise", *where, size, share, remedy=remedy, taken_out=not stays)


def white_deviation(runs: Sequence[np.ndarray]) -> float:
    """Standard deviation of the white noise on a signal: its increments follow each other with opposite signs, ``E[d_t d_t+1] = - sigma^2``.

    A signal that only moves fast (a walk, steps) has increments that know nothing of each other.

    See Roll (1984), A simple implicit measure of the effective bid-ask spread in an efficient market.

    >>> rng = np.random.default_rng(0)
    >>> slow, noise = np.sin(np.arange(5000) / 100.0), 0.1 * rng.normal(size=5000)
    >>> bool(abs(white_deviation([slow + noise]) - 0.1) < 0.005), bool(white_deviation([np.cumsum(noise)]) < 0.03)
    (True, True)
    """
    steps = [np.diff(run) for run in runs]
    products = np.concatenate([step[1:] * step[:-1] for step in steps])
    return float(np.sqrt(max(-np.mean(products), 0.0))) if len(products) else 0.0


def smoother_inputs(model: BaseCandidate) -> list[tuple[NoisyInput, np.ndarray]]:
    """Every input smoothed in several ways, and what that moves the readings of a model by (n_outputs, n_samples)."""
    record, found = model.problem.record, []
    for i, u in enumerate(record.u):
        for way in range(len(SMOOTHINGS) if np.ptp(u) > 0 else 0):
            fault = NoisyInput(i, way)
            other = model.refitted(fault.corrected(record)) if fault.deviation(record) > 0.0 else None
            if other is not None:
                found.append((fault, other.fit.y - model.fit.y))
    return found


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


class _Calibration(_OfRuns):
    """The zero or the scale of one output, which were another in some runs."""

    @property
    def differs(self) -> bool:
        """Whether runs differ by more than they share."""
        return bool(np.any(self.values == 0.0) or np.std(self.values) > np.abs(np.mean(self.values)))


@dataclass(frozen=True, eq=False)
class Offsets(_Calibration):
    """The zero of one output differs from run to run: ``values`` are measured less true."""

    kind, effect = "offset", "sensor_bias"
    remedy = (
        "Take the zero of the sensor before every run, or subtract these values. Where the plant is linear, a load, or an input "
        "that is off by a constant, of another size in these runs reads the same."
    )

    def corrected(self, record: Record) -> Record:
        """Without the offsets."""
        y = record.y.copy()
        y[self.output] -= self.values[record.recorded_run_of_row]
        return replace(record, y=y)


@dataclass(frozen=True, eq=False)
class Gains(_Calibration):
    """The scale of one output differs from run to run: measured = (1 + value) true."""

    kind, effect = "gain", "sensor_gain"
    remedy = (
        "Calibrate the sensor for every run, or divide by 1 + these values. Where the plant is linear, an input that is "
        "stronger or weaker in these runs reads the same."
    )

    def and_also(self, other: Any) -> BaseFault:
        return replace(self, values=(1.0 + self.values) * (1.0 + other.values) - 1.0)

    def corrected(self, record: Record) -> Record:
        """Every run by its own scale."""
        y = record.y.copy()
        y[self.output] /= 1.0 + self.values[record.recorded_run_of_row]
        return replace(record, y=y)

    def log_stretch(self, record: Record) -> float:
        """Readings that are scaled down come nearer to each other, and to any model."""
        assert self.output is not None
        runs = record.recorded_run_of_row[record.rows_of(self.output)]
        return float(-np.sum(np.log(np.abs(1.0 + self.values[runs]))))


@dataclass(frozen=True, eq=False)
class Hum(_OfRuns):
    """A tone on one output: ``values`` (n_runs, 2) are weights of sine and cosine of the time since the start of the run."""

    angular_frequency: float  #: Per unit of time

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
        y, run = record.y.copy(), record.recorded_run_of_row
        _, first, place = np.unique(run, return_index=True, return_inverse=True)
        phase = self.angular_frequency * (record.t - record.t[first[place]])
        y[self.output] -= self.values[run, 0] * np.sin(phase) + self.values[run, 1] * np.cos(phase)
        return replace(record, y=y)


@dataclass(frozen=True, eq=False)
class Shifts(_OfRuns):
    """All outputs of a run come some samples later than its inputs say, or earlier: ``values`` are these samples."""

    kind, effect = "shift", "sensor_delay"
    remedy = "{fault.way_out}"

    @property
    def way_out(self) -> str:
        """Where the outputs of all runs come equally early, their inputs were written late."""
        rows = -int(self.values.max())
        if rows > 0 and np.all(self.values == -rows):
            return (
                f"The input of a row acts from this row to the next; here the row before has it. Diagnose X[{rows}:] with "
                f"y[:-{rows}] of every run."
            )
        return "Give inputs and outputs one clock; shift the outputs of these runs by these samples."

    def corrected(self, record: Record) -> Record:
        """Outputs moved back; what is then missing at an end of the run was not measured."""
        rows, wrong = np.arange(record.n_samples), np.zeros(record.y.shape, bool)
        for a, b in record.spans:
            source = np.arange(a, b) + int(self.values[record.recorded_run_of_row[a]])
            wrong[:, a:b] = (source < a) | (source >= b)
            rows[a:b] = np.clip(source, a, b - 1)
        known = None if record.known is None else record.known[:, rows]
        return masked(replace(record, y=record.y[:, rows], known=known), wrong)
