"""Readings that are wrong by themselves: against their neighbours before any model is fitted, and off the free run of a model."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from sksurrogate.effects._onset import WINDOW
from sksurrogate.gap.faults._corrections import WrongReadings, masked
from sksurrogate.gap.fit._backend import BaseCandidate
from sksurrogate.gap.fit._closeness import MOST_LEFT, SETTLED
from sksurrogate.gap.fit._evidence import Evidence
from sksurrogate.gap.fit._rounding import windowed_lattice
from sksurrogate.kernels.readings import Stretch, flat_stretches, out_of_reach, spans_where, spikes
from sksurrogate.kernels.record import Record
from sksurrogate.kernels.smoother import noise_of_differences

#: A simulator that moves by this share of what a reading moves by, at the same row, makes the move a thing of the plant.
EXPECTED = 0.3
#: Where readings stand on a grid, a jump below so many of its steps is one to the next level.
ONE_STEP = 1.5
#: Spikes that end at one value are dropouts from this many on.
LEAST_DROPOUTS = 2


def wrong_readings(record: Record, expected: Callable[[], np.ndarray | None]) -> list[WrongReadings]:
    """Spikes, dropouts and stretches in which a sensor stood still.

    ``expected`` (n_outputs, n_samples): outputs of the simulator alone, asked for only where something was found: what
        it does by itself is not a fault.
    """
    whole, far = record, [_out_of_reach(record, j) for j in range(len(record.y))]
    found = [(j, "spikes", s) for j, rows in enumerate(far) for s in _spans(rows, record, j)]
    record = masked(record, np.array(far)) if found else record
    sd = noise_of_differences(record.y, record.starts, record.known, record.t)
    for j, y in enumerate(record.y):
        least = 1.001e-4 * float(record.spread[j])  # the noise is not seen: nothing can be judged by it
        if not sd[j] > max(least, 1e-12):
            continue
        for a, b in record.spans:
            rows = np.arange(a, b) if record.known is None else a + np.flatnonzero(record.known[j, a:b])
            flat = flat_stretches(y[rows], sd[j])
            found += [(j, "stuck", _in_rows(s, rows)) for s in flat]
            short = spikes(_without(y[rows], flat), sd[j])
            found += [(j, "spikes", _in_rows(s, rows)) for s in short]
    grids = {j: windowed_lattice(record, j) for j in {j for j, _, _ in found}}
    found = [(j, kind, s) for j, kind, s in found if not _is_a_level(kind, s, record, grids[j])]
    model = expected() if found else None
    if model is not None:
        found = [(j, kind, s) for j, kind, s in found if not _is_expected(whole.y[j], model[j], s)]
    return _faults(whole, found)


def _out_of_reach(record: Record, j: int) -> np.ndarray:
    """Which readings of output j no plant gives, bool (n_samples,)."""
    far = np.zeros(record.y.shape[1], bool)
    far[record.rows_of(j)] = out_of_reach(record.measured(j))
    return far


def _spans(far: np.ndarray, record: Record, j: int) -> list[Stretch]:
    """Stretches of readings out of reach, and how far these are from the middle of all."""
    off = np.abs(record.y[j] - np.median(record.measured(j))) if far.any() else far
    return [Stretch(a, b, float(np.max(off[a:b]))) for a, b in spans_where(far)]


def _is_a_level(kind: str, s: Stretch, record: Record, grid: tuple[float, int, int] | None) -> bool:
    """Whether a stretch lies where readings stand on a grid: there they stay at a level, and jump by a step."""
    if grid is None:
        return False
    step, first, last = grid
    age = s.start - record.starts[np.searchsorted(record.starts, s.start, side="right") - 1]
    return bool(first <= age < last and (kind == "stuck" or s.size < ONE_STEP * step))


def _in_rows(s: Stretch, rows: np.ndarray) -> Stretch:
    """A stretch of measured readings as rows of the record."""
    return Stretch(int(rows[s.start]), int(rows[s.stop - 1]) + 1, s.size)


def _without(y: np.ndarray, flat: list[Stretch]) -> np.ndarray:
    """Readings with stretches joined linearly."""
    kept = np.ones(len(y), bool)
    for s in flat:
        kept[s.start : s.stop] = False
    rows = np.arange(len(y))
    return np.interp(rows, rows[kept], y[kept]) if kept.any() else y


def _is_expected(y: np.ndarray, model: np.ndarray, s: Stretch) -> bool:
    """Whether the simulator alone moves as the readings do at the ends of a stretch."""
    for row in (s.start, s.stop):
        if 0 < row < len(y):
            moved, own = y[row] - y[row - 1], model[row] - model[row - 1]
            if np.isfinite(own) and own * np.sign(moved) > EXPECTED * abs(moved) and abs(moved) > 0.5 * s.size:
                return True
    return False


def _faults(record: Record, found: list[tuple[int, str, Stretch]]) -> list[WrongReadings]:
    """One fault for each output and kind; spikes that fall to one value, and flat stretches entered by a jump, are dropouts."""
    parts: dict[tuple[str, int], list[Stretch]] = {}
    for j in sorted({j for j, _, _ in found}):
        own = [(kind, s) for i, kind, s in found if i == j]
        values = _landing(record.y[j], [s for _, s in own])
        for kind, s in own:
            jumped = s.start > 0 and abs(record.y[j, s.start] - record.y[j, s.start - 1]) > 0.5 * s.size
            drop = (kind == "stuck" and jumped) or (kind == "spikes" and record.y[j, s.start] in values)
            parts.setdefault(("dropouts" if drop else kind, j), []).append(s)
    out = []
    for (kind, j), stretches in parts.items():
        rows = np.unique(np.concatenate([np.arange(s.start, s.stop) for s in stretches]))
        out.append(WrongReadings(kind, j, rows, max(s.size for s in stretches)))
    return out


def _landing(y: np.ndarray, stretches: list[Stretch]) -> set[float]:
    """Values that several wrong readings share exactly, which a noisy signal does not."""
    first = [float(y[s.start]) for s in stretches]
    usual = set(np.delete(y, np.concatenate([np.arange(s.start, s.stop) for s in stretches])).tolist())
    return {v for v in first if (first.count(v) >= LEAST_DROPOUTS and v not in usual) or v == 0.0}


#: A reading is off from so many robust deviations of the residual on, and its neighbours are below this share of it.
OUTLYING, NEIGHBOURS_OF_OUTLIERS = 6.0, 0.35
#: Most readings in a row, and the largest share of all, that are off by themselves.
LONGEST_BURST, MOST_OUTLYING = 8, 0.05
#: Times that another output may leave as much there as elsewhere (RMS): a wrong reading is one of one sensor, a peak of the plant moves others.
SHARED = 2.0
#: They are the reason of what is left where the rest is at the noise, or where they hold this share of its power.
REASON = 0.5


def outlying_rows(residual: np.ndarray, starts: np.ndarray, noise: float = 0.0) -> np.ndarray:
    """Rows of isolated outliers in a residual (n_samples,): a rise and a fall within a few readings.

    ``noise``: deviation that the readings have where the median of the residual is smaller, as where some of them are rounded.

    >>> r = np.sin(np.arange(60.0))
    >>> r[[20, 21]] = 30.0
    >>> outlying_rows(r, np.array([0])).tolist()
    [20, 21]
    """
    scale = max(1.4826 * float(np.median(np.abs(residual))), noise)
    off = np.abs(residual) > OUTLYING * max(scale, 1e-300)
    first_rows = set(starts.tolist()) | {len(residual)}
    found = [
        np.arange(a, b)
        for a, b in spans_where(off)
        if b - a <= LONGEST_BURST
        and not first_rows & set(range(a, b + 1))  # at the ends of a run nothing returns
        and max(abs(residual[a - 1]), abs(residual[b])) < NEIGHBOURS_OF_OUTLIERS * np.max(np.abs(residual[a:b]))
    ]
    rows = np.concatenate(found) if found else np.zeros(0, dtype=int)
    return rows if len(rows) <= MOST_OUTLYING * len(residual) else rows[:0]


def outlying_beside(final: Evidence, null: BaseCandidate) -> WrongReadings | None:
    """Outlying readings on top of the names, or of the simulator alone where the names leave them too: names may stand in for them."""
    odd = outlying(final.candidate)
    if odd is not None or final.left < SETTLED or not final.effects:
        return odd
    odd = outlying(null)
    if odd is None:
        return None
    left, alone = (np.sum(model.residual[odd.output, odd.rows] ** 2) for model in (final.candidate, null))
    return odd if left > MOST_LEFT**2 * alone else None


def shared_with_others(residual: np.ndarray, j: int, rows: np.ndarray) -> bool:
    """Whether another output than j leaves clearly more at some rows than elsewhere: then what acts there is of the plant.

    ``residual`` (n_outputs, n_samples).

    >>> r = np.sin(np.arange(120.0)).reshape(2, 60)
    >>> r[0, 20] = 30.0
    >>> alone = shared_with_others(r, 0, np.array([20]))
    >>> r[1, 20] = 9.0
    >>> alone, shared_with_others(r, 0, np.array([20]))
    (False, True)
    """
    others = np.delete(residual, j, axis=0) ** 2
    elsewhere = np.mean(np.delete(others, rows, axis=1), axis=1)
    return bool(np.any(np.mean(others[:, rows], axis=1) > SHARED**2 * elsewhere))


def at_an_edge(model: BaseCandidate, rows: np.ndarray) -> np.ndarray:
    """Which rows lie where an effect of a model begins or ends: what is off there is a matter of its time, no reading."""
    named = [zip(effect.parameters, model.theta_of(i)) for i, effect in enumerate(model.effects)]
    edges = [float(value) for pairs in named for parameter, value in pairs if parameter.name in ("time", *WINDOW)]
    record, at = model.problem.record, np.zeros(len(rows), bool)
    for edge in edges:
        at |= np.abs(record.t[rows] - edge) <= LONGEST_BURST * record.dt
    return at


def outlying(model: BaseCandidate) -> WrongReadings | None:
    """Outlying readings of one output alone, where they hold most of what is left there; None without any."""
    record, residual = model.problem.record, model.residual
    for j, r in enumerate(residual):
        rows = outlying_rows(r, record.starts, float(model.problem.sd[j]))
        rows = rows[~at_an_edge(model, rows)]
        rest = np.delete(r, rows)
        near = np.sqrt(np.mean(rest**2)) < SETTLED * model.problem.sd[j]
        most = near or np.sum(r[rows] ** 2) > REASON * np.sum(r**2)
        if len(rows) and most and not shared_with_others(residual, j, rows):
            return WrongReadings("spikes", j, rows, float(np.max(np.abs(r[rows]))))
    return None
