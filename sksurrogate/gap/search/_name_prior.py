"""How probable a set of names is before any data."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from sksurrogate.effects._effect import BaseEffect


def log_prior(effects: Sequence[BaseEffect], library: Sequence[BaseEffect], positions: Collection[str] = ()) -> float:
    """Log prior probability of a set of names out of a library: the product of their shares of all weights.

    ``positions``: states that are integrals of others.

    >>> from sksurrogate.effects import CATALOGUE
    >>> friction, hysteresis = (CATALOGUE[name]("speed", "speed") for name in ("coulomb_friction", "hysteresis"))
    >>> round(float(np.exp(log_prior([hysteresis], [friction, hysteresis]))), 3)  # 0.1 against 1
    0.091
    """
    total = sum(effect.prior_weight(positions) for effect in library)
    return float(sum(np.log(effect.prior_weight(positions) / total) for effect in effects))
