"""What external programs print: on another stream in this process, nowhere in workers, which would only repeat it.

A library in C writes past Python to the descriptor of the output, and keeps what it wrote in a buffer of its own.
"""

from __future__ import annotations

import ctypes
import multiprocessing
import os
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from typing import TextIO

OUTPUT, ERRORS = 1, 2


@contextmanager
def printed_as_errors(bar: bool = False) -> Iterator[None]:
    """Within, what is printed goes to the error stream.

    ``bar``: whether a bar may be drawn on a terminal there: what is written past Python would go through the middle of it, and goes
        nowhere.
    """
    drawn = bar and getattr(sys.stderr, "isatty", lambda: False)()
    with _led(OUTPUT, None if drawn else ERRORS, sys.stdout), redirect_stdout(sys.stderr):
        yield


@contextmanager
def silent() -> Iterator[None]:
    """Within, nothing is printed.

    >>> with silent():
    ...     print("step")
    """
    with (
        open(os.devnull, "w") as nowhere,
        _led(OUTPUT, None, sys.stdout),
        _led(ERRORS, None, sys.stderr),
        redirect_stdout(nowhere),
        redirect_stderr(nowhere),
    ):
        yield


@contextmanager
def silent_in_worker() -> Iterator[None]:
    """Within, nothing is printed, if this is a process of its own that does one thing at a time."""
    if multiprocessing.parent_process() is None or threading.current_thread() is not threading.main_thread():
        yield
    else:
        with silent():
            yield


@contextmanager
def _led(descriptor: int, elsewhere: int | None, stream: TextIO) -> Iterator[None]:
    """A descriptor leads elsewhere within, None for nowhere; as it is, where there are no such descriptors."""
    try:
        _flush(stream)
        kept = os.dup(descriptor)
        if elsewhere is None:
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, descriptor)
            os.close(nowhere)
        else:
            os.dup2(elsewhere, descriptor)
    except OSError:  # it is closed
        yield
        return
    try:
        yield
    finally:
        _flush(None)
        os.dup2(kept, descriptor)
        os.close(kept)


def _flush(stream: TextIO | None) -> None:
    """What Python and C keep in their buffers goes where it belongs."""
    if stream is not None:
        stream.flush()
    if os.name == "posix":
        ctypes.CDLL(None).fflush(None)
