"""The errors of the package, and ``require`` for optional packages.

::

    SurrogateError
    ├── DataError (ValueError)             X, y, groups, time do not fit the data convention
    │   └── RunError                       a run is in two pieces, too short, unknown
    ├── SimulatorError (ValueError)        a simulator does not keep the protocol
    │   └── SimulationDiverged             a free run became infinite or nan, or its simulator stopped
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
    """Base of every error that this package raises on purpose.

    Examples
    --------
    >>> from sksurrogate import cut_runs
    >>> from sksurrogate.exceptions import SurrogateError
    >>> try:
    ...     cut_runs([0, 0], n_blocks=5)
    ... except SurrogateError as error:
    ...     print(type(error).__name__)
    RunError
    """


class DataError(SurrogateError, ValueError):
    """The data given do not keep the data convention.

    Examples
    --------
    >>> from sksurrogate import stack_runs
    >>> from sksurrogate.exceptions import DataError
    >>> issubclass(DataError, ValueError)   # as scikit-learn's own
    True
    """


class RunError(DataError):
    """A run is in two pieces, too short for the lags asked for, or unknown.

    Examples
    --------
    >>> from sksurrogate.runs import resolve_runs
    >>> resolve_runs([[1.0], [2.0], [3.0]], groups=[0, 1, 0])
    Traceback (most recent call last):
    sksurrogate.exceptions.RunError: run 0 is in two pieces: ...
    """


class SimulatorError(SurrogateError, ValueError):
    """A simulator does not keep the protocol of :mod:`sksurrogate.physics`.

    Examples
    --------
    >>> from sksurrogate.gap import GapDiagnoser
    >>> GapDiagnoser("plant.py").fit(20 * [[1.0]], 20 * [1.0])
    Traceback (most recent call last):
    sksurrogate.exceptions.SimulatorError: ...
    """


class SimulationDiverged(SimulatorError):
    """A free run became infinite or nan, or its simulator stopped: a candidate that breaks it is left out.

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

    Examples
    --------
    >>> import numpy as np
    >>> from sksurrogate.exceptions import SimulationDiverged
    >>> from sksurrogate.physics import ODESimulator
    >>> runaway = ODESimulator(
    ...     lambda t, x, u, p: [x[0] ** 2], states=["x"], inputs=[], outputs=["x"], params={}, dt=0.1, x0=[5.0]
    ... )
    >>> try:
    ...     runaway.simulate(np.zeros((9, 0)))
    ... except SimulationDiverged as error:
    ...     print(error.row, error.state)
    2 x
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
    """An optional package is missing; the message holds the line to type.

    Examples
    --------
    >>> from sksurrogate.exceptions import MissingExtraError, require
    >>> try:
    ...     require("no_such_package", "plot")
    ... except MissingExtraError as error:
    ...     print(error)
    no_such_package is needed here and is not installed: type  pip install 'sksurrogate[plot]'
    """


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
