"""Candidates whose effects are at values at which they are not what their names say."""

from __future__ import annotations

import numpy as np

from sksurrogate.gap.fit._ode import OdeCandidate
from sksurrogate.gap.fit._probe import probe_of

__all__ = ["plausible"]


def plausible(candidate: OdeCandidate) -> bool:
    """Whether the path of a candidate shows what makes each of its effects what it is; a path that breaks shows nothing else."""
    problem = candidate.problem
    x = candidate.fit.x[: len(problem.plant.states)]
    if not np.isfinite(x).all():
        return True
    pairs = ((effect, candidate.theta_of(i)) for i, effect in enumerate(candidate.effects))
    return all(e.plausible(tuple(theta), probe_of(problem, e, x, problem.rate)) for e, theta in pairs)
