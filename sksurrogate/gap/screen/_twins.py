"""Candidates that do along the data what named effects do, to first order about these: a parameter that depends on a signal, and two terms
of a balance."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np

from sksurrogate.effects._base_effect import BaseEffect
from sksurrogate.gap.fit._normal_equations import project_starts, solve
from sksurrogate.gap.fit._ode import OdeCandidate
from sksurrogate.gap.screen._candidate_columns import CandidateColumns
from sksurrogate.gap.screen._responses import Responses
from sksurrogate.gap.screen._screen import grown

#: Share of a starting magnitude whose column is a slope: those of the named effects are slopes too.
SLOPE = 1e-4


class Twin(NamedTuple):
    """A candidate that does what named effects do."""

    places: tuple[int, ...]  #: Of these effects
    effect: BaseEffect
    theta: np.ndarray  #: The starting value that comes nearest
    left: float  #: Squared error over the noise that it is expected to leave


def twins(named: OdeCandidate, candidates: Sequence[BaseEffect], x: np.ndarray, most: float) -> Iterator[Twin]:
    """Candidates that in the place of some effects leave less than ``most``, of most effects first; the others and the initial states follow.

    Columns along the path of what is named need no fit of a set without these effects, which may be far from the data.

    ``x`` (n_states, n_samples): trajectory near the measured one, to start the smoother.
    ``most``: squared error over the noise.
    """
    with np.errstate(all="ignore"):
        s = Responses(named, x)
        asked, known = CandidateColumns(s, (), None, SLOPE), s.white.reshape(len(s.known), -1)
        for effect in (one for one in candidates if one.parameters):
            columns = asked.of_all([effect], None)
            if not columns:
                continue
            own = np.stack([one.column for one in columns]) / s.problem.sd[:, None]
            flat = np.concatenate([known, project_starts(own, s.J_x, s.problem.record.starts).reshape(len(own), -1)])
            G, added = flat @ flat.T, list(range(len(known), len(flat)))
            if not np.isfinite(G).all():
                continue
            for places, missing, others in _replaced(named):
                if _left(G, missing, [*others, *added])[0] < most:
                    left, k, amplitude = _nearest(G, missing, others, added, len(effect.parameters))
                    if left < most:
                        yield Twin(places, effect, grown(effect, columns[k - len(known)].theta, amplitude), left)


def _nearest(
    G: np.ndarray, missing: np.ndarray, others: Sequence[int], added: Sequence[int], n: int
) -> tuple[float, int, float]:
    """What ``n`` columns leave, chosen one after the other: as many as an effect has numbers; the first of them and its weight."""
    tries = {k: _left(G, missing, [*others, k]) for k in added}
    first = min(tries, key=lambda k: tries[k][0])
    (left, weights), chosen = tries[first], [*others, first]
    for _ in range(min(n, len(added)) - 1):
        left, k = min((_left(G, missing, [*chosen, k])[0], k) for k in added if k not in chosen)
        chosen.append(k)
    return left, first, float(weights[-1])


def _replaced(named: OdeCandidate) -> Iterator[tuple[tuple[int, ...], np.ndarray, list[int]]]:
    """Places of effects, what is missing without them as weights of [residual, parameters], and places there of the other parameters."""
    n, theta = len(named.effects), named.fit.theta
    sized = [i for i in range(n) if named.effects[i].parameters]  # what is there or not is no term of a balance either
    for places in (some for size in range(len(sized), 0, -1) for some in combinations(sized, size)):
        missing = np.zeros(1 + len(theta))
        missing[0] = 1.0
        for i in places:
            first = named.slice_of(i).start
            missing[1 + first] = theta[first] - named.effects[i].parameters[0].null
        taken = {k for i in places for k in range(len(theta))[named.slice_of(i)]}
        if np.isfinite(missing).all():  # what is absent at an infinite limit is no term of a balance
            yield places, missing, [1 + k for k in range(len(theta)) if k not in taken]


def _left(G: np.ndarray, missing: np.ndarray, chosen: Sequence[int]) -> tuple[float, np.ndarray]:
    """Square of a sum of the first columns that some columns leave, and their weights; ``G`` the Gram of all.

    >>> _left(np.array([[4.0, 2.0], [2.0, 1.0]]), np.array([3.0]), [1])
    (0.0, array([6.]))
    """
    n = len(missing)
    toward = G[np.ix_(chosen, range(n))] @ missing
    weights = solve(G[np.ix_(chosen, chosen)], toward)
    return float(missing @ G[:n, :n] @ missing - toward @ weights), weights
