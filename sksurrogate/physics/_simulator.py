"""The simulator protocol: what is present decides what can be asked."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import Any

import numpy as np
from sklearn.base import BaseEstimator

from sksurrogate.exceptions import SimulatorError, require


class BaseSimulator(BaseEstimator):
    """Base of the simulators: one method, ``simulate``; everything else is found by presence.

    A subclass gives ``simulate(U, x0=None, t=None) -> Y`` for one run. It may give ``rhs(t, x, u, p)``,
    ``step(t, x, u, p, dt)``, ``output(t, x, u, p)``, ``simulate_states(U, x0, t)``, ``simulate_batch(U, X0, t)``,
    ``ports`` (names of forces that are not inputs; ``rhs``, ``step`` and ``output`` then take them as a
    last argument ``forces`` (n_ports, ...)), ``law_parameters`` (key of an effect at a port: name and value of the parameter to
    which its magnitude adds, where a parameter is that law), and the names ``states``, ``inputs``, ``outputs``, the dict ``params``, ``dt``, ``hold``
    and ``x0``; ``described()``, a dict of "inputs", "outputs", "states" and "x0", answers where these are None. ``kinematic``
    names states that are integrals, or copies, of others: no effect is sought in their balance. ``exact_step = True``
    says that ``step`` is what the simulator itself does, and ``rhs`` only its limit: then ``step`` is used where both are
    there. Any object with ``simulate`` is a simulator; this base only adds ``get_params``, ``clone`` and ``repr``.

    Examples
    --------
    >>> import numpy as np
    >>> from sksurrogate.physics import BaseSimulator
    >>> class Gain(BaseSimulator):
    ...     inputs, outputs = ["u"], ["y"]
    ...     def __init__(self, gain=2.0):
    ...         self.gain = gain
    ...     def simulate(self, U, x0=None, t=None):
    ...         return self.gain * np.asarray(U, dtype=float)
    >>> Gain().set_params(gain=3.0).simulate([[1.0], [2.0]]).tolist()
    [[3.0], [6.0]]
    """

    @classmethod
    @cache
    def _get_param_names(cls) -> list[str]:
        """Constructor arguments; scikit-learn inspects the signature anew at every clone."""
        return super()._get_param_names()

    @abstractmethod
    def simulate(self, U: Any, x0: Any = None, t: Any = None) -> np.ndarray:
        """Free run of one run: ``U`` (n_samples, n_inputs) -> ``Y`` (n_samples, n_outputs)."""

    def to_control(self) -> Any:
        """The plant as ``control.NonlinearIOSystem`` (python-control), in continuous time for ``rhs``, else with ``dt``.

        Raises
        ------
        SimulatorError
            The simulator gives trajectories only.
        """
        plant = describe(self)
        if plant.access == "trajectory":
            raise SimulatorError(
                f"{type(self).__name__} gives trajectories only: python-control needs a simulator with rhs or step."
            )
        places, output = plant.output_states, getattr(self, "output", None)

        def moved(t: Any, x: Any, u: Any, p: Any) -> np.ndarray:
            if plant.access == "rhs":
                found = self.rhs(t, np.array(x), np.array(u), dict(p))  # type: ignore[attr-defined]
            else:
                found = self.step(t, np.array(x), np.array(u), dict(p), plant.dt)  # type: ignore[attr-defined]
            return np.array([float(np.squeeze(v)) for v in found])

        def seen(t: Any, x: Any, u: Any, p: Any) -> np.ndarray:
            if places is not None:
                return np.asarray(x)[list(places)]
            assert callable(output)
            return np.array([float(np.squeeze(v)) for v in output(t, np.array(x), np.array(u), dict(p))])

        names = {"states": list(plant.states), "inputs": list(plant.inputs), "outputs": list(plant.outputs)}
        dt = 0 if plant.access == "rhs" else plant.dt
        return require("control", "control").nlsys(moved, seen, params=dict(plant.params), dt=dt, **names)


@dataclass(frozen=True)
class Plant:
    """What is known of a simulator, read once at the border.

    Attributes
    ----------
    simulator : object
    access : {"rhs", "step", "trajectory"}
        Finest access that the simulator gives.
    states, inputs, outputs : tuple of str
        Names; made up (``u0``, ``y0``) where the simulator gives none.
    params : dict
        Nominal parameters.
    dt : float
    hold : {"zoh", "foh"}
    x0 : ndarray (n_states,)
        Nominal initial state.
    input_range : ndarray (2, n_inputs), optional
        Least and largest recorded inputs. Where it is given candidates are tried on the simulator: whatever it raises at a point
        beside the first is a refusal of that point.
    """

    simulator: Any
    access: str
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    params: Mapping[str, float]
    dt: float
    hold: str
    x0: np.ndarray
    input_range: np.ndarray | None = None

    @property
    def output_states(self) -> tuple[int, ...] | None:
        """Positions of the states that are the outputs, None where an output function is given."""
        if callable(getattr(self.simulator, "output", None)):
            return None
        if not set(self.outputs) <= set(self.states):
            return None
        return tuple(self.states.index(name) for name in self.outputs)

    @cached_property
    def further_ports(self) -> tuple[str, ...]:
        """Where forces can enter that are not inputs: what the simulator offers as ``ports``, as far as no state has the name."""
        if self.access == "trajectory":
            return ()
        taken = {*self.inputs, *self.states}
        return tuple(name for name in offered_ports(self.simulator) if name not in taken)

    @cached_property
    def ports(self) -> tuple[str, ...]:
        """Where forces, flows or heat can enter: the inputs, then further ports."""
        return (*self.inputs, *self.further_ports)


def simulated(simulator: Any, U: np.ndarray, x0: Any = None, t: Any = None) -> np.ndarray:
    """``simulate`` of a run, on copies: what it writes into its arguments, or at its next call into what it gave, stays its own."""
    return np.array(simulator.simulate(np.array(U), *_given(x0, t)), dtype=float)


def simulated_batch(simulator: Any, U: np.ndarray, X0: Any = None, t: Any = None) -> np.ndarray:
    """``simulate_batch``, on copies."""
    return np.array(simulator.simulate_batch(np.array(U), *_given(X0, t)), dtype=float)


def _given(x0: Any, t: Any) -> list[Any]:
    """Further arguments of a run, up to the last one that is given: a simulator need not take the others."""
    start = None if x0 is None else np.array(x0, dtype=float)
    return [start, t] if t is not None else [start] if start is not None else []


def _names(given: Sequence[str] | None, count: int | None, letter: str, argument: str) -> tuple[str, ...]:
    """Names as given, else letter and number; ``argument``: which of the simulator's they are, for the message."""
    if isinstance(given, bytes) or not (given is None or isinstance(given, Iterable)):
        raise SimulatorError(
            f"the simulator's {argument}={given!r}: expected a list of names; write {argument}=['{letter}']."
        )
    if given is not None:
        return (given,) if isinstance(given, str) else tuple(str(name) for name in given)
    return tuple(f"{letter}{k}" for k in range(count or 0))


def offered_ports(simulator: Any) -> tuple[str, ...]:
    """Names of the ports that a simulator offers beside its inputs."""
    return _names(getattr(simulator, "ports", None), 0, "joint", "ports")


def _or(given: Any, own: Any) -> Any:
    """What the user gave, else what the simulator knows by itself."""
    return own if given is None else given


def recorded(plant: Plant, inputs: Sequence[np.ndarray]) -> Plant:
    """The plant with the range of the inputs (n_samples, n_inputs) of recorded runs."""
    every = np.concatenate([np.asarray(U, dtype=float) for U in inputs])
    return replace(plant, input_range=np.stack([every.min(axis=0), every.max(axis=0)]))


def describe(
    simulator: Any, *, n_inputs: int | None = None, n_outputs: int | None = None, dt: float | None = None
) -> Plant:
    """Read a simulator: access, names, parameters.

    ``n_inputs, n_outputs``: columns of the data, for simulators that do not name their signals.
    ``dt``: sample time for simulators that have none.
    Raises SimulatorError where it is a class, has no ``simulate``, or names and data do not fit.
    """
    if isinstance(simulator, type):
        name = simulator.__name__
        raise SimulatorError(f"simulator={name} is a class: give one simulator of it, {name}(...).")
    if not callable(getattr(simulator, "simulate", None)):
        raise SimulatorError(
            f"simulator={simulator!r} has no method simulate(U, x0=None, t=None): wrap it, "
            "for example in sksurrogate.physics.CallableSimulator or ODESimulator."
        )
    own = simulator.described() if callable(getattr(simulator, "described", None)) else {}
    own_states = _or(getattr(simulator, "states", None), own.get("states"))
    has_states = own_states is not None
    stepwise = bool(getattr(simulator, "events", None)) or bool(getattr(simulator, "exact_step", False))
    jumps = stepwise and callable(getattr(simulator, "step", None))
    if callable(getattr(simulator, "rhs", None)) and has_states and not jumps:
        access = "rhs"
    elif callable(getattr(simulator, "step", None)) and has_states:
        access = "step"
    else:
        access = "trajectory"
    inputs = _names(_or(getattr(simulator, "inputs", None), own.get("inputs")), n_inputs, "u", "inputs")
    outputs = _names(_or(getattr(simulator, "outputs", None), own.get("outputs")), n_outputs, "y", "outputs")
    states = _names(own_states, 0, "x", "states")
    ports = offered_ports(simulator)
    for names, what in ((states, "state"), (inputs, "input"), (outputs, "output"), (ports, "port")):
        twice = [name for k, name in enumerate(names) if name in names[:k]]
        if twice:
            raise SimulatorError(
                f"{what}s={list(names)}: {twice[0]!r} is named twice; every {what} needs a name of its own."
            )
    for given, count, what, argument in ((inputs, n_inputs, "inputs", "X"), (outputs, n_outputs, "outputs", "y")):
        if count is not None and len(given) != count:
            raise SimulatorError(
                f"{argument} has {count} columns, but the simulator has {len(given)} {what} {list(given)}: "
                f"give {argument} the columns of the simulator, in its order."
            )
    x0 = _or(getattr(simulator, "x0", None), own.get("x0") if access != "trajectory" else None)
    start = np.zeros(len(states)) if x0 is None else np.asarray(x0, dtype=float).reshape(-1)
    own_dt = getattr(simulator, "dt", None)
    params = dict(getattr(simulator, "params", None) or {})
    _check_units(simulator, {*states, *inputs, *outputs, *params, *ports, "time"})
    return Plant(
        simulator,
        access,
        states,
        inputs,
        outputs,
        params,
        float(own_dt if own_dt is not None else (dt if dt is not None else 1.0)),
        str(getattr(simulator, "hold", "zoh")),
        start,
    )


def _check_units(simulator: Any, known: set[str]) -> None:
    """A unit of a name that the simulator does not have is a mistake."""
    for name in getattr(simulator, "__dict__", {}).get("units") or {}:
        if name not in known:
            raise SimulatorError(
                f"units: the simulator has no signal or parameter {name!r}; expected names out of {sorted(known)}."
            )


def units_of(simulator: Any) -> dict[str, str]:
    """Units by name: those of the model itself (an FMU's, SI for joints), those that were given in their place."""
    own = simulator.own_units() if callable(getattr(simulator, "own_units", None)) else {}
    given = dict(getattr(simulator, "units", None) or {})
    return {name: str(unit) for name, unit in {**own, **given}.items()}


def bounds_of(simulator: Any) -> dict[str, tuple[float, float]]:
    """Ranges outside of which parameters have no meaning, as far as a simulator knows them (those of a MuJoCo model)."""
    return dict(simulator.own_bounds()) if callable(getattr(simulator, "own_bounds", None)) else {}
