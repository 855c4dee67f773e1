"""Joint logs whose signals share their rows: CSV, and NPZ with an array for each signal or for several."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sksurrogate._close_names import did_you_mean
from sksurrogate._csv import read_csv, read_header
from sksurrogate._headers import columns_of, split_unit
from sksurrogate.datasets._log_streams import Asked, Part, Record, Stream, chosen, columns_by_name, distinct, shown
from sksurrogate.exceptions import DataError
from sksurrogate.runs import resolve_runs

#: What columns of the time and of the run are called by default.
TIMES, RUNS = ("time", "timestamp", "t"), ("run", "episode_index")


def read_csv_log(path: Path, asked: Asked) -> Record:
    """A CSV with a column for each signal; an empty cell of an output is nan."""
    _refuse_sources(path, asked)
    header = read_header(path)
    bare = [split_unit(column)[0] for column in header]
    known = list(dict.fromkeys([*bare, *header]))
    time, run = _mark("time", asked.time, known, TIMES), _mark("run", asked.run, known, RUNS)
    there = [name for name in known if name not in (time, run)]
    inputs, outputs = (_named(argument, getattr(asked, argument), there) for argument in ("inputs", "outputs"))
    signals = list(dict.fromkeys([*inputs.values(), *outputs.values()]))
    column = columns_of([*signals, *filter(None, (time, run))], header, {})
    gaps = [column[name] for name in outputs.values() if name not in inputs.values()]
    values, labels = read_csv(
        path, [column[name] for name in signals], column.get(run or ""), column.get(time or ""), gaps
    )
    n = len(next(iter(values.values())))
    X, y = (
        np.array([values[column[old]] for old in pairs.values()]).reshape(len(pairs), n).T
        for pairs in (inputs, outputs)
    )
    clock = values[column[time]] if time else None
    return table_record(path.name, X, y, tuple(inputs), tuple(outputs), clock, labels, asked.dt)


def read_npz_log(path: Path, asked: Asked) -> Record:
    """An NPZ: arrays (n_samples,) by the names of signals, or (n_samples, n_signals), perhaps with their ``<key>_names``."""
    arrays = _Arrays(path)
    time, run = _mark("time", asked.time, arrays.keys, TIMES), _mark("run", asked.run, arrays.keys, RUNS)
    there = [key for key in arrays.keys if key not in (time, run)]
    inputs = _side(arrays, there, "inputs", asked.inputs, "commands", asked.commands, "X")
    outputs = _side(arrays, there, "outputs", asked.outputs, "readings", asked.readings, "y")
    clock, labels = (arrays.column(key) if key else None for key in (time, run))
    n = arrays.length(path.name)
    X, y = (np.array([*columns.values()], dtype=float).reshape(len(columns), n).T for columns in (inputs, outputs))
    return table_record(path.name, X, y, tuple(inputs), tuple(outputs), clock, labels, asked.dt)


def _side(
    arrays: _Arrays, there: Sequence[str], argument: str, names: Any, other: str, tables: Sequence[str], usual: str
) -> dict[str, np.ndarray]:
    """Inputs or outputs of an NPZ by the names asked for: from ``tables``, or the ``usual`` one, or arrays of their own."""
    if not tables and (usual not in there or _by_key(names, there)):
        return {name: arrays.signal(argument, other, key) for name, key in _named(argument, names, there).items()}
    streams = distinct([arrays.stream(other, key) for key in tables or (usual,)])
    known = list(dict.fromkeys(name for stream in streams for name in stream.names))
    pairs = chosen(argument, names, known, known, all(stream.numbered for stream in streams))
    return columns_by_name(streams, pairs)


def table_record(
    name: str, X: np.ndarray, y: np.ndarray, inputs: tuple[str, ...], outputs: tuple[str, ...], clock: np.ndarray | None,
    labels: np.ndarray | None, dt: float | None, step: float | None = None,
) -> Record:  # fmt: skip
    """The runs of a table.

    ``name``: of the file, for messages.
    ``clock`` (n_samples,): s, or None where rows are ``dt`` apart.
    ``labels`` (n_samples,): of the runs; None where pauses part them.
    ``step``: time between two rows in s where the format says it.
    Raises DataError where an input is not finite, time does not increase within a run, or neither clock nor dt is there.
    """
    if not outputs:
        raise DataError(f"outputs: no signal of {name} is read; name at least one.")
    bad = ~np.isfinite(X)
    if bad.any():
        row, j = (int(i) for i in np.argwhere(bad)[0])
        raise DataError(
            f"{name}: input {inputs[j]!r} is {X[row, j]} in row {row}; {int(bad.sum())} values in all. Fill them, or start a new run "
            "behind them; only outputs may be nan, where nothing was measured."
        )
    if clock is None and dt is None:
        raise DataError(f"{name} has no time: give dt=, the time between two rows in s, or time= with its name there.")
    parts = []
    for run in resolve_runs(X, y, groups=labels, unmeasured=True):
        rows = slice(run.start, run.stop)
        t = float(dt or 0.0) * np.arange(len(run)) if clock is None else np.asarray(clock[rows], dtype=float)
        back = np.flatnonzero(~(np.diff(t) > 0))
        if len(back):
            row = run.start + int(back[0])
            raise DataError(
                f"{name}: time does not increase after row {row} ({t[back[0]]:g} -> {t[back[0] + 1]:g}): sort the rows, delete one of "
                "two at the same time, or name the column of the runs with run=."
            )
        parts.append(Part((Stream(name, outputs, t, y[rows]),), (Stream(name, inputs, t, X[rows]),), run.label))
    return Record(tuple(parts), inputs, outputs, dt if clock is None else step)


# ---- which columns ----------------------------------------------------------------------------------------------------
def _named(argument: str, names: Any, there: Sequence[str]) -> dict[str, str]:
    """Signals of a file that has names and does not say which are inputs: name asked for -> name in the file."""
    states = [name for name in there if name.endswith((".pos", ".vel"))]
    if names is None and argument == "inputs":
        raise DataError(
            f"inputs=None: the file does not say which of its signals are inputs; name them (inputs=[] for none) out of {shown(there)}."
        )
    if names is None and not states:
        raise DataError(
            f"outputs=None: no signal of the file is called <joint>.pos or <joint>.vel; name the outputs out of {shown(there)}."
        )
    return chosen(argument, names, there, states)


def _mark(argument: str, name: str | None, known: Sequence[str], usual: Sequence[str]) -> str | None:
    """Column of the time or of the runs; without a name one of the usual, if it is there."""
    if name is None:
        return next((one for one in usual if one in known), None)
    if name not in known:
        raise DataError(
            f"{argument}={name!r} is not in the log;{did_you_mean(name, known)} Its signals are {shown(known)}."
        )
    return name


def _refuse_sources(path: Path, asked: Asked) -> None:
    """A CSV has no topics."""
    for argument in ("readings", "commands"):
        if getattr(asked, argument):
            raise DataError(
                f"{argument}={list(getattr(asked, argument))}: {path.name} is a CSV, which has columns alone; name them with inputs= and outputs=."
            )


# ---- NPZ --------------------------------------------------------------------------------------------------------------
def _by_key(names: Any, keys: Sequence[str]) -> bool:
    """Whether a signal that is asked for is an array of its own."""
    if names is None:
        return False
    named = list(names.values()) if isinstance(names, Mapping) else [names] if isinstance(names, str) else list(names)
    return any(name in keys for name in named)


class _Arrays:
    """Arrays of an NPZ, all as long as the first that was read."""

    def __init__(self, path: Path):
        self.path = path
        self.lengths: dict[str, int] = {}
        try:
            with np.load(path, allow_pickle=False) as data:
                self.keys = list(data.files)
        except (OSError, ValueError, zipfile.BadZipFile, AttributeError) as error:
            raise DataError(f"{path.name} is no NPZ that can be read ({error}): write it with numpy.savez.") from error

    def read(self, key: str) -> np.ndarray:
        """One array as it is."""
        try:
            with np.load(self.path, allow_pickle=False) as data:
                return data[key]
        except Exception as error:  # Python objects, or a damaged archive, which fails in a dozen ways
            raise DataError(
                f"{self.path.name}: the array {key!r} cannot be read ({error}): write it as numbers with numpy.savez."
            ) from error

    def column(self, key: str) -> np.ndarray:
        """An array (n_samples,)."""
        values = self.read(key)
        values = values[:, 0] if values.ndim == 2 and values.shape[1] == 1 else values
        if values.ndim != 1:
            raise DataError(f"{self.path.name}: {key!r} has shape {values.shape}, expected (n_samples,).")
        return self._as_long(key, values)

    def signal(self, argument: str, other: str, key: str) -> np.ndarray:
        """One signal (n_samples,)."""
        values = self.read(key)
        if values.ndim > 1 and values.shape[1:] != (1,):
            raise DataError(
                f"{argument}: {key!r} of {self.path.name} has shape {values.shape}, expected (n_samples,). Where it holds several "
                f"signals, give {other}={key!r} and their names in {argument}=."
            )
        return self._numbers(key, self.column(key))

    def stream(self, argument: str, key: str) -> Stream:
        """Signals of an array (n_samples, n_signals) or (n_samples,)."""
        if key not in self.keys:
            raise DataError(
                f"{argument}={key!r} is not in {self.path.name};{did_you_mean(key, self.keys)} its arrays are {shown(self.keys)}."
            )
        values = self.read(key)
        if values.ndim not in (1, 2):
            raise DataError(
                f"{argument}={key!r} has shape {values.shape}, expected (n_samples, n_signals) or (n_samples,): stack runs of equal length "
                "(array.reshape(-1, n_signals)) and write their labels as an array 'run'."
            )
        values = self._as_long(key, self._numbers(key, values))
        if values.ndim == 1:
            return Stream(key, (key,), np.empty(0), values[:, None])
        width = values.shape[1]
        if f"{key}_names" not in self.keys:
            return Stream(key, tuple(f"{key}[{j}]" for j in range(width)), np.empty(0), values, numbered=True)
        names = tuple(str(name) for name in np.ravel(self.read(f"{key}_names")))
        if len(names) != width or len(set(names)) < width:
            raise DataError(
                f"{self.path.name}: {key}_names holds {list(names)}, expected {width} different names, one for each column of {key!r}."
            )
        return Stream(key, names, np.empty(0), values)

    def length(self, name: str) -> int:
        """Rows of the arrays that were read."""
        if not self.lengths or not max(self.lengths.values()):
            raise DataError(f"{name}: no rows are there; its arrays are {shown(self.keys)}.")
        return next(iter(self.lengths.values()))

    def _numbers(self, key: str, values: np.ndarray) -> np.ndarray:
        if values.dtype.kind not in "biuf":
            raise DataError(f"{self.path.name}: {key!r} holds {values.dtype}, expected real numbers.")
        return values.astype(float)

    def _as_long(self, key: str, values: np.ndarray) -> np.ndarray:
        """The array, as long as those before."""
        first = next(iter(self.lengths.items()), (key, len(values)))
        self.lengths[key] = len(values)
        if len(values) != first[1]:
            raise DataError(
                f"{self.path.name}: {first[0]!r} has {first[1]} rows and {key!r} has {len(values)}: every array needs one row per sample."
            )
        return values
