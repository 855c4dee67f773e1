"""Runs whose time stamps jitter or have gaps, laid on the even grid of a simulator."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from sksurrogate.exceptions import DataError
from sksurrogate.runs import Run, Runs

#: Share of a sample by which stamps may be off an even grid and count as on it: rounded stamps.
ON_GRID = 1e-3
#: The median step may differ from the simulator's by this share: beyond, one of the two is in another unit.
SAME_STEP = 0.25
#: A step of so many samples is a gap.
GAP = 1.5
#: Rows of a run between two gaps that can stand alone.
SHORTEST_PART = 8
#: Rows of the grid may be so many times those of the data: a record of gaps alone is not one run.
MOST_GAPS = 20


def rows_of_stamps(t: np.ndarray, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Row of the grid nearest to every stamp, counted from the first, and how far the stamp is behind it, in time.

    >>> rows_of_stamps(np.array([5.0, 6.2, 6.9, 9.0]), 1.0)[0]
    array([0, 1, 2, 4])
    """
    rows = np.round((t - t[0]) / dt).astype(int)
    return rows, t - t[0] - rows * dt


def on_grid(runs: Runs, dt: float, hold: str, time: Any) -> tuple[Runs, list[np.ndarray] | None]:
    """Runs on the even grid of a simulator.

    Rows without a reading hold nan in y. Inputs that are held (``hold="zoh"``) are averaged over every row of the grid, so that
    their integral is kept; others are joined linearly. Of two readings nearest to one row the nearer one counts.

    ``runs``: with y.
    ``dt``: sample time of the simulator.
    ``hold`` {"zoh", "foh"}.
    ``time``: what the time column is called, for messages.
    Returns ``runs``: with t = 0 at their first rows.
    Returns ``offsets`` list of (n_rows,), or None: how far the readings of every row were taken behind it; None where
        all were taken at their rows.
    Raises DataError where the usual step is not the simulator's, or a run is mostly gaps.
    """
    _check_step(runs, dt, time)
    if all(np.allclose(np.diff(run.t), dt, rtol=ON_GRID, atol=0.0) for run in runs):
        return replace(runs, runs=tuple(replace(run, t=run.t - run.t[0]) for run in runs)), None
    laid = [_laid(run, dt, hold, time) for run in runs]
    offsets = [offset for _, offset in laid]
    small = all(np.max(np.abs(offset), initial=0.0) <= ON_GRID * dt for offset in offsets)
    return replace(runs, runs=tuple(run for run, _ in laid)), None if small else offsets


def with_rows_in_gaps(runs: Runs, dt: float, hold: str, time: Any) -> tuple[Runs, bool, np.ndarray]:
    """Runs from stamp to stamp, for simulators that can be integrated so.

    Gaps across which no input differs are filled with rows of nan in y, about dt apart. Behind a gap across which one does, what
    entered the plant meanwhile is not known: the rest is a run of its own, with its own unknown initial state.
    Parameters as for :func:`on_grid`.

    Returns ``runs``: with t = 0 at the first rows of the runs that were given.
    Returns ``uneven``: whether rows are not dt apart.
    Returns ``first``: which of them begin a run that was given.
    """
    _check_step(runs, dt, time)
    out: list[Run] = []
    first: list[int] = []
    for run in runs:
        first.append(len(out))
        out += [_filled(part, dt, hold, time) for part in _parts(run, dt)]
    uneven = not all(np.allclose(np.diff(run.t), dt, rtol=ON_GRID, atol=0.0) for run in out)
    return replace(runs, runs=tuple(out)), uneven, np.array(first)


def _parts(run: Run, dt: float) -> list[Run]:
    """A run cut at gaps across which an input differs, where the parts are long enough."""
    t = run.t - run.t[0]
    differs = np.any(run.X[1:] != run.X[:-1], axis=1) if run.X.shape[1] else np.zeros(len(run) - 1, bool)
    cuts = [0]
    for cut in np.flatnonzero((np.diff(t) > GAP * dt) & differs) + 1:
        known = run.y is None or not np.isnan(run.y[cut:]).all()
        if cut - cuts[-1] >= SHORTEST_PART and len(run) - cut >= SHORTEST_PART and known:
            cuts.append(int(cut))
    out = []
    for a, b in zip(cuts, [*cuts[1:], len(run)]):
        label = run.label if a == 0 else f"{run.label} from t = {t[a]:g}" if run.label is not None else f"t = {t[a]:g}"
        y = None if run.y is None else run.y[a:b]
        out.append(replace(run, label=label, start=run.start + a, stop=run.start + b, X=run.X[a:b], y=y, t=t[a:b]))
    return out


def _filled(run: Run, dt: float, hold: str, time: Any) -> Run:
    """A run with rows of nan in its gaps."""
    parts = np.where(np.diff(run.t) > GAP * dt, np.round(np.diff(run.t) / dt), 1.0).astype(int)
    n = 1 + int(parts.sum())
    _check_gaps(run, n, dt, time)
    rows = np.r_[0, np.cumsum(parts)]
    stamps = np.interp(np.arange(n), rows, run.t)
    X, y = np.repeat(run.X, np.r_[parts, 1], axis=0), None
    if hold != "zoh" and run.X.shape[1]:
        X = _joined(run.X, run.t, stamps)
    if run.y is not None:
        y = np.full((n, run.y.shape[1]), np.nan)
        y[rows] = run.y
    return replace(run, stop=run.start + n, X=X, y=y, t=stamps)


def _check_gaps(run: Run, n: int, dt: float, time: Any) -> None:
    """A record of gaps alone is not one run."""
    if n > MOST_GAPS * len(run):
        raise DataError(
            f"time={time!r}, run {run.label!r}: {len(run)} rows are spread over {n} samples of dt={dt:g}: label the parts "
            "between the gaps as runs of their own (groups)."
        )


def _check_step(runs: Sequence[Run], dt: float, time: Any) -> None:
    """The median step is the simulator's."""
    steps = np.concatenate([np.diff(run.t) for run in runs])
    usual = float(np.median(steps)) if len(steps) else dt
    if abs(usual / dt - 1.0) > SAME_STEP:
        unit = " (milliseconds in the data?)" if abs(usual / dt / 1000.0 - 1.0) < SAME_STEP else ""
        raise DataError(
            f"time={time!r}: the usual step of the data is {usual:g}, the sample time of the simulator {dt:g}{unit}: "
            f"set dt={usual:g} there, or bring both to one unit."
        )


def _laid(run: Run, dt: float, hold: str, time: Any) -> tuple[Run, np.ndarray]:
    """One run on the grid, and the offsets of its rows."""
    rows, offset = rows_of_stamps(run.t, dt)
    n = int(rows[-1]) + 1
    n += bool(offset[-1] > ON_GRID * dt)  # a row behind the last reading, so that none is extrapolated
    _check_gaps(run, n, dt, time)
    grid = run.t[0] + dt * np.arange(n)
    X = _held(run.X, run.t, grid, dt) if hold == "zoh" else _joined(run.X, run.t, grid)
    order = np.argsort(-np.abs(offset), kind="stable")  # the nearest reading of a row is written last
    y, behind = np.full((n, run.y.shape[1] if run.y is not None else 0), np.nan), np.zeros(n)
    if run.y is not None:
        y[rows[order]] = run.y[order]
    behind[rows[order]] = offset[order]
    return replace(run, stop=run.start + n, X=X, y=None if run.y is None else y, t=grid - grid[0]), behind


def _held(X: np.ndarray, t: np.ndarray, grid: np.ndarray, dt: float) -> np.ndarray:
    """Means over the rows of a grid of inputs that are held from stamp to stamp."""
    edges = np.r_[grid, grid[-1] + dt]
    total = np.concatenate([np.zeros((1, X.shape[1])), np.cumsum(X[:-1] * np.diff(t)[:, None], axis=0)])
    place = np.clip(np.searchsorted(t, edges, side="right") - 1, 0, len(t) - 1)
    integral = total[place] + X[place] * (edges - t[place])[:, None]
    return np.diff(integral, axis=0) / dt


def _joined(X: np.ndarray, t: np.ndarray, grid: np.ndarray) -> np.ndarray:
    """Inputs that are joined linearly, at the rows of a grid."""
    return np.stack([np.interp(grid, t, column) for column in X.T], axis=1) if X.shape[1] else np.zeros((len(grid), 0))
