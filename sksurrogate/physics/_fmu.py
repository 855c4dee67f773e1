"""FMUs as simulators, through FMPy."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from sksurrogate._columns import by_name
from sksurrogate.exceptions import SimulatorError, require
from sksurrogate.physics._fmu_unit import OpenUnit, describe, equal_steps, unpack
from sksurrogate.physics._free_run import raise_if_diverged
from sksurrogate.physics._params import ParametricSimulator

__all__ = ["FMUSimulator"]


class FMUSimulator(ParametricSimulator):
    """A functional mock-up unit, co-simulation or model exchange, FMI 2 or 3.

    Parameters
    ----------
    path : str or path
        The ``.fmu`` file.
    inputs, outputs : list of str, optional
        Variables; those of causality input and output by default.
    initial : list of str, optional
        Variables that ``x0`` sets, in its order. (They are not called states: a unit gives no access to a right-hand
        side, so only its trajectories are used.)
    params : dict of float, optional
        Start values of parameters.
    dt : float, default=1.0
        Sample time.
    x0 : array-like, optional
        Values of ``initial`` where ``simulate`` gets none; those of the unit by default.
    fmi_type : {"CoSimulation", "ModelExchange"}, optional
        First that the unit offers by default.

    Raises
    ------
    MissingExtraError
        FMPy is not installed.
    SimulatorError
        The file is no safe unit, or a variable is unknown.

    Notes
    -----
    Inputs are held over a sample. The unit is unpacked once a process and one instance is used again, put back to its
    start between runs by a copy of its state where the unit offers one, else by a reset, else by a new instance; a way
    is kept only once it has given a run equal to that of a new instance (``restart`` tells which). Pickle and clone
    leave the instance behind and open their own.

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
    ):
        self.path = path
        self.inputs = inputs
        self.outputs = outputs
        self.initial = initial
        self.params = params
        self.dt = dt
        self.x0 = x0
        self.fmi_type = fmi_type

    def __getstate__(self) -> dict[str, Any]:
        """Handles stay behind."""
        return {key: value for key, value in super().__getstate__().items() if key != "_handle"}

    def _files(self) -> list[Any]:
        """Files whose content is part of the simulator's value."""
        return [self.path]

    def close(self) -> None:
        """Free the unit; the next simulation opens it again."""
        handle = self.__dict__.pop("_handle", None)
        if handle is not None:
            handle[0].close()

    @property
    def restart(self) -> str:
        """How the next run gets its start: "state" (copy of the unit's state), "reset" or "new" (another instance)."""
        return self._opened().way

    def _opened(self) -> OpenUnit:
        """The unit in memory; opened on first use and after a change of file or process."""
        folder = unpack(os.fspath(self.path))
        handle = self.__dict__.get("_handle")
        if handle is not None and handle[0].folder == folder and handle[1] == (os.getpid(), self.fmi_type):
            return handle[0]
        description = describe(folder, self.path)
        offered = [
            k
            for k, has in (("CoSimulation", description.coSimulation), ("ModelExchange", description.modelExchange))
            if has
        ]
        kind = self.fmi_type or (offered[0] if offered else "")
        if kind not in offered:
            raise SimulatorError(f"fmi_type={self.fmi_type!r}: the unit {self.path!s} offers {offered}.")
        self.close()
        self._handle = (OpenUnit(folder, description, kind), (os.getpid(), self.fmi_type))
        return self._handle[0]

    def _variables(self, description: Any, given: Sequence[str] | None, causality: str) -> list[str]:
        """Names as given, else by causality."""
        known = {variable.name: variable for variable in description.modelVariables}
        names = (
            [v.name for v in description.modelVariables if v.causality == causality] if given is None else list(given)
        )
        unknown = [name for name in names if name not in known]
        if unknown:
            raise SimulatorError(f"the unit {self.path!s} has no variable {unknown[0]!r}; it has {sorted(known)[:30]}.")
        return names

    def _check_settable(self, description: Any, names: list[str]) -> None:
        """A unit ignores start values of what it calculates itself: that must not pass in silence."""
        for variable in description.modelVariables:
            if (
                variable.name in names
                and variable.causality in ("output", "local")
                and variable.initial not in ("exact", "approx")
            ):
                raise SimulatorError(
                    f"variable {variable.name!r} cannot be set: the unit {self.path!s} calculates it. Name in initial=[...] a start parameter "
                    'or a variable with initial="exact".'
                )

    def simulate(self, U: Any, x0: Any = None, t: Any = None) -> np.ndarray:
        """Free run of one run: (n_samples, n_outputs)."""
        unit = self._opened()
        description = unit.description
        inputs, outputs = (
            self._variables(description, self.inputs, "input"),
            self._variables(description, self.outputs, "output"),
        )
        initial = self._variables(description, self.initial or (), "local")
        rows = np.asarray(by_name(U, inputs), dtype=float)
        rows = rows[:, None] if rows.ndim == 1 else rows
        if rows.ndim != 2 or rows.shape[1] != len(inputs):
            raise SimulatorError(
                f"U has shape {rows.shape}, expected (n_samples, {len(inputs)}): one column for each of {inputs}."
            )
        times = self.dt * np.arange(len(rows)) if t is None else np.asarray(t, dtype=float)
        if times.shape != (len(rows),) or not np.all(np.diff(times) > 0):
            raise SimulatorError(
                f"t has shape {times.shape}, expected ({len(rows)},): one time for each row of U, each later than the one before."
            )
        values = dict(self.params or {})
        self._variables(description, list(values), "parameter")
        start = self.x0 if x0 is None else x0
        if start is not None:
            given = np.asarray(start, dtype=float).reshape(-1)
            if len(given) != len(initial):
                raise SimulatorError(
                    f"x0 has {len(given)} values, expected {len(initial)}: name the variables that it sets, initial=[...]."
                )
            values |= dict(zip(initial, given.tolist()))
        self._check_settable(description, list(values))
        found = self._run(unit, rows, times, values, inputs, outputs)
        raise_if_diverged(found[None], times, tuple(outputs))
        return found

    def _run(
        self, unit: OpenUnit, rows: np.ndarray, times: np.ndarray, values: dict[str, float], inputs: list[str],
        outputs: list[str],
    ) -> np.ndarray:  # fmt: skip
        """One run; inputs are held by stating each both at its first and just before the next sample."""
        single = len(rows) == 1
        if single:
            rows, times = np.repeat(rows, 2, axis=0), np.array([times[0], times[0] + self.dt])
        exchange = unit.kind == "ModelExchange"
        # Two rows at one time are an event: there the solver of a model exchange halts and writes its outputs down.
        doubled, held = (np.repeat(times, 2)[1:-1], np.repeat(rows[:-1], 2, axis=0)) if exchange else (times, rows)
        signal = None
        if inputs or exchange:
            signal = np.array(
                [(a, *b) for a, b in zip(doubled, held)], dtype=[("time", float), *((name, float) for name in inputs)]
            )
        stretches = [(0, len(times) - 1)] if exchange else equal_steps(times)
        if len(stretches) > 1 and not unit.description.coSimulation.canHandleVariableCommunicationStepSize:
            raise SimulatorError(
                f"t has steps from {np.diff(times).min():g} to {np.diff(times).max():g}, but the unit {self.path!s} takes steps of one "
                "width only (canHandleVariableCommunicationStepSize is false): resample U and t evenly."
            )

        def once(instance: Any) -> np.ndarray:
            parts = [self._stretch(unit, instance, times, a, b, values, signal, outputs) for a, b in stretches]
            return np.concatenate([part[k > 0 :] for k, part in enumerate(parts)])

        try:
            found = unit.run(once)
        except SimulatorError:
            self.__dict__.pop("_handle", None)
            raise
        except Exception as error:
            self.__dict__.pop("_handle", None)
            raise SimulatorError(f"the unit {self.path!s} stopped: {type(error).__name__}: {error}.") from error
        return found[:1] if single else found

    def _stretch(
        self, unit: OpenUnit, instance: Any, times: np.ndarray, a: int, b: int, values: dict[str, float], signal: np.ndarray | None,
        outputs: list[str],
    ) -> np.ndarray:  # fmt: skip
        """Outputs at the rows a to b, which are evenly apart for a co-simulation; it goes on where the last one ended."""
        step, last = float(times[a + 1] - times[a]), b == len(times) - 1
        result = require("fmpy", "fmu").simulate_fmu(
            unit.folder, model_description=unit.description, fmu_instance=instance, fmi_type=unit.kind, start_time=times[a],
            stop_time=times[b], step_size=step, output_interval=step, start_values=dict(values), input=signal, output=outputs,
            relative_tolerance=1e-8, validate=False, initialize=a == 0, terminate=last, set_stop_time=a == 0 and last,
        )  # fmt: skip
        clock = np.asarray(result["time"], dtype=float)
        rows_at = np.searchsorted(clock, times[a : b + 1] - 1e-9 * step, side="left")
        if rows_at.max() >= len(clock):
            raise SimulatorError(f"the unit {self.path!s} ended at t = {clock[-1]:g}, before t = {times[b]:g}.")
        return np.stack([np.asarray(result[name], dtype=float)[rows_at] for name in outputs], axis=1)
