"""Worker processes that an interrupt does not reach, and that end with the process that started them: it decides what becomes of them."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing import resource_tracker
from typing import Any

from joblib import Parallel, delayed, effective_n_jobs
from joblib.externals.loky.backend import resource_tracker as loky_tracker
from joblib.parallel import get_active_backend

from sksurrogate._parallel._orphans import watch_parent


@contextmanager
def interrupts_blocked() -> Iterator[None]:
    """Processes that are started within never see Ctrl-C; this one sees it afterwards.

    Python shows a traceback of an interrupt that comes while a process still imports what it needs.

    >>> import signal, subprocess, sys
    >>> with interrupts_blocked():
    ...     child = subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE)
    >>> child.send_signal(signal.SIGINT)
    >>> _ = child.communicate(b"\\n")
    >>> child.returncode
    0
    """
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def workers(n_jobs: int | None, **options: Any) -> Parallel:
    """joblib's workers, started with :func:`interrupts_blocked`. Those of this machine end with this process, whatever they are doing.

    >>> workers(1)(delayed(abs)(k) for k in (-1, 2))
    [1, 2]
    """
    n = effective_n_jobs(n_jobs)
    if n > 1:
        if sys.platform != "win32":
            for tracker in (resource_tracker, loky_tracker):
                tracker.ensure_running()  # where one starts later it lets interrupts in again
        with interrupts_blocked():
            Parallel(n_jobs=n_jobs, **_looked_after())(delayed(os.getpid)() for _ in range(n))
        options = {**_looked_after(), **options}
    return Parallel(n_jobs=n_jobs, **options)


def _looked_after() -> dict[str, Any]:
    """Options of workers that are processes which this one starts: one that waits in a simulator would outlive a process that is killed."""
    local = type(get_active_backend()[0]).__name__ == "LokyBackend"
    return {"initializer": _ends_with, "initargs": (os.getpid(),)} if local else {}


def _ends_with(owner: int) -> None:
    """Said to every worker when it starts."""
    if os.getppid() != owner:
        os._exit(1)  # it has ended meanwhile
    watch_parent()
