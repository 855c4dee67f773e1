"""Entry point of the command ``sksurrogate``, and of ``python -m sksurrogate``."""

from __future__ import annotations

import os
import signal
import sys
from importlib import import_module
from types import FrameType

__all__ = ["main"]


def main() -> int:
    """The command line; an interrupt while it is imported ends it with a sentence."""
    before = signal.getsignal(signal.SIGINT)
    heard = before is signal.default_int_handler  # a command in the background may have been started to ignore it
    if heard:
        signal.signal(signal.SIGINT, _ended)
    run = import_module("sksurrogate.cli").main  # not at the top: the import takes most of a second
    if heard:
        signal.signal(signal.SIGINT, before)
    return int(run())


def _ended(number: int, frame: FrameType | None) -> None:
    """End at once: an exception within an import may come out as another one."""
    os.write(2, b"sksurrogate: interrupted before anything was known\n")
    os._exit(130)


if __name__ == "__main__":
    sys.exit(main())
