"""What a simulator of the user's own raises, as a message with its place."""

from __future__ import annotations

import sysconfig
import traceback
from functools import cache
from pathlib import Path

from sksurrogate.exceptions import SurrogateError

#: What is below these folders is no file of the user's own: this package, installed ones, Python.
_OTHERS = (
    str(Path(__file__).resolve().parent),
    *(sysconfig.get_path(name) for name in ("stdlib", "platstdlib", "purelib", "platlib")),
)


def failure_of(error: Exception, simulator: str, data: str) -> str | None:
    """What is wrong in the file of a simulator; None where an error does not come from there.

    ``simulator``: ``file.py:name``.
    ``data``: file of the recording.
    """
    place = line_in(simulator.rpartition(":")[0], error)
    if not place:
        return None
    if isinstance(error, SurrogateError):
        return f"{simulator} fails in {place}: {error}"
    return (
        f"{simulator} fails in {place}: {type(error).__name__}: {error}. See that its simulate "
        f"answers the inputs in {data}; where it must refuse some values, return nan there."
    )


def line_in(file: str | None, error: BaseException | None) -> str:
    """The deepest line of a file in which an error, or what it was raised from, came up; empty where there is none.

    ``file``: None for any file of the user's own.

    >>> line_in("plant.py", SyntaxError("invalid syntax", ("plant.py", 3, 1, "x = = 1")))
    'line 3 of plant.py, `x = = 1`'
    >>> line_in("plant.py", ValueError("no level"))
    ''
    """
    while error is not None:
        frames = traceback.extract_tb(error.__traceback__)
        if isinstance(error, SyntaxError) and error.filename:
            frames.append(traceback.FrameSummary(error.filename, error.lineno, "", line=error.text or ""))
        for frame in reversed(frames):
            if _is_own(frame.filename) if file is None else Path(frame.filename).resolve() == Path(file).resolve():
                source = f", `{frame.line.strip()}`" if frame.line else ""
                return f"line {frame.lineno} of {Path(frame.filename).name}{source}"
        error = error.__cause__
    return ""


@cache
def _is_own(filename: str) -> bool:
    """Whether a file is neither of this package, nor installed, nor made up as ``<string>`` is."""
    return not filename.startswith("<") and not str(Path(filename).resolve()).startswith(_OTHERS)
