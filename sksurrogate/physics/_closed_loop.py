"""A plant under a given controller: the loop as a simulator."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from sklearn.base import clone
from sklearn.utils.metaestimators import available_if

from sksurrogate.exceptions import SimulatorError
from sksurrogate.physics._contents import contents, same
from sksurrogate.physics._control import ControlSimulator
from sksurrogate.physics._events import EventMap
from sksurrogate.physics._inner import InnerRunsMixin
from sksurrogate.physics._ode import ODESimulator
from sksurrogate.physics._simulator import BaseSimulator, Plant, describe, units_of
from sksurrogate.physics._wrappers import StepSimulator

#: Before the name of a state of the controller that the plant has too.
CONTROLLER = "controller."


@dataclass(frozen=True, eq=False)
class _Layout:
    """Who is connected to whom."""

    plant: Plant
    controller: Plant
    inputs: tuple[str, ...]  #: Of the loop: inputs of the plant that are not driven, then references
    driven: tuple[str, ...]  #: Inputs of the plant that the controller commands
    states: tuple[str, ...]  #: Of the plant, then of the controller

    @property
    def continuous(self) -> bool:
        """Whether both have a right-hand side."""
        return self.plant.access == self.controller.access == "rhs"


def _is_continuous(self: ClosedLoopSimulator) -> bool:
    return self._layout().continuous


def _is_stepped(self: ClosedLoopSimulator) -> bool:
    return not self._layout().continuous


class ClosedLoopSimulator(InnerRunsMixin, BaseSimulator):
    """A plant and its controller as one simulator.

    In a closed loop the controller reacts to disturbances of the outputs. A model that is fitted to these inputs takes the
    reaction for a cause, and names effects that are absent. With the loop as the simulator, the references are the inputs, and a
    disturbance passes through the loop in the model as in the plant.

    Parameters
    ----------
    plant : simulator with a right-hand side or a step
    controller : simulator with a right-hand side or a step, or a system of python-control
        From outputs of the plant and references to inputs of the plant, by name. A step is a sampled controller: it reads the
        outputs at a sample, and its command is held until the next one.
    outputs : list of str, optional
        What is measured: outputs of the plant, and commands by the name of the input. By default the outputs of the plant.
    x0 : array-like (n_states,), optional
        States of the plant, then of the controller; by default their own.

    Attributes
    ----------
    states : list of str
        Of the plant, then of the controller (with ``controller.`` before a name that the plant has too).
    inputs : list of str
        Inputs of the plant that the controller does not drive, then references: its inputs that the plant does not give.
    params : dict
        Those of the plant: the controller is known.
    ports : list of str
        The driven inputs: a law there adds to the command, between controller and plant.

    Raises
    ------
    SimulatorError
        Plant or controller gives trajectories only, the names or sample times do not fit, or an output that the controller reads
        depends on its command at once.

    Notes
    -----
    A diagnosis tries no effect in the controller. Effects on an output are effects of the recording: the controller reads the
    true output. For effects of an actuator with a memory or a dead zone, diagnose the plant with its recorded commands as inputs,
    if no disturbance is large.

    Examples
    --------
    >>> import numpy as np
    >>> from sksurrogate.physics import ClosedLoopSimulator, ODESimulator, StepSimulator
    >>> tank = ODESimulator(lambda t, x, u, p: (u[0] + 0 * x[0],), states=["level"], inputs=["flow"], outputs=["level"],
    ...                     params={}, dt=0.1)
    >>> gain = StepSimulator(lambda t, x, u, p, dt: x, output=lambda t, x, u, p: [2.0 * (u[0] - u[1])], states=[],
    ...                      inputs=["set_point", "level"], outputs=["flow"], dt=0.1)
    >>> loop = ClosedLoopSimulator(tank, gain)
    >>> loop.inputs, loop.simulate(np.ones((3, 1))).ravel().round(6).tolist()  # 1 - 0.8^k
    (['set_point'], [0.0, 0.2, 0.36])
    """

    def __init__(self, plant: Any, controller: Any, *, outputs: Sequence[str] | None = None, x0: Any = None):
        self.plant = plant
        self.controller = controller
        self.outputs = outputs
        self.x0 = x0

    def __getstate__(self) -> dict[str, Any]:
        """What is looked up again stays behind."""
        return {key: value for key, value in super().__getstate__().items() if key not in ("_kept", "_maps")}

    # ---- what a simulator shows -------------------------------------------------------------------------------------
    @property
    def states(self) -> list[str]:
        """Of the plant, then of the controller."""
        return list(self._layout().states)

    @property
    def inputs(self) -> list[str]:
        """Inputs of the plant that are not driven, then references."""
        return list(self._layout().inputs)

    @property
    def params(self) -> dict[str, float]:
        """Of the plant."""
        return dict(getattr(self.plant, "params", None) or {})

    @property
    def dt(self) -> float:
        """Sample time."""
        return self._layout().plant.dt

    @property
    def hold(self) -> str:
        """How inputs act between samples."""
        return self._layout().plant.hold if self._layout().continuous else "zoh"

    @property
    def units(self) -> dict[str, str]:
        """Units by name, of the plant and of the references."""
        known = {*self.states, *self.inputs, *self.described()["outputs"], *self.params, *self.ports, "time"}
        both = {**units_of(self.controller), **units_of(self.plant)}
        return {name: unit for name, unit in both.items() if name in known}

    @property
    def ports(self) -> list[str]:
        """Driven inputs, then further ports of the plant."""
        return [*self._layout().driven, *self._layout().plant.further_ports]

    @property
    def kinematic(self) -> list[str]:
        """States in whose balance nothing can be missing: those that the plant names, and all of the controller."""
        own = list(getattr(self.plant, "kinematic", None) or [])
        return [*own, *self._layout().states[len(self._layout().plant.states) :]]

    def described(self) -> dict[str, Any]:
        """What the plant knows where nothing is given."""
        layout = self._layout()
        start = np.concatenate([layout.plant.x0, layout.controller.x0])
        return {"outputs": list(self.outputs or layout.plant.outputs), "x0": start if self.x0 is None else self.x0}

    def set_params(self, **params: Any) -> ClosedLoopSimulator:
        """Set constructor arguments, or single parameters of the plant as ``params__k=2.0``."""
        single = {key: params.pop(key) for key in list(params) if key.startswith("params__")}
        if params:
            super().set_params(**params)
        if single:
            self.plant = clone(self.plant).set_params(**single)
        return self

    # ---- equations --------------------------------------------------------------------------------------------------
    @available_if(_is_continuous)
    def rhs(self, t: Any, x: Any, u: Any, p: Mapping[str, Any], forces: Any = None) -> list[Any]:
        """dx/dt of plant and controller."""
        layout, n = self._layout(), len(self._layout().plant.states)
        enters, reads, further = self._connected(t, x, u, p, forces)
        moved = self.controller_.rhs(t, x[n:], reads, layout.controller.params) if len(x) > n else []
        return [*self.plant.rhs(t, x[:n], enters, p, *further), *moved]

    @available_if(_is_stepped)
    def step(self, t: Any, x: Any, u: Any, p: Mapping[str, Any], dt: float, forces: Any = None) -> list[Any]:
        """Plant and controller one sample later, the command held."""
        layout, n = self._layout(), len(self._layout().plant.states)
        enters, reads, further = self._connected(t, x, u, p, forces)
        after = list(self._moved(layout.plant, t, x[:n], enters, p, dt, *further))
        if len(x) > n:
            after += list(self._moved(layout.controller, t, x[n:], reads, layout.controller.params, dt))
        return after

    def output(self, t: Any, x: Any, u: Any, p: Mapping[str, Any], forces: Any = None) -> list[Any]:
        """Outputs of the plant, and commands as the controller gives them: without the forces, which add behind it."""
        layout, n = self._layout(), len(self._layout().plant.states)
        commanded, _, _ = self._connected(t, x, u, p, None)
        enters, _, further = (commanded, None, ()) if forces is None else self._connected(t, x, u, p, forces)
        shown = dict(zip(layout.plant.inputs, commanded))
        shown.update(zip(layout.plant.outputs, _outputs(layout.plant, t, x[:n], enters, p, *further)))
        return [shown[name] for name in self.described()["outputs"]]

    @property
    def controller_(self) -> Any:
        """The controller as a simulator."""
        return self._layout().controller.simulator

    def _connected(self, t: Any, x: Any, u: Any, p: Any, forces: Any) -> tuple[Any, Any, tuple[Any, ...]]:
        """What enters the plant, what the controller reads, and what enters at further ports of the plant."""
        layout, n = self._layout(), len(self._layout().plant.states)
        given = dict(zip(layout.inputs, u))
        nothing = 0.0 * (x[0] if len(x) else u[0])
        open_ = _stacked([given.get(name, nothing) for name in layout.plant.inputs], nothing)
        seen = dict(zip(layout.plant.outputs, _outputs(layout.plant, t, x[:n], open_, p)))
        reads = _stacked([seen.get(name, given.get(name)) for name in layout.controller.inputs], nothing)
        command = list(_outputs(layout.controller, t, x[n:], reads, layout.controller.params))
        further: tuple[Any, ...] = ()
        if forces is not None:
            command = [value + force for value, force in zip(command, forces)]
            further = (forces[len(command) :],) if len(forces) > len(command) else ()
        acting = {**given, **dict(zip(layout.controller.outputs, command))}
        return _stacked([acting[name] for name in layout.plant.inputs], nothing), reads, further

    def _moved(self, one: Plant, t: Any, x: Any, u: Any, p: Any, dt: float, *further: Any) -> Any:
        """States of plant or controller one sample later under held inputs."""
        if one.access == "step":
            return one.simulator.step(t, x, u, p, dt, *further)
        maps = self.__dict__.setdefault("_maps", {})
        if id(one) not in maps:
            maps[id(one)] = one, EventMap(one.simulator.rhs, (), one.states)
        states, inputs = np.asarray(x, dtype=float), np.asarray(u, dtype=float)
        shape = states.shape[1:]
        flat = states.reshape(len(states), -1)
        held = np.broadcast_to(inputs, (len(inputs), *shape)).reshape(len(inputs), -1)
        times = np.broadcast_to(np.asarray(t, dtype=float), shape).reshape(-1)
        spread = {k: np.broadcast_to(v, shape).reshape(-1) if np.ndim(v) else v for k, v in p.items()}
        return maps[id(one)][1].sample(times, flat, held, spread, dt).reshape(states.shape)

    def _inner(self) -> Any:
        """The loop as one of this package's simulators."""
        layout, own = self._layout(), self.described()
        names = {"states": layout.states, "inputs": layout.inputs, "outputs": own["outputs"], "x0": own["x0"]}
        common = {"params": self.params, "output": self.output, "dt": layout.plant.dt, **names}
        return (
            ODESimulator(self.rhs, hold=self.hold, **common)
            if layout.continuous
            else StepSimulator(self.step, **common)
        )

    def _layout(self) -> _Layout:
        """Who is connected to whom; looked up again where plant or controller has changed."""
        kept, now = self.__dict__.get("_kept"), contents(self.plant, self.controller, self.outputs)
        if kept is None or not same(kept[0], now):
            self.__dict__.pop("_maps", None)
            self._kept = kept = now, _connect(self.plant, self.controller, self.outputs)
        return kept[1]


def _connect(plant_given: Any, controller_given: Any, outputs: Sequence[str] | None) -> _Layout:
    """Plant and controller by the names of their signals."""
    plant = describe(plant_given)
    if not callable(getattr(controller_given, "simulate", None)) and hasattr(controller_given, "input_labels"):
        controller_given = ControlSimulator(controller_given, dt=None if controller_given.dt else plant.dt)
    controller = describe(controller_given)
    for one, name in ((plant, "plant"), (controller, "controller")):
        if one.access == "trajectory":
            raise SimulatorError(
                f"{name}={type(one.simulator).__name__} gives trajectories only: a loop needs rhs or step of both, for example "
                "ODESimulator, StepSimulator, ControlSimulator or an FMU with states."
            )
    foreign = [name for name in controller.outputs if name not in plant.inputs]
    if foreign or not controller.outputs:
        raise SimulatorError(
            f"controller: its outputs {list(controller.outputs)} must be inputs of the plant {list(plant.inputs)}; name them so."
        )
    if not set(controller.inputs) & set(plant.outputs):
        raise SimulatorError(
            f"controller: none of its inputs {list(controller.inputs)} is an output of the plant {list(plant.outputs)}; name what "
            "it reads as the plant does."
        )
    if controller.access == "step" and not np.isclose(controller.dt, plant.dt, rtol=1e-9, atol=0.0):
        raise SimulatorError(f"controller: dt={controller.dt:g}, expected that of the plant, {plant.dt:g}.")
    unknown = [name for name in outputs or () if name not in (*plant.outputs, *controller.outputs)]
    if unknown:
        raise SimulatorError(
            f"outputs={list(outputs or ())}: {unknown[0]!r} is neither an output of the plant {list(plant.outputs)} nor a command "
            f"{list(controller.outputs)}."
        )
    left = [name for name in plant.inputs if name not in controller.outputs]
    references = [name for name in controller.inputs if name not in (*plant.outputs, *left)]
    own = [CONTROLLER + name if name in plant.states else name for name in controller.states]
    layout = _Layout(plant, controller, (*left, *references), controller.outputs, (*plant.states, *own))
    _check_causal(layout)
    return layout


def _check_causal(layout: _Layout) -> None:
    """Outputs that the controller reads do not depend on its command at once."""
    plant = layout.plant
    x, u = plant.x0 + 0.5, np.zeros(len(plant.inputs))
    driven = [plant.inputs.index(name) for name in layout.driven]
    moved = u.copy()
    moved[driven] = 1.0
    both = [np.array(list(_outputs(plant, 0.0, x, v, plant.params)), dtype=float).ravel() for v in (u, moved)]
    for name, one, other in zip(plant.outputs, *both):
        if name in layout.controller.inputs and one != other:
            raise SimulatorError(
                f"output {name!r} depends on the command {list(layout.driven)} at once, and the command on it: give the plant the "
                "state that lies between them (a lag of the actuator or of the sensor)."
            )


def _outputs(one: Plant, t: Any, x: Any, u: Any, p: Any, *further: Any) -> Any:
    """Outputs of plant or controller at a point."""
    places = one.output_states
    return one.simulator.output(t, x, u, p, *further) if places is None else [x[i] for i in places]


def _stacked(values: list[Any], like: Any) -> Any:
    """Signals (n, *s) as an array; a list of symbols stays one."""
    if any(hasattr(value, "graph") for value in (*values, like)):
        return values
    if not values:
        return np.zeros((0, *np.shape(like)))
    return np.stack(np.broadcast_arrays(*values, like)[:-1]).astype(float)
