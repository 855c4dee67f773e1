"""What a reader should know of kinks whose width was fitted."""

from __future__ import annotations

import numpy as np

from sksurrogate.effects._effect import BalanceEffect, BaseEffect, HiddenEffect
from sksurrogate.gap.decide._experiment import name_of
from sksurrogate.gap.fit._ode import OdeCandidate

NOTE = "The kink of {name} is round: it turns over about {width:.3g} of {variable} to each side, as fitted."


def notes_on_kinks(candidate: OdeCandidate) -> list[str]:
    """Over how much of their variables the named laws turn, where that was fitted."""
    if not candidate.problem.numerics.rounded:
        return []
    widths = candidate.model.bind(candidate.fit.theta[:, None]).widths
    return [
        NOTE.format(name=name_of(effect), width=width, variable=effect.variable)
        for i, (effect, width) in enumerate(zip(candidate.effects, widths))
        if has_kink(effect, candidate.theta_of(i), width)
    ]


def has_kink(effect: BaseEffect, theta: np.ndarray, width: float) -> bool:
    """Whether a law without states of its own changes within a width of a signal with that width.

    >>> from sksurrogate.effects import CATALOGUE
    >>> has_kink(CATALOGUE["coulomb_friction"]("v", "v"), np.array([1.0]), 0.1)
    True
    >>> has_kink(CATALOGUE["linear_loss"]("v", "v"), np.array([1.0]), 0.1)
    False
    """
    if not isinstance(effect, BalanceEffect) or isinstance(effect, HiddenEffect) or "*" in str(effect.variable):
        return False
    v = width * np.linspace(-1.0, 1.0, 9)
    wide, narrow = (effect.term(np.zeros(9), v, v, list(theta), one) for one in (width, 0.5 * width))
    return not np.allclose(wide, narrow)
