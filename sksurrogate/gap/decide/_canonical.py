"""Which of several exact twins is named: one rule that no unit and no order of the states can change."""

from __future__ import annotations

from dataclasses import replace

from sksurrogate.effects._catalogue import CATALOGUE
from sksurrogate.effects._effect import BaseEffect
from sksurrogate.gap.decide._equivalence import Slot, equivalents
from sksurrogate.gap.decide._posterior import Posterior
from sksurrogate.gap.fit._evidence import C, estimate_noise
from sksurrogate.gap.search._base import BaseSearch

__all__ = ["canonical_classes", "rank"]

#: Places in the order in which twins are named: what the simulator has already comes first.
_ORDER_OF_KINDS = ("parameter", "state", "input", "output")
_PLACE = {name: i for i, name in enumerate(CATALOGUE)}


def rank(effect: BaseEffect) -> tuple[int, int, int, str, str, str]:
    """What twins are ordered by: fewest parameters, the order of places and of the catalogue, then the names themselves.

    Examples
    --------
    >>> from sksurrogate.effects._input import InputBias
    >>> from sksurrogate.effects._sensor import SensorBias
    >>> rank(InputBias("valve")) < rank(SensorBias("level"))
    True
    """
    kind = _ORDER_OF_KINDS.index(effect.kind) if effect.kind in _ORDER_OF_KINDS else len(_ORDER_OF_KINDS)
    place = _PLACE.get(effect.name, len(_PLACE))
    return len(effect.parameters), kind, place, effect.name, str(effect.location), effect.variable or ""


def canonical_classes(search: BaseSearch[C], posterior: Posterior) -> tuple[list[Slot[C]], Posterior]:
    """The class of every named effect; where an exact twin comes first by :func:`rank`, that is what stands, and is settled.

    Which of two twins a search meets first hangs on rounding, and so on the unit of time and on the order of the states.

    Parameters
    ----------
    search : BaseSearch
        Its ``final`` may become another.
    posterior : Posterior
        Of what stands.

    Returns
    -------
    slots : list of Slot
        In the order of the effects that stand then.
    posterior : Posterior
        In the same order.
    """
    final = search.final or search.fitted_null
    slots, kept = equivalents(search, final, posterior.as_likely), list(posterior.probabilities)
    for own in final.effects:
        i = [effect.key for effect in final.effects].index(own.key)
        first = _first_twin(slots[i], own)
        if first is None or slots[i].own is None:
            continue
        final = search.final = search.judge(estimate_noise(first, final.noise, final.curvature, max_iterations=8))
        search.richer.setdefault(first.effects[-1].key, []).extend(search.richer.get(own.key, []))
        order = [*(k for k in range(len(slots)) if k != i), i]  # the twin stands last in its candidate
        slots = [replace(slots[k], index=n) for n, k in enumerate(order)]
        slots[-1] = _seen_from(slots[-1], first)
        kept = [kept[k] for k in order] if kept else kept
    search.settle()
    return slots, replace(posterior, probabilities=tuple(kept))


def _first_twin(slot: Slot[C], own: BaseEffect) -> C | None:
    """The exact twin that comes before the named effect; None where that is the first itself."""
    exact = [twin for twin, same in zip(slot.twins, slot.identical) if same and rank(twin.effects[-1]) < rank(own)]
    return min(exact, key=lambda twin: rank(twin.effects[-1]), default=None)


def _seen_from(slot: Slot[C], twin: C) -> Slot[C]:
    """The same class with a twin as the named effect."""
    assert slot.own is not None
    others = [(one, same) for one, same in zip(slot.twins, slot.identical) if one is not twin]
    return replace(
        slot, twins=[slot.own, *(one for one, _ in others)], identical=[True, *(same for _, same in others)], own=twin
    )
