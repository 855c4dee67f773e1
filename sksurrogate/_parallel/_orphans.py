"""Helper processes end with the process that started them, whatever they are doing."""

from __future__ import annotations

import ctypes
import os
import signal
import sys
import threading
import time

#: ``PR_SET_PDEATHSIG`` of Linux: the signal that a process is sent when its parent dies.
SIGNAL_AT_DEATH_OF_PARENT = 1
#: Seconds between two looks at the parent.
PAUSE = 1.0


def end_with(parent: int) -> None:
    """End this process, a fork, when its parent does: also while it waits in a simulator. Linux only.

    ``parent``: its process number; one that has ended before this call is noticed too.
    """
    if sys.platform == "linux":
        ctypes.CDLL(None, use_errno=True).prctl(SIGNAL_AT_DEATH_OF_PARENT, signal.SIGKILL, 0, 0, 0)
        if os.getppid() != parent:
            os._exit(1)


def watch_parent() -> threading.Thread:
    """End this process when the one that started it does, on every system that gives orphans to another parent.

    A thread looks: a signal at the death of the parent would come when the *thread* ends that started this process.
    """
    parent = os.getppid()

    def look() -> None:
        while os.getppid() == parent:
            time.sleep(PAUSE)
        os._exit(1)

    thread = threading.Thread(target=look, daemon=True, name="watch-parent")
    thread.start()
    return thread
