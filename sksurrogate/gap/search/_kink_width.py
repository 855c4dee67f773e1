"""The width of a kink: friction that turns round, a valve that opens, an orifice near rest are no corners on a real plant.

The width is one more parameter of a set. It is fitted by itself, since the others follow it in a few steps: wider and wider as long
as that leads nearer to the data, then by parabolas.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np

from sksurrogate.effects._input import LimitedActuator
from sksurrogate.gap.fit._evidence import gain_by_size
from sksurrogate.gap.fit._ode import Numerics, OdeCandidate
from sksurrogate.gap.search._restart import WORTH_A_FIT

#: Sharpness (size of a variable over the width of its kinks) of wider kinks, one after the other. Wider than a third of the size a
#: friction is no longer told from a loss that is proportional to the speed.
WIDER = (25.0, 12.5, 6.25, 3.125)
#: One over the corner of an actuator's limit: of a corner that is one to the data, and of softer and softer ones up to ``tanh``.
CORNER, WIDER_CORNERS = 50.0, (20.0, 8.0, 3.2, 1.6, 1.0)
#: One that is tried for every limit; whether it is soft is asked where that leaves less than this share (squares).
BENT, MUCH_NEARER = 3.2, 0.5
#: Widths between these that are fitted.
MOST_BETWEEN = 5


def rounded(candidate: OdeCandidate, price: float) -> OdeCandidate:
    """A set with the width of its kinks fitted, where that gains more than a ``price`` (twice the log likelihood); else as it is.

    The limits of actuators have corners of their own (:class:`~sksurrogate.effects._input.LimitedActuator`).
    """
    for i, effect in enumerate(candidate.effects):
        if isinstance(effect, LimitedActuator) and effect.corner == 0:
            candidate = _worth(price, candidate, _bent({CORNER: candidate}, i))
    own = candidate.problem.numerics
    if own.rounded or not may_be_rounded(candidate):
        return candidate
    return _worth(price, candidate, _softer({own.sharpness: candidate}, WIDER, with_width))


def bends(candidate: OdeCandidate) -> OdeCandidate:
    """A set whose last effect is a limit with a corner, or with a soft one where that leaves far less.

    A limit that bends is far from the data as a corner, and would not be polished.
    """
    last = len(candidate.effects) - 1
    effect = candidate.effects[last]
    bent = with_corner(candidate, BENT, last) if isinstance(effect, LimitedActuator) and effect.corner == 0 else None
    if bent is None or bent.fit.cost > MUCH_NEARER * candidate.fit.cost:
        return candidate
    return _bent({CORNER: candidate, BENT: bent}, last)


def _bent(tried: dict[float, OdeCandidate], i: int) -> OdeCandidate:
    """A set with the corner of limit i fitted."""
    return _softer(tried, WIDER_CORNERS, partial(with_corner, i=i))


def _worth(price: float, candidate: OdeCandidate, softer: OdeCandidate) -> OdeCandidate:
    """A set with softer kinks where that gains more than a price, else the set as it was."""
    gain = 2.0 * gain_by_size(candidate.problem.record.n_values, candidate.fit.cost / softer.fit.cost)
    return softer if gain > price else candidate


def _softer(
    tried: dict[float, OdeCandidate], wider: Sequence[float], at: Callable[[OdeCandidate, float], OdeCandidate | None]
) -> OdeCandidate:
    """The set of the sharpness that leads nearest to the data: ``wider`` up to the first that leaves more, if all do in between; then by parabolas.

    ``tried``: by sharpness; the sharpest is the set as it is.
    ``at``: a set fitted with a sharpness.
    """
    own = max(tried)
    candidate = tried[own]
    for sharpness in wider:
        nearest = min((one for s, one in tried.items() if s > sharpness), key=lambda one: one.fit.cost)
        if sharpness not in tried:
            tried[sharpness] = at(nearest, sharpness) or candidate
        if tried[sharpness].fit.cost > nearest.fit.cost:
            break
    if _nearest(tried) is candidate:
        between = float(np.sqrt(own * wider[0]))
        tried[between] = at(candidate, between) or candidate
    for _ in range(MOST_BETWEEN):
        nearest, sharpness = _nearest(tried), lowest({s: np.log(one.fit.cost) for s, one in tried.items()})
        if nearest is candidate or sharpness in tried:
            break
        tried[sharpness] = at(nearest, sharpness) or candidate
        if tried[sharpness].fit.cost > nearest.fit.cost - WORTH_A_FIT:
            break
    return _nearest(tried)


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


def with_corner(candidate: OdeCandidate, sharpness: float, i: int) -> OdeCandidate | None:
    """A set fitted with the corner of limit i, one over a sharpness."""
    limit = candidate.effects[i]
    bent = type(limit)(**{**limit.get_params(deep=False), "corner": 1.0 / sharpness})
    effects = (*candidate.effects[:i], bent, *candidate.effects[i + 1 :])
    return candidate.problem.fit(effects, candidate.fit.theta, candidate.fit.x, open_steps=0)
