"""Parts of a record: pieces of a long one that candidates are compared and fitted on, folds that are left out in turn."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sksurrogate.kernels.record import Record

#: Candidates are compared on at most this many readings, or samples: what more of them could tell apart is below any practical bar.
SEARCHED_READINGS, SEARCHED_SAMPLES = 18_000, 9_000
#: But on as many samples at least, however many outputs there are.
FEWEST_SEARCHED = 3_000
#: The candidate that won is fitted again on at most this many.
FITTED_SAMPLES = 60_000
#: Samples of a piece that is cut out of a long run.
PIECE = 1_500


def searched_samples(n_outputs: int) -> int:
    """Samples that candidates are compared on: time and memory go with the readings.

    >>> [searched_samples(n) for n in (1, 2, 4, 12)]
    [9000, 9000, 4500, 3000]
    """
    return min(max(SEARCHED_READINGS // n_outputs, FEWEST_SEARCHED), SEARCHED_SAMPLES)


def excerpt(record: Record, most: int) -> tuple[Record, np.ndarray]:
    """Pieces spread evenly over a record, at most ``most`` samples in all, and the rows of the record that they hold.

    Every piece is a run of its own, with its own unknown initial state; short runs stay whole.

    >>> import numpy as np
    >>> from sksurrogate.kernels.record import Record
    >>> whole = Record(np.zeros((1, 100_000)), np.zeros((1, 100_000)), np.arange(1e5), np.array([0]), 1.0)
    >>> part, rows = excerpt(whole, 6000)
    >>> part.n_samples, len(part.starts), int(rows[0]), int(rows[-1])
    (5970, 4, 0, 99999)
    """
    if record.n_samples <= most:
        return record, np.arange(record.n_samples)
    edges = [np.round(np.linspace(a, b, max(1, round((b - a) / PIECE)) + 1)).astype(int) for a, b in record.spans]
    pieces = [piece for ends in edges for piece in zip(ends[:-1], ends[1:])]
    length = float(np.median([min(b - a, PIECE) for a, b in pieces]))
    n = min(len(pieces), max(1, int(most / length)))
    chosen = np.unique(np.round(np.linspace(0, len(pieces) - 1, n)).astype(int))
    bounds, total = [], 0
    for k in chosen:
        a, b = pieces[k]
        if total + b - a > most:
            a = b - (most - total) if k == len(pieces) - 1 else a
            b = min(b, a + most - total)
        if b - a >= 8:
            bounds.append((a, b))
            total += b - a
    rows = np.concatenate([np.arange(a, b) for a, b in bounds])
    starts = np.cumsum([0] + [b - a for a, b in bounds[:-1]])
    part = record.cut(record.starts).rows(rows, starts)
    return replace(part, history=None, place=None), rows  # all of a long record costs too much


#: Runs are put into at most this many folds.
MOST_FOLDS = 6
#: Fewer runs are cut into blocks: of two, the one that is left would have to choose alone.
FEWEST_RUNS = 3
#: Rows of the shortest block of a run that is cut.
SHORTEST_BLOCK = 20


def run_folds(record: Record) -> np.ndarray:
    """Fold of every run, (n_runs,): as many as runs, :data:`MOST_FOLDS` at most; pieces go with their run where there are enough."""
    number = np.unique(record.recorded_run_of_row[record.starts], return_inverse=True)[1]
    if number.max() + 1 < FEWEST_RUNS:
        number = np.arange(len(record.starts))
    return number % min(MOST_FOLDS, number.max() + 1)


def blocked(record: Record) -> Record:
    """The record with its runs cut into blocks where there are fewer than :data:`FEWEST_RUNS`."""
    if len(record.starts) >= FEWEST_RUNS:
        return record
    pieces = int(np.ceil(4 / len(record.starts)))
    starts = []
    for a, n in zip(record.starts, record.lengths):
        count = max(1, min(pieces, n // SHORTEST_BLOCK))
        starts.extend(a + np.round(np.linspace(0, n, count + 1)[:-1]).astype(int))
    return record.cut(np.array(starts, dtype=int))
