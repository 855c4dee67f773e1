"""A moment at which long computations stop: loops that take long ask for it between two steps."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

#: The moment by :func:`time.perf_counter`, and the process that it holds for: a fork answers for another one, which waits.
_UNTIL: ContextVar[tuple[float, int]] = ContextVar("until", default=(math.inf, 0))


class TimeIsUp(KeyboardInterrupt):
    """The moment has passed; like an interrupt it is not an error, and what is known by then stays."""


@contextmanager
def time_until(moment: float) -> Iterator[None]:
    """:func:`check_time` raises within, once, after this moment.

    >>> with time_until(time.perf_counter() - 1.0):
    ...     try:
    ...         check_time()
    ...     except TimeIsUp:
    ...         print("over", time_left())
    over inf
    """
    token = _UNTIL.set((moment, os.getpid()))
    try:
        yield
    finally:
        _UNTIL.reset(token)


def limited() -> bool:
    """Whether a moment is set."""
    return math.isfinite(_UNTIL.get()[0])


def time_left() -> float:
    """Seconds until the moment; inf where none is set, or where it was raised: what follows is to end in order."""
    moment, owner = _UNTIL.get()
    return math.inf if math.isinf(moment) or owner != os.getpid() else moment - time.perf_counter()


def check_time() -> None:
    """Stop where the moment has passed.

    Raises TimeIsUp: once: who catches it may end in order.
    """
    if _UNTIL.get()[0] is not math.inf and time_left() <= 0.0:
        _UNTIL.set((math.inf, os.getpid()))
        raise TimeIsUp
