"""The recording that a command reads, a CSV or a joint log, and the options that say what is where in it."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from sksurrogate._csv import read_csv, read_header
from sksurrogate._headers import assigned, columns_of, split_unit
from sksurrogate.exceptions import DataError

#: Columns with these names, ``_id`` or ``_index`` behind them, mostly tell one run from the next.
RUN_WORDS = ("run", "episode", "experiment", "trial", "batch")


def add_data(parser: argparse.ArgumentParser) -> None:
    """Add the file and its options."""
    parser.add_argument(
        "data",
        help="CSV with a header: the simulator's inputs and outputs by name; or .npz, .mcap, a folder of LeRobot",
    )
    parser.add_argument("--run", metavar="COL", help="column that names the run of each row")
    parser.add_argument("--time", metavar="COL", help="column that holds the time")
    parser.add_argument(
        "--columns", metavar="SIGNAL=COLUMN", nargs="+", action="extend", default=[],
        help="columns whose names are not those of the signals",
    )  # fmt: skip
    parser.add_argument(
        "--readings", metavar="NAME", nargs="+", action="extend", default=[],
        help="joint logs: topics, features or tables of the outputs",
    )  # fmt: skip
    parser.add_argument(
        "--commands", metavar="NAME", nargs="+", action="extend", default=[],
        help="joint logs: topics, features or tables of the inputs",
    )  # fmt: skip
    parser.add_argument("--clock", choices=("header", "log"), help="MCAP: times of the headers, or of the recording")


def is_log(data: str) -> bool:
    """Whether a file is a joint log and no CSV."""
    path = Path(data)
    return path.suffix.lower() in (".npz", ".mcap") or path.is_dir()


def recording(
    arguments: argparse.Namespace, plant: Any, known: Mapping[str, str]
) -> tuple[np.ndarray, np.ndarray, np.ndarray | None, np.ndarray | None, dict[str, str]]:
    """Inputs, outputs, time, runs, and the units that the header names.

    ``plant``: the simulator as it describes itself.
    ``known``: units of its signals.
    Raises DataError where the file does not hold what the simulator needs, or an option does not fit the file.
    """
    signals = list(dict.fromkeys([*plant.inputs, *plant.outputs]))
    if is_log(arguments.data):
        return *_joint_log(arguments, plant, assigned(arguments.columns, signals)), {}
    for option in ("readings", "commands", "clock"):
        if getattr(arguments, option):
            raise DataError(f"--{option}: {arguments.data} is a CSV, which has columns alone; leave it out.")
    header = read_header(arguments.data)
    given = assigned(arguments.columns, signals)
    column = columns_of(signals, header, given)
    marks = columns_of([name for name in (arguments.run, arguments.time) if name], header, {})
    run, time = marks.get(arguments.run), marks.get(arguments.time)
    wanted = list(dict.fromkeys(column[name] for name in signals))
    inputs = {column[name] for name in plant.inputs}
    gaps = [column[name] for name in plant.outputs if column[name] not in inputs]
    columns, labels = read_csv(arguments.data, wanted, run, time, gaps)
    n = len(next(iter(columns.values())))
    X = np.stack([columns[column[name]] for name in plant.inputs], axis=1) if plant.inputs else np.zeros((n, 0))
    y = np.stack([columns[column[name]] for name in plant.outputs], axis=1)
    shown = {**column, **{name: text for name, text in given.items() if text not in header}}
    units = {name: unit for name in signals if (unit := split_unit(shown[name])[1])}
    if time and split_unit(time)[1]:
        units["time"] = split_unit(time)[1]
    word = re.compile(rf"({'|'.join(RUN_WORDS)})[ _-]?(id|index)?", re.IGNORECASE)
    unread = [text for text in header if word.fullmatch(split_unit(text)[0])]
    if run is None and unread and unread[0] not in wanted:
        print(
            f"sksurrogate: column {unread[0]!r} of {arguments.data} is not read, and all rows are one run. If it tells the runs apart: "
            f"--run {unread[0]}.",
            file=sys.stderr,
        )
    for name, unit in units.items():
        if known.get(name, unit) != unit:
            print(
                f"sksurrogate: {name!r} is in {unit} in {arguments.data} and in {known[name]} in the simulator. "
                "The numbers are read as they are: unless both are names of one unit, convert the column.",
                file=sys.stderr,
            )
    return X, y, columns[time] if time else None, labels, units


def _joint_log(
    arguments: argparse.Namespace, plant: Any, given: Mapping[str, str]
) -> tuple[np.ndarray, np.ndarray, np.ndarray | None, np.ndarray]:
    """Inputs, outputs, time and runs of a joint log."""
    from sksurrogate.datasets import load_joint_log

    inputs, outputs = (
        {name: given.get(name, name) for name in names} if set(given) & set(names) else list(names)
        for names in (plant.inputs, plant.outputs)
    )
    log = load_joint_log(
        arguments.data, inputs=inputs, outputs=outputs, readings=arguments.readings, commands=arguments.commands,
        dt=plant.dt, time=arguments.time, run=arguments.run, clock=arguments.clock or "auto", as_frame=False,
    )  # fmt: skip
    for note in log.notes:
        print(f"sksurrogate: {note}", file=sys.stderr)
    return log.X[:, : len(log.inputs)], log.y, None if log.time is None else log.stamps, log.groups
