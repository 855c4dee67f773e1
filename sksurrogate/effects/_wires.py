"""Where effects enter a plant and what drives them, by position: looked up once for a model."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sksurrogate.effects._base_effect import BaseEffect
from sksurrogate.effects._families import BalanceEffect, HiddenEffect
from sksurrogate.effects._law import LawEffect
from sksurrogate.effects._ports import at_port
from sksurrogate.effects._structure import largest_gains
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._simulator import Plant


@dataclass(frozen=True)
class Wire:
    """The wiring of one effect."""

    place: int  #: State whose balance holds the effect; -1: none
    #: tuple of (bool, int): signals of the variable: whether it is a state, and its position
    drivers: tuple[tuple[bool, int], ...]
    width: float | None  #: Width over which kinks are smoothed, in units of the variable (None: of time)
    port: int = -1  #: Port at which a law adds to what enters; -1: none
    #: What a unit of the effect's force changes in the rate of its own variable: 1 in the balance of that variable, at
    #: most the port's gain at a port, else 0
    feedback: float = 0.0
    #: Parameter of the simulator, and its value, to which the law's magnitude adds in place of a force
    #: (``law_parameters``)
    parameter: tuple[str, float] | None = None


def wire_of(effect: BaseEffect, model: PlantModel, width: Callable[[BaseEffect], float]) -> Wire:
    """The wiring of an effect; ``width`` tells that of its kinks."""
    plant = model.plant
    states, inputs = plant.states, plant.inputs
    if effect.kind not in ("state", "parameter"):
        followed = ((True, states.index(str(effect.variable))),) if isinstance(effect, HiddenEffect) else ()
        return Wire(-1, followed, None)
    drivers = tuple((True, states.index(n)) if n in states else (False, inputs.index(n)) for n in effect.signals)
    if effect.kind == "parameter":
        return Wire(-1, drivers, None)
    smoothed = width(effect) if effect.variable else None
    if not at_port(effect, plant):
        own = effect.variable == effect.location or (
            isinstance(effect, LawEffect) and effect.location in effect.signals
        )
        return Wire(states.index(str(effect.location)), drivers, smoothed, feedback=float(own))
    port = plant.ports.index(str(effect.location))
    own_parameters = getattr(plant.simulator, "law_parameters", None) or {}
    return Wire(-1, drivers, smoothed, port, feedback_of(model, port, drivers), own_parameters.get(effect.key))


def feedback_of(model: PlantModel, port: int, drivers: Sequence[tuple[bool, int]]) -> float:
    """Largest change of the rate of a law's variable, a single state, by a unit of what enters at its port."""
    if len(drivers) != 1 or not drivers[0][0]:
        return 0.0
    return float(largest_gains(model)[drivers[0][1], port])


def kink_width(effect: BaseEffect, wire: Wire, parameters: Sequence[Any], h: float) -> Any:
    """Width of an effect's kinks in steps ``h``: a jump against its own variable is smoothed as far as they follow it."""
    width = h if wire.width is None else wire.width
    return effect.smoothed(parameters, width, h * wire.feedback) if isinstance(effect, BalanceEffect) else width


def beside(
    model: PlantModel, effect: BalanceEffect, port: int, x: np.ndarray, u: np.ndarray, varied: Any = None
) -> Any:
    """What enters at a port beside a law there: the input; at a further port 0, or what the drives bring if the law depends on it.

    ``varied``: parameters that differ from their nominal values.
    """
    if port < len(model.plant.inputs):
        return u[port]
    return model.brought(port, x, u, varied) if effect.of_load else np.zeros(x.shape[1:])


def entering(
    plant: Plant, u: np.ndarray, forces: Sequence[tuple[int, np.ndarray]], shape: tuple[int, ...]
) -> np.ndarray:
    """What enters at the ports (n_inputs or n_ports, *shape): the inputs ``u`` with laws (port, force) added."""
    n = len(plant.inputs)
    rows = n if all(port < n for port, _ in forces) else len(plant.ports)
    out = np.zeros((rows, *shape), dtype=u.dtype if u.dtype == object else float)
    out[:n] = u
    for port, force in forces:
        out[port] += force
    return out
