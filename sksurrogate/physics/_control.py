"""Systems of python-control as simulators."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from sklearn.utils.metaestimators import available_if

from sksurrogate.exceptions import SimulatorError, require
from sksurrogate.physics._contents import contents, same
from sksurrogate.physics._control_points import ControlPoints
from sksurrogate.physics._inner import InnerRunsMixin, held_over_samples
from sksurrogate.physics._ode import ODESimulator
from sksurrogate.physics._params import ParametricSimulator, numbers_of
from sksurrogate.physics._wrappers import StepSimulator


def _is_continuous(self: ControlSimulator) -> bool:
    return not self.system.dt


def _is_discrete(self: ControlSimulator) -> bool:
    return bool(self.system.dt)


class ControlSimulator(InnerRunsMixin, ParametricSimulator):
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
        Parameters of a nonlinear system, in place of its own values; they can be calibrated and diagnosed, those that are not
        named here cannot. ``params=dict(system.params)`` names all of them.
    units : dict of str, optional
        Units of states, inputs, outputs, parameters and "time" by name, for reports and labels: ``{"speed": "rad/s"}``.

    Raises
    ------
    MissingExtraError
        python-control is not installed (for transfer functions).

    Notes
    -----
    A linear system is stepped exactly by the matrix exponential, at even or uneven times, and at any stiffness. Functions of
    a nonlinear system that take arrays of points are found by a probe and called once for all points.

    Examples
    --------
    >>> import control, numpy as np
    >>> from sksurrogate.physics import ControlSimulator
    >>> lag = ControlSimulator(control.ss([[-1.0]], [[1.0]], [[1.0]], [[0.0]]), dt=0.1)
    >>> lag.simulate(np.ones((3, 1))).ravel().round(4)  # 1 - exp(-t)
    array([0.    , 0.0952, 0.1813])
    """

    def __init__(
        self,
        system: Any,
        *,
        dt: float | None = None,
        hold: str = "zoh",
        x0: Any = None,
        params: Any = None,
        units: Mapping[str, str] | None = None,
    ):
        self.system = system
        self.dt = dt
        self.hold = hold
        self.x0 = x0
        self.params = params
        self.units = units

    def __getstate__(self) -> dict[str, Any]:
        """What is looked up again stays behind."""
        return {key: value for key, value in super().__getstate__().items() if key not in ("_kept", "_abreast")}

    def _realised(self) -> Any:
        """The system with states; a transfer function is realised once."""
        if getattr(self.system, "nstates", None) is not None:
            return self.system
        kept, now = self.__dict__.get("_kept"), contents(self.system)
        if kept is None or not same(kept[0], now):
            try:
                realised = require("control", "control").ss(self.system)
            except Exception as error:  # more zeros than poles, several inputs without slycot, frequency responses
                raise SimulatorError(
                    f"system={type(self.system).__name__} cannot be realised in state space ({type(error).__name__}: {error}): make it with "
                    "control.ss or control.nlsys."
                ) from error
            self._kept = kept = (now, realised)
        return kept[1]

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
        shape = (xs if len(xs) else us).shape[1:]  # a gain has no states
        flat_x, flat_u = (v.reshape(len(v), int(np.prod(shape))) for v in (xs, us))
        times = np.broadcast_to(t, (flat_x.shape[1],)) if np.ndim(t) < 2 else np.ravel(t)
        given = {name: np.ravel(v) if np.ndim(v) else float(v) for name, v in dict(p or {}).items()}
        kept = self.__dict__.get("_abreast")
        if kept is None or kept.system is not system:
            self._abreast = kept = ControlPoints(system)
        return kept(what, times, flat_x, flat_u, given).reshape(-1, *shape)

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
                f"system={self.system!r} is not a system of python-control: make one with control.ss, control.tf or control.nlsys."
            )
        own, linear = self.system.dt, hasattr(self._realised(), "A")
        params = numbers_of(self.params)
        if linear and params:
            raise SimulatorError(
                f"params={params}: a linear system has no parameters; make it with control.nlsys, whose functions get them."
            )
        names = {
            "states": self.states,
            "inputs": self.inputs,
            "outputs": self.outputs,
            "params": params,
            "x0": self.x0,
        }
        if own:
            held_over_samples(self.hold)
            step = float(1.0 if self.dt is None else self.dt) if own is True else float(own)
            if self.dt is not None and not np.isclose(self.dt, step, rtol=1e-9, atol=0.0):
                raise SimulatorError(
                    f"dt={self.dt}, but the system goes from sample to sample in {step:g}: leave dt out, or make the system anew for "
                    "the other sample time."
                )
            return StepSimulator(self.step, output=self.output, dt=step, **names)
        if self.dt is None:
            raise SimulatorError(
                "dt=None: a continuous system needs its sample time, e.g. ControlSimulator(system, dt=0.1)."
            )
        method = "exact" if linear else "auto"
        return ODESimulator(self.rhs, output=self.output, dt=self.dt, hold=self.hold, method=method, **names)
