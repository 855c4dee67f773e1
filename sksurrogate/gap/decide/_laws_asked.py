"""Laws that were asked for beside sets of effects: of sets that leave the same to a law it is asked for once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sksurrogate.gap.fit._ode import OdeCandidate
from sksurrogate.gap.search._ode_search import OdeSearch
from sksurrogate.gap.unnamed._law_evidence import LawName
from sksurrogate.kernels.disturbance import Noise

#: Squared distance of free runs, in units of the noise, and nats up to which two sets leave the same to a law.
SAME_RUN, SAME_NATS = 1e-4, 0.05
#: Change of the sizes and memories of a noise (logarithms) up to which it is the same.
SAME_NOISE = 0.02


@dataclass(frozen=True, eq=False)
class LawAsked:
    """What a law was asked for."""

    named: OdeCandidate  #: What is named
    beside: OdeCandidate  #: The set that the law stands beside
    instead: OdeCandidate | None  #: The set with the effect in whose place it stands
    along: bool  #: Whether along the path of what is named
    noises: Sequence[Noise]
    seeds: Sequence[LawName]  #: Laws that are compared in any case

    def is_like(self, other: LawAsked, search: OdeSearch) -> bool:
        """Whether another question has the same answer, but for its seeds."""
        if self.along != other.along or not same_noise(self.noises, other.noises):
            return False
        pairs = (self.named, other.named), (self.beside, other.beside), (self.instead, other.instead)
        return all(leaves_the_same(search, *pair) for pair in pairs)


def same_noise(some: Sequence[Noise], others: Sequence[Noise]) -> bool:
    """Whether noises are the same, up to what their fits leave open."""
    pairs = [(one.pack(), other.pack()) for one, other in zip(some, others)]
    return len(some) == len(others) and all(np.max(np.abs(a - b)) < SAME_NOISE for a, b in pairs)


def leaves_the_same(search: OdeSearch, one: OdeCandidate | None, other: OdeCandidate | None) -> bool:
    """Whether two sets give the same free run, by parameters as many and as likely (a friction at a speed that keeps its sign is a constant)."""
    if one is None or other is None or one is other:
        return one is other
    if one.problem.record is not other.problem.record or one.n_fitted != other.n_fitted:
        return False
    apart = (one.fit.y - other.fit.y) / one.problem.sd[:, None]
    nats = abs(search.evidence(one) - search.evidence(other)) if one.keys != other.keys else 0.0
    return bool(np.sum(apart**2) < SAME_RUN and nats < SAME_NATS)
