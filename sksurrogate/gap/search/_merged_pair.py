"""Two effects that are one law between them: dry friction and its Stribeck part, a law and its simpler form."""

from __future__ import annotations

from dataclasses import replace
from itertools import permutations

import numpy as np
from scipy.optimize import least_squares

from sksurrogate.effects._effect import BalanceEffect, BaseEffect, HiddenEffect
from sksurrogate.gap.fit._ode import OdeCandidate
from sksurrogate.gap.search._nested import richer

__all__ = ["folded"]

#: A law is the sum of two where it differs by less than this share of its deviation (RMS); and its fit is where theirs is
#: with less than so many times their cost: kinks of larger jumps are smoothed further.
SAME_FORCE, LITTLE_MORE = 0.01, 1.3


def folded(candidate: OdeCandidate) -> OdeCandidate | None:
    """A candidate with two of its effects as one, fitted from their sum; None where no two are such, or the fit does not get there.

    Of two forms of one variable in one balance, of which one contains the other, the richer may be their sum along the path.
    """
    for i, j in permutations(range(len(candidate.effects)), 2):
        own = together(candidate, i, j) if contains(candidate.effects[i], candidate.effects[j]) else None
        if own is not None:
            theta = candidate.fit.theta.copy()
            theta[candidate.slice_of(i)] = own
            effects, values = replace(candidate, fit=replace(candidate.fit, theta=theta)).without_effect(j)
            one = candidate.problem.fit(effects, values, candidate.fit.x[: candidate.model.n_nominal], open_steps=0)
            return one if one is not None and one.fit.cost < LITTLE_MORE * candidate.fit.cost else None
    return None


def force_of(candidate: OdeCandidate, k: int, theta: np.ndarray) -> np.ndarray:
    """What effect k adds to its balance along the path, (n_samples,)."""
    model, record = candidate.model, candidate.problem.record
    width = model.wires[k].width or 0.0
    return model.force_of(k, record.t, candidate.fit.x[:, None], record.u[:, None], list(theta[:, None]), width)[0]


def contains(rich: BaseEffect, simple: BaseEffect) -> bool:
    """Whether a law of a balance has the form of another one among its own."""
    laws = all(isinstance(e, BalanceEffect) and not isinstance(e, HiddenEffect) for e in (rich, simple))
    return laws and rich.variable == simple.variable and richer(rich, simple)


def together(candidate: OdeCandidate, i: int, j: int) -> np.ndarray | None:
    """Values with which effect i is effects i and j together, along the path; None where it has none."""
    own = candidate.theta_of(i)
    wanted = force_of(candidate, i, own) + force_of(candidate, j, candidate.theta_of(j))
    low, high = (bound[candidate.slice_of(i)] for bound in candidate.problem.bounds(candidate.effects))
    size = np.std(wanted) or 1.0
    begin = np.clip(own, low, high)
    found = least_squares(
        lambda theta: (force_of(candidate, i, theta) - wanted) / size,
        begin,
        bounds=(low, high),
        x_scale="jac",
        max_nfev=50,
    )
    return found.x if np.mean(found.fun**2) < SAME_FORCE**2 else None
