"""Steps of quantisation: which the data tell apart, and which look alike."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sksurrogate.effects._effect import BaseEffect
from sksurrogate.kernels.record import Record
from sksurrogate.physics._simulator import Plant

__all__ = ["alike", "told_apart"]

#: Steps more or fewer up to the mean level that are looked at.
MORE = 2


def rounded(plant: Plant, record: Record, effect: BaseEffect) -> np.ndarray:
    """The signal that a quantisation rounds, as it was recorded (n_values,)."""
    if effect.kind == "input":
        return record.u[plant.inputs.index(str(effect.location))]
    return record.measured(plant.outputs.index(str(effect.location)))


def told_apart(plant: Plant, record: Record, effect: BaseEffect, theta: Sequence[float] | np.ndarray) -> float:
    """How many steps round the data in different ways down to this one; 1 for other effects.

    While a step shrinks a value u passes from one multiple to the next u / c times.
    """
    if not len(theta) or not theta[0] or not effect.scan(tuple(theta)):
        return 1.0
    return max(1.0, float(np.sum(np.abs(rounded(plant, record, effect)))) / abs(float(theta[0])))


def alike(plant: Plant, record: Record, effect: BaseEffect, theta: Sequence[float]) -> list[tuple[float, ...]]:
    """Steps that round a signal far from 0 nearly alike: with one or two more of them, or fewer, up to its mean level.

    Parameters beyond the step, such as an onset, stay.
    """
    step, *others = (float(value) for value in theta)
    level = abs(float(np.mean(rounded(plant, record, effect))))
    if level <= MORE * abs(step):
        return []
    return [(step / (1.0 + k * step / level), *others) for k in range(-MORE, MORE + 1) if k]
