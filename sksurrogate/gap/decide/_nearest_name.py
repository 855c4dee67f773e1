"""Which effect of the catalogue comes nearest to a law that has no name."""

from __future__ import annotations

from sksurrogate.effects._effect import BaseEffect
from sksurrogate.gap.decide._one_curve import LARGEST_CORRECTION, is_at
from sksurrogate.gap.fit._evidence import C
from sksurrogate.gap.results._law import Law
from sksurrogate.gap.search._base import BaseSearch
from sksurrogate.gap.unnamed._law_evidence import place_and_signal


def is_like(effect: BaseEffect, law: Law) -> bool:
    """Whether an effect acts at the place of a law, driven by a signal of it.

    >>> from sksurrogate.effects import CATALOGUE, LawEffect
    >>> law = Law("force", "input", ("force",), LawEffect("force"), {}, {})
    >>> [is_like(CATALOGUE[name](at), law) for name, at in (("input_saturation", "force"), ("sensor_gain", "force"))]
    [True, False]
    """
    return is_at(effect, law) and not set(place_and_signal(effect)[1].split("*")).isdisjoint(law.variables)


def nearest_name(search: BaseSearch[C], law: Law) -> C | None:
    """The single effect that comes nearest, fitted; None where each leaves more of the gap than a correction of its form may be."""
    alone = [one for keys, one in search.fitted.items() if len(keys) == 1 and is_like(one.effects[0], law)]
    nearest = min(alone, key=lambda one: one.fit.cost, default=None)
    return nearest if nearest is not None and nearest.fit.cost < LARGEST_CORRECTION**2 * search.tolerated_cost else None
