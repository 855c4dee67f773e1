"""What effects without a memory do at a point: in the right-hand side and outputs of a simulator that has them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np

from sksurrogate.effects._at_work import paired, values_of
from sksurrogate.effects._base_effect import BaseEffect
from sksurrogate.effects._families import BalanceEffect, ParameterEffect
from sksurrogate.effects._variable import driver_of
from sksurrogate.physics._simulator import offered_ports


class Augmented(Protocol):
    """A simulator with effects."""

    simulator: Any
    effects: Sequence[BaseEffect]
    values: Sequence[Any]
    scale: Any
    sharpness: float

    @property
    def states(self) -> Any:
        """Names of the states."""

    @property
    def inputs(self) -> Any:
        """Names of the inputs."""


def term_at(model: Augmented, effect: BalanceEffect, given: Any, t: Any, x: Any, u: Any, own: Any) -> Any:
    """What a law adds, ``own`` being the state or input of its location."""
    states = list(model.states)
    sizes = None if model.scale is None else np.broadcast_to(np.asarray(model.scale, dtype=float), (len(states),))
    names = effect.signals
    width = 0.0
    if sizes is not None and names and set(names) <= set(states):
        width = float(np.prod([sizes[states.index(name)] for name in names])) / model.sharpness
    return effect.term(t, own, _driver(model, effect, x, u), values_of(effect, given), width)


def _driver(model: Augmented, effect: BaseEffect, x: Any, u: Any) -> Any:
    """What an effect is given as its variable."""
    states, inputs = list(model.states), list(model.inputs)
    found = [x[states.index(name)] if name in states else u[inputs.index(name)] for name in effect.signals]
    return driver_of(effect.variable, found)


def entering_at(
    model: Augmented, t: Any, x: Any, u: Any, p: Mapping[str, Any], laws: Sequence[tuple[BalanceEffect, Any]]
) -> tuple[Any, tuple[Any, ...]]:
    """The inputs with laws at them, and what enters at further ports, where a law acts at one; ``p``: parameters that act."""
    if not laws:
        return u, ()
    inputs, further = list(model.inputs), offered_ports(model.simulator)
    enters, forces = list(u), [np.zeros_like(x[0]) for _ in further]
    for effect, given in laws:
        here = str(effect.location)
        rows, i = (enters, inputs.index(here)) if here in inputs else (forces, further.index(here))
        by_drives = rows is forces and effect.of_load
        own = model.simulator.drive_forces(x, u, p)[i] if by_drives else u[i] if rows is enters else np.zeros_like(x[0])
        rows[i] = rows[i] + term_at(model, effect, given, t, x, u, own)
    beyond = any(effect.location not in inputs for effect, _ in laws)
    return np.stack(np.broadcast_arrays(*enters)) if enters else u, (np.stack(forces),) if beyond else ()


def acting_params(model: Augmented, t: Any, x: Any, u: Any, p: Mapping[str, Any]) -> dict[str, Any]:
    """Parameters with the effects on them."""
    acting = dict(p)
    for effect, given in paired(model.effects, model.values):
        if isinstance(effect, ParameterEffect):
            name = str(effect.location)
            driver = () if effect.variable is None else (_driver(model, effect, x, u),)
            acting[name] = effect.value(acting[name], t, values_of(effect, given), 0.0, *driver)
    return acting
