"""What a simulator of the user's own raises, as a message with its place."""

from __future__ import annotations

import traceback
from pathlib import Path

from sksurrogate.exceptions import SurrogateError


def failure_of(error: Exception, simulator: str, data: str) -> str | None:
    """What is wrong in the file of a simulator; None where an error does not come from there.

    ``simulator``: ``file.py:name``.
    ``data``: file of the recording.
    """
    file = Path(simulator.rpartition(":")[0]).resolve()
    frames = [one for one in traceback.extract_tb(error.__traceback__) if Path(one.filename).resolve() == file]
    if isinstance(error, SurrogateError) or not frames:
        return None
    return (
        f"{simulator} fails in line {frames[-1].lineno} of {file.name}: {type(error).__name__}: {error}. See that its simulate "
        f"answers the inputs in {data}; where it must refuse some values, return nan there."
    )
