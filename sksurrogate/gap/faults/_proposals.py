"""Faults of runs as columns: to first order, what each would move the readings by."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from sksurrogate.gap.faults._corrections import BaseFault, Gains, Hum, Offsets, Shifts
from sksurrogate.kernels.record import Record
from sksurrogate.kernels.run_columns import RunColumns

#: A tone has this many periods in a run or more: less is a trend.
LEAST_PERIODS = 3.0
#: Parts into which a step of the periodogram is divided where a tone is placed.
FINE_SHIFTS = 40
#: Longest shift that is tried, as a share of the shortest run.
LONGEST_SHIFT = 0.2
#: A shift or a smoother input is there whole, not in part: its column has a weight of one, more or less.
WHOLE = (0.5, 1.7)


@dataclass(frozen=True, eq=False)
class Proposal:
    """A fault of runs beside a model."""

    columns: np.ndarray  #: (n_outputs, n_columns, n_samples): what it adds to the readings, by its weights
    #: The fault at some weights, run by run where they differ from run to run; None where these are not possible
    fault: Callable[[np.ndarray], BaseFault | None]
    extra: int = 0  #: Parameters that were chosen before (a frequency, a number of samples)
    chosen: float = 0.0  #: Price of runs chosen among all, twice the log likelihood
    some: Callable[[np.ndarray], Proposal] | None = None  #: The same in some of its runs, where each has a value
    of: np.ndarray | None = None  #: (n_samples,): number of the run of every row, where weights differ from run to run
    acts: np.ndarray = field(default_factory=lambda: np.zeros(0, int))  #: Numbers of the runs in which it acts

    @property
    def n_weights(self) -> int:
        """Weights."""
        return self.columns.shape[1] * (1 if self.of is None else len(self.acts))

    @property
    def acting(self) -> np.ndarray:
        """The columns in the runs in which it acts, 0 elsewhere."""
        return self.columns if self.of is None else self.columns * np.isin(self.of, self.acts)

    @property
    def own(self) -> RunColumns | None:
        """The same with weights of their own in several runs; None where one weight for each column is all."""
        return None if self.of is None or len(self.acts) == 1 else RunColumns(self.acting, self.of)


def proposals(record: Record, run: np.ndarray, y: np.ndarray, residual: np.ndarray) -> Iterator[Proposal]:
    """All faults of runs, each in one run alone and in every run.

    ``record``: runs, or pieces of them.
    ``run`` (n_samples,): number of the run of every row.
    ``y`` (n_outputs, n_samples): outputs of the model.
    ``residual`` (n_outputs, n_samples): measured less these.
    """
    seen, of = np.unique(run, return_inverse=True)
    if int(run[-1]) > 0:
        for j in range(len(y)):
            for kind, moved in ((Offsets, np.ones(y.shape[1])), (Gains, y[j])):
                columns = np.zeros((len(y), 1, y.shape[1]))
                columns[j] = moved
                for acts in [*np.arange(len(seen))[:, None], np.arange(len(seen))]:
                    yield _by_run(kind, j, columns, seen, of, acts)
    yield from _shifts(record, run, y)
    yield from tones(record, run, residual)


def tones(record: Record, run: np.ndarray, residual: np.ndarray) -> Iterator[Proposal]:
    """The strongest tone on every output."""
    for j in range(len(residual)):
        found = tone(record, residual[j])
        if found is not None:
            yield _hum(record, run, j, found, residual.shape)


def _by_run(
    kind: type[Offsets] | type[Gains], j: int, columns: np.ndarray, seen: np.ndarray, of: np.ndarray, acts: np.ndarray
) -> Proposal:
    """One value for each of some runs, at output j; ``seen`` are the runs that the rows are of."""

    def fault(weights: np.ndarray) -> BaseFault | None:
        values = np.zeros(int(seen[-1]) + 1)
        values[seen[acts]] = weights
        return kind(j, values) if kind is Offsets or np.all(np.abs(weights) < 0.9) else None

    def some(kept: np.ndarray) -> Proposal:
        """Each run may have the fault or not."""
        part = _by_run(kind, j, columns, seen, of, acts[kept])
        return replace(part, chosen=2.0 * len(acts) * np.log(2.0), some=None)

    return Proposal(columns, fault, some=some if len(acts) > 1 else None, of=of, acts=acts)


def later(y: np.ndarray, k: int) -> np.ndarray:
    """Signals (n_outputs, n_rows) k samples later, earlier where k < 0; the end values are held.

    >>> later(np.array([[1.0, 2.0, 3.0]]), 1)
    array([[1., 1., 2.]])
    """
    n = y.shape[1]
    return y[:, np.clip(np.arange(n) - k, 0, n - 1)]


def best_shifts(record: Record, run: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The whole number of samples by which every run comes later than y (n_runs,), and what that takes of its misfit."""
    most, n_runs = int(LONGEST_SHIFT * record.lengths.min()), int(run[-1]) + 1
    spread = np.maximum(np.std(record.y, axis=1), 1e-300)[:, None]
    steps = np.arange(-most, most + 1)
    cost = np.zeros((n_runs, len(steps)))
    for a, b in record.spans:
        inner = slice(most, max(b - a - most, most + 1))  # where no end value is held
        for i, k in enumerate(steps):
            missed = (record.y[:, a:b] - later(y[:, a:b], int(k))) / spread
            if record.known is not None:
                missed = missed * record.known[:, a:b]
            cost[run[a], i] += np.sum(missed[:, inner] ** 2)
    return np.where(cost.any(axis=1), steps[np.argmin(cost, axis=1)], 0), cost[:, most] - cost.min(axis=1)


def _shifts(record: Record, run: np.ndarray, y: np.ndarray) -> Iterator[Proposal]:
    """The best whole number of samples in every run: the run that gains most alone, and every run with its own."""
    values, gains = best_shifts(record, run, y)
    if not values.any():
        return
    moved = np.zeros_like(y)
    for a, b in record.spans:
        moved[:, a:b] = later(y[:, a:b], int(values[run[a]])) - y[:, a:b]
    one = np.where(np.arange(len(values)) == int(np.argmax(gains)), values, 0)
    seen, of = np.unique(run, return_inverse=True)
    for some in (one, values):
        acts = np.flatnonzero(some[seen])
        yield Proposal(moved[:, None], there_whole(Shifts(None, some)), extra=len(acts), of=of, acts=acts)


def there_whole(fault: BaseFault) -> Callable[[np.ndarray], BaseFault | None]:
    """A fault whose columns have weights of about one; None at others."""
    low, high = WHOLE
    return lambda weights: fault if np.all((weights > low) & (weights < high)) else None


def tone(record: Record, residual: np.ndarray) -> float | None:
    """Angular frequency of the strongest tone (n_samples,) of unknown phase in every run; None where runs are too short."""
    n = int(record.lengths.max())
    if n < 4 * LEAST_PERIODS:
        return None
    parts = [residual[a:b] - residual[a:b].mean() for a, b in record.spans]
    power = np.sum([np.abs(np.fft.rfft(part, 2 * n)) ** 2 for part in parts], axis=0)
    power[: int(2 * LEAST_PERIODS)] = 0.0
    # rad per sample
    at = 2 * np.pi * (np.argmax(power) + np.arange(-FINE_SHIFTS, FINE_SHIFTS + 1) / FINE_SHIFTS) / (2 * n)
    rows = [np.arange(len(part)) for part in parts]
    explained = [sum(abs(part @ np.exp(-1j * w * row)) ** 2 / len(part) for part, row in zip(parts, rows)) for w in at]
    return float(at[int(np.argmax(explained))] / record.dt)


def _hum(record: Record, run: np.ndarray, j: int, w: float, shape: tuple[int, ...]) -> Proposal:
    """Sine and cosine in every run, at output j."""
    seen, first, of = np.unique(run, return_index=True, return_inverse=True)
    phase = w * (record.t - record.t[first][of])
    columns = np.zeros((shape[0], 2, shape[1]))
    columns[j] = np.sin(phase), np.cos(phase)

    def fault(weights: np.ndarray) -> BaseFault | None:
        values = np.zeros((int(seen[-1]) + 1, 2))
        values[seen] = weights.reshape(-1, 2)
        return Hum(j, values, w)

    return Proposal(columns, fault, extra=1, of=of, acts=np.arange(len(seen)))
