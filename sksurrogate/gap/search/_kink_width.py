"""The width of a kink: friction that turns round, a valve that opens, an orifice near rest are no corners on a real plant."""

from __future__ import annotations

import numpy as np

from sksurrogate.gap.fit._ode import Numerics, OdeCandidate
from sksurrogate.gap.search._softer import softer, worth

#: Sharpness (size of a variable over the width of its kinks) of wider kinks, one after the other. Wider than a third of the size a
#: friction is no longer told from a loss that is proportional to the speed.
WIDER = (25.0, 12.5, 6.25, 3.125)


def rounded(candidate: OdeCandidate, price: float) -> OdeCandidate:
    """A set with the width of its kinks fitted, where that gains more than a ``price`` (twice the log likelihood); else as it is.

    A width that was fitted to fewer effects may have stood for one that was missing: beside it kinks are sharp again, where that is nearer.
    """
    own = candidate.problem.numerics
    if own.rounded and len(candidate.effects) > 1:
        sharp = candidate.resumed(candidate.problem.at(Numerics(own.n_sub, WIDER[0], rounded=False)))
        return candidate if sharp is None or sharp.fit.cost > candidate.fit.cost else sharp
    if own.rounded or not may_be_rounded(candidate):
        return candidate
    return worth(price, candidate, softer({own.sharpness: candidate}, WIDER, with_width))


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
