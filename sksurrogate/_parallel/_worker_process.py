"""Questions answered in a second process while this one goes on with others."""

from __future__ import annotations

import gc
import mmap
import multiprocessing
import os
import signal
import socket
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterable
from contextlib import AbstractContextManager
from functools import cache, partial
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np
from threadpoolctl import ThreadpoolController

from sksurrogate._parallel._ipc import receive, send
from sksurrogate._parallel._orphans import end_with
from sksurrogate._printed import silent
from sksurrogate.kernels.clock import check_time, time_left

T = TypeVar("T")
#: Seconds that are waited for an answer, and how many times what has passed since the question was asked: after that it is
#: worked out here.
PATIENCE, TIMES_PASSED = 30.0, 3.0
#: Niceness of a process whose answers are wanted later: where cores are wanted it takes a tenth of one.
LATER = 10


def can_fork() -> bool:
    """Whether a second process is of use and safe: a free core, no other thread whose lock it would inherit, and this
    process none of several workers."""
    alone = threading.active_count() == 1 and multiprocessing.parent_process() is None
    return sys.platform == "linux" and alone and len(os.sched_getaffinity(0)) > 1


class _Answer(NamedTuple):
    """Of one question; ``answered`` is False where there is none."""

    answered: bool
    value: Any = None
    heard: tuple[tuple[Any, type[Warning], str, int], ...] = ()  #: Message, kind, file and line of each warning


class WorkerProcess:
    """A second process, which answers one question after the other until it is left.

    It is a fork, made at the first question; what it is asked travels to it, but for what is ``known`` from the beginning.
    Where it cannot be made, a question cannot travel, or no answer comes, the question is answered here.

    ``known``: what does not change, such as a simulator: it need not be such that it can be pickled.
    ``apart``: whether a second process is wanted.
    ``later``: whether its answers are wanted much later: until then it takes mostly time that no other process wants.

    >>> with WorkerProcess() as second:
    ...     six = second.ask(lambda: 2 * 3)
    ...     six.answer()
    6
    """

    def __init__(self, known: Iterable[object] = (), apart: bool = True, later: bool = False):
        self.apart, self._nice = apart, LATER if later else 0
        #: Whole numbers that both processes see.
        self.shared = memoryview(mmap.mmap(-1, 16)).cast("q") if apart else memoryview(bytearray(16)).cast("q")
        self._known = [self.shared, *known]
        self._places = {id(one): place for place, one in enumerate(self._known)}
        self._line: socket.socket | None = None
        self._process: Any = None
        self._owner = os.getpid()
        self._asked = self._lost = 0
        self._answers: dict[int, _Answer] = {}

    def ask(self, question: Callable[[], T]) -> PendingAnswer[T]:
        """The answer, worked out beside."""
        if self._line is None and self.apart and can_fork():
            self._fork()
        if self._line is None or self._owner != os.getpid():
            return PendingAnswer(question)
        self._asked += 1
        try:
            send(self._line, (self._asked, np.geterr(), question), self._places)
        except OSError:  # it died
            self._give_up()
        except Exception:  # it cannot travel
            return PendingAnswer(question)
        return PendingAnswer(question, self, self._asked)

    def wait(self, number: int, patience: float) -> _Answer:
        """The answer to a question; without one for so many seconds the process is left."""
        until = time.monotonic() + min(patience, time_left())
        while number not in self._answers and number > self._lost and self._line is not None:
            try:
                self._line.settimeout(max(until - time.monotonic(), 1e-3))
                one, answer = receive(self._line, self._known)
                self._answers[one] = answer
            except TimeoutError:
                check_time()
                self._give_up()
            except Exception:  # it died, or given what cannot be read
                self._give_up()
        return self._answers.pop(number, _Answer(False))

    def leave(self) -> None:
        """End the second process: its answers are here, or not wanted any more."""
        if self._process is not None and self._owner == os.getpid():
            self._process.kill()
            multiprocessing.active_children()  # those that have ended are let go; this one may take a moment
        self._process, self._lost = None, self._asked
        if self._line is not None:
            self._line.close()
            self._line = None

    def _give_up(self) -> None:
        """All is answered here from now on."""
        self.leave()
        self.apart = False

    def _fork(self) -> None:
        libraries()
        fork = multiprocessing.get_context("fork")
        with warnings.catch_warnings():
            # From Python 3.12 on a fork warns of the threads of numerical libraries; these are made again or not used there.
            warnings.simplefilter("ignore", DeprecationWarning)
            try:
                here, there = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
            except OSError:  # no more files are allowed
                return
            process = fork.Process(
                target=_serve,
                args=(os.getpid(), here, there, self._known, self._places, self._nice),
                daemon=True,
            )
            try:
                process.start()
            except OSError:  # no more processes are allowed
                here.close()
                return
            finally:
                there.close()
        self._line, self._process = here, process

    def __enter__(self) -> WorkerProcess:
        return self

    def __exit__(self, *raised: object) -> None:
        self.leave()

    def __del__(self) -> None:
        self.leave()

    def __reduce__(self) -> tuple[Any, ...]:
        return partial(WorkerProcess, apart=False), ()  # no process of the second one


class PendingAnswer(Generic[T]):
    """The answer to a question: of the second process that was asked, or of this one.

    ``question`` () -> answer.
    ``number``: of the question among those that were asked there.
    """

    def __init__(self, question: Callable[[], T], second: WorkerProcess | None = None, number: int = 0):
        self._question, self._second, self._number = question, second, number
        self._begun = time.monotonic()

    def answer(self) -> T:
        """What the question gives."""
        if self._second is not None:
            second = self._second
            found = second.wait(self._number, PATIENCE + TIMES_PASSED * (time.monotonic() - self._begun))
            self._second = None
            if found.answered:
                for warning in found.heard:
                    warnings.warn_explicit(*warning)
                return found.value
        return self._question()  # what raised there raises here, where it is seen


def _serve(
    owner: int, here: socket.socket, line: socket.socket, known: list[object], places: dict[int, int], nice: int
) -> None:
    """Answer in the second process, until the first one is gone."""
    end_with(owner)
    here.close()
    os.nice(nice)
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # an interrupt comes from the first one
    gc.freeze()  # a collection would touch, and so copy, all that both processes share
    try:
        with libraries().limit(limits=1), silent():  # the first one runs the same simulator, and shows what it prints
            while True:
                number, errors, question = receive(line, known)
                answer = _answered(errors, question)
                try:
                    send(line, (number, answer), places)
                except Exception:  # it cannot travel
                    send(line, (number, _Answer(False)), places)
                del question, answer
    finally:
        os._exit(0)


def _answered(errors: dict[str, Any], question: Callable[[], object]) -> _Answer:
    """With the warnings that were given; none where the question raises."""
    try:
        with np.errstate(**errors), warnings.catch_warnings(record=True) as heard:
            value = question()
    except Exception:
        return _Answer(False)
    return _Answer(True, value, tuple((one.message, one.category, one.filename, one.lineno) for one in heard))


def one_thread() -> AbstractContextManager[Any]:
    """Linear algebra in one thread: two processes share the cores, and no sum depends on which of them adds it up."""
    return libraries().limit(limits=1, user_api="blas")


@cache
def libraries() -> ThreadpoolController:
    """Numerical libraries with threads of their own, which do not live on in a fork."""
    return ThreadpoolController()
