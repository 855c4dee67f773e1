"""What these data cannot tell apart: the candidates that could stand in the place of each name."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Generic

import numpy as np

from sksurrogate.gap.fit._backend import BaseCandidate
from sksurrogate.gap.fit._evidence import C, Evidence, estimate_noise, judged_under
from sksurrogate.gap.search._base import EQUAL, BaseSearch
from sksurrogate.gap.search._nested import richer

__all__ = ["Slot", "equivalents"]

#: Candidates further than this under the final noise are not judged under their own; nor are more than this many.
MAY_CATCH_UP, MOST_JUDGED = 40.0, 8
#: Squares of errors over the noise within which the named effect, fitted as its candidates are, came as near again.
CLOSE = 0.5
#: Nats by which a form with more parameters may be less likely than the named one and yet be of its class.
NEARLY_AS_LIKELY = 1.0
#: Outputs closer than this share of the noise are the same prediction.
SAME_PREDICTION = 0.02


@dataclass(frozen=True, eq=False)
class Slot(Generic[C]):
    """One named effect and the candidates that could stand in its place.

    Attributes
    ----------
    index : int
    twins : list of BaseCandidate
        Candidates with another effect in this slot that these data cannot reject.
    identical : list of bool
        Whether the prediction of each twin is the same within a fraction of the noise.
    own : BaseCandidate or None
        With the named effect itself in the last place; None where it was not fitted so.
    """

    index: int
    twins: list[C]
    identical: list[bool]
    own: C | None = None


def equivalents(search: BaseSearch[C], final: Evidence[C], as_likely: Sequence[Any] = ()) -> list[Slot[C]]:
    """Refit every other candidate in each slot under the final noise model; those within :data:`EQUAL` are its class.

    So are sets that are ``as_likely`` beside a law of their own.
    """
    return [_with_as_likely(_slot(search, final, i), final, as_likely) for i in range(len(final.effects))]


def _with_as_likely(slot: Slot[C], final: Evidence[C], as_likely: Sequence[Any]) -> Slot[C]:
    """The class of one slot with the other effects that are as likely in its place."""
    beside = set(final.candidate.keys) - {final.effects[slot.index].key}
    known = {final.effects[slot.index].key, *(twin.effects[-1].key for twin in slot.twins)}
    more = [one for one in as_likely if set(one.keys[:-1]) == beside and one.keys[-1] not in known]
    identical = [predicts_the_same(one, final) for one in more]
    return replace(slot, twins=[*slot.twins, *more], identical=[*slot.identical, *identical])


def _slot(search: BaseSearch[C], final: Evidence[C], i: int) -> Slot[C]:
    """The class of one slot."""
    named, own = final.candidate, final.effects[i].key

    def worth(candidate: C) -> float:
        return judged_under(candidate, [final.noise]).log_likelihood - 0.5 * search.prior_cost(candidate)

    level, found, itself = worth(named), [], named if named.keys[-1] == own else None
    for candidate in search.in_place_of(final, i):
        value = worth(candidate)
        if candidate.effects[-1].key != own:
            found.append((value, candidate))
        elif candidate.fit.cost < final.fit.cost + CLOSE:
            # Readings in steps have slopes that promise what no fit keeps.
            level, itself = min(level, value), itself or candidate
    found = _with_own_noise(search, final, level, found)
    twins, identical = [], []
    size = len(final.effects[i].parameters)
    for value, candidate in found:
        same = predicts_the_same(candidate, final)
        # With more parameters a form must be as likely, and predict something else than a limit that is never reached.
        more = len(candidate.effects[-1].parameters) > size
        if more and (same or value < level - NEARLY_AS_LIKELY):
            if richer(candidate.effects[-1], final.effects[i]):
                search.richer.setdefault(final.effects[i].key, []).append(candidate.effects[-1].key)
        else:
            twins.append(candidate)
            identical.append(same)
    return Slot(i, twins, identical, itself)


def predicts_the_same(candidate: BaseCandidate, final: Evidence) -> bool:
    """Whether no output differs by more than :data:`SAME_PREDICTION` of its noise."""
    apart = np.sqrt(np.mean((candidate.fit.y - final.fit.y) ** 2, axis=1)) / final.noise.sigma
    return bool(np.max(apart) < SAME_PREDICTION)


def _with_own_noise(
    search: BaseSearch[C], final: Evidence[C], level: float, found: list[tuple[float, C]]
) -> list[tuple[float, C]]:
    """The candidates within :data:`EQUAL`, best first; near ones are judged under their own noise, as the final candidate is.

    Those that predict the same, with free parameters as likely, are in it whatever a force or an initial state would do.
    """
    found.sort(key=lambda item: -item[0])
    judged = []
    for rank, (value, candidate) in enumerate(found):
        missing = 2.0 * (level - value)
        if EQUAL < missing <= MAY_CATCH_UP and rank < MOST_JUDGED:
            again = search.judge(estimate_noise(candidate, final.noise, final.curvature, max_iterations=8))
            value = max(value, again.log_likelihood - 0.5 * search.prior_cost(candidate))
        cheap = search.prior_cost(candidate) <= search.prior_cost(final.candidate) + EQUAL
        if 2.0 * (level - value) <= EQUAL or (cheap and predicts_the_same(candidate, final)):
            judged.append((value, candidate))
    return sorted(judged, key=lambda item: -item[0])
