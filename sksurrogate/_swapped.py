"""Columns that may have been swapped: another assignment follows the simulator much better."""

from __future__ import annotations

import time
from collections.abc import Sequence
from itertools import combinations
from typing import Any

import numpy as np

from sksurrogate.kernels.clock import TimeIsUp, check_time, time_until

#: Rows of the first run that are compared; signals up to which every pair is tried.
ROWS, MOST_COMPARED_SIGNALS = 1500, 8
#: Seconds after which nothing is said of a simulator that is slow.
LONGEST_COMPARISON = 5.0
#: A simulator that misses less than this (RMS over deviation) has its columns in order.
IN_ORDER = 0.3
#: A swap is suspected when it leaves less than this share of the error.
MUCH_LESS = 0.4


def swapped_columns(
    simulator: Any, X: np.ndarray, y: np.ndarray, inputs: Sequence[str], outputs: Sequence[str]
) -> list[str]:
    """Sentences about pairs of columns that look swapped; empty where none do.

    ``X`` (n_samples, n_inputs).
    ``y`` (n_samples, n_outputs): one run.
    """
    try:
        with time_until(time.perf_counter() + LONGEST_COMPARISON):
            return _swapped(simulator, X[:ROWS], y[:ROWS], inputs, outputs)
    except TimeIsUp:
        return []


def _swapped(
    simulator: Any, u: np.ndarray, measured: np.ndarray, inputs: Sequence[str], outputs: Sequence[str]
) -> list[str]:
    """The same, however long it takes."""
    plain = _error(simulator, u, measured)
    if plain is None or plain < IN_ORDER:
        return []
    tried = []
    for names, array, what in ((outputs, measured, "outputs"), (inputs, u, "inputs")):
        for i, j in combinations(range(min(array.shape[1], MOST_COMPARED_SIGNALS)), 2):
            order = list(range(array.shape[1]))
            order[i], order[j] = j, i
            error = _error(simulator, *((u, array[:, order]) if what == "outputs" else (array[:, order], measured)))
            if error is not None and error < MUCH_LESS * plain:
                tried.append((error, f"the {what} {names[i]!r} and {names[j]!r}"))
    return [f"{pair} look swapped: with them exchanged the simulator follows the data far better ({error:.2g} instead of {plain:.2g})."
            for error, pair in sorted(tried)[:1]]  # fmt: skip


def _error(simulator: Any, u: np.ndarray, measured: np.ndarray) -> float | None:
    """RMS of the simulator's error without its mean, over the deviation of each output; None where it cannot be run."""
    check_time()
    try:
        with np.errstate(all="ignore"):
            found = np.asarray(simulator.simulate(u.copy()), dtype=float)
    except Exception:  # the diagnosis says what is wrong with it
        return None
    spread = np.nanstd(measured, axis=0)
    if len(found) != len(measured) or not np.isfinite(found).all() or not np.all(spread > 0):
        return None
    return float(np.sqrt(np.nanmean((np.nanstd(found - measured, axis=0) / spread) ** 2)))
