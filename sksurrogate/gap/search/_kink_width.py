"""The width of a kink: friction that turns round, a valve that opens, an orifice near rest are no corners on a real plant.

The width is one more parameter of a set. It is fitted by itself, since the others follow it in a few steps: wider and wider as long
as that leads nearer to the data, then by parabolas.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from sksurrogate.gap.fit._evidence import gain_by_size
from sksurrogate.gap.fit._ode import Numerics, OdeCandidate
from sksurrogate.gap.search._restart import WORTH_A_FIT

#: Sharpness (size of a variable over the width of its kinks) of wider kinks, one after the other. Wider than a third of the size a
#: friction is no longer told from a loss that is proportional to the speed.
WIDER = (25.0, 12.5, 6.25, 3.125)
#: Widths between these that are fitted.
MOST_BETWEEN = 5


def rounded(candidate: OdeCandidate, price: float) -> OdeCandidate:
    """A set with the width of its kinks fitted, where that gains more than a ``price`` (twice the log likelihood); else as it is."""
    if candidate.problem.numerics.rounded or not may_be_rounded(candidate):
        return candidate
    tried = _widths_around(candidate)
    for _ in range(MOST_BETWEEN):
        nearest, sharpness = _nearest(tried), lowest({s: one.fit.cost for s, one in tried.items()})
        if nearest is candidate or sharpness in tried:
            break
        tried[sharpness] = with_width(nearest, sharpness) or candidate
        if tried[sharpness].fit.cost > nearest.fit.cost - WORTH_A_FIT:
            break
    best = _nearest(tried)
    gain = 2.0 * gain_by_size(candidate.problem.record.n_values, candidate.fit.cost / best.fit.cost)
    return best if gain > price else candidate


def _widths_around(candidate: OdeCandidate) -> dict[float, OdeCandidate]:
    """A set by its sharpness: as it is, and with wider kinks up to the first that leave more; if all do, with some in between."""
    own = candidate.problem.numerics.sharpness
    tried = {own: candidate}
    for sharpness in WIDER:
        nearest = _nearest(tried)
        tried[sharpness] = with_width(nearest, sharpness) or candidate
        if tried[sharpness].fit.cost > nearest.fit.cost:
            break
    if _nearest(tried) is candidate:
        between = float(np.sqrt(own * WIDER[0]))
        tried[between] = with_width(candidate, between) or candidate
    return tried


def _nearest(tried: Mapping[float, OdeCandidate]) -> OdeCandidate:
    """The one that leaves least."""
    return min(tried.values(), key=lambda one: one.fit.cost)


def lowest(costs: Mapping[float, float]) -> float:
    """Where the parabola through the least of some costs and those beside it is lowest, over the logarithm; at an end the end itself.

    >>> round(lowest({2.0: np.log(2.0 / 3.0) ** 2, 4.0: np.log(4.0 / 3.0) ** 2, 8.0: np.log(8.0 / 3.0) ** 2}), 9)
    3.0
    """
    at = sorted(costs)
    k = min(range(len(at)), key=lambda k: costs[at[k]])
    if not 0 < k < len(at) - 1:
        return at[k]
    z, c = np.log(at[k - 1 : k + 2]), np.array([costs[one] for one in at[k - 1 : k + 2]])
    before, after = (c[1] - c[0]) / (z[1] - z[0]), (c[2] - c[1]) / (z[2] - z[1])
    bent = (after - before) / (z[2] - z[0])
    return float(np.exp(0.5 * (z[0] + z[1] - before / bent))) if bent > 0 else at[k]


def may_be_rounded(candidate: OdeCandidate) -> bool:
    """Whether there are effects, and none makes steps: their softness is one of numerics."""
    steps = (effect.scan(tuple(candidate.theta_of(i))) for i, effect in enumerate(candidate.effects))
    return bool(candidate.effects) and not any(steps)


def with_width(candidate: OdeCandidate, sharpness: float) -> OdeCandidate | None:
    """A set fitted with another width of its kinks; the set itself where the width moves nothing."""
    at = candidate.problem.at(Numerics(candidate.problem.numerics.n_sub, sharpness, rounded=True))
    theta, x = candidate.fit.theta[:, None], candidate.fit.x[:, None]
    with np.errstate(all="ignore"):
        before, after = (one.bind(theta)(x) for one in (candidate.model, at.augmented(candidate.effects)))
    if np.array_equal(before, after, equal_nan=True):
        return candidate
    return candidate.resumed(at)
