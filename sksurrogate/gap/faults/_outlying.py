"""Readings that are off the free run of a model by themselves, while their neighbours agree with it."""

from __future__ import annotations

import numpy as np

from sksurrogate.gap.faults._correction import WrongReadings
from sksurrogate.gap.fit._backend import BaseCandidate
from sksurrogate.gap.fit._closeness import CLOSED

__all__ = ["outlying", "outlying_rows"]

#: A reading is off from so many robust deviations of the residual on, and its neighbours are below this share of it.
OFF, NEIGHBOURS = 6.0, 0.35
#: Most readings in a row, and the largest share of all, that are off by themselves.
LONGEST_BURST, MOST_OUTLYING = 8, 0.05
#: They are the reason of what is left where the rest is at the noise, or where they hold this share of its power.
REASON = 0.5


def outlying_rows(residual: np.ndarray, starts: np.ndarray) -> np.ndarray:
    """Rows of isolated outliers in a residual (n_samples,): a rise and a fall within a few readings.

    Examples
    --------
    >>> r = np.sin(np.arange(60.0))
    >>> r[[20, 21]] = 30.0
    >>> outlying_rows(r, np.array([0])).tolist()
    [20, 21]
    """
    scale = 1.4826 * float(np.median(np.abs(residual)))
    off = np.abs(residual) > OFF * max(scale, 1e-300)
    edges = np.flatnonzero(np.diff(np.r_[False, off, False].astype(int)))
    first_rows = set(starts.tolist()) | {len(residual)}
    found = [
        np.arange(a, b)
        for a, b in zip(edges[::2], edges[1::2])
        if b - a <= LONGEST_BURST
        and not first_rows & set(range(a, b + 1))  # at the ends of a run nothing returns
        and max(abs(residual[a - 1]), abs(residual[b])) < NEIGHBOURS * np.max(np.abs(residual[a:b]))
    ]
    rows = np.concatenate(found) if found else np.zeros(0, dtype=int)
    return rows if len(rows) <= MOST_OUTLYING * len(residual) else rows[:0]


def outlying(model: BaseCandidate) -> WrongReadings | None:
    """Outlying readings of one output, where they hold most of what is left there; None without any."""
    record, residual = model.problem.record, model.residual
    for j, r in enumerate(residual):
        rows = outlying_rows(r, record.starts)
        rest = np.delete(r, rows)
        near = np.sqrt(np.mean(rest**2)) < CLOSED * model.problem.sd[j]
        if len(rows) and (near or np.sum(r[rows] ** 2) > REASON * np.sum(r**2)):
            return WrongReadings("spikes", j, rows, float(np.max(np.abs(r[rows]))))
    return None
