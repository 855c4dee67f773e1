"""Constructor arguments that are read as what they mean for a model, and its names."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from numbers import Integral
from pathlib import Path
from typing import Any

import numpy as np

from sksurrogate._close_names import did_you_mean
from sksurrogate.exceptions import SimulatorError
from sksurrogate.physics._mujoco_effects import law_of
from sksurrogate.physics._mujoco_engine import Engine
from sksurrogate.physics._mujoco_source import files_of, identity, read_model
from sksurrogate.physics._mujoco_units import joint_units
from sksurrogate.physics._params import ParametricSimulator


class Resolved:
    """A constructor argument that is kept as given and read through the method ``_read_<name>(given)``."""

    def __set_name__(self, owner: type, name: str) -> None:
        self.name = name

    def __set__(self, obj: Any, value: Any) -> None:
        obj.__dict__[self.name] = value

    def __get__(self, obj: Any, owner: type | None = None) -> Any:
        return self if obj is None else getattr(obj, f"_read_{self.name}")(obj.__dict__[self.name])


def listed(names: Any) -> list[str]:
    """One name or several."""
    return [names] if isinstance(names, str) else [str(name) for name in names]


def known_names(names: list[str], known: Sequence[str], argument: str, fault: str) -> list[str]:
    """Names that the model has, each once."""
    for k, name in enumerate(names):
        if name not in known:
            raise SimulatorError(
                f"{argument}: {name!r} {fault} of the model;{did_you_mean(name, known)} it has {list(known)}."
            )
        if name in names[:k]:
            raise SimulatorError(f"{argument}: {name!r} is listed twice; list each name once.")
    return names


def number(value: Any, name: str) -> float:
    """The value of a parameter."""
    try:
        return float(value)
    except (TypeError, ValueError) as error:
        raise SimulatorError(f"params: {name}={value!r}, expected a number.") from error


def whole_steps(widths: np.ndarray, step: float, what: str) -> np.ndarray:
    """How many steps of the model there are in each width."""
    with np.errstate(invalid="ignore"):
        counts = np.rint(widths / step)
        off = ~((counts >= 1) & (np.abs(widths - counts * step) <= 1e-6 * widths))  # times are sums of rounded numbers
    if np.any(off):
        raise SimulatorError(
            f"{what} {widths[np.argmax(off)]:g}, expected a positive multiple of the model's timestep {step:g}: change it, "
            'or the timestep (<option timestep="..."/> in the MJCF).'
        )
    return counts.astype(int)


class NamedModel(ParametricSimulator):
    """Base of :class:`MuJoCoSimulator`: the model in memory, opened when it is needed, and its names."""

    model: Any
    n_threads: Any
    inputs: Any = Resolved()
    outputs: Any = Resolved()
    params: Any = Resolved()
    dt: Any = Resolved()
    x0: Any = Resolved()

    def __getstate__(self) -> dict[str, Any]:
        """The model in memory stays behind."""
        return {key: value for key, value in super().__getstate__().items() if key != "_handle"}

    def _files(self) -> list[Path]:
        """Files whose content is part of the simulator's value."""
        return files_of(self.model)

    def close(self) -> None:
        """Free the model in memory and its threads; the next simulation opens it again."""
        handle = self.__dict__.pop("_handle", None)
        if handle is not None and handle[1].alive:
            handle[1].close()

    def _engine(self) -> Engine:
        """The model in memory; opened on first use and after a change of source, threads or process."""
        key = (identity(self.model), self._threads())
        handle = self.__dict__.get("_handle")
        if handle is None or handle[0] != key or not handle[1].alive:
            self._handle = handle = (key, Engine(read_model(self.model), key[1]))
        return handle[1]

    def _threads(self) -> int:
        given = self.n_threads
        if given is None:
            return 1
        if not isinstance(given, Integral) or (given < 1 and given != -1):
            raise SimulatorError(f"n_threads={given!r}: expected None, -1 or a positive integer.")
        return os.cpu_count() or 1 if given == -1 else int(given)

    def _read_inputs(self, given: Sequence[str] | None) -> list[str]:
        layout = self._engine().layout
        names = list(layout.controls) if given is None else listed(given)
        return known_names(names, (*layout.controls, *layout.ports), "inputs", "is neither an actuator nor a joint")

    def _read_outputs(self, given: Sequence[str] | None) -> list[str]:
        layout = self._engine().layout
        names = list(layout.sensors or layout.states) if given is None else listed(given)
        if not names:
            raise SimulatorError(f"outputs=[]: name at least one of {[*layout.states, *layout.sensors]}.")
        return known_names(names, (*layout.states, *layout.sensors), "outputs", "is neither a state nor a sensor")

    def _read_params(self, given: Any) -> dict[str, float]:
        own = self._engine().parameters
        names = list(own) if given is None else known_names(listed(given), tuple(own), "params", "is not a parameter")
        return {name: number(given[name], name) if isinstance(given, Mapping) else own[name].value for name in names}

    def _read_dt(self, given: float | None) -> float:
        step = self._engine().timestep
        if given is not None:
            whole_steps(np.array([float(given)]), step, "dt is")
        return step if given is None else float(given)

    def _read_x0(self, given: Any) -> np.ndarray:
        engine = self._engine()
        return engine.start if given is None else self._checked_x0(np.asarray(given, dtype=float).reshape(-1), engine)

    def _checked_x0(self, start: np.ndarray, engine: Engine) -> np.ndarray:
        if start.shape[-1] != engine.n_states:
            raise SimulatorError(
                f"x0 has {start.shape[-1]} values, expected {engine.n_states}: one for each of states={self.states}."
            )
        return start

    def own_units(self) -> dict[str, str]:
        """SI units of joints, ports and time."""
        return joint_units(self._engine().origin)

    def own_bounds(self) -> dict[str, tuple[float, float]]:
        """Ranges of parameters that cannot be negative: damping, dry friction and armature of joints."""
        known = self._engine().parameters
        return {name: (0.0, np.inf) for name in self.params if known[name].not_negative}

    @property
    def states(self) -> list[str]:
        """Positions, velocities and activations by name."""
        return list(self._engine().layout.states)

    @property
    def ports(self) -> list[str]:
        """Where forces can enter that are not inputs."""
        taken = set(self.inputs)
        return [name for name in self._engine().layout.ports if name not in taken]

    @property
    def kinematic(self) -> list[str]:
        """States that are integrals of others."""
        return list(self._engine().layout.positions)

    @property
    def law_parameters(self) -> dict[tuple[str, str, str], tuple[str, float]]:
        """Laws at joints that are parameters of the model: damping, dry friction (a constraint), a spring that rests at 0."""
        engine, given = self._engine(), self.params
        found = {}
        for name, own in engine.parameters.items():
            laws = law_of(engine.origin, engine.layout, own)
            found.update({law: (name, float(given.get(name, own.value))) for law in laws})
        return found

    @property
    def absent_params(self) -> list[str]:
        """Parameters of the value 0 that a law at a joint says in its own name: a diagnosis tries that law instead.

        A damping (``linear_loss`` in the joint's velocity), a dry friction (``coulomb_friction``), a spring (``linear_loss`` in
        its position) that the model does not have. None where ``params`` names a choice: what is chosen is tried.
        """
        params = self.params
        if set(params) != set(self._engine().parameters):
            return []
        return [name for name, value in self.law_parameters.values() if value == 0 and name in params]

    @property
    def timestep(self) -> float:
        """Step of the model's integrator."""
        return self._engine().timestep

    @property
    def exact_step(self) -> bool:
        """Whether the model's own step is more than an accurate solution of its forward dynamics; not where its steps are of order four."""
        return not self._engine().accurate

    def keyframe(self, name: str) -> np.ndarray:
        """State (n_states,) of a keyframe of the model, to be given as ``x0``.

        Raises
        ------
        SimulatorError
            The model has no such keyframe.
        """
        model = self._engine().origin
        known = [model.key(i).name for i in range(model.nkey)]
        known_names([name], known, "name", "is not a keyframe")
        key = model.key(name)
        return np.concatenate([key.qpos, key.qvel, key.act])
