"""What to measure or excite next."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from sksurrogate.gap.results._table import EMPTY, Table

#: Difference of log likelihoods (natural logarithm) that settles between two candidates: odds of twenty.
NATS_THAT_SETTLE = 3.0
ENOUGH = f"{NATS_THAT_SETTLE:g} is enough: odds of 20 to 1"
#: Tied candidates that a line of text lists.
TIED_LISTED = 4


def first_of(names: Sequence[str]) -> str:
    """The first names of a list, and how many more there are.

    >>> first_of(["drag", "friction", "hysteresis", "lag", "bias", "gain"])
    'drag; friction; hysteresis; lag; and 2 more'
    """
    more = len(names) - TIED_LISTED
    return "; ".join([*names[:TIED_LISTED], *([f"and {more} more"] if more > 0 else [])])


@dataclass(frozen=True)
class NextExperiment:
    """What to measure or excite next.

    Attributes
    ----------
    sentence : str
    options : Table
        experiment, gain (expected log-likelihood difference of the tied candidates), between, within (whether its inputs stay where
        inputs were recorded).
    named : str
        The effect whose candidates it is about.
    parted : tuple of str
        Candidates from which the first option parts it.
    """

    sentence: str
    options: Table = EMPTY
    named: str = ""
    parted: tuple[str, ...] = ()
