"""How probable names are before any data: common effects before special ones, natural drivers before any other signal."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from sksurrogate.effects._effect import BaseEffect

__all__ = ["log_prior", "prior_weight"]

#: How many times less probable a law is that is driven by a signal other than those its form is known for.
FOREIGN = 10.0


def prior_weight(effect: BaseEffect, positions: Collection[str] = ()) -> float:
    """Prior odds of one effect against a common one with its natural driver.

    Parameters
    ----------
    effect : BaseEffect
    positions : collection of str
        States that are integrals of others.

    Returns
    -------
    float
        ``1 / rarity``, divided by :data:`FOREIGN` where the driver is not natural to the form.

    Examples
    --------
    >>> from sksurrogate.effects import CATALOGUE
    >>> drag = CATALOGUE["quadratic_drag"]
    >>> prior_weight(drag("speed", "speed")), prior_weight(drag("speed", "flow"))
    (1.0, 0.1)
    """
    natural, v = effect.natural_drivers, effect.variable
    fits = (
        effect.kind != "state"
        or v is None
        or "other" in natural
        or ("own" in natural and v == effect.location)
        or ("position" in natural and v in positions)
    )
    return 1.0 / (effect.rarity * (1.0 if fits else FOREIGN))


def log_prior(effects: Sequence[BaseEffect], library: Sequence[BaseEffect], positions: Collection[str] = ()) -> float:
    """Log prior probability of a set of names out of a library: the product of their shares of all weights."""
    total = sum(prior_weight(effect, positions) for effect in library)
    return float(sum(np.log(prior_weight(effect, positions) / total) for effect in effects))
