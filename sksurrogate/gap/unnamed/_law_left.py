"""A law without a name that is left of the gap: where it acts, how large it is, how certain."""

from __future__ import annotations

from dataclasses import dataclass

from sksurrogate.gap.unnamed._law_shapes import AND_ITS_PAST


@dataclass(frozen=True)
class LawLeft:
    """The likeliest law beside what is named, whichever simulator shows it."""

    location: str
    kind: str
    variable: str  #: Signals of the law
    #: size, spread: Mean and standard deviation of the RMS that it moves the outputs by, over the gap's
    size: float = 0.0
    spread: float = 0.0
    gain: float = 0.0  #: Twice the nats by which the data are likelier with the law than without; its choice is paid
    #: RMS that the law moves an output by over the deviation of that output, the largest; what is fitted beside it follows
    deviation: float = 0.0
    probability: float = 0.0  #: That the law is larger than the tolerance
    left: float = 1.0  #: RMS over the noise that names and law leave of the data, to first order

    @property
    def signal(self) -> str:
        """What the law is a function of: a signal, or two as a product, now or before."""
        return self.variable.removesuffix(AND_ITS_PAST)

    @property
    def signals(self) -> frozenset[str]:
        """Signals of the law, now or before.

        >>> sorted(LawLeft("level", "state", "level*pump").signals), LawLeft("level", "state", "level and its past").signals
        (['level', 'pump'], frozenset({'level'}))
        """
        return frozenset(self.signal.split("*"))
