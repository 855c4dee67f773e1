"""The command line: ``sksurrogate diagnose``, ``sksurrogate demo``."""

from __future__ import annotations

import argparse
import csv
import importlib.util
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sksurrogate.exceptions import DataError, SimulatorError, SurrogateError

__all__ = ["load_simulator", "main", "read_csv"]

#: A CSV larger than this is refused unread.
LARGEST_CSV = 512 * 2**20


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point; returns the exit status."""
    arguments = _parser().parse_args(argv)
    try:
        return int(arguments.action(arguments))
    except SurrogateError as error:
        print(f"sksurrogate: {error}", file=sys.stderr)
        return 2


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="sksurrogate", description="Diagnose the gap between a simulator and a real plant."
    )
    commands = parser.add_subparsers(required=True, metavar="command")
    diagnose = commands.add_parser("diagnose", help="diagnose a simulator against a recording")
    diagnose.add_argument("simulator", help="file.py:name of a simulator object")
    diagnose.add_argument("data", help="CSV with a header: the simulator's inputs and outputs by name")
    diagnose.add_argument("--run", metavar="COL", help="column that names the run of each row")
    diagnose.add_argument("--time", metavar="COL", help="column that holds the time")
    diagnose.add_argument(
        "--free", metavar="NAME", nargs="+", default=[], help="parameters to re-tune; all for every one"
    )
    diagnose.add_argument("--html", metavar="FILE", help="write one self-contained page")
    diagnose.add_argument("--save", metavar="FILE", help="write the effects and re-tuned parameters as JSON")
    diagnose.add_argument("--jobs", type=int, default=None, help="worker processes")
    diagnose.add_argument("--quiet", action="store_true", help="no progress")
    diagnose.set_defaults(action=_diagnose)
    demo = commands.add_parser("demo", help="two stories on data that the package makes itself")
    demo.add_argument("--html", metavar="FOLDER", help="write a page for each story there")
    demo.set_defaults(action=_demo)
    return parser


def load_simulator(reference: str) -> Any:
    """The object ``name`` of ``file.py:name``.

    Raises
    ------
    SimulatorError
        The file or the name is not there, or the file fails.
    """
    file, _, name = reference.rpartition(":")
    if not file or not name:
        raise SimulatorError(f"simulator={reference!r}: write file.py:name, for example plant.py:plant.")
    path = Path(file)
    if not path.is_file():
        raise SimulatorError(f"simulator={reference!r}: there is no file {file!r} in {Path.cwd()}.")
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.path.insert(0, str(path.parent.resolve()))
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        raise SimulatorError(f"{file} fails when it is read: {type(error).__name__}: {error}") from error
    finally:
        sys.path.pop(0)
    if not hasattr(module, name):
        public = [
            key
            for key, value in vars(module).items()
            if hasattr(value, "simulate") and not key.startswith("_") and not isinstance(value, type)
        ]
        raise SimulatorError(f"{file} has no {name!r}; simulators in it: {public or 'none'}.")
    return getattr(module, name)


def read_csv(
    path: Any, wanted: Sequence[str], run: str | None = None
) -> tuple[dict[str, np.ndarray], np.ndarray | None]:
    """Columns of a CSV by name, as numbers; the run column as text.

    Parameters
    ----------
    path : path
    wanted : sequence of str
        Numeric columns.
    run : str, optional
        Column of run labels.

    Returns
    -------
    columns : dict of ndarray
    labels : ndarray or None

    Raises
    ------
    DataError
        A column is missing, a line is short, a value is not a number; the message names line and column.
    """
    file = Path(path)
    if not file.is_file():
        raise DataError(f"data={str(path)!r}: there is no such file.")
    if file.stat().st_size > LARGEST_CSV:
        raise DataError(f"data={str(path)!r} is larger than {LARGEST_CSV >> 20} MiB: use the Python interface for it.")
    with file.open(newline="", encoding="utf-8-sig", errors="replace") as stream:
        sample = stream.read(4096)
        stream.seek(0)
        delimiter = max(",;\t", key=sample.split("\n", 1)[0].count)
        reader = csv.reader(stream, delimiter=delimiter)
        header = [name.strip() for name in next(reader, [])]
        for name in [*wanted, *([run] if run else [])]:
            if name not in header:
                raise DataError(
                    f"{file.name} has no column {name!r}; its columns are {header}. Rename it there, or the signal in the simulator."
                )
        places = [header.index(name) for name in wanted]
        label = header.index(run) if run else None
        values: list[list[float]] = []
        labels: list[str] = []
        try:
            for row in reader:
                if not row or not any(cell.strip() for cell in row):
                    continue
                if len(row) < len(header):
                    raise DataError(
                        f"{file.name}, line {reader.line_num}: {len(row)} cells, expected {len(header)} as in the header."
                    )
                values.append([_number(row[j], header[j], file.name, reader.line_num) for j in places])
                if label is not None:
                    labels.append(row[label].strip())
        except csv.Error as error:
            raise DataError(f"{file.name}, line {reader.line_num}: not readable as CSV ({error}).") from error
    if not values:
        raise DataError(f"{file.name} has a header and no rows.")
    table = np.array(values)
    return {name: table[:, j] for j, name in enumerate(wanted)}, np.array(labels) if label is not None else None


def _number(text: str, column: str, file: str, line: int) -> float:
    try:
        value = float(text)
    except ValueError:
        hint = " Decimal commas are not read: write 1.5, not 1,5." if "," in text else ""
        raise DataError(
            f"{file}, line {line}, column {column!r}: {text!r} is not a number.{hint} Empty cells: fill or delete the row."
        ) from None
    if not np.isfinite(value):
        raise DataError(f"{file}, line {line}, column {column!r}: {text!r} is not finite; fill or delete the row.")
    return value


def _diagnose(arguments: argparse.Namespace) -> int:
    from sksurrogate.effects import save_augmented
    from sksurrogate.gap import GapDiagnoser
    from sksurrogate.physics._simulator import describe
    from sksurrogate.runs import resolve_runs

    simulator = load_simulator(arguments.simulator)
    plant = describe(simulator)
    times = [arguments.time] if arguments.time else []
    columns, labels = read_csv(
        arguments.data, list(dict.fromkeys([*plant.inputs, *plant.outputs, *times])), arguments.run
    )
    X = (
        np.stack([columns[name] for name in plant.inputs], axis=1)
        if plant.inputs
        else np.zeros((len(columns[plant.outputs[0]]), 0))
    )
    y = np.stack([columns[name] for name in plant.outputs], axis=1)
    if arguments.time:
        runs = resolve_runs(np.column_stack([X, columns[arguments.time]]), y, groups=labels, time=X.shape[1])
        if not np.isclose(runs.dt, plant.dt, rtol=1e-3):
            raise DataError(
                f"--time {arguments.time}: the sample time of the data is {runs.dt:g}, that of the simulator {plant.dt:g}: set dt={runs.dt:g} there."
            )
    free: Any = "all" if arguments.free == ["all"] else tuple(arguments.free)
    diagnoser = GapDiagnoser(
        simulator, free_params=free, n_jobs=arguments.jobs, verbose=0 if arguments.quiet else 1, random_state=0
    )
    diagnoser.fit(X, y, groups=labels)
    print(diagnoser.report_)
    if arguments.html:
        diagnoser.report_.to_html(arguments.html)
        print(f"\npage: {arguments.html}")
    if arguments.save:
        save_augmented(diagnoser.augmented_, arguments.save, verdict=diagnoser.report_.verdict)
        print(f"augmented simulator: {arguments.save}")
    return 0


def _demo(arguments: argparse.Namespace) -> int:
    from sksurrogate.demo import story_actuator_and_sensor, story_linearised

    for number, story in enumerate((story_actuator_and_sensor, story_linearised), start=1):
        told = story()
        print(f"{'=' * 80}\nStory {number}: {told.title}\n{'=' * 80}\n{told.report}\n\n{told.ending}\n")
        if arguments.html:
            folder = Path(arguments.html)
            folder.mkdir(parents=True, exist_ok=True)
            told.report.to_html(folder / f"story_{number}.html")
            print(f"page: {folder / f'story_{number}.html'}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
