"""Sets of effects that contend to be named: each beside its law, or by its likelihood where a law has nothing to correct."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from sksurrogate.effects._base_effect import BaseEffect
from sksurrogate.gap.decide._laws_asked import LawAsked
from sksurrogate.gap.fit._closeness import AT_THE_NOISE, FAR, MOST_LEFT, SETTLED
from sksurrogate.gap.fit._evidence import C, Evidence, estimate_noise
from sksurrogate.gap.fit._ode import OdeCandidate
from sksurrogate.gap.results._next_experiment import NATS_THAT_SETTLE
from sksurrogate.gap.search._base import BaseSearch
from sksurrogate.gap.search._nested import of_one_law
from sksurrogate.gap.search._ode_search import OdeSearch
from sksurrogate.gap.unnamed._law_evidence import LawBeside, LawName, LawQuestion, law_beside, place_and_signal
from sksurrogate.gap.unnamed._law_places import forms_of_places
from sksurrogate.kernels.disturbance import Noise

#: Prior probability that what is missing, or a part of it beyond the tolerance, has no name.
UNNAMED = 0.02
#: Sets that are compared beside a law: at most so many.
MOST_OTHERS = 6


def log_prior(effects: Sequence[BaseEffect], library: Sequence[BaseEffect], positions: Collection[str] = ()) -> float:
    """Log prior probability of a set of names out of a library: the product of their shares of all weights.

    ``positions``: states that are integrals of others.

    >>> from sksurrogate.effects import CATALOGUE
    >>> friction, hysteresis = (CATALOGUE[name]("speed", "speed") for name in ("coulomb_friction", "hysteresis"))
    >>> round(float(np.exp(log_prior([hysteresis], [friction, hysteresis]))), 3)  # 0.1 against 1
    0.091
    """
    total = sum(effect.prior_weight(positions) for effect in library)
    return float(sum(np.log(effect.prior_weight(positions) / total) for effect in effects))


class Contender(NamedTuple):
    """A set beside its law: log evidence with its price, and the part of it that is known before any data."""

    net: float
    before: float
    candidate: OdeCandidate
    law: LawBeside


def contenders(
    search: OdeSearch, final: Evidence, law: LawBeside, fallen: Collection[frozenset] = ()
) -> tuple[Contender, list[Contender]]:
    """What stands beside its law, and the sets with another effect in the place of one, beside theirs.

    A set that says the same in more names counts too where it is likelier before any data: two usual effects with fewer parameters than
    a special one.

    They are judged in the order of the most that they could reach: to be as likely as what stands, at the price of a law that
    corrects the form in one direction, and of its choice among those of its place and signal.

    ``fallen``: keys of sets that did not stand.
    """
    own, level = contender(search, final.candidate, law), search.evidence(final.candidate)
    forms = forms_of_places(final.candidate)

    def reach(candidate: OdeCandidate) -> float:
        chosen = sum(forms[place] for place in set(map(place_and_signal, candidate.effects))) or sum(forms.values())
        corrected = -0.5 * np.log1p(max(candidate.fit.cost - final.fit.cost, 0.0)) - np.log(chosen)
        return max(search.evidence(candidate) - level, corrected) + _before(search, candidate) - own.before

    near = _near(search, final)
    others: list[Contender] = []
    plainer = [one for one in in_more_names(search, final) if _before(search, one) > own.before]
    swapped = [one for one in swaps(search, final.candidate) if one in near] + plainer
    swapped = [one for one in swapped if frozenset(one.keys) not in fallen]
    for candidate in sorted(swapped, key=reach, reverse=True)[:MOST_OTHERS]:
        if own.net + reach(candidate) > max([own.net, *(one.net for one in others)]) - NATS_THAT_SETTLE:
            others.extend(judged_contender(search, final, candidate, [law.name]))
    return own, others


def elsewhere(search: OdeSearch, final: Evidence, own: Contender) -> list[tuple[frozenset, float]]:
    """Names of sets that differ by more than one effect in the place of one, and the nats by which they are likelier than what stands.

    Data that show the sum of several effects may be explained as well by others. Sets that hold what stands, or are a part of it, or
    say it in more names or in others that predict the same one by one, do not count; one that holds another form of the same law holds the name. Those that are as likely without a law are judged beside
    theirs, as what stands is. Where what stands leaves more than the noise, its forms are not exact, and the likelihood says too little of
    others that are as inexact: none counts.
    """
    if final.left > SETTLED:
        return []
    keys, level = set(final.candidate.keys), search.evidence(final.candidate)
    no_rivals = [*swaps(search, final.candidate), *in_more_names(search, final), *in_other_names(search, final)]
    likelier = {
        one: search.evidence(one) - level + _before(search, one) - own.before
        for one in _near(search, final)
        if search.own(one) is not None and not (one in no_rivals or keys <= set(one.keys) or keys >= set(one.keys))
    }
    as_likely = sorted(
        (one for one in likelier if likelier[one] > -NATS_THAT_SETTLE), key=likelier.__getitem__, reverse=True
    )
    for one in as_likely[:MOST_OTHERS]:
        for beside in judged_contender(search, final, one, [own.law.name]):
            likelier[one] = beside.net - own.net
    return [(_held(one, final.candidate), nats) for one, nats in likelier.items()]


def in_more_names(search: OdeSearch, final: Evidence) -> list[OdeCandidate]:
    """Sets that say in more names what stands: these data cannot tell them apart."""
    named = set(final.candidate.keys)
    more = (one for one in _near(search, final) if len(one.effects) > len(named) and not named <= set(one.keys))
    return [one for one in more if nats_apart(one, final.candidate, final.noise) < NATS_THAT_SETTLE]


def in_other_names(search: OdeSearch, final: Evidence) -> list[OdeCandidate]:
    """Sets of which every other name predicts, alone, what one of those predicts that it replaces: a coupling of inputs, and a loss that
    an input drives.

    Each is in the class of the other.
    """
    named = set(final.candidate.keys)

    def alike(key: Any, other: Any) -> bool:
        one, another = (search.fitted.get(frozenset((k,))) for k in (key, other))
        return one is not None and another is not None and nats_apart(one, another, final.noise) < NATS_THAT_SETTLE

    same_size = (one for one in _near(search, final) if len(one.effects) == len(named))
    apart = ((one, set(one.keys) - named, named - set(one.keys)) for one in same_size)
    return [one for one, new, gone in apart if new and all(any(alike(key, other) for other in gone) for key in new)]


def nats_apart(one: OdeCandidate, other: OdeCandidate, noise: Noise) -> float:
    """Nats by which the data would tell two predictions apart if one of them were right, under white noise of the sensors."""
    apart = (one.residual - other.residual) / noise.sigma[:, None]
    return float(0.5 * np.sum(apart**2))


def _held(one: OdeCandidate, other: OdeCandidate) -> frozenset:
    """Keys of a set, and those of another set of which it holds another form."""
    forms = (effect.key for effect in other.effects if any(of_one_law(effect, own) for own in one.effects))
    return frozenset((*one.keys, *forms))


def preferred(own: Contender, others: Sequence[Contender]) -> Contender:
    """Of the sets that are as likely as the likeliest, up to :data:`NATS_THAT_SETTLE`, the likeliest before any data.

    Where several are, what stands, else the likeliest; or one that leaves much less to the law beside it.
    """
    ordered = own, *sorted(others, key=lambda one: -one.net)
    best = max(one.net for one in ordered)
    near = [one for one in ordered if one.net > best - NATS_THAT_SETTLE]
    before = max(one.before for one in near)
    first, *alike = (one for one in near if one.before > before - 1e-9)
    nearest = min(alike, key=lambda one: one.candidate.fit.cost, default=first)
    return nearest if nearest.candidate.fit.cost < MOST_LEFT**2 * first.candidate.fit.cost else first


def _near(search: OdeSearch, final: Evidence) -> list[OdeCandidate]:
    """Plausible sets that leave as much of the gap, up to the tolerance: beyond it no law or prior of names decides, but the fit."""
    most = final.fit.cost + search.tolerated_cost
    return [one for one in search.fitted.values() if one.fit.cost < most and search.plausible(one)]


def swaps(search: BaseSearch[C], named: C) -> list[C]:
    """The sets that were fitted with another effect in the place of one that is named."""
    own = frozenset(named.keys)
    return [one for keys, one in search.fitted.items() if len(keys) == len(own) == len(keys & own) + 1]


def judged_contender(
    search: OdeSearch, final: Evidence, candidate: OdeCandidate, seeds: Sequence[LawName]
) -> list[Contender]:
    """A set beside its own law; none where that cannot be judged.

    One that is far from the data is linear about the path of what stands, if that is near: about the measured path a free
    force makes up for what it leaves. Where what stands is at the noise, its noise is that of the plant, and laws beside others are compared
    under it.
    """
    known = search.judged.get(candidate) or search.judge(estimate_noise(candidate, search.fitted_null.noise))
    along = _is_far(search, known) and not _is_far(search, final)
    noises = noises_of(final) if final.left <= AT_THE_NOISE else None
    law = judged_law(search, final if along else known, candidate, along, seeds, noises=noises)
    return [] if law is None else [contender(search, candidate, law)]


def _is_far(search: OdeSearch, evidence: Evidence) -> bool:
    """Whether a free run is too far from the data to be the path of a linear model: further than any noise, and the tolerance."""
    return evidence.left > max(FAR, search.tolerance * search.gap_over_noise)


def contender(search: OdeSearch, candidate: OdeCandidate, law: LawBeside) -> Contender:
    """A set with its law."""
    before = _before(search, candidate)
    return Contender(float(np.logaddexp(law.small, law.large + np.log(UNNAMED))) + before, before, candidate, law)


def _before(search: OdeSearch, candidate: OdeCandidate) -> float:
    """Log prior of the names of a set, with the price of its parameters."""
    names = log_prior(candidate.effects, search.library, search.positions)
    return float(names - 0.5 * candidate.n_parameters * np.log(search.n_values))


def noises_of(final: Evidence) -> Sequence[Noise]:
    """Noises under which laws beside a set are compared: its own, and where it leaves more, which may hold what a law explains, quiet forces."""
    noise = final.noise
    return (noise,) if final.left <= AT_THE_NOISE else (noise, final.candidate.problem.quiet(noise))


def judged_law(
    search: OdeSearch,
    final: Evidence,
    candidate: OdeCandidate,
    along: bool,
    seeds: Sequence[LawName] = (),
    instead: OdeCandidate | None = None,
    noises: Sequence[Noise] | None = None,
) -> LawBeside | None:
    """A law beside a candidate, under the noise of what is named by default; of two linear models the likelier.

    Far from the data, also beside the gap, the models are linear about the measured path, not about the free run. What was asked of a
    set that leaves the same to a law is not asked again.
    """
    noises = noises_of(final) if noises is None else noises
    asked = LawAsked(final.candidate, candidate, instead, along, noises, seeds)
    for known, law in search.laws:
        seen = {*known.seeds, *([law.name] if law else [])}
        if seen.issuperset(seeds) and known.is_like(asked, search):
            return law
    law = _law(search, final, asked)
    search.laws.append((asked, law))
    return law


def _law(search: OdeSearch, final: Evidence, asked: LawAsked) -> LawBeside | None:
    candidate, far = asked.beside, _is_far(search, final)
    x = search.x if far else final.candidate.states
    question = LawQuestion(
        candidate, asked.noises, x if asked.along or far else None, seeds=asked.seeds, instead=asked.instead
    )
    found = [law_along(search, question)]
    if candidate.effects and final.left > AT_THE_NOISE and _may_be_regressors(candidate):
        found.append(law_along(search, replace(question, path=x, bare=True)))
    return max((one for one in found if one is not None), key=lambda one: one.total, default=None)


def _may_be_regressors(candidate: OdeCandidate) -> bool:
    """Whether effects may be regressors along the data: none has a state, and none changes a sensor.

    Along the data a sensor reads the noise of its own readings. What it would change of them, less a law of what the simulator reads,
    explains that noise.
    """
    sensors = any(effect.kind == "output" for effect in candidate.effects)
    return not sensors and candidate.model.n_states == candidate.model.n_nominal


def law_along(search: OdeSearch, asked: LawQuestion) -> LawBeside | None:
    """A law beside a set."""
    with np.errstate(all="ignore"):
        return law_beside(asked, search.gap_over_noise, search.tolerance)
