"""Files that the package writes: beside their place first, so that what cannot be finished costs nothing that was there."""

from __future__ import annotations

import os
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any


@contextmanager
def beside(path: Any) -> Iterator[Path]:
    """A path to write to in the folder of ``path``; it takes that name when the block has ended and is removed otherwise.

    A link is followed, permissions of a file that is there are kept. What is not a file, a pipe or ``/dev/stdout``, is
    written as it is.

    Returns Path: ends like ``path``.
    Raises OSError where the folder is not there or full, or ``path`` is a folder or write-protected; a file that was
        there is as it was.

    >>> import tempfile
    >>> from pathlib import Path
    >>> from sksurrogate._files import beside
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     with beside(Path(folder, "a.txt")) as part:
    ...         _ = part.write_text("whole")
    ...     [file.name for file in Path(folder).iterdir()]
    ['a.txt']
    """
    target = Path(os.path.realpath(path))
    if target.is_dir():
        raise IsADirectoryError(21, "is a folder, expected the name of a file", str(path))
    if target.exists() and not target.is_file():
        yield target
        return
    if target.exists() and not os.access(target, os.W_OK):
        raise PermissionError(13, "is write-protected", str(path))
    part = target.with_name(f".{secrets.token_hex(8)}{target.suffix}")
    try:
        yield part
        if target.exists():
            shutil.copymode(target, part)
        _on_disk(part)
        os.replace(part, target)
    finally:
        part.unlink(missing_ok=True)


def _on_disk(path: Path) -> None:
    """Wait until the bytes are there: a name that moves before them is an empty file after a power cut."""
    with path.open("rb+") as file:
        os.fsync(file.fileno())


def write_bytes(path: Any, content: bytes) -> None:
    """Write a file whole or not at all."""
    with beside(path) as part:
        part.write_bytes(content)


def write_text(path: Any, text: str) -> None:
    """Write a file as UTF-8, whole or not at all."""
    write_bytes(path, text.encode("utf-8"))


def append_line(path: Any, text: str) -> None:
    """Add a line in one piece, so that lines of two processes do not mix; one that was broken off before stays alone."""
    with Path(path).open("ab+") as stream, _alone(stream):
        whole = stream.seek(0, os.SEEK_END) == 0 or _last(stream) == b"\n"
        data = (("" if whole else "\n") + text + "\n").encode("utf-8")
        if os.write(stream.fileno(), data) != len(data):
            raise OSError(28, "No space left on device", str(path))


@contextmanager
def _alone(stream: Any) -> Iterator[None]:
    """No other process that asks for the same looks at the end of the file, or adds to it, meanwhile."""
    try:
        import fcntl
    except ImportError:  # not a POSIX system
        yield
        return
    fcntl.flock(stream, fcntl.LOCK_EX)
    try:
        yield
    finally:
        fcntl.flock(stream, fcntl.LOCK_UN)


def _last(stream: Any) -> bytes:
    stream.seek(-1, os.SEEK_END)
    return bytes(stream.read(1))
