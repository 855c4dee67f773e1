"""The command line: ``sksurrogate diagnose``, ``sksurrogate demo``."""

from __future__ import annotations

import argparse
import importlib.util
import sys
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sksurrogate import __version__
from sksurrogate._csv import read_csv
from sksurrogate.exceptions import DataError, RunError, SimulatorError, SurrogateError

__all__ = ["load_simulator", "main", "read_csv"]


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point; returns the exit status."""
    arguments = _parser().parse_args(argv)
    try:
        return int(arguments.action(arguments))
    except SurrogateError as error:
        print(f"sksurrogate: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("sksurrogate: interrupted before anything was known", file=sys.stderr)
        return 130


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="sksurrogate", description="Diagnose the gap between a simulator and a real plant."
    )
    parser.add_argument("--version", action="version", version=f"%(prog)s {__version__}")
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
    _add_blind(commands)
    demo = commands.add_parser("demo", help="two stories on data that the package makes itself")
    demo.add_argument("--html", metavar="FOLDER", help="write a page for each story there")
    demo.set_defaults(action=_demo)
    return parser


def _add_blind(commands: Any) -> None:
    """``sksurrogate blind``."""
    blind = commands.add_parser("blind", help="check the diagnosis on plants whose effect is withheld from it")
    blind.add_argument("--cases", type=int, default=50, help="number of cases, spread over the arms (default 50)")
    blind.add_argument("--arms", default="all", help="all, or names joined by commas")
    blind.add_argument("--resume", metavar="FILE", help="rows as JSON lines: those there count, new ones are appended")
    blind.add_argument("--seed", type=int, default=None, help="the same cases again; fresh entropy by default")
    blind.add_argument("--jobs", type=int, default=None, help="cases abreast")
    blind.add_argument(
        "--follow-up", type=float, default=1.0, metavar="SHARE",
        help="share of the cases with tied names whose suggested experiment is carried out (default 1)",
    )  # fmt: skip
    blind.add_argument("--simulator", metavar="FILE:NAME", help="your own simulator in place of the built-in plants")
    blind.add_argument("--data", metavar="CSV", help="with --simulator: recorded inputs by name")
    blind.add_argument("--run", metavar="COL", help="column of --data that names the run of each row")
    blind.add_argument("--html", metavar="FILE", help="write one self-contained page")
    blind.add_argument("--quiet", action="store_true", help="no progress")
    blind.set_defaults(action=_blind)


def _blind(arguments: argparse.Namespace) -> int:
    from sksurrogate.blind import run_blind_check

    own: dict[str, Any] = {}
    if arguments.html and not Path(arguments.html).absolute().parent.is_dir():
        raise DataError(f"--html {arguments.html}: there is no such folder.")
    if arguments.simulator:
        if not arguments.data:
            raise DataError("--simulator needs --data CSV: the recorded inputs that the check repeats.")
        simulator = load_simulator(arguments.simulator)
        columns, labels = read_csv(arguments.data, list(simulator.inputs), arguments.run)
        own = {"simulator": simulator, "X": np.column_stack([columns[n] for n in simulator.inputs]), "groups": labels}
    result = run_blind_check(
        arguments.cases, arguments.arms, seed=arguments.seed, resume=arguments.resume, n_jobs=arguments.jobs,
        follow_up=arguments.follow_up, verbose=0 if arguments.quiet else 1, **own,
    )  # fmt: skip
    print(result)
    if arguments.html:
        result.to_html(arguments.html)
        print(f"page: {arguments.html}")
    if result.complete:
        return 0
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
        spec.loader.exec_module(module)
    except (Exception, SystemExit) as error:
        raise SimulatorError(
            f"{file} fails when it is read: {type(error).__name__}: {error}. Try  python {file}  first."
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


def _diagnose(arguments: argparse.Namespace) -> int:
    from sksurrogate.effects import save_augmented
    from sksurrogate.gap import GapDiagnoser
    from sksurrogate.physics._simulator import describe

    if arguments.jobs == 0:
        raise DataError("--jobs 0: give the number of worker processes, or -1 for one a core.")
    for option, target in (("--html", arguments.html), ("--save", arguments.save)):
        if target and not Path(target).resolve().parent.is_dir():  # before minutes of work, not after
            raise DataError(f"{option} {target}: there is no folder {str(Path(target).parent)!r}; make it first.")
    simulator = load_simulator(arguments.simulator)
    plant = describe(simulator)
    signals = list(dict.fromkeys([*plant.inputs, *plant.outputs]))
    columns, labels = read_csv(arguments.data, signals, arguments.run, arguments.time)
    X = (
        np.stack([columns[name] for name in plant.inputs], axis=1)
        if plant.inputs
        else np.zeros((len(columns[plant.outputs[0]]), 0))
    )
    y = np.stack([columns[name] for name in plant.outputs], axis=1)
    free: Any = "all" if arguments.free == ["all"] else tuple(arguments.free)
    diagnoser = GapDiagnoser(
        simulator, free_params=free, n_jobs=arguments.jobs, verbose=0 if arguments.quiet else 1, random_state=0
    )
    try:
        if arguments.time:
            _check_time(arguments.time, X, y, columns[arguments.time], labels, plant.dt)
        diagnoser.fit(X, y, groups=labels)
    except DataError as error:
        if "row" not in str(error):
            raise
        raise type(error)(f"{error} Row 0 is the first line below the header of {arguments.data}.") from None
    print(diagnoser.report_)
    if arguments.html:
        diagnoser.report_.to_html(arguments.html)
        print(f"\npage: {arguments.html}")
    if arguments.save:
        save_augmented(diagnoser.augmented_, arguments.save, verdict=diagnoser.report_.verdict)
        print(f"augmented simulator: {arguments.save}")
    return 0


def _check_time(column: str, X: np.ndarray, y: np.ndarray, clock: np.ndarray, labels: Any, dt: float) -> None:
    """The time column is even, and its step is the simulator's."""
    from sksurrogate.runs import resolve_runs

    try:
        found = resolve_runs(np.column_stack([X, clock]), y, groups=labels, time=X.shape[1]).dt
    except RunError:
        raise
    except DataError as error:
        raise DataError(str(error).replace(f"time={X.shape[1]}", f"--time {column}")) from None
    if not np.isclose(found, dt, rtol=1e-3):
        unit = " (milliseconds in the data?)" if np.isclose(found, 1000 * dt, rtol=1e-3) else ""
        raise DataError(
            f"--time {column}: the sample time of the data is {found:g}, that of the simulator {dt:g}{unit}: "
            f"set dt={found:g} there, or bring both to one unit."
        )


def _demo(arguments: argparse.Namespace) -> int:
    from sksurrogate.demo import story_actuator_and_sensor, story_linearised

    for number, story in enumerate((story_actuator_and_sensor, story_linearised), start=1):
        print(f"[demo] story {number} of 2: a diagnosis, less than a minute on a free machine ...", file=sys.stderr)
        told = story()
        print(
            f"{'=' * 80}\nStory {number}: {told.title}\n{'=' * 80}\n{told.report}\n\n{textwrap.fill(told.ending, 80)}\n"
        )
        if arguments.html:
            folder = Path(arguments.html)
            folder.mkdir(parents=True, exist_ok=True)
            told.report.to_html(folder / f"story_{number}.html")
            print(f"page: {folder / f'story_{number}.html'}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
