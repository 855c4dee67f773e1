"""How probable a name is: among the rivals fitted in its place, none, and the likeliest law without a name."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sksurrogate.gap.decide._equivalence import Slot
from sksurrogate.gap.fit._problem import Candidate
from sksurrogate.gap.search._search import EQUAL, Search

__all__ = ["probabilities"]

#: What is left of a probability where the verdict is unknown: the names leave too much, whatever their likelihood.
UNKNOWN = 0.5


def probabilities(
    search: Search, final: Candidate, slots: Sequence[Slot], unnamed: float, unknown: bool
) -> list[float]:
    """Probability of each named effect, by penalised likelihood.

    Parameters
    ----------
    search : Search
    final : Candidate
    slots : sequence of Slot
    unnamed : float
        ``2 (L - L_final)`` of the likeliest law without a name, its parameters paid; -inf where none was looked at.
    unknown : bool
        Whether the verdict is unknown.
    """
    own = search.score(final)
    none = search.score(search.null.candidate) if search.null is not None else -np.inf
    out = []
    for slot in slots:
        tied = [_score(search, rival, final) for rival in slot.twins]
        values = np.array([own, *tied, *_others(search, final, slot), none, own + 0.5 * unnamed])
        weight = np.exp(values - np.max(values))
        out.append(float(weight[0] / weight.sum()) * (UNKNOWN if unknown else 1.0))
    return out


def _score(search: Search, rival: Candidate, final: Candidate) -> float:
    """Of a tied rival; one that was not given a noise of its own predicts the same as the final one."""
    if search.own(rival) is not None:
        return search.score(rival)
    return search.score(final) - 0.5 * (rival.n_parameters - final.n_parameters) * float(np.log(search.n_values))


def _others(search: Search, final: Candidate, slot: Slot) -> list[float]:
    """Scores of the rivals in one slot that the data reject, at least :data:`EQUAL` below the final one."""
    own = final.effects[slot.index].key
    beside = frozenset(final.keys) - {own}
    taken = {own, *(rival.effects[-1].key for rival in slot.twins)}
    scores = [
        search.score(rival)
        for keys, rival in search.fitted.items()
        if len(keys) == len(final.keys) and beside < keys and not (keys - beside) & taken
    ]
    return [min(score, search.score(final) - EQUAL) for score in scores if np.isfinite(score)]
