"""Whether the record fits the simulator in another unit: of time, of its readings, of readings and inputs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sksurrogate.effects._model import AugmentedModel
from sksurrogate.kernels.output_error import free_run
from sksurrogate.kernels.record import Record
from sksurrogate.physics._model import PlantModel

#: What people confuse: a second and its thousandths, its millionths, minutes, hours, days; minutes and days; hours and days.
UNITS_OF_TIME = (1000.0, 60.0, 3600.0, 1e6, 86400.0, 1440.0, 24.0)
FACTORS = (*UNITS_OF_TIME, *(1 / factor for factor in UNITS_OF_TIME))
#: And in readings: degrees and radians, thousandths, hundredths; how much larger the numbers are than the simulator's.
DEGREES = 180.0 / np.pi
OF_READINGS = (DEGREES, 1000.0, 100.0, 1 / DEGREES, 1 / 1000.0, 1 / 100.0)
#: In the right unit the simulator alone explains at least this share of every output's variance more: half of what there is.
MORE_EXPLAINED = 0.5
#: Time, or all signals, in units so much further off: there the simulator stands still, is linear, or at its limits.
FAR_OFF = 1e9
#: Share of the variance that a unit of all signals may leave, where one far off leaves less than twice as much.
MOST_UNEXPLAINED = 0.05
#: Steps of the integrator in a sample, enough where a sample resolves the plant.
SUBSTEPS_OF_A_LOOK = 8


def other_unit(model: PlantModel, record: Record) -> str:
    """A sentence where the simulator alone explains the record in another unit, and not in its own; empty where it does not.

    A simulator that says what its own ``timestep`` is was given ``dt`` in that unit, as a multiple of it. Only shorter sample
    times are tried with it: one that is 3600 times longer would take 3600 times as many of its steps.
    """
    own = max(_explained(model, record), 0.0)
    if own > 1.0 - MORE_EXPLAINED:
        return ""
    return _of_time(model, record, own) or _of_readings(model, record, own)


def _of_time(model: PlantModel, record: Record, own: float) -> str:
    """The sample time in another unit."""
    steps = getattr(model.plant.simulator, "timestep", None) is not None
    tried = [factor for factor in FACTORS if factor < 1.0 or not steps]
    shares = {k: _explained(model, _slower(record, k)) for k in tried}
    best = max(shares, key=lambda factor: shares[factor])
    if shares[best] < own + MORE_EXPLAINED:
        return ""
    if best < 1.0 and 1.0 - shares[best] > MORE_EXPLAINED * (1.0 - _explained(model, _slower(record, 1.0 / FAR_OFF))):
        return ""  # what stands still at its first reading leaves nearly as little: runs differ in their starts
    text = f"{best:g} times longer" if best > 1 else f"{1 / best:g} times shorter"
    return (
        f"With a sample time {text} the simulator alone explains {100 * shares[best]:.0f} % of every output's variance, with "
        f"dt={record.dt:g} {100 * own:.0f} %: is the unit of time of dt that of the simulator's rates? Write dt={best * record.dt:g}."
    )


def _of_readings(model: PlantModel, record: Record, own: float) -> str:
    """Readings in other units, each in the likeliest one, or all of them and the inputs in the same."""
    options = [(np.ones(len(record.u)), _likely_units(model, record)), *(_all_in(record, k) for k in OF_READINGS)]
    found = [_explained(model, _divided(record, *option)) for option in options]
    best = int(np.argmax(found))
    if found[best] < own + MORE_EXPLAINED:
        return ""
    if best > 0 and _any_further(model, record, OF_READINGS[best - 1], 1.0 - found[best]):
        return ""
    plant, (of_inputs, of_outputs) = model.plant, options[best]
    names, factors = (*plant.inputs, *plant.outputs), np.concatenate([of_inputs, of_outputs])
    parts = [_in_words(k, [n for n, f in zip(names, factors) if f == k]) for k in dict.fromkeys(factors) if k != 1.0]
    return (
        f"With {' and '.join(parts)} the simulator alone explains {100 * found[best]:.0f} % of every output's variance, with "
        f"the record as it is {100 * own:.0f} %: are the units of the record those of the simulator? Convert these columns."
    )


def _any_further(model: PlantModel, record: Record, factor: float, unexplained: float) -> bool:
    """Whether a unit of all signals does no better than any that is further off: motions may be so small that the simulator is
    linear, or so large that it stands at its limits."""
    far = _divided(record, *_all_in(record, FAR_OFF if factor > 1 else 1 / FAR_OFF))
    as_well = 1.0 - _explained(model, far) < 2.0 * unexplained
    return as_well and unexplained > MOST_UNEXPLAINED


def _likely_units(model: PlantModel, record: Record) -> np.ndarray:
    """For each output the factor, or 1, that comes nearest to its size over that of the simulator from its own start."""
    nominal = _run(model, record, np.repeat(model.plant.x0[:, None], len(record.starts), axis=1))
    size = np.std(nominal, axis=1)
    if not np.isfinite(size).all() or not (size > 0).all():
        return np.ones(len(size))
    known = np.array([1.0, *OF_READINGS])
    return known[np.argmin(np.abs(np.log(record.spread / size)[:, None] - np.log(known)), axis=1)]


def _all_in(record: Record, factor: float) -> tuple[np.ndarray, np.ndarray]:
    """One factor for every input, and for every output."""
    return np.full(len(record.u), factor), np.full(len(record.y), factor)


def _slower(record: Record, factor: float) -> Record:
    """The sample time in another unit."""
    return replace(record, t=factor * record.t, dt=factor * record.dt)


def _divided(record: Record, inputs: np.ndarray, outputs: np.ndarray) -> Record:
    """Signals in other units."""
    return replace(record.with_inputs(record.u / inputs[:, None]), y=record.y / outputs[:, None])


def _in_words(factor: float, names: Sequence[str]) -> str:
    """What is done to some columns."""
    what = ", ".join(names)
    if factor in (DEGREES, 1 / DEGREES):
        units = ("degrees", "radians") if factor > 1 else ("radians", "degrees")
        return f"{what} taken from {units[0]} to {units[1]}"
    return f"{what} divided by {factor:g}" if factor > 1 else f"{what} times {1 / factor:g}"


def _explained(model: PlantModel, record: Record) -> float:
    """Share of the variance of each output that the free run explains at least; -inf without a run."""
    start = np.repeat(model.plant.x0[:, None], len(record.starts), axis=1)
    for j, i in enumerate(model.plant.output_states or ()):
        start[i] = record.y[j, record.starts]
    left = record.residual(_run(model, record, start))
    left = left - left.mean(axis=1, keepdims=True)
    with np.errstate(all="ignore"):  # in a unit far off the run may leave the numbers
        share = 1.0 - np.mean(left**2, axis=1) / record.spread**2
    return float(np.min(share)) if np.isfinite(share).all() else -np.inf


def _run(model: PlantModel, record: Record, start: np.ndarray) -> np.ndarray:
    """Outputs (n_outputs, n_samples) of the free run."""
    nominal = AugmentedModel(model, (), (), record, n_sub=SUBSTEPS_OF_A_LOOK, scale=np.ones(len(model.plant.states)))
    with np.errstate(all="ignore"):
        x = free_run(nominal, np.zeros(0), start)
        return nominal.bind(np.zeros((0, 1))).outputs(x[:, None])[:, 0]
