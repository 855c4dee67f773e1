"""Readings that disagree with their own neighbours: spikes, and stretches at one level that a sensor jumps out of.

Both are judged in one output of one run, against the noise of that output and without a model of the plant. A spike is a
reading beside a smooth path; what a plant does suddenly bends or lifts the path *after* the moment as well, so that a kink
or a step explains it better than one reading that is off.
"""

from __future__ import annotations

from functools import cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from sksurrogate.kernels.linear_fit import linear_least_squares

#: Rows before and after a reading that it is compared with, and the degree of the path through them.
SIDE, DEGREE = 6, 3
#: Most readings in a row that one spike takes.
LONGEST_SPIKE = 3
#: Twice the log likelihood that a spike must gain over a path without it beyond ``2 ln N``, and over a path with a kink or a step.
BEYOND_NONE, BEYOND_KINK = 10.0, 12.0
#: Weights of the cubic through two readings on either side, and the standard deviation of what it misses in units of the noise.
NEIGHBOURS = np.array([-1.0, 4.0, 0.0, 4.0, -1.0]) / 6.0
MISSED = float(np.sqrt(1.0 + np.sum(NEIGHBOURS**2)))
#: A sensor is flat at a level for this many readings or more.
SHORTEST_FLAT = 4
#: A jump is this many times the noise, and this many times what 99 % of the readings move by.
JUMP, JUMP_OVER_USUAL = 12.0, 3.0
#: Largest share of the readings that are called wrong; where more seem so the path is rough and they are not.
MOST_WRONG = 0.15

#: A reading out of reach is so many times what half of the readings span off their middle.
FAR_FROM_ALL = 100.0


class Stretch(NamedTuple):
    """Readings ``start:stop`` of a run, and how far the sensor jumps at their ends."""

    start: int
    stop: int
    size: float


def predicted_by_neighbours(y: np.ndarray) -> np.ndarray:
    """Every reading from the two before and the two after it by a cubic; the first and last two are left as they are.

    ``y`` (n_samples,).
    Returns (n_samples,).

    >>> predicted_by_neighbours(np.array([0.0, 1.0, 8.0, 27.0, 64.0]))
    array([ 0.,  1.,  8., 27., 64.])
    """
    out = y.astype(float).copy()
    if len(y) > 4:
        out[2:-2] = np.convolve(y, NEIGHBOURS, mode="valid")
    return out


@cache
def _paths(n: int, place: int) -> tuple[np.ndarray, list[np.ndarray], np.ndarray]:
    """For n rows: smooth paths (an orthonormal basis), spikes at ``place`` and kinks and steps anywhere, beside these paths.

    Returns ``smooth`` (n, DEGREE + 1).
    Returns ``impulses`` list of (n,): spikes of 1, 2, ... readings that begin at ``place``.
    Returns ``sudden`` (n, n_sudden).
    """
    rows = np.arange(n, dtype=float)
    smooth = np.linalg.qr(np.vander(rows / n, DEGREE + 1))[0]
    impulses = [
        np.isin(rows, np.arange(place, place + k)).astype(float) for k in range(1, LONGEST_SPIKE + 1) if place + k < n
    ]
    sudden = [np.maximum(rows - k, 0.0) for k in range(1, n - 1)] + [(rows >= k).astype(float) for k in range(1, n)]
    beside = [f - smooth @ (smooth.T @ f) for f in impulses + sudden]
    beside = [f / np.linalg.norm(f) for f in beside]
    return smooth, beside[: len(impulses)], np.column_stack(beside[len(impulses) :])


def _is_spike(y: np.ndarray, place: int, sd: float, needed: float) -> tuple[int, float]:
    """Readings that a spike at ``place`` takes, 0 where a smooth path, a kink or a step does as well; and what it gains."""
    smooth, impulses, sudden = _paths(len(y), place)
    rest = y - smooth @ (smooth.T @ y)
    free = max(len(y) - DEGREE - 2, 1)
    taken, gained = 0, 0.0
    for k, impulse in enumerate(impulses, start=1):
        removed = float(impulse @ rest) ** 2
        left = max(float(rest @ rest) - removed, 0.0)
        variance = max(sd**2, left / free)
        other = float(np.max((sudden.T @ rest) ** 2))
        enough = removed > needed * variance and removed - other > BEYOND_KINK * variance
        if enough and removed / variance > gained + BEYOND_NONE * (taken > 0):
            taken, gained = k, removed / variance
    return taken, gained


def spikes(y: np.ndarray, sd: float) -> list[Stretch]:
    """Readings that are off a path which is smooth before and after them.

    ``y`` (n_samples,): of one run.
    ``sd``: its white noise.
    Returns list of Stretch: in order of time; none where they would be more than :data:`MOST_WRONG` of all readings.

    >>> y = np.sin(0.05 * np.arange(100))
    >>> y[40] += 1.0
    >>> [(s.start, s.stop) for s in spikes(y, sd=0.01)]
    [(40, 41)]
    >>> spikes(np.abs(y[:30] - 0.5), sd=0.01)   # a kink is none
    []
    """
    n, width = len(y), 2 * SIDE + 1
    if n < width or not sd > 0:
        return []
    path, found = y.astype(float).copy(), []
    needed = 2.0 * np.log(n) + BEYOND_NONE
    missed = path - predicted_by_neighbours(path)
    rough = max(1.4826 * float(np.median(np.abs(missed))) / MISSED, sd)
    done = np.zeros(n, bool)
    for _ in range(n):
        suspect = np.where(done, 0.0, np.abs(missed))
        k = int(np.argmax(suspect))
        if suspect[k] < 0.5 * np.sqrt(needed) * rough:  # a spike of two readings shows half its size there
            break
        done[k] = True
        best: tuple[float, int, int] = (0.0, k, 0)
        for first in range(max(k - LONGEST_SPIKE + 1, 1), k + 1):
            a = int(np.clip(first - SIDE, 0, n - width))
            taken, gained = _is_spike(path[a : a + width], first - a, rough, needed)
            if taken and first + taken > k and gained > best[0]:
                best = (gained, first, taken)
        gained, first, taken = best
        if not taken:
            continue
        bridge = _bridge(path, first, taken)
        found.append(Stretch(first, first + taken, float(np.max(np.abs(path[first : first + taken] - bridge)))))
        path[first : first + taken] = bridge
        near = slice(max(first - 2, 0), min(first + taken + 2, n))
        missed = path - predicted_by_neighbours(path)
        done[near] = False
        done[first : first + taken] = True
    wrong = sum(s.stop - s.start for s in found)
    return sorted(found) if wrong <= MOST_WRONG * n else []


def _bridge(y: np.ndarray, first: int, taken: int) -> np.ndarray:
    """What a smooth path through the rows around gives for some readings."""
    width = 2 * SIDE + 1
    a = int(np.clip(first - SIDE, 0, len(y) - width))
    rows = np.arange(width)
    inside = (rows >= first - a) & (rows < first - a + taken)
    basis = np.vander((rows - SIDE) / SIDE, DEGREE + 1)
    weights = linear_least_squares(basis[~inside], y[a : a + width][~inside])
    return basis[inside] @ weights


def flat_stretches(y: np.ndarray, sd: float) -> list[Stretch]:
    """Stretches at one level that the sensor jumps out of, or into: it stood still while what it measures moved on.

    ``y`` (n_samples,): of one run.
    ``sd``: its white noise.
    Returns list of Stretch: of :data:`SHORTEST_FLAT` readings or more, in order of time.

    >>> y = np.sin(0.05 * np.arange(200))
    >>> y[60:110] = y[60]
    >>> [(s.start, s.stop) for s in flat_stretches(y, sd=0.01)]
    [(60, 110)]
    """
    n = len(y)
    if n < 4 * SHORTEST_FLAT or not sd > 0:
        return []
    moved = np.abs(np.diff(y))
    least = _least_jump(moved, sd)
    jumps = np.flatnonzero(moved > least) + 1  # rows that a jump leads to
    exact = _equal_runs(y)
    found = []
    for a, b in sorted({*exact, *_between(y, jumps, sd)}):
        into = abs(y[a] - y[a - 1]) if a > 0 else 0.0
        out_of = abs(y[b] - y[b - 1]) if b < n else 0.0
        if b - a >= SHORTEST_FLAT and max(into, out_of) > least and b - a <= n // 2:
            found.append(Stretch(a, b, float(max(into, out_of))))
    return _apart(found)


def jumps_that_stay(y: np.ndarray, sd: float) -> np.ndarray:
    """Rows that a single jump leads to: the readings before it and behind it move little, and do not return, int (n_jumps,).

    ``y`` (n_samples,), ``sd``: its white noise.

    >>> y = np.sin(0.05 * np.arange(200))
    >>> y[60], y[120:] = 5.0, y[120:] + 2.0
    >>> jumps_that_stay(y, sd=0.01).tolist()
    [120]
    """
    moved = np.abs(np.diff(y))
    if len(moved) < 3:
        return np.zeros(0, dtype=int)
    beside = np.maximum(moved[:-2], moved[2:])
    return np.flatnonzero((moved[1:-1] > _least_jump(moved, sd)) & (moved[1:-1] > JUMP_OVER_USUAL * beside)) + 2


def _least_jump(moved: np.ndarray, sd: float) -> float:
    """Least size of a jump among the steps (n_samples - 1,) of an output with this noise; in a short run 1 % of the steps tell no usual one."""
    usual = JUMP_OVER_USUAL * float(np.quantile(moved, 0.99)) if len(moved) >= 400 else 0.0
    return max(JUMP * sd, usual)


def out_of_reach(y: np.ndarray) -> np.ndarray:
    """Which readings no plant gives: single ones, or of one value repeated (a code for "no reading"), :data:`FAR_FROM_ALL` off all others.

    ``y`` (n_samples,): none where half of the readings are equal, which tells no range.
    Returns bool (n_samples,).

    >>> y = np.sin(0.05 * np.arange(200))
    >>> y[[60, 120, 121]] = 1e9, -9999.0, -9999.0
    >>> np.flatnonzero(out_of_reach(y)).tolist()
    [60, 120, 121]
    """
    low, middle, high = np.quantile(y, [0.25, 0.5, 0.75]) if len(y) else np.zeros(3)
    if not high > low:
        return np.zeros(len(y), bool)
    far = np.abs(y - middle) > FAR_FROM_ALL * (high - low)
    beside = np.r_[False, far[:-1]] | np.r_[far[1:], False]
    _, place, count = np.unique(y[far], return_inverse=True, return_counts=True)
    far[far] = (count[place] > 1) | ~beside[far]
    return far


def spans_where(holds: np.ndarray) -> list[tuple[int, int]]:
    """First rows and ends of the stretches in which something holds (n_rows,) of bool.

    >>> spans_where(np.array([True, False, True, True]))
    [(0, 1), (2, 4)]
    """
    edges = np.flatnonzero(np.diff(np.r_[False, holds, False].astype(int))).tolist()
    return list(zip(edges[::2], edges[1::2]))


def _equal_runs(y: np.ndarray) -> list[tuple[int, int]]:
    """Stretches of exactly equal readings, where readings usually differ."""
    same = np.diff(y) == 0
    runs = [(a, b + 1) for a, b in spans_where(same)]
    long = [(a, b) for a, b in runs if b - a >= SHORTEST_FLAT]
    other = float(same.sum() - sum(b - a - 1 for a, b in long))
    return long if other < 0.02 * len(y) else []  # on a grid equal neighbours are usual


def _between(y: np.ndarray, jumps: np.ndarray, sd: float) -> list[tuple[int, int]]:
    """Stretches between two jumps that are flat within the noise."""
    return [
        (int(a), int(b))
        for a, b in pairwise(jumps)
        if b - a >= SHORTEST_FLAT and np.std(y[a:b]) < 1.5 * sd and np.sign(y[a] - y[a - 1]) != np.sign(y[b] - y[b - 1])
    ]


def _apart(found: list[Stretch]) -> list[Stretch]:
    """Without stretches that lie in others."""
    out: list[Stretch] = []
    for one in sorted(found, key=lambda s: (s.start, -s.stop)):
        if not out or one.start >= out[-1].stop:
            out.append(one)
    return out
