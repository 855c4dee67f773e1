"""A unit for co-simulation as a map from sample to sample: back to its start, to a point, one step on."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from typing import Any

import numpy as np

from sksurrogate.physics._call_loop import Call, CallLoop, Real, Row
from sksurrogate.physics._fmu_signals import Signals
from sksurrogate.physics._fmu_unit import Messages, new_instance
from sksurrogate.physics._foreign import offered


class CoSteps:
    """One instance of a unit for co-simulation that begins anew at every point.

    A copy of the state it was instantiated in brings it back where it offers one, else a reset; then time, parameters and
    states are start values, and the unit makes one communication step.

    ``folder``: of the unpacked unit.
    ``params``: names behind ``signals.params``.
    """

    def __init__(self, folder: str, description: Any, signals: Signals, params: tuple[str, ...]):
        self.folder, self.description, self.signals, self.names = folder, description, signals, params
        self.messages = Messages()
        self._given = np.concatenate([signals.params, signals.state_references, signals.inputs]).astype(np.uint32)
        self._ignored = np.zeros(4)  #: What a step of FMI 3 says beside its status
        self._open()

    def _open(self) -> None:
        self.instance = new_instance(self.folder, self.description, "CoSimulation", self.messages)
        self._state, self._begun = None, False
        self._loops: dict[bool, CallLoop] = {}
        if self.description.coSimulation.canGetAndSetFMUstate:
            copy = self.instance.getFMUstate if self.signals.version == 2 else self.instance.getFMUState
            self._state = copy()

    def close(self) -> None:
        """Free the copy and the instance."""
        if self._state is not None:
            free = self.instance.freeFMUstate if self.signals.version == 2 else self.instance.freeFMUState
            free(self._state)
            self._state = None
        self.instance.freeInstance()

    def sample(self, t: Any, x: np.ndarray, u: np.ndarray, p: Mapping[str, Any], dt: float) -> np.ndarray:
        """States (n_states, n_points) a time ``dt`` later under held inputs; nan where the unit refuses a point."""
        return self._at_points(t, x, u, p, self.signals.state_references, dt)

    def outputs(self, t: Any, x: np.ndarray, u: np.ndarray, p: Mapping[str, Any]) -> np.ndarray:
        """Outputs (n_outputs, n_points) where a run begins; nan where the unit refuses a point."""
        return self._at_points(t, x, u, p, self.signals.outputs, None)

    def _at_points(
        self, t: Any, x: np.ndarray, u: np.ndarray, p: Mapping[str, Any], asked: np.ndarray, dt: float | None
    ) -> np.ndarray:  # fmt: skip
        """What is asked for by reference, (n_asked, n_points)."""
        n_points = x.shape[1]
        times = np.broadcast_to(np.asarray(t, dtype=float), (n_points,))
        P = np.array([np.broadcast_to(p[name], (n_points,)) for name in self.names], dtype=float).reshape(-1, n_points)
        good = np.flatnonzero(offered(times, x, u, P))
        given = np.concatenate([P, x, u])[:, good].T  # in the order of the references
        at = {
            "t": times[good], "given": np.ascontiguousarray(given), "again": np.ones(len(good), bool),
            "zero": np.zeros(len(good)), "dt": np.full(len(good), np.nan if dt is None else dt), "out": np.full((len(good), len(asked)), np.nan),
        }  # fmt: skip
        k = 0
        while k < len(good):
            at["again"][k] = self._begun
            self._begun = True
            k, status = self._loop(asked, dt is not None)(k, at)
            if k < len(good):
                at["out"][k] = np.nan
                self.messages.keep(f"a call failed with status {status}")
                if status == 4:  # lost: nothing may be called, not even to free it
                    self._open()
                k += 1
        out = np.full((len(asked), n_points), np.nan)
        out[:, good] = at["out"].T
        return out

    def _loop(self, asked: np.ndarray, steps: bool) -> CallLoop:
        """The calls at a point: from instantiation to the point, one step on, and what is asked for."""
        if steps not in self._loops:
            s, c, dll = self.signals, self.instance.component, self.instance.dll
            old = s.version == 2

            def call(name: str, *arguments: int | Row | Real, when: str = "") -> Call:
                function = getattr(dll, f"fmi{s.version}{name}")
                return Call(int(ctypes.cast(function, ctypes.c_void_p).value or 0), (c, *arguments), when)

            def values(name: str, references: np.ndarray, array: str) -> Call:
                size = len(references)
                tail = () if old else (size,)
                return call(name, references.ctypes.data, size, Row(array), *tail)

            if self._state is not None:
                made = [call("SetFMUstate" if old else "SetFMUState", self._state.value or 0)]
            else:
                made = [call("Reset", when="again")]
            if old:
                made.append(call("SetupExperiment", 0, Real("zero"), Real("t"), 0, Real("zero")))
            if len(self._given):
                made.append(values("SetReal" if old else "SetFloat64", self._given, "given"))
            made.append(
                call("EnterInitializationMode", *(() if old else (0, Real("zero"), Real("t"), 0, Real("zero"))))
            )
            made.append(call("ExitInitializationMode"))
            if steps:
                rest = () if old else tuple(self._ignored.ctypes.data + 8 * k for k in range(4))
                made.append(call("DoStep", Real("t"), Real("dt"), 1, *rest))
            if len(asked):
                made.append(values("GetReal" if old else "GetFloat64", asked, "out"))
            self._loops[steps] = CallLoop(made)
        return self._loops[steps]
