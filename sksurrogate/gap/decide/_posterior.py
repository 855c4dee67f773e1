"""How probable each name is, whatever else acts: sets of effects, each beside a law without a name, in one sum of evidence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sksurrogate.gap.fit._closeness import AT_THE_NOISE, FAR, SETTLED
from sksurrogate.gap.fit._evidence import Evidence, estimate_noise
from sksurrogate.gap.fit._ode import OdeCandidate
from sksurrogate.gap.search._name_prior import log_prior
from sksurrogate.gap.search._search import Search
from sksurrogate.gap.search._stopping import closes_by_size
from sksurrogate.gap.unnamed._law_evidence import LawBeside, law_beside
from sksurrogate.kernels.disturbance import Noise

__all__ = ["Posterior", "law_beside_none", "stands", "weigh"]

#: Prior probability that what is missing, or a part of it beyond the tolerance, has no name.
UNNAMED = 0.02
#: Names less probable than this do not stand, beside others and alone: a law does as well in their place.
LEAST_BESIDE, LEAST_ALONE = 0.9, 0.5
#: Sets that are compared beside a law: within so many nats of the one that stands, which a law may turn; at most so many.
LAW_MAY_TURN, MOST_OTHERS = 8.0, 6
#: Nats by which another set must be likelier to take the place of one.
CLEARLY_LIKELIER = 1.0


@dataclass(frozen=True)
class Posterior:
    """Of what is named.

    Attributes
    ----------
    probabilities : tuple of float
        That each effect acts, beside a law of any size; the members of its class count for it.
    law : LawBeside or None
        The law beside the set; None where it cannot be judged.
    """

    probabilities: tuple[float, ...]
    law: LawBeside | None


def weigh(search: Search, final: Evidence, tolerance: float) -> Posterior:
    """The posterior of a set's effects against the set without each of them, and without all, a law in their place."""
    n = len(final.effects)
    none = _without(final.candidate, tuple(range(n)))
    nothing = _judged(search, final, none, tolerance, along=True)
    seeds = [] if nothing is None else [nothing.seed]
    own = _judged(search, final, final.candidate, tolerance, along=False, seeds=seeds)
    if own is None:
        return Posterior(tuple(1.0 for _ in final.effects), None)
    net = _net(search, final.candidate, own)
    empty = -np.inf if nothing is None else _net(search, none, nothing)
    without = [empty]
    if n > 1:
        rests = [_without(final.candidate, (i,)) for i in range(n)]
        laws = [_judged(search, final, rest, tolerance, along=True, seeds=[*seeds, own.seed]) for rest in rests]
        without = [-np.inf if law is None else _net(search, rest, law) for rest, law in zip(rests, laws)]
    odds = (np.clip(np.logaddexp(one, empty) - net, -700.0, 700.0) for one in without)
    return Posterior(tuple(float(1.0 / (1.0 + np.exp(value))) for value in odds), own)


def stands(search: Search, final: Evidence, tolerance: float) -> tuple[Evidence, Posterior]:
    """The set that is likeliest beside a law, without effects that the practical bar does not need. And its posterior.

    Effects in whose place a law does as well are taken out, the least probable first; another effect takes the place of one
    where that is likelier.
    """
    final = needed_only(search, final, tolerance)
    if closes_by_size(final, search.gap_cost, tolerance):
        law = _judged(search, final, final.candidate, tolerance, along=False)
        return final, Posterior(tuple(1.0 for _ in final.effects), law)
    while final.effects:
        posterior = weigh(search, final, tolerance)
        least = int(np.argmin(posterior.probabilities))
        if posterior.probabilities[least] >= (LEAST_BESIDE if len(final.effects) > 1 else LEAST_ALONE):
            better = likelier(search, final, posterior, tolerance)
            if better is None:
                return final, posterior
            final = better
            continue
        fewer = search.without(final.candidate, least)
        if fewer is None or not fewer.effects:
            break
        final = _taken(search, fewer, final)
    search.final = search.fitted_null
    return search.fitted_null, Posterior((), None)


def _taken(search: Search, candidate: OdeCandidate, before: Evidence) -> Evidence:
    """A smaller set that takes the place of another, under its own noise: that of the larger one knows less to explain."""
    search.judge(estimate_noise(candidate, before.noise, before.curvature))
    return search.judged[search.stand(search.polish(candidate))]


def needed_only(search: Search, final: Evidence, tolerance: float) -> Evidence:
    """A set without effects that the practical bar does not need, the least needed first.

    A set that leaves more than the noise is not exact. There an effect counts if the set without it, fitted again, leaves more
    of the gap by at least the tolerance (in power: its square); a smaller one may only correct the form of the others.
    """
    while len(final.effects) > 1 and final.left > SETTLED:
        sets = [search.without(final.candidate, i) for i in range(len(final.effects))]
        known = [one for one in sets if one is not None and one.effects]
        if not known:
            break
        fewer = min(known, key=lambda one: one.fit.cost)
        if fewer.fit.cost - final.fit.cost > tolerance**2 * search.gap_cost:
            break
        final = _taken(search, fewer, final)
    return final


def likelier(search: Search, final: Evidence, posterior: Posterior, tolerance: float) -> Evidence | None:
    """Another set of as many effects that is likelier beside a law, the likeliest; None where there is none.

    Sets compete that leave as much of the gap, up to the tolerance: beyond it no law or prior of names decides, but the fit.
    """
    own = posterior.law
    if own is None:
        return None
    most = final.fit.cost + tolerance**2 * search.gap_cost
    net, keys = _net(search, final.candidate, own), frozenset(final.candidate.keys)
    level = _plain(search, final.candidate) - LAW_MAY_TURN
    others = [
        candidate
        for names, candidate in search.fitted.items()
        if len(names) == len(keys)
        and len(names & keys) == len(keys) - 1
        and candidate.fit.cost < most
        and _plain(search, candidate) > level
    ]
    others = sorted(others, key=lambda one: _plain(search, one), reverse=True)[:MOST_OTHERS]
    nets = [_net_of(search, candidate, tolerance) for candidate in others]
    if not others or max(nets) < net + CLEARLY_LIKELIER:
        return None
    polished = search.polish(others[int(np.argmax(nets))])
    if _net_of(search, polished, tolerance) < net + CLEARLY_LIKELIER:
        return None
    return search.judged[search.stand(polished)]


def _net_of(search: Search, candidate: OdeCandidate, tolerance: float) -> float:
    """Log evidence of a set beside its own law, with its price."""
    law = _judged(search, search.judged[candidate], candidate, tolerance, along=False)
    return -np.inf if law is None else _net(search, candidate, law)


def _plain(search: Search, candidate: OdeCandidate) -> float:
    """Log evidence without a law, with the price of the parameters and the prior of the names."""
    return search.score(candidate) + _log_prior(search, candidate)


def _log_prior(search: Search, candidate: OdeCandidate) -> float:
    """Of the names of a set."""
    problem = search.problem
    positions = [name for name in problem.plant.states if name not in problem.balances]
    return log_prior(candidate.effects, search.library, positions)


def _without(candidate: OdeCandidate, out: tuple[int, ...]) -> OdeCandidate:
    """A candidate without some effects, everything else as it is."""
    effects, theta = candidate.without_effect(*out)
    return candidate.problem.candidate(effects, replace(candidate.fit, theta=theta, linearised=None))


def _judged(
    search: Search,
    final: Evidence,
    candidate: OdeCandidate,
    tolerance: float,
    along: bool,
    seeds: Sequence[tuple[int, int, Noise]] = (),
) -> LawBeside | None:
    """A law beside a candidate, under the noise of what is named and under quiet forces; of two linear models the likelier.

    Far from the data, also beside the gap, they are linear about the measured path, not about the free run.
    """
    problem = candidate.problem
    far = final.left > max(FAR, tolerance * gap_over_noise(search))
    x = (search.x if far else final.candidate.fit.x)[: len(problem.plant.states)]
    noises, along = (final.noise, problem.quiet(final.noise)), along or far
    how = gap_over_noise(search), tolerance, noises
    with np.errstate(all="ignore"):
        found = [law_beside(candidate, *how, x if along else None, seeds=seeds)]
        if candidate.effects and final.left > AT_THE_NOISE and candidate.model.n_states == candidate.model.n_nominal:
            found.append(law_beside(candidate, *how, x, bare=True, seeds=seeds))
    return max((one for one in found if one is not None), key=lambda one: one.total, default=None)


def gap_over_noise(search: Search) -> float:
    """RMS of the gap of the simulator over the noise."""
    return float(np.sqrt(max(search.gap_cost / search.n_values - 1.0, 1e-6)))


def law_beside_none(search: Search, tolerance: float) -> LawBeside | None:
    """The law beside no effect at all, along the measured path."""
    null = search.fitted_null
    problem = null.candidate.problem
    noises = null.noise, problem.quiet(null.noise)
    with np.errstate(all="ignore"):
        return law_beside(
            null.candidate, gap_over_noise(search), tolerance, noises, search.x[: len(problem.plant.states)]
        )


def _net(search: Search, candidate: OdeCandidate, law: LawBeside) -> float:
    """Log evidence with the price of its parameters and the prior of its names and of a large law."""
    price = 0.5 * candidate.n_parameters * np.log(search.n_values) - _log_prior(search, candidate)
    return float(np.logaddexp(law.small, law.large + np.log(UNNAMED)) - price)
