"""Signals that never move: they drive nothing that data could show."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from sksurrogate.effects._base_effect import BaseEffect
from sksurrogate.kernels.record import Record
from sksurrogate.physics._simulator import Plant


def still_signals(plant: Plant, record: Record) -> frozenset[str]:
    """Names of the inputs and of the measured outputs that have one value in the whole record."""
    inputs = [name for name, u in zip(plant.inputs, record.u) if np.ptp(u) == 0]
    outputs = [name for j, name in enumerate(plant.outputs) if np.ptp(record.measured(j)) == 0]
    return frozenset([*inputs, *(name for name in outputs if name not in plant.states)])


def driven_effects(effects: Sequence[BaseEffect], asked: Any, plant: Plant, record: Record) -> list[BaseEffect]:
    """The effects whose place and driving signals move.

    An exchange with a room whose temperature is one number is a loss and a constant, and the gain of a constant input is a
    constant: such candidates would share the probability of the names that they imitate. What a user gives as an instance stays.

    ``effects``: candidates.
    ``asked``: what the user asked for.
    """
    still = still_signals(plant, record)
    if not still:
        return list(effects)
    listed = [asked] if isinstance(asked, BaseEffect) else asked
    given = listed if isinstance(listed, Iterable) and not isinstance(listed, str) else ()
    own = {item.key for item in given if isinstance(item, BaseEffect) and item.location is not None}
    return [effect for effect in effects if effect.key in own or not still & set(_signals(effect))]


def _signals(effect: BaseEffect) -> list[str]:
    """Signals that an effect acts on or is driven by, states but for its place left out."""
    place = [str(effect.location)] if effect.kind == "input" else []
    return [*place, *effect.signals]
