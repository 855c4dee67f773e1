"""Output to the terminal that never raises: a broken pipe, a full disk or an unknown letter must not end the work."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from typing import Any, TextIO


class SafeStream:
    """A text stream that never raises where it is written; the first thing that went wrong is kept in ``error``.

    ``stream``: None, where the terminal is closed, swallows everything.

    >>> import io
    >>> from sksurrogate._terminal import SafeStream
    >>> plain = io.TextIOWrapper(io.BytesIO(), encoding="ascii")
    >>> print("gap ≥ 3", file=SafeStream(plain), flush=True)
    >>> plain.buffer.getvalue().decode()
    'gap ? 3\\n'
    """

    def __init__(self, stream: TextIO | None):
        self.stream = stream
        self.error: OSError | None = None

    def write(self, text: str) -> int:
        """Write what the stream can show, "?" for what it cannot."""
        if self.stream is not None and self.error is None:
            try:
                self.stream.write(text)
            except UnicodeEncodeError:
                known = getattr(self.stream, "encoding", None) or "ascii"
                return self.write(text.encode(known, errors="replace").decode(known))
            except (OSError, ValueError) as error:  # ValueError: it was closed
                self._failed(error)
        return len(text)

    def flush(self) -> None:
        """Hand over what was written."""
        if self.stream is not None and self.error is None:
            try:
                self.stream.flush()
            except (OSError, ValueError) as error:
                self._failed(error)

    def _failed(self, error: Exception) -> None:
        """Nothing more goes there; what is left in its buffer goes nowhere, so that Python's exit does not stumble on it."""
        self.error = error if isinstance(error, OSError) else OSError(str(error))
        try:
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, self.stream.fileno())  # type: ignore[union-attr]
            os.close(nowhere)
        except (OSError, ValueError, AttributeError):  # no descriptor behind it
            pass

    def __getattr__(self, name: str) -> Any:
        return getattr(vars(self)["stream"], name)


@contextmanager
def safe_terminal() -> Iterator[SafeStream]:
    """``sys.stdout`` and ``sys.stderr`` never raise within; yields the first."""
    shown = SafeStream(sys.stdout)
    with redirect_stdout(shown), redirect_stderr(SafeStream(sys.stderr)):  # type: ignore[type-var]
        try:
            yield shown
        finally:
            shown.flush()
