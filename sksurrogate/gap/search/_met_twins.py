"""Sets meet the effects that do the same as some of theirs: one in the place of several names, and one in the place of another."""

from __future__ import annotations

import numpy as np

from sksurrogate.gap.fit._closeness import SETTLED
from sksurrogate.gap.fit._evidence import Evidence, estimate_noise
from sksurrogate.gap.fit._ode import OdeCandidate
from sksurrogate.gap.screen._twins import Twin, twins
from sksurrogate.gap.search._base import EQUAL
from sksurrogate.gap.search._expander import Expander
from sksurrogate.gap.search._nested import richer

#: Candidates fitted in the place of each effect of what stands, and of several.
MOST_MET = 6
#: A fit may find what the screen expects to leave so many times as much.
ABOUT = 1.5


def met_twins(search: Expander, found: Evidence[OdeCandidate]) -> Evidence[OdeCandidate]:
    """What stands once effects were fitted in the place of names that they do the same as.

    Several names may do together what one does: a search that adds names one by one sees it only beside the others. It stands in their
    place where they are not worth their number; in the place of one where it comes nearer to the data. Between names at the noise the
    posterior decides: here they meet.
    """
    named, alike = found.candidate, twins_of(search, found.candidate)
    for twin in [twin for twin in alike if len(twin.places) > 1][:MOST_MET]:
        one = with_twin(search, named, twin)
        if one is not None and not search.passes(named, _judged(search, one, found), True):
            return _stand_instead(search, one)
    for i in range(len(named.effects)):
        likelier = [twin for twin in alike if twin.places == (i,) and _may_be_likelier(search, named, twin)]
        for twin in likelier[:MOST_MET]:
            one = with_twin(search, named, twin)
            if one is not None and found.left > SETTLED and search.leads(_judged(search, one, found), named):
                return _stand_instead(search, one)
    return found


def twins_of(search: Expander, named: OdeCandidate) -> list[Twin]:
    """The effects that may do what some of a set do, the likeliest first; those of the last set are kept.

    Of those left for later the ones that imitate others; beside several at the noise all. Of the others none where simulations are dear, and
    none for a name alone: the search has fitted them in its place.
    """
    if search.last_twins is None or search.last_twins[0] is not named:
        several, late = len(named.effects) > 1, search.later_asked
        distant = several and search.judged[named].left < SETTLED
        near = (several or bool(search.problem.free)) and not search.frugal
        asked = [e for e in search.library if e.late or (distant if e.key in late else near)]
        others = [e for e in asked if e.key not in named.keys]
        found = twins(named, others, search.guess(named), about_as_much(named.fit.cost))
        search.last_twins = named, sorted(found, key=lambda twin: twin.left)
    return search.last_twins[1]


def about_as_much(cost: float) -> float:
    """The cost up to which a set leaves about as much as one of this cost."""
    return ABOUT * cost + 50.0 * EQUAL


def with_twin(search: Expander, named: OdeCandidate, twin: Twin) -> OdeCandidate | None:
    """A set with another effect in the place of those that it does the same as; None where it runs away, or does not show.

    A fit that cannot come near what the screen expects is abandoned.
    """
    rest, values = named.without_effect(*twin.places)
    n = len(values) - len(search.problem.free)
    start = np.concatenate([values[:n], twin.theta, values[n:]])
    one = named.problem.fit((*rest, twin.effect), start, named.states, open_steps=0, best=about_as_much(named.fit.cost))
    if one is None or not search.plausible(one):
        return None
    search.remember([one])
    return one


def _judged(search: Expander, one: OdeCandidate, found: Evidence[OdeCandidate]) -> OdeCandidate:
    """A set, its evidence under a noise of its own known."""
    return search.judge(estimate_noise(one, found.noise)).candidate


def _stand_instead(search: Expander, one: OdeCandidate) -> Evidence[OdeCandidate]:
    """What stands in the end where a set with a twin takes the place: the other names were chosen beside those that are gone."""
    search.later_asked.pop(one.effects[-1].key, None)
    chosen = search.polish(one)
    return met_twins(search, search.stand(search.swap(chosen) if len(chosen.effects) > 1 else chosen))


def _may_be_likelier(search: Expander, named: OdeCandidate, twin: Twin) -> bool:
    """Whether an effect in the place of one may be as likely, and is not known to be no nearer.

    Of one that contains the named one, what it adds has been found not to be needed.
    """
    # in the place of a name alone the search has fitted the likeliest already
    alone = len(named.effects) == 1 and twin.effect.key not in search.later_asked
    if alone or richer(twin.effect, named.effects[twin.places[0]]):
        return False
    rest = {key for i, key in enumerate(named.keys) if i not in twin.places}
    known = search.fitted.get(frozenset({twin.effect.key, *rest}))
    least = np.inf if known is None else known.fit.cost
    return twin.left < min(named.fit.cost + EQUAL, least - EQUAL)
