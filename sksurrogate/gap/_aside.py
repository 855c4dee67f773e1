"""A question answered in a second process while this one goes on with others."""

from __future__ import annotations

import gc
import mmap
import multiprocessing
import os
import pickle
import signal
import sys
import threading
import time
import warnings
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from functools import cache
from itertools import accumulate
from multiprocessing.connection import Connection
from typing import Any, Generic, TypeVar

import numpy as np
from threadpoolctl import ThreadpoolController

__all__ = ["Aside", "can_fork", "one_thread", "side_by_side"]

S = TypeVar("S")
T = TypeVar("T")
#: Seconds that are waited for an answer, and how many times what has passed since the question was asked: after that it is
#: worked out here.
PATIENCE, TIMES = 30.0, 3.0
#: Bytes of which the place of an array that travels is a multiple.
ALIGNED = 64
#: Niceness of a process whose answer is wanted later: where cores are wanted it takes a tenth of one.
LATER = 10


def can_fork() -> bool:
    """Whether a second process is of use and safe: a free core, no other thread whose lock it would inherit, and this
    process none of several workers."""
    alone = threading.active_count() == 1 and multiprocessing.parent_process() is None
    return sys.platform == "linux" and alone and len(os.sched_getaffinity(0)) > 1


class Aside(Generic[T]):
    """An answer that is worked out beside.

    The second process is a fork: it sees everything that this one knows at that moment, so that nothing but the answer has
    to travel, and what it changes is lost. Where it cannot be made, or brings no answer, the question is answered here.

    Parameters
    ----------
    question : callable () -> answer
        Its answer can be pickled.
    apart : bool
        Whether a second process is wanted.
    later : bool, default=False
        Whether the answer is wanted much later: until then it takes mostly time that no other process wants.

    Examples
    --------
    >>> six = Aside(lambda: 2 * 3)
    >>> six.answer()
    6
    """

    def __init__(self, question: Callable[[], T], apart: bool = True, later: bool = False):
        self._question = question
        self._nice = LATER if later else 0
        self._begun = time.monotonic()
        self._pipe: Connection | None = None
        self._memory = -1
        self._process: Any = None
        self._owner = os.getpid()
        if apart and can_fork():
            self._fork()

    def answer(self) -> T:
        """What the question gives."""
        if self._pipe is not None:
            pipe, self._pipe = self._pipe, None
            try:
                if pipe.poll(PATIENCE + TIMES * (time.monotonic() - self._begun)):
                    answer, heard = _heard(pipe, self._memory)
                    for warning in heard:
                        warnings.warn(warning, stacklevel=2)
                    return answer
            except (EOFError, OSError):
                pass  # it raised, or could not be sent: here it raises where it is seen
            finally:
                self.leave()
        return self._question()

    def leave(self) -> None:
        """End the second process: its answer is here, or not wanted any more."""
        if self._process is not None and self._owner == os.getpid():
            self._process.kill()
            multiprocessing.active_children()  # those that have ended are let go; this one may take a moment
            self._process = None
            os.close(self._memory)

    def __del__(self) -> None:
        self.leave()

    def _fork(self) -> None:
        libraries()
        fork = multiprocessing.get_context("fork")
        here, there = fork.Pipe(duplex=False)
        memory = os.memfd_create("answer")
        process = fork.Process(target=_tell, args=(self._question, there, memory, self._nice), daemon=True)
        with warnings.catch_warnings():
            # From Python 3.12 on a fork warns of the threads of numerical libraries; these are made again or not used there.
            warnings.simplefilter("ignore", DeprecationWarning)
            try:
                process.start()
            except OSError:  # no more processes are allowed
                os.close(memory)
                return
        there.close()
        self._pipe, self._process, self._memory = here, process, memory


def side_by_side(
    function: Callable[[S], T], items: Sequence[S], apart: bool, effort: Callable[[S], float] | None = None
) -> list[T]:
    """The function of every item, begun at both ends: from the front here, from the back in a second process.

    Each takes the next item when it is done with one, until they meet. Where both begin the last item at once it is worked
    out twice. Items of most ``effort`` stand at the ends, so that they meet at short ones.

    Examples
    --------
    >>> side_by_side(lambda x: x**2, [1, 2, 3], apart=False)
    [1, 4, 9]
    """
    order = list(range(len(items)))
    if effort is not None:
        order.sort(key=lambda k: -effort(items[k]))
        order = order[::2] + order[1::2][::-1]
    met = memoryview(mmap.mmap(-1, 16)).cast("q")  # how many are begun here, the first that is begun there
    met[1] = len(items)

    def from_the_back() -> dict[int, T]:
        out = {}
        for k in reversed(range(len(items))):
            if k < met[0]:
                break
            met[1] = k
            out[k] = function(items[order[k]])
        return out

    beside = Aside(from_the_back, apart and len(items) > 1)
    here: dict[int, T] = {}
    while len(here) < met[1]:
        met[0] = len(here) + 1
        here[len(here)] = function(items[order[len(here)]])
    both = {**beside.answer(), **here}
    return [both[k] for k in np.argsort(order)]


def _tell(question: Callable[[], T], pipe: Connection, memory: int, nice: int) -> None:
    """Answer in the second process; silence is the sign that it could not."""
    os.nice(nice)
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # an interrupt is told by the first one
    gc.disable()  # a collection would touch, and so copy, all that both processes share
    try:
        with libraries().limit(limits=1), warnings.catch_warnings(record=True) as heard:
            answer = question()
        arrays: list[pickle.PickleBuffer] = []
        told = pickle.dumps((answer, [warning.message for warning in heard]), 5, buffer_callback=arrays.append)
        raw = [array.raw() for array in arrays]
        for one in raw:
            _write(memory, one)
        pipe.send((told, [one.nbytes for one in raw]))
    finally:
        os._exit(0)


def _write(memory: int, one: memoryview) -> None:
    """Behind what is there, so that the next begins at a multiple of :data:`ALIGNED`."""
    done = 0
    while done < one.nbytes:
        done += os.write(memory, one[done:])
    os.write(memory, bytes(-done % ALIGNED))


def _heard(pipe: Connection, memory: int) -> Any:
    """What the second process told; its arrays lie where it wrote them, changes stay here."""
    told, sizes = pipe.recv()
    ends = list(accumulate(size + -size % ALIGNED for size in sizes))
    if not ends or not ends[-1]:
        return pickle.loads(told, buffers=[bytearray() for _ in sizes])
    whole = memoryview(mmap.mmap(memory, ends[-1], flags=mmap.MAP_PRIVATE))
    return pickle.loads(told, buffers=[whole[a : a + size] for a, size in zip([0, *ends], sizes)])


def one_thread() -> AbstractContextManager[Any]:
    """Linear algebra in one thread: two processes share the cores, and no sum depends on which of them adds it up."""
    return libraries().limit(limits=1, user_api="blas")


@cache
def libraries() -> ThreadpoolController:
    """Numerical libraries with threads of their own, which do not live on in a fork."""
    return ThreadpoolController()
