"""Plants of the check: nominal equations as a user would write them, and the experiments that are feasible on them."""

from __future__ import annotations

import mmap
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sksurrogate.blind import _equations as eq
from sksurrogate.physics import ODESimulator


@dataclass(frozen=True)
class Drive:
    """What an input may do."""

    name: str
    #: middle, swing: excitations move about ``middle`` by about ``swing`` (units of the input)
    middle: float
    swing: float
    #: low, high: feasible range
    low: float = -np.inf
    high: float = np.inf


class CountingRhs:
    """A right-hand side that counts how many columns it was asked for.

    ``rhs``: ``rhs(t, x, u, p)``.
    """

    def __init__(self, rhs: Callable[..., Any], columns: int = 0):
        self.rhs = rhs
        # Shared memory: what a fork of this process asks counts too.
        self._count = np.frombuffer(mmap.mmap(-1, 8), dtype=np.int64)
        self._count[0] = columns

    @property
    def columns(self) -> int:
        """Columns so far."""
        return int(self._count[0])

    def __call__(self, t: Any, x: Any, u: Any, p: Any) -> Any:
        self._count[0] += np.asarray(x[0]).size
        return self.rhs(t, x, u, p)

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.rhs, self.columns)


@dataclass(frozen=True)
class PlantSpec:
    """A plant and the effects that it can have.

    Attributes
    ----------
    name, domain : str
    rhs : callable
        ``rhs(t, x, u, p)``, columns at once.
    states : tuple of str
    drives : tuple of Drive
    outputs : tuple of str
        All that can be measured.
    params : dict
    dt : float
    start, spread : tuple of float
        Initial states: ``start + spread * uniform(-1, 1)``.
    partial : tuple of str
        Outputs that remain when sensors are few.
    kinematic : dict
        Position -> its speed: no effect can be missing in the balance of a position.
    positive : bool
        Whether states are levels or concentrations.
    warm : bool
        Whether states are temperatures (radiation makes sense).
    output : callable, optional
        ``output(t, x, u, p)`` where outputs are not states.
    hold : {"zoh", "foh"}
    within : dict
        State -> largest magnitude in an experiment: runs that go further are drawn again (a pendulum that tumbles forgets
        where it began, and what is missing in it can no longer be seen in a free run).

    Examples
    --------
    >>> from sksurrogate.blind import PLANTS
    >>> PLANTS["cascaded_tanks"].states
    ('upper', 'lower')
    """

    name: str
    domain: str
    rhs: Callable[..., Any]
    states: tuple[str, ...]
    drives: tuple[Drive, ...]
    outputs: tuple[str, ...]
    params: Mapping[str, float]
    dt: float
    start: tuple[float, ...]
    spread: tuple[float, ...]
    partial: tuple[str, ...]
    kinematic: Mapping[str, str]
    positive: bool = False
    warm: bool = False
    output: Callable[..., Any] | None = None
    hold: str = "zoh"
    within: Mapping[str, float] = field(default_factory=dict)

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the inputs."""
        return tuple(drive.name for drive in self.drives)

    def holds(self, states: np.ndarray) -> bool:
        """Whether states (..., n_states) stay where an experiment may go."""
        limit = np.array([self.within.get(name, np.inf) for name in self.states])
        return bool(np.all(np.abs(states) <= limit))

    @property
    def balances(self) -> tuple[str, ...]:
        """States in whose balance an effect can be missing."""
        return tuple(name for name in self.states if name not in self.kinematic)

    @property
    def twin_places(self) -> dict[str, str]:
        """Input -> the one balance it pushes, where it pushes nothing else: a fault of one is a fault of the other."""
        if self.output is not None:
            return {}
        start = np.array(self.start, dtype=float)
        u = np.array([drive.middle for drive in self.drives])
        rates = [np.array(self.rhs(0.0, start, row, self.params), dtype=float).ravel() for row in [u, *self._pushed(u)]]
        moved = {name: np.flatnonzero(rate != rates[0]) for name, rate in zip(self.inputs, rates[1:])}
        return {name: self.states[int(which[0])] for name, which in moved.items() if len(which) == 1}

    def _pushed(self, u: np.ndarray) -> list[np.ndarray]:
        """Inputs with one of them moved."""
        steps = [drive.swing * 0.5 for drive in self.drives]
        return [u + step * (np.arange(len(u)) == j) for j, step in enumerate(steps)]

    def simulator(
        self, params: Mapping[str, float] | None = None, outputs: Sequence[str] | None = None, *, counting: bool = False
    ) -> ODESimulator:
        """The nominal simulator, as its user would have written it."""
        names = tuple(outputs if outputs is not None else self.outputs)
        reading = None
        if self.output is not None:
            reading = self.output if names == self.outputs else eq.Chosen(self.output, self.outputs, names)
        return ODESimulator(
            CountingRhs(self.rhs) if counting else self.rhs,
            states=list(self.states),
            inputs=list(self.inputs),
            outputs=list(names),
            params=dict(self.params if params is None else params),
            dt=self.dt,
            hold=self.hold,
            output=reading,
            x0=list(self.start),
        )

    def read(self, t: Any, x: np.ndarray, u: np.ndarray, p: Mapping[str, Any]) -> np.ndarray:
        """All outputs, (n_outputs, n_columns)."""
        if self.output is None:
            return np.stack([x[self.states.index(name)] for name in self.outputs])
        return np.stack([np.broadcast_to(y, x[0].shape) for y in self.output(t, x, u, p)])


def _spec(
    name: str,
    domain: str,
    rhs: Callable[..., Any],
    states: str,
    drives: tuple[Drive, ...],
    outputs: str,
    params: Mapping[str, float],
    dt: float,
    start: tuple[float, ...],
    spread: tuple[float, ...],
    *,
    partial: str = "",
    kinematic: Mapping[str, str] | None = None,
    positive: bool = False,
    warm: bool = False,
    output: Callable[..., Any] | None = None,
    within: Mapping[str, float] | None = None,
) -> PlantSpec:
    """A plant, names written as one string."""
    return PlantSpec(
        name, domain, rhs, tuple(states.split()), drives, tuple(outputs.split()), dict(params), dt, start, spread,
        tuple((partial or outputs).split()), dict(kinematic or {}), positive, warm, output, within=dict(within or {}),
    )  # fmt: skip


_ALL = (
    _spec(
        "reactor", "chemistry", eq.reactor, "concentration", (Drive("temperature", 0.15, 0.06, 0.05, 0.25),),
        "concentration", {"flow": 2.0, "feed": 4.0, "second": 1e2, "first": 1e3}, 0.02, (7.0,), (4.0,), positive=True,
    ),
    _spec(
        "cooled_reactor", "chemistry", eq.cooled_reactor, "concentration temperature",
        (Drive("coolant", 300.0, 12.0, 270.0, 330.0), Drive("flow", 1.0, 0.25, 0.4, 1.8)), "concentration temperature",
        {"feed": 1.0, "feed_temperature": 350.0, "rate": 0.35, "activation": 9.0, "heat": 40.0, "cooling": 1.2}, 0.1,
        (0.6, 330.0), (0.15, 6.0), partial="temperature", positive=True, warm=True,
    ),
    _spec(
        "oscillator", "mechanics", eq.oscillator, "position velocity", (Drive("force", 0.0, 4.0),), "position velocity",
        {"gain": 1.0, "stiffness": 9.0, "damping": 0.6}, 0.05, (0.0, 0.0), (0.5, 1.5), partial="position",
        kinematic={"position": "velocity"},
    ),
    _spec(
        "pendulum", "mechanics", eq.pendulum, "angle rate", (Drive("torque", 0.0, 5.0),), "angle rate",
        {"gain": 1.0, "gravity": 9.0, "damping": 0.4}, 0.05, (0.0, 0.0), (0.6, 1.5), partial="angle",
        kinematic={"angle": "rate"}, within={"angle": 6.3},
    ),
    _spec(
        "two_mass_drive", "mechanics", eq.two_mass_drive, "twist motor_speed load_speed", (Drive("torque", 0.0, 3.0),),
        "motor_speed load_speed", {"shaft": 12.0, "motor_inertia": 0.5, "load_inertia": 0.8, "motor_damping": 0.25,
        "load_damping": 0.3, "shaft_damping": 0.4}, 0.05, (0.0, 0.0, 0.0), (0.1, 1.0, 1.0), partial="motor_speed",
    ),
    _spec(
        "dc_motor", "electricity", eq.dc_motor, "angle speed current", (Drive("voltage", 0.0, 6.0, -24.0, 24.0),),
        "speed current", {"torque": 0.5, "friction": 0.1, "inertia": 0.2, "resistance": 1.0, "inductance": 0.3}, 0.05,
        (0.0, 0.0, 0.0), (0.5, 2.0, 2.0), partial="speed", kinematic={"angle": "speed"},
    ),
    _spec(
        "rlc_circuit", "electricity", eq.rlc_circuit, "charge current", (Drive("source", 0.0, 5.0, -12.0, 12.0),),
        "charge current", {"resistance": 0.8, "inductance": 0.5, "capacitance": 0.4}, 0.05, (0.0, 0.0), (0.6, 1.5),
        partial="current", kinematic={"charge": "current"},
    ),
    _spec(
        "battery", "electricity", eq.battery, "charge fast slow", (Drive("load", 1.0, 2.5, -6.0, 8.0),), "voltage",
        {"capacity": 2500.0, "r0": 0.03, "r1": 0.02, "c1": 600.0, "r2": 0.03, "c2": 4000.0}, 2.0, (0.6, 0.0, 0.0),
        (0.1, 0.01, 0.01), output=eq.battery_voltage,
    ),
    _spec(
        "cascaded_tanks", "hydraulics", eq.cascaded_tanks, "upper lower", (Drive("pump", 3.0, 1.5, 0.2, 8.0),),
        "upper lower", {"lift": 0.5, "drain_1": 0.6, "drain_2": 0.5}, 0.3, (6.0, 9.0), (2.0, 3.0), partial="lower",
        positive=True,
    ),
    _spec(
        "mixing_tank", "hydraulics", eq.mixing_tank, "level salt",
        (Drive("water", 1.0, 0.4, 0.1, 2.5), Drive("brine", 0.6, 0.3, 0.05, 1.5)), "level salt",
        {"area": 1.0, "outflow": 0.8, "strength": 5.0, "water_gain": 1.0, "brine_gain": 1.0}, 0.2, (3.5, 2.0), (1.0, 0.6),
        positive=True,
    ),
    _spec(
        "two_rooms", "buildings", eq.two_rooms, "heater room",
        (Drive("power", 5.0, 4.0, 0.0, 15.0), Drive("outdoor", 8.0, 5.0, -15.0, 30.0)), "heater room",
        {"heating": 1.0, "to_room": 0.3, "to_air": 0.05, "from_heater": 0.15, "walls": 0.12}, 0.5, (50.0, 25.0),
        (8.0, 4.0), partial="room", warm=True,
    ),
    _spec(
        "heat_exchanger", "heat", eq.heat_exchanger, "hot cold",
        (Drive("hot_flow", 1.0, 0.4, 0.2, 2.0), Drive("cold_flow", 1.2, 0.5, 0.2, 2.5)), "hot cold",
        {"hot_in": 80.0, "cold_in": 15.0, "transfer_hot": 0.9, "transfer_cold": 0.8}, 0.2, (55.0, 35.0), (5.0, 4.0),
        partial="cold", positive=True, warm=True,
    ),
    _spec(
        "vehicle", "vehicles", eq.vehicle, "speed",
        (Drive("drive", 1.2, 0.9, -2.5, 4.0), Drive("slope", 0.0, 0.03, -0.1, 0.1)), "speed",
        {"thrust": 1.0, "rolling": 0.15, "air": 0.0012, "gravity": 9.81}, 0.5, (18.0,), (4.0,),
    ),
    _spec(
        "quarter_car", "vehicles", eq.quarter_car, "travel body_speed tyre wheel_speed", (Drive("road_speed", 0.0, 0.25),),
        "travel body_speed wheel_speed", {"spring": 60.0, "damper": 5.0, "tyre_stiffness": 500.0, "wheel_mass": 0.15},
        0.01, (0.0, 0.0, 0.0, 0.0), (0.02, 0.1, 0.005, 0.2), partial="travel body_speed",
    ),
    _spec(
        "bioprocess", "biology", eq.bioprocess, "biomass substrate", (Drive("dilution", 0.22, 0.12, 0.02, 0.42),),
        "biomass substrate", {"growth": 0.5, "half": 0.8, "feed": 10.0, "yield": 0.5}, 0.4, (4.0, 2.0), (1.0, 0.8),
        partial="biomass", positive=True,
    ),
)  # fmt: skip

#: Name -> plant.
PLANTS: dict[str, PlantSpec] = {plant.name: plant for plant in _ALL}
