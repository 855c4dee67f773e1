"""Would the tests notice? Small faults are put into the package one at a time, and the tests that run the line are run.

    python tests/benchmarks/mutate.py --map folder [--minutes 5] [--longest 60]  # which test runs which lines; goes on
    python tests/benchmarks/mutate.py --use folder --out rows.jsonl [--faults 200] [--seed 0] [--folders kernels effects]
                                      [--limit 60] [--minutes 5] [--again survivors.jsonl]

A fault is a changed operator, comparison, constant, connective or a dropped term, drawn evenly over the folders. One process
imports everything and collects the tests that are not slow. A fork of it gets the fault and runs those that run the line,
quickest and nearest first. A fault is *caught* when a test fails, or takes ten times its time, and passes without the fault;
a *survivor* when all pass; *undecided* when the limit left some out, or a process waited too long. What takes effect on
import is tried, with and without it, in a fresh process. With `--out` a draw goes on where it stopped; `--again`
tries what was not caught once more, with the tests that are newer than the map.
"""

from __future__ import annotations

import argparse
import contextlib
import importlib
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import pytest
from fault_draw import FOLDERS, PACKAGE, ROOT, Fault, drawn, listed_again
from forked_tests import Forks
from line_map import LineMap, MapMaker

#: Seconds of tests in one fork: a first look at the likeliest ones, then more.
STAGES = (1.0, 5.0, 20.0, 60.0, 240.0)
#: Seconds of tests in a fresh process, for faults that act on import.
FRESH = 10.0


class Trial:
    """Plugin of pytest: tries faults with the tests that were collected."""

    def __init__(self, faults: list[Fault], given: argparse.Namespace) -> None:
        self.faults, self.given = faults, given
        self.told = os.fdopen(os.dup(1), "w", buffering=1)

    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        """One fault after the other."""
        self.lines, self.forks, ends = (
            LineMap(self.given.use),
            Forks(session),
            time.monotonic() + 60 * self.given.minutes,
        )
        session.config.pluginmanager.register(self.forks)
        known = set(self.lines.names)
        self.newer = [(name, 0.05) for name in self.forks.items if name not in known]
        for fault in self.faults:
            if time.monotonic() > ends:
                break
            started = time.monotonic()
            self.forks.killed = False
            said, by, n = self.decided(fault)
            row = {
                "file": fault.path.relative_to(ROOT).as_posix(),
                "line": fault.line,
                "kind": fault.kind,
                "before": fault.before,
                "after": fault.after,
                "tests": n,
                "said": said,
                "by": by,
                "longer": self.forks.killed,
                "seconds": round(time.monotonic() - started, 1),
            }
            print(
                f"{said:9} {row['file']}:{fault.line} {fault.kind}: {fault.before!r} -> {fault.after!r}", file=self.told
            )
            with self.given.out.open("a", encoding="utf-8") as stream:
                stream.write(json.dumps(row) + "\n")
        return True

    def decided(self, fault: Fault) -> tuple[str, str | None, int]:
        """What the tests say, the one that noticed it, and how many run the line."""
        text = fault.path.read_text(encoding="utf-8").splitlines()
        begun = self.lines.blocks.begin(fault.path.relative_to(ROOT).as_posix(), fault.line)
        words = [re.findall(r'"\w+"(?=:)|\w+(?= *(?::[^:]*)?=)', text[k - 1])[:1] for k in (fault.line, begun)]
        found = self.lines.tests_of(fault.path, fault.line, [*words[0], *words[1]])
        own, stem = fault.path.relative_to(PACKAGE).parts[0], fault.path.stem
        near = {file for file in {name.split("::")[0] for name, _ in self.newer} if _is_near(file, own, stem)}
        tests = [test for test in self.newer if test[0].split("::")[0] in near] + [
            (self.lines.names[k], float(self.lines.seconds[k])) for k in found
        ]
        warm, spent, waiting = self.forks.functions.can_take(fault), 0.0, list(tests)
        for stage in STAGES if warm else (FRESH,):
            part: list[tuple[str, float]] = []
            while waiting and spent + waiting[0][1] <= min(stage, self.given.limit):
                spent += waiting[0][1] + 0.01
                part.append(waiting.pop(0))
            files = list(dict.fromkeys(name.split("::")[0] for name, _ in part))
            part.sort(key=lambda test: files.index(test[0].split("::")[0]))
            while part:
                run = self.forks.first_failure if warm else in_fresh_process
                try:
                    by = run(fault, part)
                    again, longer = [test for test in part if test[0] == by], self.forks.killed
                    sound = run(None, again) if again else None
                except RuntimeError:
                    return "undecided", None, len(tests)
                if by is None:
                    break
                if sound is None:
                    self.forks.killed = longer
                    return "caught", by, len(tests)
                part = [test for test in part if test[0] != by]
        return "undecided" if waiting else "survivor", None, len(tests)


def _is_near(file: str, own: str, stem: str) -> bool:
    """Whether a test file is in the folder of a module, or names it."""
    return f"/{own}/" in file or stem in (ROOT / file).read_text(encoding="utf-8")


def in_fresh_process(fault: Fault | None, tests: list[tuple[str, float]]) -> str | None:
    """The first test that fails with a copy of the package that has the fault, in a process of its own."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        shutil.copytree(PACKAGE, folder / "sksurrogate", ignore=shutil.ignore_patterns("__pycache__"))
        if fault is not None:
            (folder / fault.path.relative_to(ROOT)).write_text(fault.faulty(), encoding="utf-8")
        shutil.copytree(ROOT / "tests", folder / "tests", ignore=shutil.ignore_patterns("__pycache__"))
        for beside in ROOT.iterdir():
            if beside.name not in ("sksurrogate", "tests") and beside.name[0] != ".":
                (folder / beside.name).symlink_to(beside)
        command = [sys.executable, "-m", "pytest", "-x", "-q", "--tb=no", "-rfE", "-p", "no:xdist"]
        command += ["-c", str(ROOT / "pyproject.toml"), "--rootdir", str(folder), *(test for test, _ in tests)]
        limit = 30 + 10 * sum(seconds for _, seconds in tests)
        env = {**os.environ, "PYTHONPATH": str(folder), "PYTHONDONTWRITEBYTECODE": "1"}
        try:
            done = subprocess.run(command, cwd=folder, env=env, capture_output=True, text=True, timeout=limit)
        except subprocess.TimeoutExpired as error:
            raise RuntimeError("a loaded machine decides nothing") from error
        found = re.findall(r"^(?:FAILED|ERROR) (\S+(?:\[.*?\])?)(?: - .*)?$", done.stdout, re.M)
        if done.returncode == 0:
            return None
        names = [test for test, _ in tests if found and test.startswith(found[0])]
        return names[0] if names else tests[0][0]


def summary(rows: list[dict[str, Any]]) -> str:
    """How many were caught."""
    counts = {said: sum(row["said"] == said for row in rows) for said in ("caught", "survivor", "undecided")}
    return (
        f"{counts['caught']} of {len(rows)} were caught, {counts['survivor']} survived, {counts['undecided']} undecided"
    )


def main() -> None:
    """Make a map, or draw, try, tell."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--map", type=Path, help="make or complete a map of the lines that each test runs")
    parser.add_argument("--use", type=Path, help="the map to use")
    parser.add_argument("--faults", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--folders", nargs="+", default=FOLDERS)
    parser.add_argument("--limit", type=float, default=60.0, help="seconds that the tests of one fault take without it")
    parser.add_argument("--longest", type=float, default=60.0, help="seconds after which the map stops a test")
    parser.add_argument(
        "--minutes", type=float, default=float("inf"), help="no fault or test file is begun after this time"
    )
    parser.add_argument("--out", type=Path, help="file of rows (JSON lines); its faults are not tried again")
    parser.add_argument("--again", type=Path, help="file of rows: what was not caught is tried once more")
    given = parser.parse_args()
    sys.path.insert(0, str(ROOT))
    os.chdir(ROOT)
    if given.map:
        plugin: Any = MapMaker(given.map.absolute(), given.minutes, given.longest)
    else:
        done = len(given.out.read_text(encoding="utf-8").splitlines()) if given.out.exists() else 0
        faults = listed_again(given.again) if given.again else drawn(given.faults, given.seed, given.folders)
        plugin = Trial(faults[done:], given)
    # a fork that is stopped within an import aborts, or its later tests fail: what is heavy is imported before
    for heavy in ("torch._dynamo", "skorch", "casadi", "control", "fmpy", "matplotlib.pyplot"):
        with contextlib.suppress(ImportError):
            importlib.import_module(heavy)
    options = ["-q", "--tb=no", "-m", "not slow", "-p", "no:xdist", "-c", str(ROOT / "pyproject.toml")]
    pytest.main([*options, "tests", "sksurrogate"], plugins=[plugin])
    if given.out:
        print(summary([json.loads(row) for row in given.out.read_text(encoding="utf-8").splitlines()]))


if __name__ == "__main__":
    main()
