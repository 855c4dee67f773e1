"""A set with a softer and softer kink: the one that comes nearest to the data.

A softness is one more parameter of a set. It is fitted by itself, since the others follow it in a few steps: softer and softer as long
as that leads nearer to the data, then by parabolas.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from sklearn.base import clone

from sksurrogate.gap.fit._closeness import is_at_noise
from sksurrogate.gap.fit._evidence import C, gain_by_size
from sksurrogate.gap.search._restart import WORTH_A_FIT

#: Values between those that are given which are fitted.
MOST_BETWEEN = 5
#: The factor between two values that are tried.
TIMES_APART = 3.0


def softer(tried: dict[float, C], further: Sequence[float], at: Callable[[C, float], C | None]) -> C:
    """The set of the sharpness that leads nearest to the data.

    First those that are ``further``, up to the one that leaves more; one in between where even the first does; then by parabolas.

    ``tried``: by sharpness; the sharpest is the set as it is.
    ``further``: sharpnesses, softer and softer.
    ``at``: a set fitted with a sharpness.
    """
    own = max(tried)
    candidate = tried[own]
    for sharpness in further:
        nearest = min((one for s, one in tried.items() if s > sharpness), key=lambda one: one.fit.cost)
        if sharpness not in tried:
            tried[sharpness] = at(nearest, sharpness) or candidate
        if tried[sharpness].fit.cost > nearest.fit.cost:
            break
    if _nearest(tried) is candidate:
        between = float(np.sqrt(own * further[0]))
        tried[between] = at(candidate, between) or candidate
    for _ in range(MOST_BETWEEN):
        nearest, sharpness = _nearest(tried), lowest({s: one.fit.cost for s, one in tried.items()})
        if nearest is candidate or sharpness in tried:
            break
        tried[sharpness] = at(nearest, sharpness) or candidate
        if tried[sharpness].fit.cost > nearest.fit.cost - WORTH_A_FIT:
            break
    return _nearest(tried)


def nearest_by_parabolas(
    tried: dict[float, C],
    first: float,
    at: Callable[[float], C | None],
    apart: float = TIMES_APART,
    most: float = np.inf,
) -> C:
    """The set whose number in its shape, a positive one, comes nearest to the data: beside those that are tried, then by parabolas.

    ``tried``: by this number; ``first``: the number that is asked first; ``apart``: the factor to the next; ``most``: the largest.
    ``at``: a set fitted with a number; None where it breaks the arithmetic.
    """
    number = first
    for _ in range(MOST_BETWEEN):
        found = at(number)
        if found is None:
            break
        before, tried[number] = min(one.fit.cost for one in tried.values()), found
        costs = {s: one.fit.cost for s, one in tried.items()}
        number = lowest(costs)
        if number in tried:  # at an end: further that way
            number *= apart if number == max(tried) else 1.0 / apart
            if number > most or min(costs.values()) == found.fit.cost > before - WORTH_A_FIT:
                break
    return _nearest(tried)


def in_form(candidate: C, i: int, theta: np.ndarray | None = None, **numbers: float) -> C | None:
    """A set fitted with other numbers in the shape of effect i, as a corner; None where it breaks the arithmetic.

    ``theta``: values from which it is fitted; where it stands by default.
    """
    other = clone(candidate.effects[i]).set_params(**numbers)
    try:
        return candidate.fitted_as((*candidate.effects[:i], other, *candidate.effects[i + 1 :]), theta)
    except (ArithmeticError, np.linalg.LinAlgError):
        return None


def at_noise(candidate: C) -> bool:
    """Whether a set is at the noise by its cost: its shape is not asked further."""
    return is_at_noise(candidate.fit.cost, candidate.problem.record.n_values)


def worth(price: float, candidate: C, other: C) -> C:
    """A softer set where it gains more than a price (twice the log likelihood), else the set as it was."""
    gain = 2.0 * gain_by_size(candidate.problem.record.n_values, candidate.fit.cost / other.fit.cost)
    return other if gain > price else candidate


def _nearest(tried: Mapping[float, C]) -> C:
    """The one that leaves least."""
    return min(tried.values(), key=lambda one: one.fit.cost)


def lowest(costs: Mapping[float, float]) -> float:
    """Where the parabola through the least of some costs and those beside it is lowest, both logarithms; at an end the end itself.

    A cost of nothing is at its own place.

    >>> round(lowest({s: np.exp(np.log(s / 3.0) ** 2) for s in (2.0, 4.0, 8.0)}), 9), lowest({2.0: 1.0, 4.0: 0.0, 8.0: 1.0})
    (3.0, 4.0)
    """
    at = sorted(costs)
    k = min(range(len(at)), key=lambda k: costs[at[k]])
    if not 0 < k < len(at) - 1 or costs[at[k]] <= 0.0:
        return at[k]
    z, c = np.log(at[k - 1 : k + 2]), np.log([costs[one] for one in at[k - 1 : k + 2]])
    before, after = (c[1] - c[0]) / (z[1] - z[0]), (c[2] - c[1]) / (z[2] - z[1])
    bent = (after - before) / (z[2] - z[0])
    return float(np.exp(0.5 * (z[0] + z[1] - before / bent))) if bent > 0 else at[k]
