"""Warnings of external programs that are called many times: each line of code warns once."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any


@contextmanager
def warned_once() -> Iterator[None]:
    """Within, a warning is shown once for each line of code that gives it, and by this process alone.

    >>> with warnings.catch_warnings(record=True) as heard, warned_once():
    ...     warnings.simplefilter("always")
    ...     for k in range(9):
    ...         warnings.warn(f"{k} is out of range")
    >>> [str(one.message) for one in heard]
    ['0 is out of range']
    """
    shown: set[tuple[type[Warning], str, int]] = set()
    usual, owner, within = warnings.showwarning, os.getpid(), [True]

    def show(message: Any, category: type[Warning], filename: str, lineno: int, *rest: Any, **more: Any) -> None:
        known = (category, filename, lineno) in shown or os.getpid() != owner
        shown.add((category, filename, lineno))
        if not (known and within):  # a thread that had entered before may have put it back
            usual(message, category, filename, lineno, *rest, **more)

    with warnings.catch_warnings():
        warnings.showwarning = show
        try:
            yield
        finally:
            within.clear()
