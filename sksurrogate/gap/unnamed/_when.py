"""When a force is there: its level over the time since the start of a run, or over the runs."""

from __future__ import annotations

import numpy as np

from sksurrogate.gap.results._table import Table
from sksurrogate.kernels.record import Record

#: Blocks of time in which changes are looked for.
N_BLOCKS = 12
#: A change, or a slope, is one where it leaves less than this share of the squares about the mean: of blocks, and of runs, which
#: are fewer.
LEFT_IN_BLOCKS, LEFT_IN_RUNS = 0.2, 0.1
#: The mean of the blocks shows a change where it holds this share of their power; their size, where it grows by this factor.
SHARE_OF_MEAN, GROWTH_OF_SIZE = 0.25, 2.0
#: Runs among which a change is looked for, and the growth of the force from one to the next that is one.
FEWEST_TO_COMPARE, GROWTH_BETWEEN_RUNS = 4, 3.0


def left_by_cut(z: np.ndarray) -> np.ndarray:
    """Squares that two levels leave of a series (n,), the second from place 1, 2, ... n - 1 on, (n - 1,).

    >>> left_by_cut(np.array([1.0, 1.0, 4.0])).round(12).tolist()
    [4.5, 0.0]
    """
    z = z - z.mean()
    first, square = np.arange(1, len(z)), np.cumsum(z**2)
    total = np.cumsum(z)[:-1]
    return np.asarray(square[-1] - total**2 / first - total**2 / (len(z) - first))


def times(record: Record, w: np.ndarray) -> Table:
    """Level of a force (n_samples,) over the time since the start of the run: constant, one change, or a drift.

    A force that does not change within the runs may change from one run to the next, as a plant that wears does.
    """
    age = record.t - record.t[record.starts][record.run_of_row]
    edges = np.linspace(0.0, float(age.max()) + record.dt, N_BLOCKS + 1)
    block = np.clip(np.searchsorted(edges, age, side="right") - 1, 0, N_BLOCKS - 1)
    n = np.maximum(np.bincount(block, minlength=N_BLOCKS), 1)
    mean = np.bincount(block, w, N_BLOCKS) / n
    level = np.sqrt(np.bincount(block, w**2, N_BLOCKS) / n)
    kind, cut, signed = _change(mean, level)
    runs = _by_run(record, w) if kind == "constant" else None
    if runs is not None:
        return runs
    spans = [(0.0, float(edges[-1]))]
    if kind == "change":
        instant = _instant(age, w if signed else np.abs(w), edges[cut], 2.0 * edges[1])
        spans = [(0.0, instant), (instant, float(edges[-1]))]
    elif kind == "drift":
        spans = list(zip(edges[:-1].tolist(), edges[1:].tolist()))
    inside = [(a, z, w[(age >= a) & (age < z)]) for a, z in spans]
    return Table(tuple(_row(a, z, _rms(part), kind, "all") for a, z, part in inside if len(part)))


def _by_run(record: Record, w: np.ndarray) -> Table | None:
    """The runs before and after a change between runs, counted from 1 (a record has no labels); None where all are alike."""
    n_runs = len(record.starts)
    if n_runs < FEWEST_TO_COMPARE:
        return None
    mean = np.add.reduceat(w, record.starts) / record.lengths
    level = np.sqrt(np.add.reduceat(w**2, record.starts) / record.lengths)
    cut = min(_best_cut(mean), _best_cut(np.log(np.maximum(level, 1e-300))))
    first, last = _rms(level[: cut[1]]), _rms(level[cut[1] :])
    if cut[0] >= LEFT_IN_RUNS or max(first, last) < GROWTH_BETWEEN_RUNS * min(first, last):
        return None
    stop, kind = float(np.max(record.lengths)) * record.dt, "change between runs"
    parts = (first, 1, cut[1]), (last, cut[1] + 1, n_runs)
    return Table(tuple(_row(0.0, stop, size, kind, f"{a} to {b}" if a < b else str(a)) for size, a, b in parts))


def _change(mean: np.ndarray, level: np.ndarray) -> tuple[str, int, bool]:
    """One jump, one slope, or neither, over blocks; whether the mean (not the size) says so."""
    tried: list[tuple[float, str, int, bool]] = [(LEFT_IN_BLOCKS, "constant", 0, True)]
    if np.sum((mean - mean.mean()) ** 2) >= SHARE_OF_MEAN * np.sum(level**2):
        tried += [(*one, True) for one in _jump_and_slope(mean)]
    if np.max(level) >= GROWTH_OF_SIZE * np.min(level):
        tried += [(*one, False) for one in _jump_and_slope(np.log(np.maximum(level, 1e-300)))]
    _, kind, cut, signed = min(tried, key=lambda one: one[0])
    return kind, cut, signed


def _jump_and_slope(series: np.ndarray) -> list[tuple[float, str, int]]:
    """Share of the squares about the mean that the best slope and the best jump leave, and where the jump is."""
    left, cut = _best_cut(series)
    place = np.arange(len(series))
    line = np.polyval(np.polyfit(place, series, 1), place)
    return [(float(np.sum((series - line) ** 2)) / _squares(series), "drift", 0), (left, "change", cut)]


def _best_cut(series: np.ndarray) -> tuple[float, int]:
    """Share of the squares about the mean that the best two levels leave, and the first place of the second level."""
    left = left_by_cut(series)
    return float(np.min(left)) / _squares(series), 1 + int(np.argmin(left))


def _squares(series: np.ndarray) -> float:
    """About the mean."""
    return float(np.sum((series - series.mean()) ** 2)) + 1e-300


def _instant(age: np.ndarray, z: np.ndarray, guess: float, reach: float) -> float:
    """The moment within reach of a guess that parts a series best into two levels."""
    order = np.argsort(age, kind="stable")
    moments, place = np.unique(age[order], return_index=True)
    able = (np.abs(moments - guess) <= reach) & (place > 0)
    if not able.any():
        return guess
    left = left_by_cut(z[order])[place[able] - 1]
    return float(moments[able][np.argmin(left)])


def _rms(values: np.ndarray) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(values**2)))


def _row(start: float, stop: float, level: float, kind: str, runs: str) -> dict[str, object]:
    """One span of time."""
    return {"start": start, "stop": stop, "level": level, "kind": kind, "runs": runs}
