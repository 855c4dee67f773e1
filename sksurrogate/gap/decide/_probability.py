"""How probable a name is: the members of its class against the other effects in its place, beside a law without a name."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sksurrogate.gap.decide._equivalence import Slot
from sksurrogate.gap.fit._evidence import C
from sksurrogate.gap.search._base import EQUAL, BaseSearch

__all__ = ["probabilities"]


def probabilities(search: BaseSearch[C], final: C, slots: Sequence[Slot[C]], posterior: Sequence[float]) -> list[float]:
    """Probability that each effect, or one of its class, acts in the plant, whatever else acts.

    Parameters
    ----------
    search : BaseSearch
    final : BaseCandidate
    slots : sequence of Slot
    posterior : sequence of float
        Of each effect against none and against a law without a name in its place (:func:`weigh`).
    """
    own = search.score(final)
    out = []
    for slot, chance in zip(slots, posterior):
        ours = [own, *(_score(search, candidate, final) for candidate in slot.twins)]
        against = _others(search, final, slot)
        top = max([*ours, *against])
        for_it, in_all = (float(np.sum(np.exp(np.array(values) - top))) for values in (ours, [*ours, *against]))
        out.append(chance * for_it / in_all)
    return out


def _score(search: BaseSearch[C], candidate: C, final: C) -> float:
    """Of a tied candidate; one that was not given a noise of its own predicts the same as the final one."""
    if search.own(candidate) is not None:
        return search.score(candidate)
    return search.score(final) - 0.5 * (candidate.n_parameters - final.n_parameters) * float(np.log(search.n_values))


def _others(search: BaseSearch[C], final: C, slot: Slot[C]) -> list[float]:
    """Scores of the candidates in one slot that the data reject, at least :data:`EQUAL` below the final one."""
    own = final.effects[slot.index].key
    beside = frozenset(final.keys) - {own}
    taken = {own, *(candidate.effects[-1].key for candidate in slot.twins)}
    scores = [
        search.score(candidate)
        for keys, candidate in search.fitted.items()
        if len(keys) == len(final.keys) and beside < keys and not (keys - beside) & taken
    ]
    return [min(score, search.score(final) - EQUAL) for score in scores if np.isfinite(score)]
