"""Columns that may have been swapped: another assignment follows the simulator much better."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from itertools import combinations, permutations
from typing import Any

import numpy as np

from sksurrogate.kernels.clock import TimeIsUp, check_time, time_until

#: Rows of the first run that are compared; signals up to which every pair is tried, and up to which every order.
ROWS, MOST_COMPARED_SIGNALS, MOST_ORDERED = 1500, 8, 4
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
    tried = [(f"the outputs {said}", u, measured[:, order]) for said, order in other_orders(outputs)]
    tried += [(f"the inputs {said}", u[:, order], measured) for said, order in other_orders(inputs)]
    if u.shape == measured.shape:
        tried.append(("the inputs and the outputs exchanged", measured, u))
    errors = [(_error(simulator, *data), said) for said, *data in tried]
    better = sorted((error, said) for error, said in errors if error is not None and error < MUCH_LESS * plain)
    return [f"with {said} the simulator follows the data far better ({error:.2g} instead of {plain:.2g}): are the columns in its order?"
            for error, said in better[:1]]  # fmt: skip


def other_orders(names: Sequence[str]) -> Iterator[tuple[str, list[int]]]:
    """Orders in which signals may have been written, in words, and the numbers of the columns: two exchanged first.

    >>> for said, order in other_orders(["r", "u", "v"]):
    ...     print(said, order)
    'r' and 'u' exchanged [1, 0, 2]
    'r' and 'v' exchanged [2, 1, 0]
    'u' and 'v' exchanged [0, 2, 1]
    'r', 'u', 'v' in the order 'u', 'v', 'r' [1, 2, 0]
    'r', 'u', 'v' in the order 'v', 'r', 'u' [2, 0, 1]
    """
    n = len(names)
    for i, j in combinations(range(min(n, MOST_COMPARED_SIGNALS)), 2):
        order = list(range(n))
        order[i], order[j] = j, i
        yield f"{names[i]!r} and {names[j]!r} exchanged", order
    for changed in permutations(range(n)) if n <= MOST_ORDERED else ():
        if sum(i != k for i, k in enumerate(changed)) > 2:
            listed = (", ".join(repr(names[i]) for i in some) for some in (range(n), changed))
            yield " in the order ".join(listed), list(changed)


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
