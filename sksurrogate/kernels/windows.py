"""Free runs window by window: Newton's method over some samples at a time, one by one only where it does not settle.

A run whose map is contracting, or smooth, closes over thousands of samples in a few evaluations; one that sticks, hits a
limit or diverges does so over short windows, or not at all. A window that is closed is the run itself: the map is explicit,
and the correction that is left is that of the whole window, not of one sample.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from sksurrogate.kernels.integrate import close

#: Samples of the first window; fewer than the second are walked through one by one: Newton takes as many evaluations of the map.
FIRST_WINDOW, SHORTEST_WINDOW = 64, 12
#: Samples of a window and states: more leave the processor's cache.
LARGEST = 20_000
#: Correction, over the size of each state, at which a window counts as closed; the last one shrinks it a hundredfold at least.
WINDOW_CLOSED = 1e-11
#: Share of a state that counts as its size far from where it began: a hundred roundings of it are what a window closes to.
ROUNDED_OFF = 100.0 * np.finfo(float).eps / WINDOW_CLOSED
#: Newton steps of a window, and fresh Jacobians among them, before it is cut.
MOST_STEPS, MOST_FRESH = 16, 10
#: Growth, after every window that is closed, of the width that is tried at most: one that failed is tried again later.
REGAINED = 1.2

#: (x (n_states, n_columns, n_rows), rows) -> the states one sample after these rows.
RowMap = Callable[[np.ndarray, np.ndarray], np.ndarray]


def run_in_windows(
    step: RowMap,
    x0: np.ndarray,
    starts: np.ndarray,
    lengths: np.ndarray,
    size: np.ndarray,
    near: np.ndarray | None = None,
) -> np.ndarray:
    """Free run of stacked runs.

    ``step`` (x, rows) -> next states: the map at some of the rows; columns are perturbations.
    ``x0`` (n_states, n_runs).
    ``starts, lengths`` int (n_runs,): first row and number of rows of every run.
    ``size`` (n_states,): size of each state.
    ``near`` (n_states, n_samples): a trajectory near the run: windows start from it, as wide as may be.
    Returns (n_states, n_samples): nan behind the row at which a run is not finite.

    >>> x = run_in_windows(lambda x, rows: 0.5 * x, np.array([[1.0]]), np.array([0]), np.array([4]), np.ones(1))
    >>> x.round(12)
    array([[1.   , 0.5  , 0.25 , 0.125]])
    """
    out = np.full((len(x0), int(lengths.sum())), np.nan)
    out[:, starts] = x0
    k, width, most = 0, FIRST_WINDOW if near is None else LARGEST, np.inf
    while True:
        at = np.minimum(starts + k, out.shape[1] - 1)
        alive = np.flatnonzero((lengths - 1 > k) & np.isfinite(out[:, at]).all(axis=0))
        if not len(alive):
            return out
        largest = max(LARGEST // (len(x0) * len(alive)), SHORTEST_WINDOW)
        width = int(min(width, largest, lengths[alive].max() - 1 - k))
        first, counts = starts[alive] + k, np.minimum(lengths[alive] - k, width + 1)
        if width >= SHORTEST_WINDOW and _window(step, out, first, counts, size, near):
            most *= REGAINED
            k, width = k + width, int(max(min(2 * width, most), SHORTEST_WINDOW))
        elif width > SHORTEST_WINDOW:
            width = most = max(width // 2, SHORTEST_WINDOW)
        else:
            _walk(step, out, first, counts, width)
            k, width = k + width, 2 * SHORTEST_WINDOW


def run_by_samples(step: RowMap, x0: np.ndarray, starts: np.ndarray, lengths: np.ndarray) -> np.ndarray:
    """The same free run one sample after the other: of a map that jumps, where Newton's method closes no window.

    >>> run_by_samples(lambda x, rows: np.floor(x / 2), np.array([[9.0]]), np.array([0]), np.array([4]))
    array([[9., 4., 2., 1.]])
    """
    out = np.full((len(x0), int(lengths.sum())), np.nan)
    out[:, starts] = x0
    _walk(step, out, starts, lengths, int(lengths.max()) - 1)
    return out


def _walk(step: RowMap, out: np.ndarray, first: np.ndarray, counts: np.ndarray, width: int) -> None:
    """Fill the rows behind the first ones one by one."""
    for ahead in range(width):
        rows = first[counts - 1 > ahead] + ahead
        out[:, rows + 1] = step(out[:, None, rows], rows)[:, 0]


def _window(
    step: RowMap, out: np.ndarray, first: np.ndarray, counts: np.ndarray, size: np.ndarray, near: np.ndarray | None
) -> bool:
    """Fill the rows behind the first ones where Newton's method closes them."""
    begin = np.r_[0, np.cumsum(counts[:-1])]
    rows = np.repeat(first - begin, counts) + np.arange(counts.sum())
    x = np.repeat(out[:, first], counts, axis=1)
    if near is not None:
        x = near[:, rows].copy()
        x[:, begin] = out[:, first]
    size = np.maximum(size, ROUNDED_OFF * np.max(np.abs(out[:, first]), axis=1))
    x, closed, _ = close(
        lambda z: step(z, rows), x, begin, size, WINDOW_CLOSED, max_steps=MOST_STEPS, max_fresh=MOST_FRESH
    )
    if closed:
        out[:, rows] = x
    return closed
