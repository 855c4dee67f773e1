"""Whether the record fits the simulator in another unit: of time, of its readings, of readings and inputs, or of single columns."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sksurrogate.gap.fit._confused_units import OF_READINGS, in_words, may_differ_by
from sksurrogate.gap.fit._explained import (
    MORE_EXPLAINED,
    MOST_UNEXPLAINED,
    NOTHING_HELPS,
    OtherWriting,
    explained,
    nominal_run,
)
from sksurrogate.gap.fit._other_columns import FAR_OFF, divided, of_columns
from sksurrogate.kernels.record import Record
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._simulator import units_of

#: What people confuse: a second and its thousandths, its millionths, minutes, hours, days; minutes and days; hours and days.
UNITS_OF_TIME = (1000.0, 60.0, 3600.0, 1e6, 86400.0, 1440.0, 24.0)
FACTORS = (*UNITS_OF_TIME, *(1 / factor for factor in UNITS_OF_TIME))


def other_unit(model: PlantModel, record: Record) -> OtherWriting:
    """The unit in which the simulator alone explains the record, where it does not in its own.

    A simulator that says what its own ``timestep`` is was given ``dt`` in that unit, as a multiple of it. Only shorter sample
    times are tried with it: one that is 3600 times longer would take 3600 times as many of its steps.
    """
    own = max(explained(model, record), 0.0)
    if own > 1.0 - MORE_EXPLAINED:
        return NOTHING_HELPS
    return max(written(model, record, own) for written in (_of_time, _of_readings, of_columns))


def _of_time(model: PlantModel, record: Record, own: float) -> OtherWriting:
    """Share explained with the sample time in another unit, and the sentence."""
    steps = getattr(model.plant.simulator, "timestep", None) is not None
    tried = [factor for factor in FACTORS if factor < 1.0 or not steps]
    shares = {k: explained(model, _slower(record, k)) for k in tried}
    best = max(shares, key=lambda factor: shares[factor])
    if shares[best] < own + MORE_EXPLAINED:
        return NOTHING_HELPS
    if best < 1.0 and 1.0 - shares[best] > MORE_EXPLAINED * (1.0 - explained(model, _slower(record, 1.0 / FAR_OFF))):
        # what stands still at its first reading leaves nearly as little: runs differ in their starts
        return NOTHING_HELPS
    text = f"{best:g} times longer" if best > 1 else f"{1 / best:g} times shorter"
    return OtherWriting(
        shares[best],
        f"With a sample time {text} the simulator alone explains {100 * shares[best]:.0f} % of every output's variance, with "
        f"dt={record.dt:g} {100 * own:.0f} %: is the unit of time of dt that of the simulator's rates? Write dt={best * record.dt:g}.",
    )


def _of_readings(model: PlantModel, record: Record, own: float) -> OtherWriting:
    """The same with readings in other units, each in the likeliest one, or all of them and the inputs in the same."""
    plant, units = model.plant, units_of(model.plant.simulator)
    signals = (*plant.inputs, *plant.outputs)
    of_all = [k for k in OF_READINGS if all(may_differ_by(k, units.get(name, "")) for name in signals)]
    options = [(np.ones(len(record.u)), _likely_units(model, record)), *(_all_in(record, k) for k in of_all)]
    found = [explained(model, divided(record, *option)) for option in options]
    best = int(np.argmax(found))
    if found[best] < own + MORE_EXPLAINED:
        return NOTHING_HELPS
    if best > 0 and _any_further(model, record, of_all[best - 1], 1.0 - found[best]):
        return NOTHING_HELPS
    of_inputs, of_outputs = options[best]
    factors = np.concatenate([of_inputs, of_outputs])
    parts = [in_words(k, [n for n, f in zip(signals, factors) if f == k]) for k in dict.fromkeys(factors) if k != 1.0]
    return OtherWriting(
        found[best],
        f"With {' and '.join(parts)} the simulator alone explains {100 * found[best]:.0f} % of every output's variance, with "
        f"the record as it is {100 * own:.0f} %: are the units of the record those of the simulator? Convert these columns.",
    )


def _any_further(model: PlantModel, record: Record, factor: float, unexplained: float) -> bool:
    """Whether a unit of all signals does no better than any that is further off: motions may be so small that the simulator is
    linear, or so large that it stands at its limits."""
    far = divided(record, *_all_in(record, FAR_OFF if factor > 1 else 1 / FAR_OFF))
    as_well = 1.0 - explained(model, far) < 2.0 * unexplained
    return as_well and unexplained > MOST_UNEXPLAINED


def _likely_units(model: PlantModel, record: Record) -> np.ndarray:
    """For each output the factor, or 1, that comes nearest to its size over that of the simulator from its own start."""
    nominal = nominal_run(model, record, np.repeat(model.plant.x0[:, None], len(record.starts), axis=1))
    size = np.std(nominal, axis=1)
    if not np.isfinite(size).all() or not (size > 0).all():
        return np.ones(len(size))
    known, units = np.array([1.0, *OF_READINGS]), units_of(model.plant.simulator)
    off = np.abs(np.log(record.spread / size)[:, None] - np.log(known))
    may = [[may_differ_by(k, units.get(name, "")) for k in known] for name in model.plant.outputs]
    return known[np.argmin(np.where(may, off, np.inf), axis=1)]


def _all_in(record: Record, factor: float) -> tuple[np.ndarray, np.ndarray]:
    """One factor for every input, and for every output."""
    return np.full(len(record.u), factor), np.full(len(record.y), factor)


def _slower(record: Record, factor: float) -> Record:
    """The sample time in another unit."""
    return replace(record, t=factor * record.t, dt=factor * record.dt)
