"""Tests of one warm process that has everything imported and collected: a fork gets a fault and runs some of them."""

from __future__ import annotations

import functools
import gc
import mmap
import os
import signal
import time
from types import CodeType, FunctionType
from typing import Any

import pytest
from fault_draw import ROOT, Fault

#: Exit status of a fork that could not run its tests.
BROKEN = 3


class Functions:
    """All functions of the package that live in this process, by their code."""

    def __init__(self) -> None:
        self.by_code: dict[CodeType, list[FunctionType]] = {}
        self.memories = []
        for one in gc.get_objects():
            if type(one) is FunctionType and one.__code__.co_filename.startswith(str(ROOT / "sksurrogate")):
                self.by_code.setdefault(one.__code__, []).append(one)
            elif type(one) is functools._lru_cache_wrapper and str(one.__module__).startswith("sksurrogate"):
                self.memories.append(one)

    def can_take(self, fault: Fault) -> bool:
        """Whether the fault is in the code of a function: else it acts on import."""
        return bool(self._changed(fault))

    def take(self, fault: Fault) -> None:
        """Put the fault into this process."""
        for function, code in self._changed(fault):
            function.__code__ = code
        for memory in self.memories:
            memory.cache_clear()

    def _changed(self, fault: Fault) -> list[tuple[FunctionType, CodeType]]:
        """Functions with their faulty code."""
        place = str(fault.path)
        sound = compile(fault.path.read_text(encoding="utf-8"), place, "exec", dont_inherit=True)
        pairs = [(sound, compile(fault.faulty(), place, "exec", dont_inherit=True))]
        out = []
        while pairs:
            a, b = pairs.pop()
            live = [f for f in self.by_code.get(a, []) if f.__code__.co_freevars == b.co_freevars]
            out += [(function, b) for function in live]
            inner = [c for c in a.co_consts if isinstance(c, CodeType)]
            pairs += [p for p in zip(inner, (c for c in b.co_consts if isinstance(c, CodeType))) if p[0] != p[1]]
        return out


class Forks:
    """Runs collected tests in forks."""

    def __init__(self, session: pytest.Session) -> None:
        self.session, self.failed, self.killed = session, False, False
        self.items = {item.nodeid: item for item in session.items}
        self.functions = Functions()
        self.at = mmap.mmap(-1, 8)

    def pytest_runtest_logreport(self, report: Any) -> None:
        """Whether the test at hand failed."""
        self.failed |= report.failed

    def first_failure(self, fault: Fault | None, tests: list[tuple[str, float]]) -> str | None:
        """Run tests, each with its processor seconds without a fault, in a fork; the first that fails or takes ten times longer."""
        names = [(name, seconds) for name, seconds in tests if name in self.items]
        self.at[:] = (0).to_bytes(8, "big")
        pid = os.fork()
        if pid == 0:
            code = BROKEN
            try:
                code = self._run(fault, names)
            finally:
                os._exit(code)
        deadline = time.monotonic() + 60 + 60 * sum(seconds for _, seconds in names)
        ended, status = os.waitpid(pid, os.WNOHANG)
        while not ended and time.monotonic() < deadline:
            time.sleep(0.01)
            ended, status = os.waitpid(pid, os.WNOHANG)
        _end_group(pid)
        if not ended:
            _, status = os.waitpid(pid, 0)
        if not ended or (os.WIFEXITED(status) and os.WEXITSTATUS(status) == BROKEN):
            raise RuntimeError("the fork broke or waited before its tests ended: a loaded machine decides nothing")
        self.killed = os.WIFSIGNALED(status)
        return None if status == 0 else names[int.from_bytes(self.at[:], "big")][0]

    def _run(self, fault: Fault | None, names: list[tuple[str, float]]) -> int:
        """0 where all pass, 1 where one does not."""
        os.setsid()
        self.session.config.pluginmanager.unregister(name="terminalreporter")
        if fault is not None:
            self.functions.take(fault)
        items = [self.items[name] for name, _ in names]
        signal.signal(signal.SIGPROF, signal.SIG_DFL)
        for k, (item, following) in enumerate(zip(items, [*items[1:], None], strict=True)):
            self.at[:] = k.to_bytes(8, "big")
            signal.setitimer(signal.ITIMER_PROF, 10 + 10 * names[k][1])
            item.config.hook.pytest_runtest_protocol(item=item, nextitem=following)
            if self.failed:
                return 1
        return 0


def _end_group(pid: int) -> None:
    """What a fork left behind."""
    try:
        os.killpg(pid, signal.SIGKILL)
    except ProcessLookupError:
        pass
