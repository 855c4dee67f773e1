"""The errors of the package, and ``require`` for optional packages.

::

    SurrogateError
    ├── DataError (ValueError)             X, y, groups, time do not fit the data convention
    │   └── RunError                       a run is in two pieces, too short, unknown
    ├── SimulatorError (ValueError)        a simulator does not keep the protocol
    │   └── SimulationDiverged             a free run left the finite numbers
    └── MissingExtraError (ImportError)    an optional package is not installed
"""

from __future__ import annotations

import importlib
from types import ModuleType

__all__ = [
    "DataError",
    "MissingExtraError",
    "RunError",
    "SimulationDiverged",
    "SimulatorError",
    "SurrogateError",
    "require",
]


class SurrogateError(Exception):
    """Base of every error that this package raises on purpose."""


class DataError(SurrogateError, ValueError):
    """The data given do not keep the data convention."""


class RunError(DataError):
    """A run is in two pieces, too short for the lags asked for, or unknown."""


class SimulatorError(SurrogateError, ValueError):
    """A simulator does not keep the protocol of :mod:`sksurrogate.physics`."""


class SimulationDiverged(SimulatorError):
    """A free run left the finite numbers.

    Attributes
    ----------
    run : object
        Label of the run, None where there is one.
    row : int or None
        First row (within the run) that is not finite.
    time : float or None
        Time of that row.
    state : str or None
        Name of the state or output that left first.
    """

    def __init__(
        self,
        message: str,
        *,
        run: object = None,
        row: int | None = None,
        time: float | None = None,
        state: str | None = None,
    ):
        super().__init__(message)
        self.run, self.row, self.time, self.state = run, row, time, state

    def __reduce__(self) -> tuple:
        return _rebuild_diverged, (str(self), self.run, self.row, self.time, self.state)


def _rebuild_diverged(
    message: str, run: object, row: int | None, time: float | None, state: str | None
) -> SimulationDiverged:
    """Exceptions with keyword arguments do not pickle by themselves."""
    return SimulationDiverged(message, run=run, row=row, time=time, state=state)


class MissingExtraError(SurrogateError, ImportError):
    """An optional package is missing; the message holds the line to type."""


def require(module: str, extra: str) -> ModuleType:
    """Import an optional module or say which line installs it.

    Parameters
    ----------
    module : str
        Name of the module, for example ``"matplotlib.pyplot"``.
    extra : str
        Extra of this package that brings it, for example ``"plot"``.

    Returns
    -------
    module

    Raises
    ------
    MissingExtraError
        If the import fails.

    Examples
    --------
    >>> from sksurrogate.exceptions import require
    >>> require("math", "plot").pi
    3.14159...
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise MissingExtraError(
            f"{module} is needed here and is not installed: type  pip install 'sksurrogate[{extra}]'"
        ) from error
