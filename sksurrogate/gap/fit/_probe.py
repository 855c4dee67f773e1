"""What an effect sees of a trajectory: its variable, the place where it acts, the noise there."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np

from sksurrogate.effects._base_effect import BaseEffect
from sksurrogate.effects._parts import Probe
from sksurrogate.effects._ports import at_port
from sksurrogate.effects._structure import mean_gains
from sksurrogate.effects._variable import value_of
from sksurrogate.effects._wires import beside

#: Of a kind of place and its name the signal there and the slope of the log likelihood in it, each (n_samples,); None where none is
#: known.
SlopesOf: TypeAlias = Callable[[str, str], tuple[np.ndarray, np.ndarray] | None]


def probe_of(
    problem: Any, effect: BaseEffect, x: np.ndarray, rates: np.ndarray, slopes: SlopesOf | None = None
) -> Probe:
    """What an effect sees of a trajectory (n_states, n_samples); of one without states its inputs and readings."""
    plant, record = problem.plant, problem.record

    def signal(name: str) -> np.ndarray:
        if name in plant.states and effect.kind in ("state", "parameter"):
            return x[plant.states.index(name)]
        if name in plant.inputs:
            return record.u[plant.inputs.index(name)]
        return record.measured(plant.outputs.index(name))

    v: np.ndarray | None = None
    factors: tuple[np.ndarray, ...] = ()
    if effect.variable:
        factors = tuple(signal(name) for name in effect.signals)
        v = value_of(effect.variable, factors)
    where, rate, feedback, gain = np.zeros(record.n_samples), 0.0, None, None
    if at_port(effect, plant):
        model, port = problem.augmented((effect,)), plant.ports.index(str(effect.location))
        rate, feedback = problem.port_rate(str(effect.location)), model.wires[0].feedback
        where = beside(model.model, effect, port, x, record.u)
    elif effect.kind == "state":
        place = plant.states.index(str(effect.location))
        where, rate = x[place], float(rates[place])
        if effect.variable in plant.inputs:
            gain = float(mean_gains(problem.model)[place, plant.ports.index(effect.variable)])
    elif effect.kind in ("input", "output"):
        where = signal(str(effect.location))
        v = where if v is None else v
    duration = record.dt * int(record.lengths.max())
    noise = float(problem.sd[plant.outputs.index(str(effect.location))]) if effect.kind == "output" else 0.0
    slope = None if slopes is None else slopes(effect.kind, str(effect.location))
    pair = factors if len(factors) == 2 else ()
    return Probe(v, where, rate, record.dt, duration, record.starts, pair, noise, slope, feedback, gain)
