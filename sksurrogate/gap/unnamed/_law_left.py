"""A law without a name that is left of the gap: where it acts, how large it is, how certain."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class LawLeft:
    """The likeliest law beside what is named, whichever simulator shows it.

    Attributes
    ----------
    location, kind, variable : str
        Place and signals of the law.
    size, spread : float
        Mean and standard deviation of the RMS that it moves the outputs by, over the gap's.
    gain : float
        Twice the nats by which the data are likelier with the law than without; its choice is paid.
    deviation : float
        RMS that the law moves an output by over the deviation of that output, the largest; what is fitted beside it follows.
    probability : float
        That the law is larger than the tolerance.
    left : float
        RMS over the noise that names and law leave of the data, to first order.
    """

    location: str
    kind: str
    variable: str
    size: float = 0.0
    spread: float = 0.0
    gain: float = 0.0
    deviation: float = 0.0
    probability: float = 0.0
    left: float = 1.0
