"""The data of a fit: all runs one behind the other on one time axis, and which readings were measured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from sksurrogate.kernels.signals import Signal, hold, stacked


def bridged(y: np.ndarray, known: np.ndarray, starts: np.ndarray) -> np.ndarray:
    """Signals with what is not known joined linearly within a run, ends held; of a run without any the mean of the others.

    ``y`` (n_signals, n_samples), ``known`` bool (n_signals, n_samples), ``starts`` int (n_runs,).

    >>> y = np.array([[1.0, np.nan, 3.0, np.nan]])
    >>> bridged(y, np.isfinite(y), np.array([0]))
    array([[1., 2., 3., 3.]])
    """
    out = y.copy()
    edges = np.r_[starts, y.shape[1]]
    for row, seen in zip(out, known):
        if seen.all():
            continue
        mean = float(row[seen].mean()) if seen.any() else 0.0
        for a, b in zip(edges[:-1], edges[1:]):
            rows = a + np.flatnonzero(seen[a:b])
            row[a:b] = np.interp(np.arange(a, b), rows, row[rows]) if len(rows) else mean
    return out


def ages_of(starts: np.ndarray, n_samples: int) -> np.ndarray:
    """Samples since the first row of the run, int (n_samples,).

    >>> ages_of(np.array([0, 3]), 5).tolist()
    [0, 1, 2, 0, 1]
    """
    return np.arange(n_samples) - np.repeat(starts, np.diff(np.r_[starts, n_samples]))


@dataclass(frozen=True, eq=False)
class Record:
    """Stacked runs, time last and contiguous."""

    u: np.ndarray  #: (n_inputs, n_samples)
    #: (n_outputs, n_samples): finite everywhere: what was not measured is bridged, and no residual is taken of it
    y: np.ndarray
    t: np.ndarray  #: (n_samples,)
    starts: np.ndarray  #: int (n_runs,): first row of every run
    dt: float
    #: bool (n_outputs, n_samples): which values of ``y`` were measured; None where all were
    known: np.ndarray | None = None
    #: (n_samples,): how long after ``t`` the readings of a row were taken; None where all were taken at ``t``
    offset: np.ndarray | None = None
    #: (n_samples,): time from every row to the next; None where that is ``dt`` everywhere
    steps: np.ndarray | None = None
    #: (n_outputs,): RMS that no model follows, as far as it is known: what noise on the measured inputs, or a disturbance of the
    #: plant, moves the outputs by
    disturbance: np.ndarray | float = 0.0
    #: int (n_samples,): number of the recorded run of every row, where ``starts`` are those of pieces; None where runs
    #: are whole
    recorded: np.ndarray | None = None
    began: np.ndarray | None = None  #: (n_recorded_runs,): times at which these began
    history: Record | None = None  #: The record before it was cut: what an actuator remembers at the start of a piece
    place: np.ndarray | None = None  #: int (n_samples,): rows of the history
    joined: bool = False  #: Whether inputs move in straight lines between rows, also where the simulator holds them

    @classmethod
    def from_runs(
        cls, U: Sequence[np.ndarray], Y: Sequence[np.ndarray], t: Sequence[np.ndarray], dt: float,
        offsets: Sequence[np.ndarray] | None = None, uneven: bool = False,
    ) -> Record:  # fmt: skip
        """From one array (n_samples, n) a run; nan in Y was not measured; ``offsets`` as :attr:`offset` run by run.

        Where rows are ``uneven`` they are as far apart as ``t`` says.
        """
        starts = np.cumsum([0] + [len(part) for part in U[:-1]]).astype(int)
        y = np.ascontiguousarray(np.concatenate(Y).T)
        known = ~np.isnan(y)
        whole = bool(known.all())
        return cls(
            np.ascontiguousarray(np.concatenate(U).T),
            y if whole else bridged(y, known, starts),
            np.concatenate(t),
            starts,
            float(dt),
            None if whole else known,
            None if offsets is None else np.concatenate(offsets),
            np.concatenate([np.diff(part, append=part[-1] + dt) for part in t]) if uneven else None,
        )

    # ---- what was measured ------------------------------------------------------------------------------------------
    def seen(self, values: np.ndarray) -> np.ndarray:
        """Outputs (..., n_outputs, n_samples) with 0 where nothing was measured."""
        return values if self.known is None else np.where(self.known, values, 0.0)

    def seen_of(self, values: np.ndarray) -> np.ndarray:
        """The same of outputs that come first, (n_outputs, ..., n_samples)."""
        if self.known is None:
            return values
        shape = (len(self.known), *(1,) * (values.ndim - 2), self.known.shape[1])
        return np.where(self.known.reshape(shape), values, 0.0)

    def residual(self, y: np.ndarray) -> np.ndarray:
        """Measured less predicted (n_outputs, n_samples), 0 where nothing was measured."""
        return self.seen(self.y - y)

    @cached_property
    def counts(self) -> np.ndarray:
        """Measured values of every output in every run, (n_runs, n_outputs)."""
        if self.known is None:
            return np.repeat(self.lengths[:, None], len(self.y), axis=1)
        return np.add.reduceat(self.known, self.starts, axis=1, dtype=int).T

    @cached_property
    def n_values(self) -> int:
        """Measured values."""
        return self.y.size if self.known is None else int(self.known.sum())

    @cached_property
    def spread(self) -> np.ndarray:
        """Standard deviation of the measured values of every output, > 0, (n_outputs,)."""
        rows = [self.measured(j) for j in range(len(self.y))]
        return np.maximum([np.std(row) if len(row) else 0.0 for row in rows], 1e-300)

    @cached_property
    def level(self) -> np.ndarray:
        """Mean of the measured values of every output (n_outputs,)."""
        return np.array([np.mean(self.measured(j)) if self.counts[:, j].any() else 0.0 for j in range(len(self.y))])

    def rows_of(self, j: int) -> slice | np.ndarray:
        """The rows in which output j was measured."""
        return slice(None) if self.known is None else self.known[j]

    def measured(self, j: int) -> np.ndarray:
        """The measured values of output j, in order of time."""
        return self.y[j, self.rows_of(j)]

    def readings(self, j: int) -> np.ndarray:
        """Output j, nan where it was not measured (n_samples,)."""
        return self.y[j] if self.known is None else np.where(self.known[j], self.y[j], np.nan)

    def rms(self, residual: np.ndarray) -> np.ndarray:
        """Root mean square of a :meth:`residual` over the measured values, (n_outputs,)."""
        if self.known is None:
            return np.sqrt(np.mean(residual**2, axis=1))
        return np.sqrt(np.sum(residual**2, axis=1) / np.maximum(self.known.sum(axis=1), 1))

    # ---- rows -------------------------------------------------------------------------------------------------------
    @property
    def n_samples(self) -> int:
        """Rows of all runs together."""
        return len(self.t)

    @property
    def lengths(self) -> np.ndarray:
        """Rows of every run."""
        return np.diff(np.r_[self.starts, self.n_samples])

    @property
    def spans(self) -> list[tuple[int, int]]:
        """First row of every run, and the row behind its last."""
        edges = [*self.starts.tolist(), self.n_samples]
        return list(zip(edges[:-1], edges[1:]))

    @property
    def run_of_row(self) -> np.ndarray:
        """Number of the run of every row."""
        return np.repeat(np.arange(len(self.starts)), self.lengths)

    @property
    def recorded_run_of_row(self) -> np.ndarray:
        """Number of the recorded run of every row."""
        return self.run_of_row if self.recorded is None else self.recorded

    @cached_property
    def recorded_starts(self) -> np.ndarray:
        """First rows of what was recorded without a break: the lag of an input does not begin anew in a piece."""
        if self.recorded is None:
            return self.starts
        step = self.dt if self.steps is None else self.steps[:-1]
        return np.flatnonzero(np.r_[True, (np.diff(self.recorded) != 0) | (np.diff(self.t) > 1.5 * step)])

    @property
    def whole_starts(self) -> np.ndarray:
        """Which of :attr:`recorded_starts` are first rows of recorded runs, and not of pieces within one."""
        rows = self.recorded_starts
        if self.recorded is None or self.began is None:
            return np.ones(len(rows), bool)
        return np.asarray(self.t[rows] == self.began[self.recorded[rows]])

    @property
    def uncut(self) -> Record:
        """The record with what came before its pieces, as far as that is known."""
        return self if self.history is None else self.history

    def of_uncut(self, *signals: Any) -> Any:
        """The rows of this record of signals (..., n_samples) along :attr:`uncut`, None where one is None."""
        return signals if self.place is None else [None if one is None else one[..., self.place] for one in signals]

    def order_of_inputs(self, hold: str) -> int:
        """Between rows inputs are constant (0) or straight (1); ``hold``: what the simulator does with them."""
        return 0 if hold == "zoh" and not self.joined else 1

    @cached_property
    def _held(self) -> dict[tuple[int, int], list[Signal]]:
        return {}

    def held(self, n_sub: int, order: int) -> list[Signal]:
        """Every input in ``n_sub`` parts of a sample, constant (0) or straight (1) between rows; made once for all models of a record."""
        if (n_sub, order) not in self._held:
            self._held[n_sub, order] = [hold(u, n_sub, order, self.starts) for u in self.u]
        return self._held[n_sub, order]

    @cached_property
    def _acting(self) -> dict[tuple[int, int], tuple[np.ndarray, np.ndarray | None, np.ndarray]]:
        return {}

    def acting(self, n_sub: int, order: int) -> tuple[np.ndarray, np.ndarray | None, np.ndarray]:
        """Inputs as they were recorded before the record was cut: what :func:`stacked` gives of them, made once too."""
        if (n_sub, order) not in self._acting:
            if len(self.u):
                self._acting[n_sub, order] = self.of_uncut(*stacked(self.uncut.held(n_sub, order)))
            else:
                none = np.zeros((n_sub, 0, 1, self.n_samples))
                self._acting[n_sub, order] = none, None, none[0]
        return self._acting[n_sub, order]

    def back(self, k: int) -> np.ndarray:
        """Row k samples before each, or the first of its run."""
        return np.maximum(np.arange(self.n_samples) - k, self.starts[self.run_of_row])

    def rows(self, rows: np.ndarray, starts: np.ndarray) -> Record:
        """Some rows, cut into runs that begin at ``starts`` of them."""
        known = None if self.known is None else self.known[:, rows]
        offset = None if self.offset is None else self.offset[rows]
        steps = None if self.steps is None else self.steps[rows]
        u, y, t = self.u[:, rows], self.y[:, rows], self.t[rows]
        recorded = None if self.recorded is None else self.recorded[rows]
        place = None if self.place is None else self.place[rows]
        return Record(
            u, y, t, starts, self.dt, known, offset, steps, self.disturbance, recorded, self.began, self.history, place,
            self.joined,
        )  # fmt: skip

    def cut(self, starts: np.ndarray) -> Record:
        """With its runs cut into pieces that begin at ``starts``; what was recorded without a break is still known."""
        out = replace(self, starts=starts)
        if self.recorded is None:
            out = replace(out, recorded=self.run_of_row, began=self.t[self.starts])
        return out if self.history is not None else replace(out, history=self, place=np.arange(self.n_samples))

    def with_inputs(self, u: np.ndarray) -> Record:
        """With other inputs (n_inputs, n_samples), in its history too."""
        if self.history is None:
            return replace(self, u=u)
        whole = self.history.u.copy()
        whole[:, self.place] = u
        return replace(self, u=u, history=self.history.with_inputs(whole))

    def select(self, runs: Sequence[int]) -> Record:
        """Some of the runs."""
        spans = self.spans
        rows = np.concatenate([np.arange(*spans[r]) for r in runs])
        lengths = self.lengths[list(runs)]
        return self.rows(rows, np.r_[0, np.cumsum(lengths[:-1])].astype(int))
