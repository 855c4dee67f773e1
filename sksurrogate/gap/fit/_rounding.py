"""Readings on a grid: how finely the data tell its steps, and a grid that nothing named explains.

The error of a rounding looks like white noise to every likelihood; the grid, on which the free run does not stand, tells them apart.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sksurrogate.effects._base_effect import BaseEffect
from sksurrogate.effects._lattice import coherence, lattice_steps, lattice_window, shows_steps
from sksurrogate.gap.fit._backend import BaseCandidate
from sksurrogate.gap.fit._ode import OdeCandidate
from sksurrogate.kernels.record import Record, ages_of
from sksurrogate.kernels.smoother import resolution
from sksurrogate.physics._simulator import Plant

#: What rounds readings.
QUANTIZATION = "sensor_quantization"
#: What the error of a rounding, ``step^2 / 12``, may be of the residual's variance, either way; and how far the free run may
#: crowd at the grid as the readings do: a grid by the levels of an input is one of the free run too.
FACTOR, CROWDS = 2.0, 0.5

#: Share of a rounding (:func:`share_of_rounding`) from which on a grid of readings counts; a finer one is the resolution of a display.
GRID_SHARE = 0.01

GRID_NOTE = (
    "The readings of {name!r} stand on steps of {step:.3g}, and nothing named rounds them: "
    "the error of such a rounding looks like noise."
)


@dataclass(frozen=True)
class Rounding:
    """A grid of readings."""

    sensor: str
    step: float  #: Unit of the output
    share: float  #: Its error over the deviation of the output (:func:`share_of_rounding`)


def rounds_a_display(effect: BaseEffect, plant: Plant, record: Record) -> bool:
    """Whether an effect rounds readings that all stand on one fine grid, and on no coarse one: that of the display which gives them, no cause."""
    if effect.name != QUANTIZATION:
        return False
    output = plant.outputs.index(str(effect.location))
    y, part = record.measured(output), windowed_lattice(record, output)
    seen = [*lattice_steps(y), *([] if part is None else part[:1])]
    return 0.0 < share_of_rounding(resolution(y), y) < GRID_SHARE and not any(
        share_of_rounding(step, y) > GRID_SHARE for step in seen
    )


def windowed_lattice(record: Record, output: int) -> tuple[float, int, int] | None:
    """Of an output of a record what :func:`lattice_window` finds: a step, and the ages of the runs between which readings show it."""
    ages = ages_of(record.starts, record.n_samples)
    return lattice_window(record.measured(output), ages[record.rows_of(output)])


def share_of_rounding(step: float, y: np.ndarray) -> float:
    """Deviation of an error that is even over one step, ``step / sqrt(12)``, over that of readings (n_values,)."""
    return step / 12**0.5 / max(float(np.std(y)), 1e-300)


def names_steps(candidate: BaseCandidate) -> bool:
    """Whether an effect of a candidate is a rounding whose steps the readings show."""
    plant, record = candidate.problem.plant, candidate.problem.record
    return any(
        effect.name == QUANTIZATION
        and bool(shows_steps(rounded_signal(plant, record, effect), candidate.theta_of(i)[0])[0])
        for i, effect in enumerate(candidate.effects)
    )


def unnamed_rounding(candidate: OdeCandidate) -> Rounding | None:
    """The coarsest grid that rounds the free run of a candidate to the readings, where nothing named does; None without one."""
    rounded = {effect.location for effect in candidate.effects if effect.name == QUANTIZATION}
    record = candidate.problem.record
    found = [
        Rounding(name, step, share_of_rounding(step, record.measured(j)))
        for j, name in enumerate(candidate.problem.plant.outputs)
        if name not in rounded
        for step in lattice_steps(record.measured(j))
        if shows_steps(record.measured(j), step)[0]
        and is_rounded(record.measured(j), candidate.fit.y[j, record.rows_of(j)], step)
    ]
    return max(found, key=lambda one: one.share, default=None)


def is_rounded(y: np.ndarray, fitted: np.ndarray, step: float) -> bool:
    """Whether a free run misses the rounding of readings that crowd at the multiples of a step: it does not crowd there, and
    what it leaves is as large as the error of a rounding.

    >>> import numpy as np
    >>> true = np.linspace(0.0, 9.0, 500)
    >>> is_rounded(np.round(true), true, 1.0), is_rounded(np.round(true), np.round(true) + 0.1, 1.0)
    (True, False)
    """
    error, left = step**2 / 12.0, float(np.var(y - fitted))
    steps = np.array([step])
    crowds = coherence(fitted, steps)[0] > CROWDS * coherence(y, steps)[0]
    return bool(left / FACTOR < error < FACTOR * left and not crowds)


#: Steps more or fewer up to the mean level that are looked at.
MORE = 2


def rounded_signal(plant: Plant, record: Record, effect: BaseEffect) -> np.ndarray:
    """The signal that a quantisation rounds, as it was recorded (n_values,)."""
    if effect.kind == "input":
        return record.u[plant.inputs.index(str(effect.location))]
    return record.measured(plant.outputs.index(str(effect.location)))


def distinct_steps(plant: Plant, record: Record, effect: BaseEffect, theta: Sequence[float] | np.ndarray) -> float:
    """How many steps round the data in different ways down to this one; 1 for other effects.

    While a step shrinks a value u passes from one multiple to the next u / c times.
    """
    if not len(theta) or not theta[0] or not effect.scan(tuple(theta)):
        return 1.0
    return max(1.0, float(np.sum(np.abs(rounded_signal(plant, record, effect)))) / abs(float(theta[0])))


def alike(plant: Plant, record: Record, effect: BaseEffect, theta: Sequence[float]) -> list[tuple[float, ...]]:
    """Steps that round a signal far from 0 nearly alike: with one or two more of them, or fewer, up to its mean level.

    Parameters beyond the step, such as an onset, stay.
    """
    step, *others = (float(value) for value in theta)
    level = abs(float(np.mean(rounded_signal(plant, record, effect))))
    if level <= MORE * abs(step):
        return []
    return [(step / (1.0 + k * step / level), *others) for k in range(-MORE, MORE + 1) if k]
