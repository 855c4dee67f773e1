"""Faults of runs as columns: to first order, what each would move the readings by."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from sksurrogate.gap.faults._corrections import BaseFault, Gains, Hum, Offsets, Shifts
from sksurrogate.kernels.record import Record

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
    fault: Callable[[np.ndarray], BaseFault | None]  #: The fault at some weights; None where these are not possible
    extra: int = 0  #: Parameters that were chosen before (a frequency, a number of samples)
    chosen: float = 0.0  #: Price of runs chosen among all, twice the log likelihood
    some: Callable[[np.ndarray], Proposal] | None = None  #: The same in some of its runs, where each has a value
    #: What of it is left in a corrected record, beside the outputs of a model that was fitted to that; None where nothing is
    rest: Callable[[Record, np.ndarray], BaseFault | None] | None = None


def proposals(record: Record, run: np.ndarray, y: np.ndarray, residual: np.ndarray) -> Iterator[Proposal]:
    """All faults of runs, each in one run alone and in every run.

    ``record``: runs, or pieces of them.
    ``run`` (n_samples,): number of the run of every row.
    ``y`` (n_outputs, n_samples): outputs of the model.
    ``residual`` (n_outputs, n_samples): measured less these.
    """
    n_runs = int(run[-1]) + 1
    if n_runs > 1:
        inside = np.arange(n_runs)[:, None] == run  # (n_runs, n_samples)
        some = [np.array([r]) for r in range(n_runs)] + [np.arange(n_runs)]
        for j in range(len(y)):
            for runs in some:
                yield _by_run(Offsets, j, runs, inside[runs].astype(float), y.shape, n_runs)
                yield _by_run(Gains, j, runs, inside[runs] * y[j], y.shape, n_runs)
    yield from _shifts(record, run, y)
    yield from tones(record, run, residual)


def tones(record: Record, run: np.ndarray, residual: np.ndarray) -> Iterator[Proposal]:
    """The strongest tone on every output."""
    for j in range(len(residual)):
        found = tone(record, residual[j])
        if found is not None:
            yield _hum(record, run, j, found, residual.shape)


def _by_run(
    kind: type[Offsets] | type[Gains], j: int, runs: np.ndarray, moved: np.ndarray, shape: tuple[int, ...], n_runs: int
) -> Proposal:
    """One value for each of some runs, at output j."""
    columns = np.zeros((shape[0], len(runs), shape[1]))
    columns[j] = moved

    def fault(weights: np.ndarray) -> BaseFault | None:
        values = np.zeros(n_runs)
        values[runs] = weights
        return kind(j, values) if kind is Offsets or np.all(np.abs(weights) < 0.9) else None

    def some(kept: np.ndarray) -> Proposal:
        """Each run may have the fault or not."""
        part = _by_run(kind, j, runs[kept], moved[kept], shape, n_runs)
        return replace(part, chosen=2.0 * len(runs) * np.log(2.0), some=None)

    return Proposal(columns, fault, some=some if len(runs) > 1 else None)


def later(y: np.ndarray, k: int) -> np.ndarray:
    """Signals (n_outputs, n_rows) k samples later, earlier where k < 0; the end values are held.

    Examples
    --------
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
    return steps[np.argmin(cost, axis=1)], cost[:, most] - cost.min(axis=1)


def _shifts(record: Record, run: np.ndarray, y: np.ndarray) -> Iterator[Proposal]:
    """The best whole number of samples in every run: the run that gains most alone, and every run with its own."""
    values, gains = best_shifts(record, run, y)
    if not values.any():
        return
    moved = np.zeros_like(y)
    for a, b in record.spans:
        moved[:, a:b] = later(y[:, a:b], int(values[run[a]])) - y[:, a:b]
    one = np.where(np.arange(len(values)) == int(np.argmax(gains)), values, 0)
    for some in (one, values):
        runs = np.flatnonzero(some)
        columns = np.stack([np.where(run == r, moved, 0.0) for r in runs], axis=1)
        yield Proposal(columns, _shift_of(some), extra=len(runs), rest=_rest_of_shifts(some != 0, run))


def _rest_of_shifts(where: np.ndarray, run: np.ndarray) -> Callable[[Record, np.ndarray], BaseFault | None]:
    """Initial states that were fitted to late outputs bend the start of a run: the shift is read again without them."""

    def rest(record: Record, y: np.ndarray) -> BaseFault | None:
        values = np.where(where, best_shifts(record, run, y)[0], 0)
        return Shifts(None, values) if values.any() else None

    return rest


def _shift_of(values: np.ndarray) -> Callable[[np.ndarray], BaseFault | None]:
    """Shifts whose columns have weights of about one."""

    def fault(weights: np.ndarray) -> BaseFault | None:
        low, high = WHOLE
        return Shifts(None, values) if np.all((weights > low) & (weights < high)) else None

    return fault


def tone(record: Record, residual: np.ndarray) -> float | None:
    """Angular frequency of the strongest tone (n_samples,) of unknown phase in every run; None where runs are too short."""
    n = int(record.lengths.max())
    if n < 4 * LEAST_PERIODS:
        return None
    parts = [residual[a:b] - residual[a:b].mean() for a, b in record.spans]
    power = np.sum([np.abs(np.fft.rfft(part, 2 * n)) ** 2 for part in parts], axis=0)
    power[: int(2 * LEAST_PERIODS)] = 0.0
    at = (
        2 * np.pi * (np.argmax(power) + np.arange(-FINE_SHIFTS, FINE_SHIFTS + 1) / FINE_SHIFTS) / (2 * n)
    )  # rad per sample
    rows = [np.arange(len(part)) for part in parts]
    explained = [sum(abs(part @ np.exp(-1j * w * row)) ** 2 / len(part) for part, row in zip(parts, rows)) for w in at]
    return float(at[int(np.argmax(explained))] / record.dt)


def _hum(record: Record, run: np.ndarray, j: int, w: float, shape: tuple[int, ...]) -> Proposal:
    """Sine and cosine in every run, at output j."""
    n_runs = int(run[-1]) + 1
    first = np.searchsorted(run, np.arange(n_runs))
    phase = w * (record.t - record.t[first][run])
    columns = np.zeros((shape[0], 2 * n_runs, shape[1]))
    for r in range(n_runs):
        columns[j, 2 * r] = np.where(run == r, np.sin(phase), 0.0)
        columns[j, 2 * r + 1] = np.where(run == r, np.cos(phase), 0.0)
    return Proposal(columns, lambda weights: Hum(j, weights.reshape(n_runs, 2), w), extra=1)
