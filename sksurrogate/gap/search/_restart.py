"""Fits whose parameters have run to where the prediction no longer depends on them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sksurrogate.effects._effect import BaseEffect
from sksurrogate.gap.fit._ode import OdeCandidate
from sksurrogate.gap.fit._probe import probe_of

__all__ = ["dead", "revived"]

#: Sensitivity over that of the most sensitive parameter, per unit of each, below which a parameter says nothing.
SILENT = 1e-9
#: Starting values that are tried, evenly chosen: a time of a jump has forty.
MOST_TRIED = 8


def revived(candidate: OdeCandidate) -> OdeCandidate:
    """The best fit from starting values of the parameters on which the prediction does not depend, the others kept.

    A Stribeck velocity of 0 has no slope that leads back, and the level that it leads to has none either.
    """
    problem = candidate.problem
    for i, effect in enumerate(candidate.effects):
        silent = dead(candidate, i)
        if not silent.any() or silent.all():
            continue
        path = candidate.fit.x[: len(problem.plant.states)]
        place = candidate.slice_of(i)
        now = candidate.fit.theta[place]
        starts = effect.starts(probe_of(problem, effect, path, problem.rate))
        tried = [np.where(silent, in_scale(effect, start, now, silent), now) for start in starts]
        tried = list({tuple(values): values for values in tried}.values())
        for k in np.unique(np.linspace(0, len(tried) - 1, MOST_TRIED).round().astype(int)) if tried else ():
            theta = candidate.fit.theta.copy()
            theta[place] = tried[k]
            other = problem.fit(candidate.effects, theta, candidate.fit.x)
            if other is not None and other.fit.cost < candidate.fit.cost - 1.0:
                return revived(other)
    return candidate


def in_scale(effect: BaseEffect, start: Sequence[float], now: np.ndarray, silent: np.ndarray) -> np.ndarray:
    """A starting value in proportion to what was fitted: a level beside a fitted level of the same unit."""
    given = np.array(start, dtype=float)
    out = given.copy()
    units = [parameter.unit for parameter in effect.parameters]
    for k in np.flatnonzero(silent):
        alike = [j for j in np.flatnonzero(~silent) if units[j] == units[k] and given[j] != 0]
        if alike:
            out[k] *= now[alike[0]] / given[alike[0]]
    return out


def dead(candidate: OdeCandidate, i: int) -> np.ndarray:
    """Which parameters of effect i move nothing."""
    J = candidate.linearised.J_theta
    unit = np.maximum(np.abs(candidate.problem.units(candidate.effects, candidate.fit.theta)), 1e-300)
    moved = np.sqrt(np.mean((J * unit[None, :, None]) ** 2, axis=(0, 2)))
    return moved[candidate.slice_of(i)] <= SILENT * np.max(moved, initial=0.0)
