"""The command line: ``sksurrogate diagnose``, ``sksurrogate demo``."""

from __future__ import annotations

import argparse
import importlib.util
import os
import shlex
import sys
import tempfile
import textwrap
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from sksurrogate import __version__
from sksurrogate._argument_order import positionals_first
from sksurrogate._command_data import add_data, is_log, recording
from sksurrogate._command_options import add_knowledge, knowledge_of
from sksurrogate._command_parser import CommandParser
from sksurrogate._csv import read_csv
from sksurrogate._failures import failure_of, line_in
from sksurrogate._in_options import in_options
from sksurrogate._printed import printed_as_errors
from sksurrogate._swapped import swapped_columns
from sksurrogate._terminal import safe_terminal
from sksurrogate._warned_once import warned_once
from sksurrogate.exceptions import DataError, SimulatorError, SurrogateError

__all__ = ["load_simulator", "main", "read_csv"]


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point; returns the exit status."""
    words = list(sys.argv[1:] if argv is None else argv)
    arguments = _parser().parse_args(positionals_first(words))
    arguments.words = words
    with safe_terminal() as shown:
        status = _status(arguments)
        shown.flush()
        if shown.error is not None:
            status = status or 1
            if not isinstance(shown.error, BrokenPipeError):
                print(f"sksurrogate: the output could not be printed ({_why(shown.error)})", file=sys.stderr)
    return status


def _status(arguments: argparse.Namespace) -> int:
    """Do it; the exit status."""
    try:
        return int(arguments.action(arguments))
    except SurrogateError as error:
        print(f"sksurrogate: {in_options(str(error))}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        when = "while results were written" if getattr(arguments, "known", False) else "before anything was known"
        print(f"sksurrogate: interrupted {when}", file=sys.stderr)
        return 130


def _parser() -> argparse.ArgumentParser:
    parser = CommandParser(prog="sksurrogate", description="Diagnose the gap between a simulator and a real plant.")
    parser.add_argument("--version", action="version", version=f"%(prog)s {__version__}")
    commands = parser.add_subparsers(required=True, metavar="command")
    diagnose = commands.add_parser("diagnose", help="diagnose a simulator against a recording")
    diagnose.add_argument("simulator", help="file.py:name of a simulator object")
    add_data(diagnose)
    diagnose.add_argument(
        "--free",
        metavar="NAME",
        nargs="+",
        action="extend",
        default=[],
        help="parameters to re-tune; all for every one",
    )
    add_knowledge(diagnose)
    diagnose.add_argument(
        "--effects",
        metavar="NAME",
        nargs="+",
        action="extend",
        default=None,
        help="compare these effects only; default: the catalogue",
    )
    diagnose.add_argument("--seed", type=int, default=0, help="of the bootstrap (default 0)")
    diagnose.add_argument("--title", default="", help="title of the report")
    diagnose.add_argument("--html", metavar="FILE", help="write one self-contained page")
    diagnose.add_argument(
        "--json",
        metavar="FILE",
        nargs="?",
        const="-",
        help="write the report as JSON; without FILE in place of the text",
    )
    diagnose.add_argument("--save", metavar="FILE", help="write the effects and re-tuned parameters as JSON")
    diagnose.add_argument("--jobs", type=int, default=None, help="worker processes")
    diagnose.add_argument("--quiet", action="store_true", help="no progress")
    diagnose.set_defaults(action=_diagnose)
    _add_blind(commands)
    demo = commands.add_parser("demo", help="two diagnoses of data that the package makes")
    demo.add_argument("--html", metavar="FOLDER", help="write a page for each diagnosis there")
    demo.set_defaults(action=_demo)
    return parser


def _add_blind(commands: Any) -> None:
    """``sksurrogate blind``."""
    blind = commands.add_parser("blind", help="check the diagnosis on plants whose effect is withheld from it")
    blind.add_argument("--cases", type=int, default=50, help="number of cases, spread over the arms (default 50)")
    blind.add_argument("--arms", default="all", help="all, or names joined by commas")
    blind.add_argument("--resume", metavar="FILE", help="rows as JSON lines: those there count, new ones are appended")
    blind.add_argument("--seed", type=int, default=None, help="the same cases again; fresh entropy by default")
    blind.add_argument("--jobs", type=int, default=None, help="cases at once")
    blind.add_argument(
        "--follow-up", type=float, default=1.0, metavar="SHARE",
        help="share of the cases with tied names whose suggested experiment is carried out (default 1)",
    )  # fmt: skip
    blind.add_argument(
        "--record", default="complete", help="how the cases are recorded: complete, missing, two_rate or jitter"
    )
    blind.add_argument("--simulator", metavar="FILE:NAME", help="your own simulator in place of the built-in plants")
    blind.add_argument("--data", metavar="CSV", help="with --simulator: recorded inputs by name")
    blind.add_argument("--run", metavar="COL", help="column of --data that names the run of each row")
    blind.add_argument("--html", metavar="FILE", help="write one self-contained page")
    blind.add_argument("--quiet", action="store_true", help="no progress")
    blind.set_defaults(action=_blind)


def _blind(arguments: argparse.Namespace) -> int:
    from sksurrogate.blind import run_blind_check

    own: dict[str, Any] = {}
    own_file = (arguments.simulator or "").rpartition(":")[0]
    read = {"--simulator": own_file, "--data": arguments.data, "--resume": arguments.resume}
    _check_targets({"--html": arguments.html}, read)
    if arguments.simulator:
        if not arguments.data:
            raise DataError("--simulator needs --data CSV: the recorded inputs that the check repeats.")
        simulator = load_simulator(arguments.simulator)
        columns, labels = read_csv(arguments.data, list(simulator.inputs), arguments.run)
        own = {"simulator": simulator, "X": np.column_stack([columns[n] for n in simulator.inputs]), "groups": labels}
    result = run_blind_check(
        arguments.cases, arguments.arms, seed=arguments.seed, resume=arguments.resume, n_jobs=arguments.jobs,
        follow_up=arguments.follow_up, verbose=0 if arguments.quiet else 1, record=arguments.record, **own,
    )  # fmt: skip
    arguments.known = True
    said, whole = _written("page", arguments.html, result.to_html)
    print("\n".join([str(result), *said]))
    if result.complete:
        return 0 if whole else 1
    way_on = (
        f"the same command goes on with {arguments.resume}" if arguments.resume else "with --resume FILE it could go on"
    )
    print(f"sksurrogate: interrupted after {len(result.rows)} cases; {way_on}", file=sys.stderr)
    return 130


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
        with printed_as_errors():
            spec.loader.exec_module(module)
    except (Exception, SystemExit) as error:
        place = f", in {where}" if (where := line_in(file, error)) else ""
        raise SimulatorError(
            f"{file} fails when it is read{place}: {type(error).__name__}: {error}. Try  python {file}  first."
        ) from error
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


def _check_targets(targets: Mapping[str, str | None], read: Mapping[str, str | None]) -> None:
    """Files can be written there, each under a name of its own, and none over what is ``read``: said before minutes of work, not after."""
    taken = {Path(file).resolve(): name for name, file in read.items() if file}
    for option, target in targets.items():
        if not target:
            continue
        _check_target(option, target)
        path = Path(target).resolve()
        if path in taken and (path.is_file() or not path.exists()):
            raise DataError(f"{option} {target} and {taken[path]} are the same file: give two names.")
        taken[path] = option


def _check_target(option: str, target: str) -> None:
    """A file can be written there."""
    path = Path(target)
    if path.is_dir():
        raise DataError(f"{option} {target} is a folder: name a file in it.")
    if not path.resolve().parent.is_dir():
        raise DataError(f"{option} {target}: there is no folder {str(path.parent)!r}; make it first.")
    if path.exists() and not path.is_file():
        return  # a pipe, a terminal
    try:
        if path.exists() and not os.access(path, os.W_OK):
            raise PermissionError(13, "is write-protected")
        tempfile.TemporaryFile(dir=path.resolve().parent).close()
    except OSError as error:
        raise DataError(
            f"{option} {target} cannot be written ({_why(error)}): name a file in another folder."
        ) from error


def _written(what: str, target: str | None, write: Callable[[Path], object]) -> tuple[list[str], bool]:
    """Write a file, into the temporary folder where it cannot stand in its place; what to say, and whether it stands."""
    if not target:
        return [], True
    try:
        write(Path(target))
        return [f"{what}: {target}"], True
    except (OSError, SurrogateError) as error:
        place, why = None, _why(error)
    try:
        place = Path(tempfile.mkdtemp(prefix="sksurrogate-")) / Path(target).name
        write(place)
    except (OSError, SurrogateError):
        place = None
    where = f"; it is in {place}" if place else ""
    print(f"sksurrogate: the {what} was not written to {target} ({why}){where}", file=sys.stderr)
    return ([f"{what}: {place}"] if place else []), False


def _why(error: Exception) -> str:
    return str(getattr(error, "strerror", None) or error)


def _diagnose(arguments: argparse.Namespace) -> int:
    from sklearn.base import clone

    from sksurrogate.gap import GapDiagnoser
    from sksurrogate.physics._simulator import describe, units_of

    if arguments.jobs == 0:
        raise DataError("--jobs 0: give the number of worker processes, or -1 for one for each core.")
    if not 0 <= arguments.seed < 2**32:
        raise DataError(f"--seed {arguments.seed}: give a whole number from 0 to {2**32 - 1}.")
    read = {"the simulator": arguments.simulator.rpartition(":")[0], "the data": arguments.data}
    report = None if arguments.json == "-" else arguments.json
    _check_targets({"--html": arguments.html, "--save": arguments.save, "--json": report}, read)
    simulator = load_simulator(arguments.simulator)
    plant = describe(simulator)
    X, y, clock, labels, units = recording(arguments, plant, units_of(simulator))
    if units and hasattr(simulator, "get_params") and "units" in simulator.get_params(deep=False):
        simulator = clone(simulator).set_params(units={**units, **units_of(simulator)})
    timed = X if clock is None else np.column_stack([X, clock])
    column = None if clock is None else X.shape[1]
    free: Any = "all" if arguments.free == ["all"] else arguments.free
    diagnoser = GapDiagnoser(
        simulator,
        effects=arguments.effects,
        free_params=free,
        time=column,
        n_jobs=arguments.jobs,
        verbose=0 if arguments.quiet else 1,
        random_state=arguments.seed,
        **knowledge_of(arguments),
    )
    # what a simulator prints is no part of the report
    with (
        _in_words_of_the_command(arguments, column),
        printed_as_errors(bar=not arguments.quiet),
        warnings.catch_warnings(),
    ):
        warnings.showwarning = _warned
        with warned_once():
            _say_swapped(simulator, X, y, labels, plant)
            diagnoser.fit(timed, y, groups=labels)
    arguments.known = True
    return _handed_over(_with_command(diagnoser.report_, arguments), diagnoser.augmented_, arguments)


@contextmanager
def _in_words_of_the_command(arguments: argparse.Namespace, column: int | None) -> Iterator[None]:
    """Errors that name the option of the time in ``column``, the file of a row, and the file of the simulator."""
    try:
        yield
    except DataError as error:
        time = f"--time {arguments.time}" if arguments.time else "time"
        said = str(error) if column is None else str(error).replace(f"time={column}", time)
        if "row" not in said or is_log(arguments.data):
            raise type(error)(said) from None
        raise type(error)(f"{said} Row 0 is the first line below the header of {arguments.data}.") from None
    except Exception as error:
        if (failure := failure_of(error, arguments.simulator, arguments.data)) is None:
            raise
        raise SimulatorError(failure) from error


def _handed_over(report: Any, better: Any, arguments: argparse.Namespace) -> int:
    """The report in the files and on the terminal as asked for, and the exit status."""
    from sksurrogate.effects._store import augmented_text, save_augmented

    notes = {"verdict": report.verdict, "complete": report.complete}
    saved, safe = _written("augmented simulator", arguments.save, lambda path: save_augmented(better, path, **notes))
    page, whole = _written("page", arguments.html, report.to_html)
    if arguments.json == "-":
        print(report.to_json())
        return _ended(report, safe and whole)
    text, plain = _written("report", arguments.json, report.to_json)
    print("\n".join([str(report), "", *page, *text, *saved]).rstrip("\n"))
    if arguments.save and not saved:
        print(augmented_text(better, **notes), end="")
    return _ended(report, safe and whole and plain)


def _warned(message: Warning | str, *more: Any, **others: Any) -> None:
    """A warning in one line."""
    print(f"sksurrogate: {in_options(str(message))}", file=sys.stderr)


def _ended(report: Any, written: bool) -> int:
    """The exit status: done, a file is missing, ended by the time limit, interrupted."""
    if not written:
        return 1
    if report.complete:
        return 0
    return 3 if any(note.startswith("The time limit") for note in report.notes) else 130


def _with_command(report: Any, arguments: argparse.Namespace) -> Any:
    """The report with the files, the command and the title in its provenance."""
    origin = replace(
        report.provenance,
        title=arguments.title,
        simulator=arguments.simulator,
        files=(arguments.data,),
        command=shlex.join(["sksurrogate", *arguments.words]),
    )
    return replace(report, provenance=origin)


def _say_swapped(simulator: Any, X: np.ndarray, y: np.ndarray, labels: Any, plant: Any) -> None:
    """Say where columns look swapped."""
    first = slice(None) if labels is None else labels == labels[0]
    for sentence in swapped_columns(simulator, X[first], y[first], plant.inputs, plant.outputs):
        print(f"sksurrogate: {sentence}", file=sys.stderr)


def _demo(arguments: argparse.Namespace) -> int:
    from sksurrogate.demo import story_actuator_and_sensor, story_linearised

    folder = Path(arguments.html) if arguments.html else None
    if folder is not None:
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise DataError(f"--html {folder}: no folder can be made there ({_why(error)}).") from error
    good = True
    for number, story in enumerate((story_actuator_and_sensor, story_linearised), start=1):
        print(f"[demo] diagnosis {number} of 2: about a minute on a free machine ...", file=sys.stderr)
        summary = story()
        target = None if folder is None else str(folder / f"story_{number}.html")
        said, whole = _written("page", target, summary.report.to_html)
        good = good and whole
        print(
            f"{'=' * 80}\nExample {number}: {summary.title}\n{'=' * 80}\n{summary.report}\n\n{textwrap.fill(summary.ending, 80)}\n"
        )
        print("".join(f"{line}\n\n" for line in said), end="")
        if not summary.report.complete:  # interrupted: the next one is not wanted either
            return 130
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
