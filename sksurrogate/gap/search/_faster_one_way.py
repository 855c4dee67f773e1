"""Actuators that fall faster than they rise, or slower: a valve with a spring, a heater that cools by itself, a muscle that relaxes."""

from __future__ import annotations

from functools import partial

import numpy as np

from sksurrogate.effects._followers import Follower
from sksurrogate.gap.fit._evidence import C
from sksurrogate.gap.search._softer import TIMES_APART, at_noise, in_form, nearest_by_parabolas, worth

#: The factor between two that are tried where one is fitted further.
FURTHER_APART = 1.1


def faster_one_way_where_nearer(candidate: C, price: float) -> C:
    """A set whose actuators fall faster than they rise, or slower, where that gains more than a ``price`` (twice the log likelihood).

    Where they do already, it is fitted further. Not asked at the noise.
    """
    for i, effect in enumerate(candidate.effects):
        if isinstance(effect, Follower) and not at_noise(candidate):
            own = effect.times_faster
            tried, apart = {own: candidate}, FURTHER_APART if effect.falling else TIMES_APART
            nearest = nearest_by_parabolas(tried, own * apart, partial(falling_faster, candidate, i), apart)
            candidate = nearest if effect.falling else worth(price, candidate, nearest)
    return candidate


def falling_faster(candidate: C, i: int, times: float) -> C | None:
    """A set whose actuator i falls so many times as fast as it rises, fitted from where both together are as fast as they were."""
    theta, effect = candidate.fit.theta.copy(), candidate.effects[i]
    assert isinstance(effect, Follower)
    place = candidate.slice_of(i)
    both = np.sqrt(times / effect.times_faster)
    theta[place][0] *= both if effect.parameters[0].unit == "time" else 1.0 / both
    return in_form(candidate, i, theta, falling=float(np.log(times)))
