"""Units that people confuse: by how much, and for which columns of a record."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np


class Confusion(NamedTuple):
    """Two units of one quantity."""

    factor: float  #: Numbers in the smaller unit over those in the larger one
    smaller: str = ""
    larger: str = ""
    units: re.Pattern[str] | None = None  #: Units of the simulator in which it may happen; None: in any
    only_there: bool = False  #: Whether the unit must be known


DEGREES = 180.0 / np.pi
#: In the order in which they are tried.
CONFUSED = (
    Confusion(DEGREES, "degrees", "radians", re.compile(r"\b(rad|deg|radians?|degrees?)\b|°(?![CFK])")),
    Confusion(1000.0),
    Confusion(100.0),
    Confusion(
        60.0 / (2 * np.pi), "revolutions per minute", "radians per second", re.compile(r"^(rad/s|rpm|1/min)$"), True
    ),
    Confusion(1e5, "pascal", "bar", re.compile(r"^(Pa|bar|N/m\^?2)$"), True),
)
#: How much larger the numbers of a column may be than the simulator's.
OF_READINGS = (*(one.factor for one in CONFUSED), *(1 / one.factor for one in CONFUSED))


def _of(factor: float) -> Confusion:
    """The confusion that a factor, or its inverse, stands for; 1 for none."""
    return next((one for one in CONFUSED if factor in (one.factor, 1 / one.factor)), Confusion(1.0))


def may_differ_by(factor: float, unit: str) -> bool:
    """Whether a column in this unit of the simulator may be written in one so much smaller; "" where the unit is not known.

    >>> may_differ_by(DEGREES, "ppm"), may_differ_by(DEGREES, "rad/s"), may_differ_by(DEGREES, ""), may_differ_by(1000.0, "ppm")
    (False, True, True, True)
    >>> may_differ_by(1e5, "bar"), may_differ_by(1e5, "")
    (True, False)
    """
    pair = _of(factor)
    return pair.units is None or (bool(pair.units.search(unit)) if unit else not pair.only_there)


def in_words(factor: float, names: Sequence[str]) -> str:
    """What is done to some columns whose numbers are so much larger than the simulator's.

    >>> in_words(DEGREES, ["angle"]), in_words(1e-5, ["p1", "p2"]), in_words(0.01, ["level"])
    ('angle taken from degrees to radians', 'p1, p2 taken from bar to pascal', 'level times 100')
    """
    pair, what = _of(factor), ", ".join(names)
    if pair.smaller:
        units = (pair.smaller, pair.larger) if factor > 1 else (pair.larger, pair.smaller)
        return f"{what} taken from {units[0]} to {units[1]}"
    return f"{what} divided by {factor:g}" if factor > 1 else f"{what} times {1 / factor:g}"
