"""What cannot travel to worker processes, in words, and what must not be shared with a fork."""

from __future__ import annotations

import io
import pickle
from typing import Any

from joblib import effective_n_jobs
from joblib.parallel import get_active_backend

from sksurrogate._fingerprint import fingerprint, is_open
from sksurrogate._parallel._ipc import cloudpickle
from sksurrogate.exceptions import DataError, SimulatorError


def refuse_what_stays(simulator: Any, n_jobs: int | None) -> None:
    """A simulator that holds a connection or an open file is refused where other processes are to run it.

    Sockets would travel, as two handles of one connection: two processes would read each other's answers.
    """
    if effective_n_jobs(n_jobs) == 1 or getattr(get_active_backend()[0], "uses_threads", False):
        return
    try:
        _Pickler(io.BytesIO()).dump(simulator)
    except (pickle.PicklingError, TypeError, AttributeError, ValueError) as error:
        raise SimulatorError(
            f"n_jobs={n_jobs}: the simulator holds something that other processes cannot have, an open connection or file for "
            f"example ({error}): leave out n_jobs, or let the simulator open it on its first call in each process."
        ) from error


def can_be_shared(*parts: Any) -> bool:
    """Whether a fork may run them too: with an open connection in them two processes would read each other's answers.

    What functions close over and the globals that they read count too, and what objects leave out of a pickle. What cannot be copied, a
    lock for example, is not shared either.

    >>> import threading
    >>> can_be_shared(abs, {"gain": 2.0}), can_be_shared(threading.Lock())
    (True, False)
    """
    try:
        fingerprint(parts, "simulator", whole=True)
    except DataError:
        return False
    return True


class _Pickler(cloudpickle.Pickler):
    """Refuses a port or a connection that others pickle; of a text file that is read, cloudpickle sends the text."""

    def reducer_override(self, obj: Any) -> Any:
        if is_open(obj) and not isinstance(obj, io.TextIOBase):
            raise TypeError(f"{type(obj).__name__} is open")
        return super().reducer_override(obj)
