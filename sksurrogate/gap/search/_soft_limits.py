"""How actuators bend at their limits: from a corner to ``tanh``. No amplifier, valve or pump has a corner where it is full, or opens."""

from __future__ import annotations

from functools import partial

from sksurrogate.effects._input import LimitedActuator
from sksurrogate.gap.fit._closeness import is_at_noise
from sksurrogate.gap.fit._evidence import C
from sksurrogate.gap.search._softer import in_form, softer, worth

#: One over a corner that is one to the data, and over softer and softer ones.
HARD, SOFTER = 50.0, (20.0, 8.0, 3.2, 1.6, 1.0)
#: One of these that is asked of every limit; where it leaves less than this share (squares), the limit is soft.
ASKED_FIRST, MUCH_NEARER = 3.2, 0.5


def soft_where_nearer(candidate: C) -> C:
    """A set whose last effect is a limit with a corner, or with a soft one where that leaves far less.

    A limit that bends is far from the data as a corner, and would not be chosen. Not asked at the noise.
    """
    last = len(candidate.effects) - 1
    if last not in _corners(candidate) or is_at_noise(candidate.fit.cost, candidate.problem.record.n_values):
        return candidate
    soft = with_corner(candidate, ASKED_FIRST, last)
    if soft is None or soft.fit.cost > MUCH_NEARER * candidate.fit.cost:
        return candidate
    return softer({HARD: candidate, ASKED_FIRST: soft}, SOFTER, partial(with_corner, i=last))


def with_soft_limits(candidate: C, price: float) -> C:
    """A set with the corner of each limit fitted, where that gains more than a ``price`` (twice the log likelihood); else as it is."""
    for i in _corners(candidate):
        candidate = worth(price, candidate, softer({HARD: candidate}, SOFTER, partial(with_corner, i=i)))
    return candidate


def with_corner(candidate: C, sharpness: float, i: int) -> C | None:
    """A set fitted with limit i that has a corner of one over a sharpness; None where it breaks the arithmetic."""
    return in_form(candidate, i, corner=1.0 / sharpness)


def _corners(candidate: C) -> list[int]:
    """Positions of the limits that are corners."""
    return [
        i for i, effect in enumerate(candidate.effects) if isinstance(effect, LimitedActuator) and not effect.corner
    ]
