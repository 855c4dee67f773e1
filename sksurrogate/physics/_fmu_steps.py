"""A unit for co-simulation as a map from sample to sample: back to its start, to a point, one step on."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from sksurrogate.physics._fmu_signals import Signals
from sksurrogate.physics._fmu_unit import Messages, new_instance
from sksurrogate.physics._foreign import offered

__all__ = ["CoSteps"]


class CoSteps:
    """One instance of a unit for co-simulation that begins anew at every point.

    A copy of the state it was instantiated in brings it back where it offers one, else a reset; then time, parameters and
    states are start values, and the unit makes one communication step.

    Parameters
    ----------
    folder : str
        Of the unpacked unit.
    description : model description of FMPy
    signals : Signals
    params : sequence of str
        Names behind ``signals.params``.
    """

    def __init__(self, folder: str, description: Any, signals: Signals, params: tuple[str, ...]):
        self.folder, self.description, self.signals, self.names = folder, description, signals, params
        self.messages = Messages()
        self._open()

    def _open(self) -> None:
        self.instance = new_instance(self.folder, self.description, "CoSimulation", self.messages)
        self._state, self._begun = None, False
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
        return self._at_points(t, x, u, p, self.signals.state_references.tolist(), dt)

    def outputs(self, t: Any, x: np.ndarray, u: np.ndarray, p: Mapping[str, Any]) -> np.ndarray:
        """Outputs (n_outputs, n_points) where a run begins; nan where the unit refuses a point."""
        return self._at_points(t, x, u, p, self.signals.outputs.tolist(), None)

    def _at_points(
        self, t: Any, x: np.ndarray, u: np.ndarray, p: Mapping[str, Any], asked: list[int], dt: float | None
    ) -> np.ndarray:  # fmt: skip
        """What is asked for by reference, (n_asked, n_points)."""
        n_points = x.shape[1]
        times = np.broadcast_to(np.asarray(t, dtype=float), (n_points,))
        P = np.array([np.broadcast_to(p[name], (n_points,)) for name in self.names], dtype=float).reshape(-1, n_points)
        out = np.full((len(asked), n_points), np.nan)
        for k in np.flatnonzero(offered(times, x, u, P)):
            try:
                out[:, k] = self._one(float(times[k]), x[:, k], u[:, k], P[:, k], asked, dt)
            except Exception as error:  # FMPy's own, of a call that failed
                self.messages.keep(f"{type(error).__name__}: {error}")
                if getattr(error, "status", 3) == 4:  # lost: nothing may be called, not even to free it
                    self._open()
        return out

    def _one(
        self, t: float, x: np.ndarray, u: np.ndarray, p: np.ndarray, asked: list[int], dt: float | None
    ) -> list[float]:  # fmt: skip
        """From instantiation to a point, and one step on."""
        s, instance = self.signals, self.instance
        if self._state is not None:
            (instance.setFMUstate if s.version == 2 else instance.setFMUState)(self._state)
        elif self._begun:
            instance.reset()
        self._begun = True
        write = instance.setReal if s.version == 2 else instance.setFloat64
        read = instance.getReal if s.version == 2 else instance.getFloat64
        if s.version == 2:
            instance.setupExperiment(startTime=t)
        given = [*s.params.tolist(), *s.state_references.tolist(), *s.inputs.tolist()]
        write(given, [*p.tolist(), *x.tolist(), *u.tolist()])
        instance.enterInitializationMode(**({"startTime": t} if s.version == 3 else {}))
        instance.exitInitializationMode()
        if dt is not None:
            instance.doStep(t, dt)
        return read(asked)
