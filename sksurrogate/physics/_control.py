"""Systems of python-control as simulators."""

from __future__ import annotations

from typing import Any

import numpy as np
from sklearn.utils.metaestimators import available_if

from sksurrogate.exceptions import SimulatorError, require
from sksurrogate.physics._ode import ODESimulator
from sksurrogate.physics._params import ParametricSimulator
from sksurrogate.physics._wrappers import StepSimulator

__all__ = ["ControlSimulator"]


def _is_continuous(self: ControlSimulator) -> bool:
    return not self.system.dt


def _is_discrete(self: ControlSimulator) -> bool:
    return bool(self.system.dt)


class ControlSimulator(ParametricSimulator):
    """A linear or nonlinear input/output system of python-control.

    Parameters
    ----------
    system : ``control.StateSpace``, ``TransferFunction`` or ``NonlinearIOSystem``
        Continuous or discrete in time; transfer functions are realised in state space.
    dt : float, optional
        Sample time; needed for continuous systems, else that of the system.
    hold : {"zoh", "foh"}, default="zoh"
        How inputs act between samples (python-control itself joins them linearly).
    x0 : array-like (n_states,), optional
        Initial state; zeros by default.
    params : dict of float, optional
        Parameters of a nonlinear system, in place of its own values; they can be calibrated and diagnosed.

    Raises
    ------
    MissingExtraError
        python-control is not installed (for transfer functions).

    Examples
    --------
    >>> import control, numpy as np
    >>> from sksurrogate.physics import ControlSimulator
    >>> lag = ControlSimulator(control.ss([[-1.0]], [[1.0]], [[1.0]], [[0.0]]), dt=0.1)
    >>> lag.simulate(np.ones((3, 1))).ravel().round(4)  # 1 - exp(-t)
    array([0.    , 0.0952, 0.1813])
    """

    def __init__(self, system: Any, *, dt: float | None = None, hold: str = "zoh", x0: Any = None, params: Any = None):
        self.system = system
        self.dt = dt
        self.hold = hold
        self.x0 = x0
        self.params = params

    def _realised(self) -> Any:
        """The system with states."""
        return (
            self.system
            if hasattr(self.system, "nstates") and self.system.nstates is not None
            else require("control", "control").ss(self.system)
        )

    @property
    def states(self) -> list[str]:
        """Names of the states."""
        return [str(name) for name in self._realised().state_labels]

    @property
    def inputs(self) -> list[str]:
        """Names of the inputs."""
        return [str(name) for name in self.system.input_labels]

    @property
    def outputs(self) -> list[str]:
        """Names of the outputs."""
        return [str(name) for name in self.system.output_labels]

    def _points(self, what: str, t: Any, x: Any, u: Any, p: Any) -> np.ndarray:
        """``dynamics`` or ``output`` of the system at points (n, *s)."""
        system = self._realised()
        if any(hasattr(v, "graph") for v in (*x, *u)):  # symbols of an export
            return self._written(system, what, x, u)
        xs, us = (
            np.asarray([np.asarray(v, dtype=float) for v in x]),
            np.asarray([np.asarray(v, dtype=float) for v in u]),
        )
        if hasattr(system, "A"):
            first, second = (system.A, system.B) if what == "dynamics" else (system.C, system.D)
            return np.tensordot(np.asarray(first), xs, 1) + np.tensordot(np.asarray(second), us, 1)
        flat_x, flat_u = xs.reshape(len(xs), -1), us.reshape(len(us), -1)
        times = np.broadcast_to(t, (flat_x.shape[1],)) if np.ndim(t) < 2 else np.ravel(t)
        function, given = getattr(system, what), dict(p or {})
        columns = []
        for k in range(flat_x.shape[1]):
            own = {name: float(np.ravel(v)[k if np.ndim(v) else 0]) for name, v in given.items()} or None
            columns.append(np.atleast_1d(function(times[k], flat_x[:, k], flat_u[:, k], own)))
        return np.stack(columns, axis=1).reshape(-1, *xs.shape[1:])

    def _written(self, system: Any, what: str, x: Any, u: Any) -> Any:
        """``dynamics`` or ``output`` at symbols."""
        if hasattr(system, "A"):
            pair = (system.A, system.B) if what == "dynamics" else (system.C, system.D)
            rows = np.hstack([np.asarray(part, dtype=float) for part in pair])
            return [sum(float(c) * v for c, v in zip(row, [*x, *u])) for row in rows]
        function = system.updfcn if what == "dynamics" else system.outfcn
        if function is None:
            return list(x)
        return function(
            0.0, np.array(x, dtype=object), np.array(u, dtype=object), {**system.params, **(self.params or {})}
        )

    @available_if(_is_continuous)
    def rhs(self, t: Any, x: Any, u: Any, p: Any) -> np.ndarray:
        """dx/dt."""
        return self._points("dynamics", t, x, u, p)

    @available_if(_is_discrete)
    def step(self, t: Any, x: Any, u: Any, p: Any, dt: float) -> np.ndarray:
        """The states one sample later."""
        return self._points("dynamics", t, x, u, p)

    def output(self, t: Any, x: Any, u: Any, p: Any) -> np.ndarray:
        """Outputs."""
        return self._points("output", t, x, u, p)

    def _inner(self) -> Any:
        """The same system as one of this package's simulators."""
        if not hasattr(self.system, "dt"):
            raise SimulatorError(
                f"system={self.system!r} is no system of python-control: make one with control.ss, control.tf or control.nlsys."
            )
        own = self.system.dt
        names = {
            "states": self.states,
            "inputs": self.inputs,
            "outputs": self.outputs,
            "params": dict(self.params or {}),
            "x0": self.x0,
        }
        if own:
            step = 1.0 if own is True else float(own)
            return StepSimulator(self.step, output=self.output, dt=self.dt if self.dt is not None else step, **names)
        if self.dt is None:
            raise ValueError(
                "dt=None: a continuous system needs its sample time, e.g. ControlSimulator(system, dt=0.1)."
            )
        return ODESimulator(self.rhs, output=self.output, dt=self.dt, hold=self.hold, **names)

    def simulate(self, U: Any, x0: Any = None, t: Any = None) -> np.ndarray:
        """Free run of one run: (n_samples, n_outputs)."""
        return self._inner().simulate(U, x0, t)

    def simulate_batch(self, U: Any, X0: Any = None, t: Any = None) -> np.ndarray:
        """Free runs of equal length, all abreast."""
        return self._inner().simulate_batch(U, X0, t)
