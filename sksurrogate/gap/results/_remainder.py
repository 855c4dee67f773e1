"""What is left of the gap beside everything that is named."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Remainder:
    """What is left of the gap beside everything that is named.

    Attributes
    ----------
    share : float
        RMS that is left on runs left out, over the RMS of the gap; the noise is not counted.
    deviation : float
        RMSE that is left on runs left out, each output divided by its standard deviation.
    over_noise : float
        RMS of the residual over the sensor noise (the worst output); 1 is noise alone.
    lawful : float
        RMS that a law without a name makes up beside what is named, over the RMS of the gap: a function of states and
        inputs, repeatable from run to run.
    lawful_spread : float
        Its standard deviation.
    probability : float
        That this law is larger than the tolerance.
    location, kind, variable : str or None
        Place and signal of the likeliest law; None where none was compared.
    """

    share: float = np.nan
    deviation: float = np.nan
    over_noise: float = np.nan
    lawful: float = np.nan
    lawful_spread: float = np.nan
    probability: float = np.nan
    location: str | None = None
    kind: str | None = None
    variable: str | None = None


#: Before anything was fitted.
NOTHING_KNOWN = Remainder()
