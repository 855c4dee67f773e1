"""How probable each name is, whatever else acts: sets of effects, each beside a law without a name, in one sum of evidence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import expit, logit, logsumexp, softmax

from sksurrogate.effects._catalogue import name_of
from sksurrogate.gap.decide._contenders import (
    Contender,
    contender,
    contenders,
    elsewhere,
    judged_contender,
    judged_law,
    law_along,
    preferred,
)
from sksurrogate.gap.decide._needed import is_needed, needed_only, taken
from sksurrogate.gap.decide._one_curve import form_holds, redundant_effect
from sksurrogate.gap.fit._closeness import SETTLED
from sksurrogate.gap.fit._evidence import CERTAIN, Evidence
from sksurrogate.gap.fit._ode import OdeCandidate
from sksurrogate.gap.results._next_experiment import NATS_THAT_SETTLE
from sksurrogate.gap.search._ode_search import OdeSearch
from sksurrogate.gap.search._related_forms import simplify
from sksurrogate.gap.search._stopping import closes_by_size, leaves_most
from sksurrogate.gap.unnamed._along_a_path import without
from sksurrogate.gap.unnamed._law_evidence import LawBeside, LawQuestion
from sksurrogate.gap.unnamed._law_left import LawLeft

#: Probability from which a name is given, and from which one stands beside others; below it a law does as well in its place.
CERTAIN_NAME = 0.9
#: One that stands alone is reported as uncertain from here on: it is likelier than not.
LEAST_ALONE = 0.5


@dataclass(frozen=True)
class Posterior:
    """Of what is named."""

    probabilities: tuple[float, ...]  #: That each acts, beside a law of any size; the members of its class count for it
    law: LawBeside | None  #: The law beside the set; None where it cannot be judged
    #: Sets with another effect in the place of one, as likely beside a law of their own, up to :data:`NATS_THAT_SETTLE`
    as_likely: tuple[OdeCandidate, ...] = ()
    #: Names of a set that leaves too much of the gap to be weighed
    too_far: tuple[str, ...] = ()
    elsewhere: tuple[tuple[frozenset, float], ...] = ()  #: Keys of other sets, and nats by which they are likelier
    rejected: Evidence | None = None  #: The last effect, where none stands: a law in its place is as likely


def weigh(search: OdeSearch, final: Evidence) -> Posterior:
    """The posterior of a set's effects against the set without each of them, and without all, a law in their place.

    A name whose own place and signal have a law beside it that is too large for a correction has not the form of what is there.
    """
    n = len(final.effects)
    whole = final.candidate
    none = without(whole, *range(n))
    nothing = judged_law(search, final, none, along=True, instead=whole if n == 1 else None)
    seeds = [] if nothing is None else [nothing.name]
    own = judged_law(search, final, whole, along=False, seeds=seeds)
    if own is None:
        return Posterior((1.0,) * n, None)
    net = contender(search, whole, own).net
    empty = -np.inf if nothing is None else contender(search, none, nothing).net
    against = [empty]
    if n > 1:
        rests, seeds = [without(whole, i) for i in range(n)], [*seeds, own.name]
        laws = [judged_law(search, final, rest, along=True, seeds=seeds, instead=whole) for rest in rests]
        against = [-np.inf if law is None else contender(search, rest, law).net for rest, law in zip(rests, laws)]
    chances = (
        expit(net - np.logaddexp(one, empty)) * form_holds(effect, own.left, search.tolerance)
        for one, effect in zip(against, final.effects)
    )
    return Posterior(tuple(map(float, chances)), own)


def let_stand(search: OdeSearch, final: Evidence) -> tuple[Evidence, Posterior]:
    """Let the set stand that is likeliest beside a law, without effects that the tolerance does not need: it, and its posterior.

    Where a set does not stand, the smaller ones that stood in the search are asked, the largest first, if they close the gap up to the
    tolerance: the set won by likelihood alone, which forms that are nearly exact cannot give.
    """
    smaller = [search.stood.get(n) for n in range(len(final.effects) - 1, 0, -1)]
    fallen: set[frozenset] = set()
    found = _likeliest(search, final, fallen)
    for one in smaller:
        if found[0].effects or one is None or one.fit.cost > search.tolerated_cost:
            break
        if frozenset(one.keys) not in fallen:
            found = _likeliest(search, search.stand(one), fallen)
    return found


def _likeliest(search: OdeSearch, final: Evidence, fallen: set[frozenset]) -> tuple[Evidence, Posterior]:
    """What stands of a set, or in its place, and its posterior; keys of sets that do not stand are added to ``fallen``.

    Effects in whose place a law does as well are taken out, the least probable first, and those that only correct the form of
    another. Another effect takes the place of one where that is likelier; this is also asked of an effect that is needed and whose
    magnitude the data do not show, before it is taken out. Names that leave most of the gap in the data that they were fitted to close
    no more of it on runs left out: they are not weighed.
    """
    final = needed_only(search, final)
    stood: dict[frozenset, tuple[Evidence, Posterior]] = {}
    if closes_by_size(final, search.tolerated_cost):
        law = judged_law(search, final, final.candidate, along=False)
        return final, Posterior((1.0,) * len(final.effects), law)
    while final.effects and not leaves_most(final, search.gap_cost):
        posterior, keys = weigh(search, final), frozenset(final.candidate.keys)
        falling, for_another = _that_falls(search, final, posterior)
        if falling is None or for_another:
            if posterior.law is None:
                return final, posterior
            own, others = contenders(search, final, posterior.law, fallen)
            if falling is None:
                stood[keys] = final, _beside_others(search, final, posterior, own, others)
            else:  # it does not stand; what does as much may
                fallen.add(keys)
            best = _best(search, final, own, [one for one in others if frozenset(one.candidate.keys) not in stood])
            if best is not own:
                final = search.stand(best.candidate)
                continue
            if falling is None:
                return _sure_part(search, *stood[keys])
        fallen.add(keys)
        if stood:  # what seemed likelier than a set that stood does not stand itself
            final = stood.popitem()[1][0]
            search.stand(final.candidate)
        else:
            fewer = search.without(final.candidate, falling)
            rest = None if fewer is None or not fewer.effects else taken(search, fewer, final)
            # fitted again, what is left may have moved to where no data show it
            if rest is None or not search.plausible(rest.candidate):
                return _nothing(search, Posterior((), None, rejected=final))
            final = rest
    return _nothing(search, Posterior((), None, too_far=tuple(map(name_of, final.effects))))


def _that_falls(search: OdeSearch, final: Evidence, posterior: Posterior) -> tuple[int | None, bool]:
    """The effect of a set that does not stand, None where all do; and whether the set needs it, or another one that does as much.

    It is the least probable where a law does as well in its place, or one whose magnitude the data do not show. A correction of a form
    closes less than what is needed.
    """
    least, several = int(np.argmin(posterior.probabilities)), len(final.effects) > 1
    if posterior.probabilities[least] < (CERTAIN_NAME if several else LEAST_ALONE):
        return least, False
    redundant = redundant_effect(final) if several and final.left > SETTLED else None
    fewer = None if redundant is None else search.without(final.candidate, redundant)
    return redundant, fewer is not None and is_needed(final.fit.cost, fewer.fit.cost, search.tolerated_cost)


def _nothing(search: OdeSearch, why: Posterior) -> tuple[Evidence, Posterior]:
    """No name stands."""
    search.final = search.fitted_null
    return search.fitted_null, why


def _best(search: OdeSearch, final: Evidence, own: Contender, others: Sequence[Contender]) -> Contender:
    """What stands, or another set that is preferred to it and still is when it is polished, and that the data show then."""
    best = preferred(own, others)
    if best is own:
        return own
    polished = simplify(search, search.polish(best.candidate))
    if not search.plausible(polished):
        return _best(search, final, own, [one for one in others if one is not best])
    return preferred(own, judged_contender(search, final, polished, [own.law.name]))


def _beside_others(
    search: OdeSearch, final: Evidence, posterior: Posterior, own: Contender, others: Sequence[Contender]
) -> Posterior:
    """A posterior with the sets that are as likely, and with those elsewhere."""
    near = [one for one in others if one.net > own.net - NATS_THAT_SETTLE]
    return replace(_of_classes(posterior, own, near), elsewhere=tuple(elsewhere(search, final, own)))


def _sure_part(search: OdeSearch, final: Evidence, posterior: Posterior) -> tuple[Evidence, Posterior]:
    """A set without the effects that are not certain, where others are: what they close is what remains. Else the set itself."""
    keys = final.candidate.keys
    chances = [one * _not_elsewhere(key, keys, posterior) for one, key in zip(posterior.probabilities, keys)]
    if not min(chances) < CERTAIN_NAME <= max(chances):
        return final, posterior
    fewer = search.without(final.candidate, int(np.argmin(chances)))
    if fewer is not None and fewer.effects:
        sure = let_stand(search, taken(search, fewer, final))
        if sure[0].effects:
            return sure
    search.stand(final.candidate)
    return final, posterior


def _not_elsewhere(key: tuple, keys: Sequence[tuple], posterior: Posterior) -> float:
    """Probability of one effect of a set (by ``key`` of its ``keys``) against the sets elsewhere that hold no member of its class."""
    members = {key}.union(*(set(one.keys).difference(keys) for one in posterior.as_likely if key not in one.keys))
    return float(softmax([0.0, *(more for held, more in posterior.elsewhere if not held & members)])[0])


def _of_classes(posterior: Posterior, own: Contender, near: Sequence[Contender]) -> Posterior:
    """With the other members of the class of each effect, which count for it as far as they are likely."""
    probabilities = []
    for key, chance in zip(own.candidate.keys, posterior.probabilities):
        members = [0.0, *(one.net - own.net for one in near if key not in one.candidate.keys)]
        probabilities.append(float(expit(logit(chance) + logsumexp(members))))
    return replace(posterior, probabilities=tuple(probabilities), as_likely=tuple(one.candidate for one in near))


def law_left_beside(search: OdeSearch, final: Evidence) -> LawLeft | None:
    """The law without a name beside what is named; beside no effect at all along the measured path.

    That path holds the disturbance, and a law of it may only tell how the disturbance goes on. A law that is certain there must be so
    along the free run too, which holds none.
    """
    null = search.fitted_null
    if final.effects:
        law = judged_law(search, final, final.candidate, along=False)
        return None if law is None else law.left
    problem = null.candidate.problem
    free = LawQuestion(null.candidate, (null.noise, problem.quiet(null.noise)))
    law = law_along(search, replace(free, path=search.x))
    if law is None or law.left.gain <= CERTAIN:
        return None if law is None else law.left
    along = law_along(search, free)
    return law.left if along is None or along.left.gain > CERTAIN else along.left
