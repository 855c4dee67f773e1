"""Which test runs which lines of the package: a mark is set before each block of statements, read after each test.

A mark costs 50 ns. Marks are shared with forked processes. What a fixture of a module or a remembered function ran counts for
every test that uses its result.
"""

from __future__ import annotations

import ast
import builtins
import functools
import gc
import importlib.machinery
import mmap
import os
import signal
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fault_draw import PACKAGE, ROOT

_COMPOUND = ("body", "orelse", "finalbody")


class TooLong(BaseException):
    """A test took longer than the map allows: what it ran until then counts."""


class Blocks:
    """Numbers of the blocks of all files, and the trees that mark them.

    Attributes
    ----------
    lines : dict of str to dict of int to int
        File, first line of a statement: number of the block that holds it. What runs on import has the number 0.
    """

    def __init__(self) -> None:
        self.count, self.lines, self.trees = 1, {}, {}
        for path in sorted(PACKAGE.rglob("*.py")):
            tree, self._now = ast.parse(path.read_text(encoding="utf-8")), {}
            tree.body = self._marked(tree.body, False)
            self.lines[path.relative_to(ROOT).as_posix()] = self._now
            self.trees[str(path)] = ast.fix_missing_locations(tree)

    def _marked(self, body: list[ast.stmt], inside: bool) -> list[ast.stmt]:
        out, block = [], None
        for one in body:
            plain = not isinstance(one, (ast.Global, ast.Nonlocal)) and not _is_docstring(one)
            if inside and block is None and plain:
                block, self.count = self.count, self.count + 1
                out.append(ast.copy_location(ast.parse(f"__hits__[{block}] = 1").body[0], one))
            self._now.setdefault(one.lineno, block or 0)
            parts = [one, *getattr(one, "handlers", []), *getattr(one, "cases", [])]
            for part in parts:
                for field in _COMPOUND:
                    if isinstance(getattr(part, field, None), list):
                        deeper = inside or isinstance(one, ast.FunctionDef)
                        setattr(part, field, self._marked(getattr(part, field), deeper))
            if hasattr(one, "body") and not isinstance(one, (ast.FunctionDef, ast.ClassDef)):
                block = None
            out.append(one)
        return out

    def of(self, file: str, line: int) -> int:
        """Block of the statement that holds a line."""
        return self.lines[file][self.begin(file, line)]

    def begin(self, file: str, line: int) -> int:
        """First line of the statement that holds a line."""
        return max(first for first in self.lines[file] if first <= line)


def _is_docstring(one: ast.stmt) -> bool:
    return isinstance(one, ast.Expr) and isinstance(one.value, ast.Constant)


class _Loader(importlib.machinery.SourceFileLoader):
    """Compiles a file of the package from its marked tree."""

    trees: dict[str, ast.Module]

    def get_code(self, fullname: str) -> Any:
        path = self.get_filename(fullname)
        return compile(self.trees[path], path, "exec", dont_inherit=True)


class _Finder(importlib.machinery.PathFinder):
    @classmethod
    def find_spec(cls, fullname: str, path: Any = None, target: Any = None) -> Any:
        spec = super().find_spec(fullname, path, target) if fullname.split(".")[0] == "sksurrogate" else None
        if spec is not None and spec.origin in _Loader.trees:
            spec.loader = _Loader(fullname, spec.origin)
        return spec


class MapMaker:
    """Plugin of pytest: every test file in a fork of its own, what its tests ran in a file of its own.

    Parameters
    ----------
    folder : Path
        Where the files are; tests that they hold are left out.
    minutes : float
        No test file is begun after this time.
    longest : float
        A test is stopped after so many processor seconds.
    """

    def __init__(self, folder: Path, minutes: float, longest: float) -> None:
        self.folder, self.minutes, self.longest, self.blocks = folder, minutes, longest, Blocks()
        self.hits = mmap.mmap(-1, self.blocks.count)
        self.seen = np.frombuffer(self.hits, dtype=np.uint8)
        self.of_fixture: dict[str, np.ndarray] = {}
        self.failed = False
        builtins.__hits__ = self.hits  # type: ignore[attr-defined]
        _Loader.trees = self.blocks.trees
        sys.meta_path.insert(0, _Finder)
        folder.mkdir(parents=True, exist_ok=True)

    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        """Fork for each file."""
        ends, by_file = time.monotonic() + 60 * self.minutes, {}
        for item in session.items:
            by_file.setdefault(item.nodeid.split("::")[0], []).append(item)
        known = {str(name) for path in self.folder.glob("[!b]*.npz") for name in np.load(path)["names"]}
        for file, items in by_file.items():
            items = [item for item in items if item.nodeid not in known]
            if not items or time.monotonic() > ends:
                continue
            parts = len(list(self.folder.glob(file.replace("/", "+") + ".*npz")))
            out = self.folder / f"{file.replace('/', '+')}.{parts}.npz"
            pid = os.fork()
            if pid == 0:
                try:
                    self._record(session, items, out)
                finally:
                    os._exit(0)
            os.waitpid(pid, 0)
        return True

    def _record(self, session: pytest.Session, items: list[Any], out: Path) -> None:
        session.config.pluginmanager.unregister(name="terminalreporter")
        self._watch_memories()
        rows, seconds, passed = [], [], []
        signal.signal(signal.SIGPROF, self._stop)
        for item, following in zip(items, [*items[1:], None], strict=True):
            self.seen[:], self.failed, self.stopped, started = 0, False, False, time.process_time()
            signal.setitimer(signal.ITIMER_PROF, self.longest)
            item.config.hook.pytest_runtest_protocol(item=item, nextitem=following)
            signal.setitimer(signal.ITIMER_PROF, 0)
            for name in getattr(item, "fixturenames", ()):
                if name in self.of_fixture:
                    self.seen[:] |= self.of_fixture[name]
            rows.append(np.packbits(self.seen))
            seconds.append(time.process_time() - started)
            passed.append(not self.failed or self.stopped)
        names = [item.nodeid for item in items]
        beside = out.with_name("beside-" + out.name)
        np.savez_compressed(beside, names=names, seconds=seconds, passed=passed, rows=np.array(rows))
        beside.rename(out)

    def _stop(self, *_: Any) -> None:
        self.stopped = True
        raise TooLong

    def _watch_memories(self) -> None:
        """A remembered function marks again what its first call with the same arguments ran."""
        kept = {id(one): one for one in gc.get_objects() if type(one) is functools._lru_cache_wrapper}
        watched = {key: self._watched(one) for key, one in kept.items()}
        for module in list(sys.modules.values()):
            for name, value in list(getattr(module, "__dict__", {}).items()):
                if id(value) in watched and str(getattr(module, "__file__", "")).startswith(str(ROOT)):
                    setattr(module, name, watched[id(value)])

    def _watched(self, one: Any) -> Any:
        ran: dict[Any, np.ndarray] = {}

        @functools.wraps(one)
        def call(*args: Any, **kwargs: Any) -> Any:
            key, before = (args, tuple(sorted(kwargs.items()))), self.seen.copy()
            if key not in ran:
                self.seen[:] = 0
            out = one(*args, **kwargs)
            ran.setdefault(key, self.seen.copy())
            self.seen[:] = before | ran[key]
            return out

        call.cache_clear, call.cache_info = one.cache_clear, one.cache_info  # type: ignore[attr-defined]
        return call

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(self, fixturedef: Any) -> Any:
        """What a fixture of more than one test runs; it is not stopped, since all tests that use it would fail."""
        if fixturedef.scope == "function":
            return (yield)
        before, left = self.seen.copy(), signal.setitimer(signal.ITIMER_PROF, 0)[0]
        self.seen[:] = 0
        try:
            return (yield)
        finally:
            self.of_fixture[fixturedef.argname] = self.seen.copy()
            self.seen[:] |= before
            signal.setitimer(signal.ITIMER_PROF, left)

    def pytest_runtest_logreport(self, report: Any) -> None:
        """Whether it failed."""
        self.failed |= report.failed


class LineMap:
    """What was recorded: the tests that run a line, those that are likely to notice something first."""

    def __init__(self, folder: Path) -> None:
        files = [np.load(path) for path in sorted(folder.glob("*.npz"))]
        self.names = [str(name) for file in files for name in file["names"]]
        self.seconds = np.concatenate([file["seconds"] for file in files])
        self.passed = np.concatenate([file["passed"] for file in files])
        self.rows = np.concatenate([file["rows"] for file in files])
        self.blocks = Blocks()

    def running(self, block: int) -> np.ndarray:
        """Indices of the tests that run a block."""
        return np.flatnonzero((self.rows[:, block // 8] >> (7 - block % 8)) & 1 & self.passed)

    def tests_of(self, path: Path, line: int, words: list[str]) -> list[int]:
        """Tests that run a line; of a line that runs on import, those with one of its words, and those that run a statement with one."""
        block = self.blocks.of(path.relative_to(ROOT).as_posix(), line)
        if block:
            return self._ordered(path, self.running(block))
        texts = {
            file: (ROOT / file).read_text(encoding="utf-8") for file in {name.split("::")[0] for name in self.names}
        }
        about = {file for file, text in texts.items() if any(word in text for word in words)}
        found = {k for k, name in enumerate(self.names) if name.split("::")[0] in about and self.passed[k]}
        for other in sorted(PACKAGE.rglob("*.py")):
            text = other.read_text(encoding="utf-8")
            if other == path or path.stem in text:
                for k, content in enumerate(text.splitlines(), start=1):
                    if any(word in content for word in words):
                        block = self.blocks.of(other.relative_to(ROOT).as_posix(), k) if k else 0
                        found |= set(self.running(block)) if block else set()
        return self._ordered(path, np.array(sorted(found), dtype=int))

    def _ordered(self, path: Path, found: np.ndarray) -> list[int]:
        """Quickest first; tests about the module before others, and one of many alike before its brothers."""
        own, about, alike, price = path.relative_to(PACKAGE).parts[0], path.stem.strip("_"), {}, {}
        for k in sorted(found, key=lambda k: self.seconds[k]):
            file = self.names[k].split("::")[0]
            kind = self.names[k].split("[")[0]
            alike[kind] = alike.get(kind, 0) + 1
            near = 0.1 if about in file else 0.4 if f"/{own}/" in file else 1.0
            price[k] = near * (self.seconds[k] + 0.02) * alike[kind]
        return sorted(price, key=lambda k: price[k])
