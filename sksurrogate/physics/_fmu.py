"""FMUs as simulators, through FMPy."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple, TypeVar

import numpy as np
from sklearn.utils.metaestimators import available_if

from sksurrogate._columns import by_name
from sksurrogate.exceptions import SimulationDiverged, SimulatorError
from sksurrogate.physics._fmu_access import Access, Engine, Question, find_access, open_engine
from sksurrogate.physics._fmu_events import EventSteps
from sksurrogate.physics._fmu_exchange import ExchangeUnit
from sksurrogate.physics._fmu_names import check_driven, check_settable, variables
from sksurrogate.physics._fmu_run import run_whole
from sksurrogate.physics._fmu_unit import OpenUnit, describe, unpack
from sksurrogate.physics._foreign import at_points, offered
from sksurrogate.physics._free_run import raise_if_diverged
from sksurrogate.physics._ode import ODESimulator
from sksurrogate.physics._params import ParametricSimulator, numbers_of
from sksurrogate.physics._simulator import describe as physics_describe

T = TypeVar("T")
#: Folder of an unpacked unit -> its description; question -> what the unit gives.
_DESCRIPTIONS: dict[str, Any] = {}
_FOUND: dict[Question, Access] = {}


class _Looked(NamedTuple):
    """What was found, and for what."""

    key: tuple[Any, ...]
    folder: str
    description: Any
    question: Question
    found: Access


def _has(access: str) -> Callable[[FMUSimulator], bool]:
    """Whether the unit gives this access."""
    return lambda self: self._look().found.access == access


def _has_output(self: FMUSimulator) -> bool:
    """Whether outputs are more than states by name."""
    looked = self._look()
    if looked.found.access == "trajectory" or looked.found.signals is None:
        return False
    return not set(looked.question.outputs) <= set(looked.found.signals.states)


class FMUSimulator(ParametricSimulator):
    """A functional mock-up unit, model exchange or co-simulation, FMI 2 or 3.

    The functions of the unit decide how it can be used. A unit for model exchange without events is a right-hand side of its
    continuous states. A unit with events, or a unit for co-simulation with a copy of its state, is a step from sample to sample,
    if a chain of single steps from its states alone gives the same run. Any other unit gives trajectories.

    Parameters
    ----------
    path : str or path
        The ``.fmu`` file.
    inputs, outputs : list of str, optional
        Variables; those of causality input and output by default.
    initial : list of str, optional
        Variables that ``x0`` sets, in its order; by default the continuous states that the unit names. With other variables
        (start values, for example) the unit gives trajectories only.
    params : dict of float, optional
        Start values of parameters.
    dt : float, default=1.0
        Sample time.
    x0 : array-like, optional
        Values of ``initial`` where ``simulate`` gets none; those of the unit by default.
    fmi_type : {"CoSimulation", "ModelExchange"}, optional
        By default the one with the finest access, co-simulation where both give trajectories alone.
    hold : {"zoh", "foh"}, default="zoh"
        Inputs are held over a sample, or joined linearly (with a right-hand side only).
    access : {"rhs", "step", "trajectory"}, optional
        What is used of the unit; the finest by default. "step" also tries a unit for co-simulation that can only be reset.
    units : dict of str, optional
        Units of states, inputs, outputs, parameters and "time" by name, for reports and labels: ``{"speed": "rad/s"}``.
        Those of the model description by default.

    Raises
    ------
    MissingExtraError
        FMPy is not installed.
    SimulatorError
        The file is not a safe unit, a variable is unknown, or the unit does not give the access that is asked for.

    Notes
    -----
    A point that the unit refuses is nan. Points that are not finite, or beyond 1e100, are not passed to it. Messages of the unit
    are in the errors, not on the screen. ``explain_access()`` gives the access in use and the reason.

    The unit is unpacked once per process. Trajectories use one instance. Between runs it returns to its start by a copy of its
    state, by a reset, or by a new instance. A method is used only if one of its runs equals a run of a new instance (``restart``
    gives the method). Pickles and clones open their own instance.

    Examples
    --------
    >>> from sksurrogate.physics import FMUSimulator
    >>> FMUSimulator("reactor.fmu", inputs=["u"], outputs=["y"], initial=["y"], dt=0.1).dt
    0.1
    """

    def __init__(
        self,
        path: Any,
        *,
        inputs: Sequence[str] | None = None,
        outputs: Sequence[str] | None = None,
        initial: Sequence[str] | None = None,
        params: Mapping[str, float] | None = None,
        dt: float = 1.0,
        x0: Any = None,
        fmi_type: str | None = None,
        hold: str = "zoh",
        access: str | None = None,
        units: Mapping[str, str] | None = None,
    ):
        self.path = path
        self.inputs = inputs
        self.outputs = outputs
        self.initial = initial
        self.params = params
        self.dt = dt
        self.x0 = x0
        self.fmi_type = fmi_type
        self.hold = hold
        self.access = access
        self.units = units

    def __getstate__(self) -> dict[str, Any]:
        """Handles stay behind."""
        return {
            key: value
            for key, value in super().__getstate__().items()
            if key not in ("_handle", "_engine_kept", "_looked")
        }

    def _files(self) -> list[Any]:
        """Files whose content is part of the simulator's value."""
        return [self.path]

    def close(self) -> None:
        """Free the unit; the next simulation opens it again."""
        for name in ("_handle", "_engine_kept"):
            kept = self.__dict__.pop(name, None)
            if kept is not None:
                kept[0].close()

    @property
    def restart(self) -> str:
        """How the next run gets its start: "state" (copy of the unit's state), "reset" or "new" (another instance)."""
        return self._opened().way

    # ---- what the unit gives ----------------------------------------------------------------------------------------
    def explain_access(self) -> str:
        """What is used of the unit, and why nothing finer.

        Returns
        -------
        str
        """
        found = self._look().found
        words = {
            "rhs": "its right-hand side",
            "step": "its step from sample to sample",
            "trajectory": "trajectories alone",
        }
        states = f", states {list(found.signals.states)}" if found.signals is not None else ""
        because = f" ({'; '.join(found.reasons)})" if found.reasons else ""
        return f"{os.fspath(self.path)}: {words[found.access]} by {found.kind}{states}{because}"

    def described(self) -> dict[str, Any]:
        """What the arguments leave to the unit: names of ``inputs`` and ``outputs``, and the initial states ``x0``."""
        looked = self._look()
        own: dict[str, Any] = {"inputs": looked.question.inputs, "outputs": looked.question.outputs}
        return own if looked.found.start is None else {**own, "x0": looked.found.start}

    def own_units(self) -> dict[str, str]:
        """Units that the model description names; the time of an FMU is in seconds."""
        description = describe(unpack(os.fspath(self.path)), self.path)
        named = {variable.name: str(variable.unit) for variable in description.modelVariables if variable.unit}
        return {"time": "s", **named}

    @property
    def states(self) -> list[str] | None:
        """Names of the continuous states; None where the unit gives trajectories alone."""
        found = self._look().found
        return None if found.access == "trajectory" or found.signals is None else list(found.signals.states)

    @available_if(_has("rhs"))
    def rhs(self, t: Any, x: Any, u: Any, p: Mapping[str, Any]) -> np.ndarray:
        """dx/dt at points (n_states, *s); nan where the unit refuses."""
        engine = self._engine()
        assert isinstance(engine, ExchangeUnit)
        return at_points(engine.derivatives, t, x, u, p)

    @available_if(_has("step"))
    def step(self, t: Any, x: Any, u: Any, p: Mapping[str, Any], dt: float) -> np.ndarray:
        """The states a time ``dt`` later under held inputs, (n_states, *s); nan where the unit refuses."""
        engine = self._engine()
        assert not isinstance(engine, ExchangeUnit)
        return at_points(partial(engine.sample, dt=float(dt)), t, x, u, p)

    @available_if(_has_output)
    def output(self, t: Any, x: Any, u: Any, p: Mapping[str, Any]) -> np.ndarray:
        """Outputs at points, (n_outputs, *s)."""
        return at_points(self._engine().outputs, t, x, u, p)

    def _look(self, at_file: bool = True) -> _Looked:
        """What the unit gives, found out once per process and unit.

        ``at_file`` looks whether the file has changed; between two points of one run it has not.
        """
        given = (self.inputs, self.outputs, self.initial)
        names = tuple(None if one is None else tuple(one) for one in given)
        params = tuple(numbers_of(self.params).items())
        key = (os.getpid(), os.fspath(self.path), self.fmi_type, self.access, self.dt, *names, params)
        kept = self.__dict__.get("_looked")
        if kept is None or kept.key != key or (at_file and kept.folder != unpack(key[1])):
            folder = unpack(key[1])
            if folder not in _DESCRIPTIONS:
                _DESCRIPTIONS[folder] = describe(folder, self.path)
            question = self._question(folder, _DESCRIPTIONS[folder])
            found = self._find(question, _DESCRIPTIONS[folder])
            self._looked = kept = _Looked(key, folder, _DESCRIPTIONS[folder], question, found)
        return kept

    def _question(self, folder: str, description: Any) -> Question:
        """What is asked of the unit."""
        if self.access not in (None, "rhs", "step", "trajectory"):
            raise SimulatorError(
                f'access={self.access!r}: expected "rhs", "step", "trajectory", or None for the finest.'
            )
        both = (("CoSimulation", description.coSimulation), ("ModelExchange", description.modelExchange))
        kinds = [kind for kind, has in both if has]
        if not kinds or (self.fmi_type is not None and self.fmi_type not in kinds):
            raise SimulatorError(f"fmi_type={self.fmi_type!r}: the unit {self.path!s} offers {kinds}.")
        params = numbers_of(self.params)
        variables(description, self.path, list(params), "parameter")
        check_settable(description, self.path, list(params))
        inputs = variables(description, self.path, self.inputs, "input")
        check_driven(description, self.path, inputs, params, list(self.initial or ()))
        return Question(
            folder,
            tuple(kinds) if self.fmi_type is None else (self.fmi_type,),
            self.access,
            tuple(inputs),
            tuple(variables(description, self.path, self.outputs, "output")),
            None if self.initial is None else tuple(variables(description, self.path, self.initial, "local")),
            tuple(params.items()),
            float(self.dt),
        )

    def _find(self, question: Question, description: Any) -> Access:
        """The finest access, or that which is asked for."""
        if question not in _FOUND:

            def through(U: np.ndarray, names: list[str]) -> np.ndarray:
                unit, t = OpenUnit(question.folder, description, "CoSimulation"), self.dt * np.arange(len(U))
                try:
                    return run_whole(
                        unit, self.path, U, t, self.dt, dict(question.params), list(question.inputs), names
                    )
                finally:
                    unit.close()

            _FOUND[question] = find_access(question, description, through)
        return _FOUND[question]

    def _engine(self) -> Engine:
        """The instance that answers for the equations; one for each simulator and process."""
        looked = self._look(at_file=False)
        names = tuple(name for name, _ in looked.question.params)
        key = (looked.key[:-1], looked.folder, names, looked.found.kind, looked.found.access)
        kept = self.__dict__.get("_engine_kept")
        if kept is None or kept[1] != key:
            self._engine_kept = kept = (open_engine(looked.found, looked.question, looked.description), key)
        return kept[0]

    def _opened(self) -> OpenUnit:
        """The unit in memory for whole runs; opened on first use and after a change of file or process."""
        looked = self._look()
        kind, handle = looked.found.kind, self.__dict__.get("_handle")
        if handle is None or handle[0].folder != looked.folder or handle[1] != (os.getpid(), kind):
            self._handle = handle = (OpenUnit(looked.folder, looked.description, kind), (os.getpid(), kind))
        return handle[0]

    # ---- simulation -------------------------------------------------------------------------------------------------
    def simulate(self, U: Any, x0: Any = None, t: Any = None) -> np.ndarray:
        """Free run of one run: (n_samples, n_outputs)."""
        looked = self._look()
        found, question = looked.found, looked.question
        if found.access == "rhs":
            return self._integrated(lambda inner: inner.simulate(U, x0, t))
        if self.hold != "zoh":
            raise SimulatorError(
                f'hold={self.hold!r}: inputs of a unit without right-hand side are held over a sample; hold="zoh".'
            )
        rows, times = self._checked(U, t, list(question.inputs))
        start = self._start(question, found, x0)
        if found.access == "step" and found.kind == "ModelExchange":
            return self._run_with_events(question, rows, times, start)
        values = dict(question.params)
        if start is not None:
            values |= dict(zip(question.initial or (found.signals.states if found.signals else ()), start.tolist()))
        check_settable(looked.description, self.path, list(values))
        unit, direct = self._opened(), found.access == "step" and found.direct
        shown = list(found.signals.states if direct and found.signals else question.outputs)
        try:
            Y = run_whole(unit, self.path, rows, times, self.dt, values, list(question.inputs), shown)
        except SimulatorError:
            self.__dict__.pop("_handle", None)
            raise
        raise_if_diverged(Y[None], times, tuple(shown))
        return self._engine().outputs(times, Y.T, rows.T, dict(question.params)).T if direct else Y

    @available_if(_has("rhs"))
    def simulate_batch(self, U: Any, X0: Any = None, t: Any = None) -> np.ndarray:
        """Free runs of equal length, all at once: (n_runs, n_samples, n_inputs) -> (n_runs, n_samples, n_outputs)."""
        return self._integrated(lambda inner: inner.simulate_batch(U, X0, t))

    @available_if(_has("rhs"))
    def simulate_states(self, U: Any, x0: Any = None, t: Any = None) -> tuple[np.ndarray, np.ndarray]:
        """States and their derivatives of one run, both (n_samples, n_states)."""
        return self._integrated(lambda inner: inner.simulate_states(U, x0, t))

    def _integrated(self, run: Callable[[ODESimulator], T]) -> T:
        """A run of the same equations by this package's integrators."""
        known = physics_describe(self)
        inner = ODESimulator(
            self.rhs, states=known.states, inputs=known.inputs, outputs=known.outputs, params=dict(self.params or {}),
            dt=self.dt, hold=self.hold, output=self.output if _has_output(self) else None, x0=known.x0,
        )  # fmt: skip
        try:
            return run(inner)
        except SimulationDiverged as error:
            raise _with_words(error, str(self._engine().messages)) from error  # type: ignore[union-attr]

    def _run_with_events(
        self, question: Question, U: np.ndarray, t: np.ndarray, x0: np.ndarray | None
    ) -> np.ndarray:  # fmt: skip
        """One run that goes through all events."""
        engine = self._engine()
        assert isinstance(engine, EventSteps)
        try:
            X, Y = engine.run(t, U, x0, tuple(value for _, value in question.params))
        except Exception as error:  # whatever a binary and its wrapper raise
            self.__dict__.pop("_engine_kept", None)
            said = f"{type(error).__name__}: {error}.{engine.unit.messages}"
            raise SimulationDiverged(f"the unit {self.path!s} stopped: {said}") from error
        raise_if_diverged(X[None], t, engine.unit.signals.states)
        return Y

    def _checked(self, U: Any, t: Any, inputs: list[str]) -> tuple[np.ndarray, np.ndarray]:
        """Inputs (n_samples, n_inputs) and times."""
        rows = np.asarray(by_name(U, inputs), dtype=float)
        rows = rows[:, None] if rows.ndim == 1 else rows
        if rows.ndim != 2 or rows.shape[1] != len(inputs):
            raise SimulatorError(
                f"U has shape {rows.shape}, expected (n_samples, {len(inputs)}): one column for each of {inputs}."
            )
        if not len(rows):
            raise SimulatorError("U has no rows: give one row for each sample.")
        if not offered(rows.T).all():
            row = int(np.flatnonzero(~offered(rows.T))[0])
            raise SimulatorError(f"U={rows[row].tolist()} in row {row}: expected finite inputs of at most 1e100.")
        times = self.dt * np.arange(len(rows)) if t is None else np.asarray(t, dtype=float)
        if times.shape != (len(rows),) or not np.all(np.diff(times) > 0):
            raise SimulatorError(
                f"t has shape {times.shape}, expected ({len(rows)},): one time for each row of U, each later than the one before."
            )
        return rows, times

    def _start(self, question: Question, found: Access, x0: Any) -> np.ndarray | None:
        """Values of the initial states; None: those of the unit."""
        start = self.x0 if x0 is None else x0
        if start is None:
            return None
        given = np.asarray(start, dtype=float).reshape(-1)
        names = question.initial if question.initial is not None else found.signals.states if found.signals else ()
        if len(given) != len(names):
            raise SimulatorError(
                f"x0 has {len(given)} values, expected {len(names)}: name the variables that it sets, initial=[...]."
            )
        return given


def _with_words(error: SimulationDiverged, said: str) -> SimulationDiverged:
    """The same error with what the unit said."""
    return SimulationDiverged(f"{error}{said}", run=error.run, row=error.row, time=error.time, state=error.state)
