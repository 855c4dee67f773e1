"""Whether the record fits the simulator in another unit of time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sksurrogate.effects._model import AugmentedModel
from sksurrogate.kernels.output_error import free_run
from sksurrogate.kernels.record import Record
from sksurrogate.physics._model import PlantModel

#: What people confuse: milliseconds, seconds, minutes, hours.
FACTORS = (1000.0, 60.0, 3600.0, 1 / 1000.0, 1 / 60.0, 1 / 3600.0)
#: In the right unit the simulator alone explains at least this share of the outputs' variance more: half of what there is.
MORE_EXPLAINED = 0.5
#: Steps of the integrator in a sample, enough where a sample resolves the plant.
SUBSTEPS_OF_A_LOOK = 8


def other_unit_of_time(model: PlantModel, record: Record) -> str:
    """A sentence where the simulator alone explains the record with a sample time in another unit, and not with its own.

    A simulator that says what its own ``timestep`` is was given ``dt`` in that unit, as a multiple of it. Only shorter sample
    times are tried with it: one that is 3600 times longer would take 3600 times as many of its steps.

    Returns
    -------
    str
        Empty where it does not.
    """
    own = max(_explained(model, record, 1.0), 0.0)
    if own > 1.0 - MORE_EXPLAINED:
        return ""
    steps = getattr(model.plant.simulator, "timestep", None) is not None
    tried = [factor for factor in FACTORS if factor < 1.0 or not steps]
    shares = {factor: _explained(model, record, factor) for factor in tried}
    best = max(shares, key=lambda factor: shares[factor])
    if shares[best] < own + MORE_EXPLAINED:
        return ""
    text = f"{best:g} times longer" if best > 1 else f"{1 / best:g} times shorter"
    return (
        f"With a sample time {text} the simulator alone explains {100 * shares[best]:.0f} % of the outputs' variance, with "
        f"dt={record.dt:g} {100 * own:.0f} %: is the unit of time of dt that of the simulator's rates? Write dt={best * record.dt:g}."
    )


def _explained(model: PlantModel, record: Record, factor: float) -> float:
    """Share of the variance of the outputs that the free run explains, time running by a factor faster; -inf without a run."""
    plant = model.plant
    other = replace(record, t=factor * record.t, dt=factor * record.dt)
    start = np.repeat(plant.x0[:, None], len(record.starts), axis=1)
    for j, i in enumerate(plant.output_states or ()):
        start[i] = record.y[j, record.starts]
    nominal = AugmentedModel(model, (), (), other, n_sub=SUBSTEPS_OF_A_LOOK, scale=np.ones(len(plant.states)))
    with np.errstate(all="ignore"):
        x = free_run(nominal, np.zeros(0), start)
        left = record.residual(nominal.bind(np.zeros((0, 1))).outputs(x[:, None])[:, 0])
        left = left - left.mean(axis=1, keepdims=True)
        share = 1.0 - np.mean(left**2, axis=1) / record.spread**2
    return float(np.mean(share)) if np.isfinite(share).all() else -np.inf
