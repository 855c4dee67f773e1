"""From streams of readings and commands to rows: readings at their stamps, commands held in between."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import count
from typing import Any

import numpy as np

from sksurrogate._stamps import GAP, MOST_GAPS, ON_GRID, SAME_STEP, rows_of_stamps
from sksurrogate.datasets._log_streams import Part, Record, Stream
from sksurrogate.exceptions import DataError

#: Share of a row by which a command may come late and count as given at its beginning: rounded stamps.
SAME_TIME = 1e-6


@dataclass(frozen=True, eq=False)
class Rows:
    """Stacked runs of a log."""

    X: np.ndarray  #: (n_samples, n_inputs)
    y: np.ndarray  #: (n_samples, n_outputs)
    groups: np.ndarray  #: (n_samples,)
    t: np.ndarray  #: (n_samples,) s
    dt: float
    even: bool  #: Whether rows are dt apart in every run
    notes: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class _Cut:
    """Readings of one run, with the commands of the whole part."""

    label: Any
    t: np.ndarray
    y: np.ndarray
    part: Part


def rows_of(record: Record, dt: float | None, pause: float) -> Rows:
    """Rows at the readings, each with the command from its stamp to the next.

    ``dt``: time between rows in s; that of the readings by default.
    ``pause``: a pause of so many usual steps starts a run, where the log does not name its runs.
    Raises DataError where no two readings follow a command, or the readings do not fit to ``dt``.
    """
    cuts, notes = _cuts(record, pause)
    step = record.step or _step([cut.t for cut in cuts])
    dt = step if dt is None else float(dt)
    if dt > (1.0 + SAME_STEP) * step:
        cuts = [_thinned(cut, dt, step) for cut in cuts]
    even = all(_on_grid(cut, dt) and not _has_gap(cut, dt, step) for cut in cuts)
    if not even and dt < (1.0 - SAME_STEP) * step:
        raise DataError(_too_fine(cuts, dt, step))
    laid = [_laid(cut, dt) if even else cut for cut in cuts]
    X = [_inputs(cut, record.inputs, dt, even) for cut in laid]
    labels = [np.full(len(cut.t), cut.label) for cut in laid]
    return Rows(
        np.concatenate(X), np.concatenate([cut.y for cut in laid]), np.concatenate(labels),
        np.concatenate([cut.t for cut in laid]), dt, even, (*record.notes, *notes),
    )  # fmt: skip


# ---- runs -------------------------------------------------------------------------------------------------------------
def _cuts(record: Record, pause: float) -> tuple[list[_Cut], list[str]]:
    """Runs of two readings and more, from the first command on, and what was left out."""
    cuts: list[_Cut] = []
    notes: list[str] = []
    early = alone = 0
    numbers = count()
    for part in record.parts:
        t, y, moved = merged(part.readings, record.outputs)
        notes += [
            f"Readings of {source} were moved by up to {by:.2g} s to the rows of the others." for source, by in moved
        ]
        known = t >= _first_command(part, record.inputs)
        early += int(np.sum(~known))
        t, y = t[known], y[known]
        usual = np.median(np.diff(t)) if len(t) > 1 else np.inf
        breaks = np.flatnonzero(np.diff(t) > (pause * usual if part.label is None else np.inf)) + 1
        for rows in np.split(np.arange(len(t)), breaks):
            if len(rows) < 2:
                alone += len(rows)
                continue
            label = next(numbers) if part.label is None else part.label
            cuts.append(_Cut(label, t[rows], y[rows], part))
    if not cuts:
        raise DataError(_nothing_left(record, early, alone))
    if early:
        notes.append(f"Left out, readings before the first command: {early}. What acted then is not known.")
    if alone:
        notes.append(f"Left out, readings alone between two pauses: {alone}.")
    return cuts, notes


def _nothing_left(record: Record, early: int, alone: int) -> str:
    """What to say where no run has two readings."""
    part = record.parts[0]
    if not early:
        return f"the log holds {alone} readings of {list(record.outputs)}; at least two in a row are needed."
    first, last = _first_command(part, record.inputs), max(stream.t[-1] for stream in part.readings)
    return (
        f"no two readings follow the first command: this comes at {first:.6g} s, the last reading at {last:.6g} s. Are they stamped "
        "by two clocks? clock='log' takes the times of recording for both."
    )


def _first_command(part: Part, inputs: Sequence[str]) -> float:
    """Time from which every input is known."""
    first = -np.inf
    for name in inputs:
        t, _ = _steps_of(part.commands, name)
        first = max(first, t[0] if len(t) else np.inf)
    return float(first)


# ---- readings ---------------------------------------------------------------------------------------------------------
def merged(streams: Sequence[Stream], names: Sequence[str]) -> tuple[np.ndarray, np.ndarray, list[tuple[str, float]]]:
    """Readings of several streams in rows.

    The stream with the most readings gives the rows. A reading of another one that is nearer than half a step to a row moves
    there; others are rows of their own. What a row lacks is nan.

    Returns ``t`` (n,), ``values`` (n, n_names), and what was moved: sources and the farthest way.

    >>> arm = Stream("arm", ("elbow.pos",), np.array([0.0, 1.0, 2.0]), np.array([[1.0], [2.0], [3.0]]))
    >>> hand = Stream("hand", ("grip.pos",), np.array([1.2]), np.array([[9.0]]))
    >>> t, values, moved = merged([arm, hand], ["elbow.pos", "grip.pos"])
    >>> values[1].tolist(), [(source, round(by, 9)) for source, by in moved]
    ([2.0, 9.0], [('hand', 0.2)])
    """
    order = sorted(streams, key=lambda stream: -len(stream.t))
    t, values, moved = order[0].t, _columns(order[0], names), []
    for stream in order[1:]:
        step = np.median(np.diff(t)) if len(t) > 1 else np.inf
        near = _nearest(t, stream.t)
        away = np.abs(stream.t - t[near])
        first = np.zeros(len(near), dtype=bool)
        first[np.unique(near, return_index=True)[1]] = True  # a second reading of one row is a row of its own
        fits = first & (away < 0.5 * step)
        read = _columns(stream, names)
        here = values[near[fits]]
        values[near[fits]] = np.where(np.isnan(here), read[fits], here)
        if np.any(away[fits] > SAME_TIME * step):
            moved.append((stream.source, float(away[fits].max())))
        t, values = np.concatenate([t, stream.t[~fits]]), np.concatenate([values, read[~fits]])
        rows = np.argsort(t, kind="stable")
        t, values = t[rows], values[rows]
    return t, values, moved


def _columns(stream: Stream, names: Sequence[str]) -> np.ndarray:
    """Values by name (n, n_names), nan where the stream lacks one."""
    out = np.full((len(stream.t), len(names)), np.nan)
    for j, name in enumerate(names):
        if name in stream.names:
            out[:, j] = stream.values[:, stream.names.index(name)]
    return out


def _nearest(t: np.ndarray, stamps: np.ndarray) -> np.ndarray:
    """Place in ``t`` nearest to every stamp."""
    above = np.clip(np.searchsorted(t, stamps), 1, max(len(t) - 1, 1))
    above = np.minimum(above, len(t) - 1)
    below = np.maximum(above - 1, 0)
    return np.where(stamps - t[below] <= t[above] - stamps, below, above)


# ---- a grid, where there is one ---------------------------------------------------------------------------------------
def _step(stamps: Sequence[np.ndarray]) -> float:
    """Usual step: the mean over steps without gaps, each counted in medians, so that rounding and jitter even out.

    >>> _step([np.array([0.0, 0.0333, 0.0667, 0.1]), np.array([0.0, 0.0333, 0.1])])
    0.0333333333
    """
    steps = np.concatenate([np.diff(t) for t in stamps])
    counts = np.maximum(1.0, np.round(steps / np.median(steps)))
    return float(f"{np.sum(steps) / np.sum(counts):.9g}")


def _thinned(cut: _Cut, dt: float, step: float) -> _Cut:
    """The reading nearest to every row of a coarser grid, if it is nearer than half a step of the readings."""
    rows, offset = rows_of_stamps(cut.t, dt)
    near = np.flatnonzero(np.abs(offset) <= (0.5 + ON_GRID) * step)
    order = near[np.lexsort((np.abs(offset[near]), rows[near]))]
    keep = np.sort(order[np.unique(rows[order], return_index=True)[1]])
    return replace(cut, t=cut.t[keep], y=cut.y[keep])


def _on_grid(cut: _Cut, dt: float) -> bool:
    """Whether the readings stand on the rows of a grid."""
    _, offset = rows_of_stamps(cut.t, dt)
    return bool(np.all(np.abs(offset) <= ON_GRID * dt))


def _has_gap(cut: _Cut, dt: float, step: float) -> bool:
    """Whether it is unknown what entered between two readings that are far apart."""
    return not cut.part.apart and bool(np.any(np.diff(cut.t) > GAP * max(dt, step)))


def _too_fine(cuts: Sequence[_Cut], dt: float, step: float) -> str:
    """What to say where rows between readings cannot be made."""
    if all(_on_grid(cut, dt) for cut in cuts):
        t = next(cut.t for cut in cuts if _has_gap(cut, dt, step))
        gap = int(np.argmax(np.diff(t)))
        return (
            f"dt={dt:g}: what entered in the gap from {t[gap]:g} to {t[gap + 1]:g} s is not known, so that it cannot be filled with rows: "
            "leave dt out, or let a run begin behind it (pause=, or labels of runs)."
        )
    return f"dt={dt:g}: the readings come every {step:.6g} s, not at multiples of dt: leave dt out, or give dt={step:.6g} or more."


def _laid(cut: _Cut, dt: float) -> _Cut:
    """A run on the grid, nan in y where nothing was read."""
    rows, _ = rows_of_stamps(cut.t, dt)
    n = int(rows[-1]) + 1
    if n > MOST_GAPS * len(rows):
        raise DataError(
            f"run {cut.label!r}: {len(rows)} readings are spread over {n} rows of dt={dt:g}: give a smaller pause=, a larger dt=, or "
            "label the parts between the gaps as runs of their own."
        )
    y = np.full((n, cut.y.shape[1]), np.nan)
    y[rows] = cut.y
    return replace(cut, t=cut.t[0] + dt * np.arange(n), y=y)


# ---- commands ---------------------------------------------------------------------------------------------------------
def _inputs(cut: _Cut, names: Sequence[str], dt: float, even: bool) -> np.ndarray:
    """Every input from each row to the next, (n_rows, n_inputs)."""
    edges = cut.t[0] + dt * np.arange(len(cut.t) + 1) if even else np.r_[cut.t, cut.t[-1] + dt]
    columns = [held(*_steps_of(cut.part.commands, name), edges, SAME_TIME * dt) for name in names]
    return np.stack(columns, axis=1) if columns else np.zeros((len(cut.t), 0))


def _steps_of(commands: Sequence[Stream], name: str) -> tuple[np.ndarray, np.ndarray]:
    """Stamps and values of one signal, those that are no number left out; of two at one time the later in the log counts."""
    own = [stream for stream in commands if name in stream.names]
    t = np.concatenate([stream.t for stream in own]) if own else np.empty(0)
    values = np.concatenate([s.values[:, s.names.index(name)] for s in own]) if own else np.empty(0)
    order = np.argsort(t, kind="stable")
    t, values = t[order], values[order]
    known = ~np.isnan(values)
    t, values = t[known], values[known]
    last = np.append(np.diff(t) > 0, True) if len(t) else np.empty(0, dtype=bool)
    return t[last], values[last]


def held(t: np.ndarray, values: np.ndarray, edges: np.ndarray, near: float) -> np.ndarray:
    """Means over rows of a command that is held from its stamp to the next: the command itself where none comes in between.

    ``t`` (n,), ``values`` (n,): stamps and commands.
    ``edges`` (n_rows + 1,): where rows begin, from the first stamp on.
    ``near``: a command so little behind an edge is given at it.

    >>> held(np.array([0.0, 1.5]), np.array([2.0, 4.0]), np.array([0.0, 1.0, 2.0, 3.0]), 0.0).tolist()
    [2.0, 3.0, 4.0]
    """
    place = np.maximum(np.searchsorted(t, edges + near, side="right") - 1, 0)
    inside = np.maximum(np.searchsorted(t, edges[1:] - near, side="left") - 1, place[:-1])
    total = np.append(0.0, np.cumsum(values[:-1] * np.diff(t)))
    integral = total[place] + values[place] * (edges - t[place])
    return np.where(inside == place[:-1], values[place[:-1]], np.diff(integral) / np.diff(edges))
