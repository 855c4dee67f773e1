"""One function of many items, in two processes that meet in the middle."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import TypeVar

from sksurrogate._parallel._worker_process import WorkerProcess

S = TypeVar("S")
T = TypeVar("T")


def side_by_side(function: Callable[[S], T], items: Sequence[S], second: WorkerProcess | None) -> list[T]:
    """The function of every item, started at both ends: from the front here, from the back in a second process.

    Each takes the next item when it is done with one, until they meet. Where both begin the last item at once it is worked
    out twice.

    >>> side_by_side(lambda x: x**2, [1, 2, 3], None)
    [1, 4, 9]
    """
    if second is None or not second.apart or len(items) < 2:
        return [function(one) for one in items]
    met = second.shared
    met[0], met[1] = 0, len(items)  # how many are started here, the first that is started there
    beside = second.ask(partial(_from_the_back, function, items, met))
    here: dict[int, T] = {}
    try:
        while len(here) < met[1]:
            met[0] = len(here) + 1
            here[len(here)] = function(items[len(here)])
        both = {**beside.answer(), **here}
    except BaseException:
        second.leave()  # it still works on items, and would meet those of the next question
        raise
    return [both[k] for k in range(len(items))]


def _from_the_back(function: Callable[[S], T], items: Sequence[S], met: memoryview) -> dict[int, T]:
    """What the second process does, until it meets the first one."""
    out = {}
    for k in reversed(range(len(items))):
        if k < met[0]:
            break
        met[1] = k
        out[k] = function(items[k])
    return out
