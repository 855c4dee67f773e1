"""The numbers in the shape of effects, each as the data show it: how soft, how curved, how much faster one way, when it levels off."""

from __future__ import annotations

from sksurrogate.gap.fit._evidence import C
from sksurrogate.gap.search._curved_dependence import curved_where_nearer
from sksurrogate.gap.search._faster_one_way import faster_one_way_where_nearer
from sksurrogate.gap.search._levelling_drift import levelling_where_nearer
from sksurrogate.gap.search._soft_limits import soft_where_nearer, with_soft_limits


def in_shape(candidate: C, price: float) -> C:
    """A set whose effects have the shape that comes nearest to the data, where this gains more than a ``price`` (twice the log likelihood)."""
    for shaped in (with_soft_limits, curved_where_nearer, faster_one_way_where_nearer, levelling_where_nearer):
        candidate = shaped(candidate, price)
    return candidate


def in_first_shape(candidate: C, price: float) -> C:
    """The same of a set whose last effect was just added; a drift levels off later."""
    return faster_one_way_where_nearer(curved_where_nearer(soft_where_nearer(candidate), price), price)
