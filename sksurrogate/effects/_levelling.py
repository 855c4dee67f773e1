"""A change that goes on in proportion to time, or that levels off, as what warms up does."""

from __future__ import annotations

from typing import Any

import numpy as np
from sklearn.base import clone

from sksurrogate.effects._base_effect import BaseEffect

#: Time constant that is asked first, as a share of the longest run.
LEVELLING_TIME = 0.2


class Levelling(BaseEffect):
    """A drift: its magnitude is the rate at the start of a run.

    Parameters
    ----------
    location : str, optional
        Where it enters, as in :class:`BaseEffect`.
    variable : str, optional
        None: time drives it.
    levelling : float, default=0.0
        One over the time constant with which it levels off: ``c t`` becomes ``c (1 - exp(-levelling t)) / levelling``. 0: it goes on.
    """

    def __init__(self, location: str | None = None, variable: str | None = None, levelling: float = 0.0):
        super().__init__(location, variable)
        self.levelling = levelling

    def elapsed(self, t: Any) -> Any:
        """What the rate is multiplied by at a time: the time, or less where the drift levels off."""
        return t if self.levelling == 0.0 else (1.0 - np.exp(-self.levelling * t)) / self.levelling


def levelled(effect: BaseEffect, duration: float) -> BaseEffect | None:
    """A drift that levels off within runs of a duration; None for other effects."""
    if not isinstance(effect, Levelling) or effect.levelling or duration <= 0.0:
        return None
    return clone(effect).set_params(levelling=1.0 / (LEVELLING_TIME * duration))
