"""A stage of a diagnosis as data, and how far it is: share done, estimate of what remains; a bar on a terminal, plain lines elsewhere."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any, TypeAlias

import numpy as np

from sksurrogate._parallel._worker_process import one_thread

#: A fault of the record is looked for before this share of a time limit is over: the diagnosis then begins again.
SOON = 0.3
#: Shows a message, the share that is done, and an estimate of the remaining seconds, None where it is too early to tell.
Show: TypeAlias = Callable[[str, float, float | None], None]
INTERRUPTED = "interrupted: the report holds what was known by then (report_.complete is False)"


@dataclass(frozen=True)
class Stage:
    """One stage of a diagnosis."""

    name: str
    ask: Callable[[Any], None]
    summary: str = ""  #: What is said while it is asked
    share: float = 0.0  #: Usual share of the time
    #: Share of a time limit at which it must be over; inf where nothing can be said without it
    until: float = 0.95


@contextmanager
def quiet() -> Iterator[None]:
    """Linear algebra in one thread; candidates that run away are met everywhere with finite checks."""
    with np.errstate(all="ignore"), one_thread():
        yield


#: Seconds before which an estimate would say nothing.
TOO_EARLY = 0.5


def remaining_seconds(elapsed: float, done: float, before: float = 0.0) -> float | None:
    """Estimate of what remains where a share is done, of which some was done ``before``; None where it is too early to tell.

    >>> remaining_seconds(10.0, 0.25), remaining_seconds(10.0, 0.75, before=0.5)
    (30.0, 10.0)
    """
    return elapsed * (1.0 - done) / (done - before) if done > before and elapsed > TOO_EARLY else None


class Progress:
    """Share of the work that is done, from the usual shares of the stages; each message within a stage is half of its rest.

    ``show``: None shows nothing.
    ``time_limit``: seconds after which nothing remains.
    """

    def __init__(self, show: Show | None, time_limit: float | None):
        self.show, self.time_limit = show, time_limit
        self.started_at = self.round_at = time.perf_counter()
        self.before, self.done, self.end = 0.0, 0.0, 0.0

    def begin(self, done: float = 0.0) -> None:
        """A round begins, as after a fault of the record, of which a share was done before."""
        self.round_at = time.perf_counter()
        self.before, self.done, self.end = done, done, done

    @property
    def elapsed(self) -> float:
        """Seconds since the beginning."""
        return time.perf_counter() - self.started_at

    def stage(self, share: float) -> None:
        """The next stage begins, which takes this share of the whole."""
        self.done = self.end
        self.end = min(self.done + share, 1.0)

    def say(self, message: str) -> None:
        """What is being done."""
        now = time.perf_counter()
        rest = remaining_seconds(now - self.round_at, self.done, self.before)
        if rest is not None and self.time_limit is not None:
            rest = max(min(rest, self.time_limit - (now - self.started_at)), 0.0)
        if self.show is not None:
            self.show(message, self.done, rest)
        self.done += (self.end - self.done) / 2.0


@contextmanager
def progress_shown(verbose: int) -> Iterator[Show | None]:
    """Where progress is shown while this is entered: a bar of rich on a terminal, else lines on the error stream."""
    terminal = getattr(sys.stderr, "isatty", lambda: False)()
    if not (verbose and terminal and find_spec("rich")):
        yield _line if verbose else None
        return
    from rich.console import Console
    from rich.markup import escape
    from rich.progress import BarColumn, TaskProgressColumn, TextColumn
    from rich.progress import Progress as Bar

    columns = TextColumn("[gap]", markup=False), BarColumn(), TaskProgressColumn(), TextColumn("{task.description}")
    with Bar(*columns, console=Console(file=sys.stderr), transient=True) as bar:
        task = bar.add_task("", total=1.0)

        def draw(message: str, done: float, remaining: float | None) -> None:
            bar.update(task, completed=done, description=escape(_with_rest(message, remaining)))

        yield draw


def _line(message: str, done: float, remaining: float | None) -> None:
    """A line on the error stream."""
    print(f"[gap] {100 * done:3.0f} % {_with_rest(message, remaining)}", file=sys.stderr, flush=True)


def _with_rest(message: str, remaining: float | None) -> str:
    """A message with the estimate of what remains."""
    return message if remaining is None else f"{message} (about {remaining:.0f} s left)"
