"""What a user gives as X, y and groups becomes a sequence of :class:`Run`, here and once: all other files take runs as checked."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sksurrogate._tables import (
    LEFT_OUT,
    as_labels,
    as_table,
    column_number,
    floats,
    labels_from_index,
    no_inputs,
    outputs_of,
    raw_column,
    refuse_missing,
    refuse_unlabelled,
    refuse_unseen,
    unmasked,
)
from sksurrogate.exceptions import DataError, RunError

__all__ = ["Run", "Runs", "cut_runs", "resolve_runs", "stack_runs", "unstack_runs"]


@dataclass(frozen=True, eq=False)
class Run:
    """One run: rows ``start:stop`` of the stacked data, in time order.

    Attributes
    ----------
    label : object
        What the user calls this run.
    start, stop : int
        Rows in the stacked data.
    X : ndarray (n_samples, n_inputs)
    y : ndarray (n_samples, n_outputs) or None
    t : ndarray (n_samples,)
        Time of each row; starts at 0 unless a time column was named.

    Examples
    --------
    >>> [(run.label, run.start) for run in resolve_runs([[1.0], [2.0], [3.0]], groups=[0, 0, 1])]
    [(0, 0), (1, 2)]
    """

    label: Any
    start: int
    stop: int
    X: np.ndarray
    y: np.ndarray | None
    t: np.ndarray

    def __len__(self) -> int:
        return self.stop - self.start


@dataclass(frozen=True, eq=False)
class Runs(Sequence):
    """The runs of one data set and what was learned at the border.

    Attributes
    ----------
    runs : tuple of Run
    n_samples : int
        Rows of the stacked data, rows that were left out included.
    dt : float
        Sample time.
    input_names, output_names : tuple of str or None
        Column names where a frame was given (run and time columns left out).
    y_is_1d : bool
        Whether y came as (n_samples,).

    Examples
    --------
    >>> len(resolve_runs([[1.0], [2.0], [3.0]], groups=["a", "a", "b"]))
    2
    """

    runs: tuple[Run, ...]
    n_samples: int
    dt: float
    input_names: tuple[str, ...] | None = None
    output_names: tuple[str, ...] | None = None
    y_is_1d: bool = True

    def __len__(self) -> int:
        return len(self.runs)

    def __getitem__(self, index: Any) -> Any:
        return self.runs[index]

    def unstack(self, rows: np.ndarray) -> list[np.ndarray]:
        """Cut an array of ``n_samples`` rows into runs."""
        return [rows[run.start : run.stop] for run in self.runs]

    def stack(self, parts: Sequence[np.ndarray]) -> np.ndarray:
        """Join one array per run to ``n_samples`` rows; rows that belong to no run are nan."""
        out = np.full((self.n_samples, *np.shape(parts[0])[1:]), np.nan)
        for run, part in zip(self.runs, parts):
            out[run.start : run.stop] = part
        return out


def resolve_runs(
    X: Any,
    y: Any = None,
    *,
    groups: Any = None,
    run: str | int | None = None,
    time: str | int | None = None,
    dt: float | None = None,
    allow_uneven: bool = False,
    allow_nan: bool = False,
    unmeasured: bool = False,
    min_rows: int = 1,
) -> Runs:
    """Turn data in the package's convention into runs.

    Parameters
    ----------
    X : array-like or frame (n_samples, n_columns), or None
        Inputs, and the run and time columns where they are named; None where there are no inputs.
    y : array-like (n_samples,) or (n_samples, n_outputs), optional
        Outputs.
    groups : array-like (n_samples,), optional
        Label of the run of each row; wins over ``run``. Label -1 (among texts "-1") means: in no run.
    run : None, column name, int or "index"
        Where X itself says which run a row belongs to. None: one run.
    time : column name or int, optional
        Column of X that holds the time.
    dt : float, optional
        Sample time; by default that of the time column, else 1.
    allow_uneven : bool, default=False
        Whether uneven sampling is accepted.
    allow_nan : bool, default=False
        Whether missing values are accepted.
    unmeasured : bool, default=False
        Whether nan in y is accepted: an output that was not measured in that row.
    min_rows : int, default=1
        Rows that every run needs.

    Returns
    -------
    Runs

    Raises
    ------
    DataError
        Lengths differ, a value is missing or infinite, a column is unknown, sampling is uneven.
    RunError
        A run is in two pieces or too short.

    Examples
    --------
    >>> runs = resolve_runs([[1.0], [2.0], [3.0]], [4.0, 5.0, 6.0], groups=["a", "a", "b"], dt=0.1)
    >>> [(r.label, len(r)) for r in runs]
    [('a', 2), ('b', 1)]
    """
    columns = _columns_of(no_inputs(y, groups) if X is None else X, run, time)
    n_samples = len(columns.table)
    labels = columns.labels if groups is None else _labels_of(groups, n_samples)
    refuse_unlabelled(labels, "groups" if groups is not None else f"run={run!r}")
    inputs = floats(columns.table, "X", columns.names)
    outputs, output_names, is_1d = outputs_of(y, n_samples)
    if not allow_nan:
        refuse_missing(inputs, "X", columns.names, labels)
        if outputs is not None:
            given = np.where(np.isnan(outputs), 0.0, outputs) if unmeasured else outputs
            refuse_missing(given, "y", output_names, labels)
    pieces = _pieces(labels, n_samples, min_rows)
    if unmeasured and outputs is not None:
        refuse_unseen(outputs, output_names, pieces)
    if columns.clock is not None:
        refuse_missing(columns.clock[:, None], f"time={time!r}", None, labels)
    step, times = _times(columns.clock, pieces, dt, allow_uneven, time)
    runs = tuple(
        Run(label, a, b, inputs[a:b], None if outputs is None else outputs[a:b], t)
        for (label, a, b), t in zip(pieces, times)
    )
    return Runs(
        runs,
        n_samples,
        step,
        tuple(columns.names) if columns.names else None,
        tuple(output_names) if output_names else None,
        is_1d,
    )


@dataclass(frozen=True, eq=False)
class _Columns:
    """What the columns of X are."""

    table: np.ndarray  #: (n_samples, n_inputs)
    names: list[str] | None  #: Of the inputs
    labels: np.ndarray | None  #: (n_samples,): runs
    clock: np.ndarray | None  #: (n_samples,): times


def _columns_of(X: Any, run: str | int | None, time: str | int | None) -> _Columns:
    """Inputs, run labels and times of X."""
    frame = X if hasattr(X, "columns") else None
    names = [str(c) for c in frame.columns] if frame is not None else None
    labels = labels_from_index(frame) if run == "index" else None
    clock, table, drop = None, as_table(X), []
    if run is not None and run != "index":
        drop.append(column_number(run, names, table.shape[1], "run"))
        labels = raw_column(table, drop[-1])
    if time is not None:
        drop.append(column_number(time, names, table.shape[1], "time"))
        clock = floats(table[:, drop[-1]], f"time={time!r}")
    keep = [j for j in range(table.shape[1]) if j not in drop]
    return _Columns(table[:, keep] if drop else table, [names[j] for j in keep] if names else None, labels, clock)


def _labels_of(groups: Any, n_samples: int) -> np.ndarray:
    """Run labels (n_samples,)."""
    labels = as_labels(groups)
    if labels.ndim != 1 or len(labels) != n_samples:
        raise DataError(
            f"groups has shape {labels.shape}, but X has {n_samples} rows: give one label per row, e.g. groups=run_ids."
        )
    return labels


def stack_runs(X: Sequence[Any], y: Sequence[Any] | None = None) -> tuple:
    """Stack a list of runs: ``stack_runs([X1, X2], [y1, y2]) -> X, y, groups``.

    Parameters
    ----------
    X : list of array-like (n_samples_of_the_run, n_inputs)
    y : list of array-like (n_samples_of_the_run,) or (n_samples_of_the_run, n_outputs), optional

    Returns
    -------
    X, y, groups : ndarray
        y is None where none was given; groups numbers the runs from 0.

    Examples
    --------
    >>> X, y, groups = stack_runs([[[1.0], [2.0]], [[3.0]]], [[1.0, 2.0], [3.0]])
    >>> groups
    array([0, 0, 1])
    """
    if y is not None and len(X) != len(y):
        raise DataError(f"X is a list of {len(X)} runs and y of {len(y)}: give one entry per run in both.")
    parts = [np.asarray(unmasked(part)) for part in X]
    if not parts:
        raise DataError("X holds no run: give a list of at least one array.")
    for k, part in enumerate(parts):
        if part.shape[1:] != parts[0].shape[1:]:
            raise DataError(
                f"run {k} of X has shape {part.shape} and run 0 {parts[0].shape}: all need the same columns."
            )
    groups = np.repeat(np.arange(len(parts)), [len(part) for part in parts])
    if y is None:
        return np.concatenate(parts), None, groups
    targets = [np.asarray(unmasked(part)) for part in y]
    for k, (a, b) in enumerate(zip(parts, targets)):
        if len(a) != len(b):
            raise DataError(f"run {k}: X has {len(a)} rows and y has {len(b)}: the rows of a run belong together.")
    return np.concatenate(parts), np.concatenate(targets), groups


def unstack_runs(X: Any, groups: Any) -> list[np.ndarray]:
    """Inverse of :func:`stack_runs` for one array: a list with one array per run.

    Parameters
    ----------
    X : array-like (n_samples, ...)
    groups : array-like (n_samples,)
        Rows labelled -1 (among texts "-1") are left out.

    Returns
    -------
    list of ndarray

    Examples
    --------
    >>> unstack_runs([1.0, 2.0, 3.0], [0, 0, 1])
    [array([1., 2.]), array([3.])]
    """
    rows = np.asarray(unmasked(X))
    return [rows[a:b] for _, a, b in _pieces(as_labels(groups), len(rows), 1)]


def cut_runs(groups: Any, n_blocks: int, gap: int = 0) -> np.ndarray:
    """Cut every run into blocks that count as runs, so that ``GroupKFold`` works on one long record.

    Parameters
    ----------
    groups : array-like (n_samples,) or int
        Labels of the runs, or the number of rows of a single run.
    n_blocks : int
        Blocks per run.
    gap : int, default=0
        Rows left out (label -1) between two blocks of a run.

    Returns
    -------
    ndarray of int (n_samples,)
        New labels 0, 1, ...; -1 in the gaps.

    Examples
    --------
    >>> cut_runs(7, n_blocks=2, gap=1)
    array([ 0,  0,  0, -1,  1,  1,  1])
    """
    for name, value, least in (("n_blocks", n_blocks, 1), ("gap", gap, 0)):
        if not isinstance(value, (int, np.integer)) or value < least:
            raise DataError(f"{name}={value!r} must be an int of at least {least}.")
    labels = np.zeros(groups, dtype=int) if isinstance(groups, (int, np.integer)) else as_labels(groups)
    out = np.full(len(labels), LEFT_OUT)
    count = 0
    for label, a, b in _pieces(labels, len(labels), 1):
        rows = b - a - gap * (n_blocks - 1)
        if rows < n_blocks:
            raise RunError(
                f"run {label!r} has {b - a} rows: {n_blocks} blocks with gaps of {gap} rows do not fit; lower n_blocks or gap."
            )
        edges = a + np.round(np.linspace(0, rows, n_blocks + 1)).astype(int)
        for k in range(n_blocks):
            out[edges[k] + k * gap : edges[k + 1] + k * gap] = count
            count += 1
    return out


def _pieces(labels: np.ndarray | None, n_samples: int, min_rows: int) -> list[tuple[Any, int, int]]:
    """(label, start, stop) of every run; a run in two pieces is an error."""
    if labels is None:
        pieces = [(None, 0, n_samples)]
    else:
        starts = np.flatnonzero(np.r_[True, labels[1:] != labels[:-1]])
        stops = np.r_[starts[1:], n_samples]
        pieces = []
        seen: dict[Any, tuple[int, int]] = {}
        for label, a, b in zip(labels[starts].tolist(), starts.tolist(), stops.tolist()):
            if label == LEFT_OUT:
                continue
            if label in seen:
                raise RunError(
                    f"run {label!r} is in two pieces: rows {seen[label][0]}..{seen[label][1] - 1} and again from row {a}. "
                    "The rows of a run must be adjacent and in time order: sort by run, or give the second piece its own label."
                )
            seen[label] = (a, b)
            pieces.append((label, a, b))
        if not pieces:
            raise RunError("every row is labelled -1 (left out): no run remains.")
    for label, a, b in pieces:
        if b - a < min_rows:
            name = "the data have" if label is None else f"run {label!r} has"
            raise RunError(
                f"{name} {b - a} rows (n_samples={b - a}), but {min_rows} are needed here: give longer runs or fewer lags."
            )
    return pieces


def _times(
    clock: np.ndarray | None,
    pieces: list[tuple[Any, int, int]],
    dt: float | None,
    allow_uneven: bool,
    time: str | int | None,
) -> tuple[float, list[np.ndarray]]:
    """Sample time and the time of every row."""
    if dt is not None and not (np.isfinite(dt) and dt > 0):
        raise DataError(f"dt={dt!r} must be a positive number of time units.")
    if clock is None:
        step = 1.0 if dt is None else float(dt)
        grid = step * np.arange(max(b - a for _, a, b in pieces))  # one for all runs
        return step, [grid[: b - a] for _, a, b in pieces]
    steps = [np.diff(clock[a:b]) for _, a, b in pieces]
    joined = np.concatenate(steps) if steps else np.empty(0)
    step = float(dt) if dt is not None else (float(np.median(joined)) if len(joined) else 1.0)
    for (label, a, _), difference in zip(pieces, steps):
        wrong = difference <= 0
        if not allow_uneven:
            wrong |= ~np.isclose(difference, step, rtol=1e-3, atol=0)
        if wrong.any():
            row = a + int(np.flatnonzero(wrong)[0])
            found = clock[row + 1] - clock[row]
            if found <= 0:
                problem = f"time does not increase after row {row} ({clock[row]:g} -> {clock[row + 1]:g}): sort the rows, or name the run column"
            else:
                problem = (
                    f"uneven sampling after row {row}: step {found:g}, expected {step:g}; resample to an even grid"
                )
            raise DataError(f"time={time!r}, run {label!r}: {problem}.")
    return step, [clock[a:b] for _, a, b in pieces]
