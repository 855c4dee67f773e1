"""A stage of a diagnosis as data."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np

from sksurrogate._parallel._worker_process import one_thread

__all__ = ["INTERRUPTED", "SOON", "Stage", "quiet"]

#: A fault of the record is looked for before this share of a time limit is over: the diagnosis then begins again.
SOON = 0.3
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
