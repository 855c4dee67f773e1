"""Parts of a record that are left out in turn: whole runs, or blocks where there are few runs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sksurrogate.kernels.record import Record

__all__ = ["blocked", "row_folds", "run_folds"]

#: Runs are put into at most this many folds.
MOST_FOLDS = 6
#: Rows of the shortest block of a run that is cut.
SHORTEST_BLOCK = 20


def run_folds(record: Record) -> np.ndarray:
    """Fold of every run, (n_runs,): as many as runs, :data:`MOST_FOLDS` at most."""
    n_runs = len(record.starts)
    return np.arange(n_runs) % min(MOST_FOLDS, n_runs)


def blocked(record: Record, least: int = 3) -> Record:
    """The record with its runs cut into blocks where there are fewer than ``least``."""
    if len(record.starts) >= least:
        return record
    pieces = int(np.ceil(4 / len(record.starts)))
    starts = []
    for a, n in zip(record.starts, record.lengths):
        count = max(1, min(pieces, n // SHORTEST_BLOCK))
        starts.extend(a + np.round(np.linspace(0, n, count + 1)[:-1]).astype(int))
    return replace(record, starts=np.array(starts, dtype=int))


def row_folds(record: Record, n_folds: int = 3) -> np.ndarray:
    """Fold of every sample: whole runs, or blocks where there are few runs."""
    n_runs = len(record.starts)
    if n_runs >= n_folds:
        return record.run_of_row % n_folds
    age = np.arange(record.n_samples) - record.starts[record.run_of_row]
    length = record.lengths[record.run_of_row]
    return np.minimum(age * 2 * n_folds // length, 2 * n_folds - 1) % n_folds
