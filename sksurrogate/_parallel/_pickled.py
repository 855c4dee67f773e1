"""What cannot travel to worker processes, in words."""

from __future__ import annotations

import pickle
from typing import Any

from joblib import effective_n_jobs
from joblib.parallel import get_active_backend

from sksurrogate._parallel._ipc import cloudpickle
from sksurrogate.exceptions import SimulatorError


def refuse_what_stays(simulator: Any, n_jobs: int | None) -> None:
    """A simulator that holds a connection or an open file is refused where other processes are to run it.

    Sockets would travel, as two handles of one connection: two processes would read each other's answers.
    """
    if effective_n_jobs(n_jobs) == 1 or getattr(get_active_backend()[0], "uses_threads", False):
        return
    try:
        cloudpickle.dumps(simulator)
    except (pickle.PicklingError, TypeError, AttributeError, ValueError) as error:
        raise SimulatorError(
            f"n_jobs={n_jobs}: the simulator holds something that other processes cannot have, an open connection or file for "
            f"example ({error}): leave out n_jobs, or let the simulator open it on its first call in each process."
        ) from error
