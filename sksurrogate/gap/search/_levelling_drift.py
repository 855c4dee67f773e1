"""When a drift levels off: its time constant, fitted by itself as other shapes of effects are."""

from __future__ import annotations

from functools import partial

import numpy as np

from sksurrogate.effects._levelling import Levelling
from sksurrogate.gap.fit._evidence import C
from sksurrogate.gap.search._softer import TIMES_APART, in_form, nearest_by_parabolas, worth

#: Time constant over the longest run of a drift that is straight to the data.
STRAIGHT = 16.0


def levelling_where_nearer(candidate: C, price: float) -> C:
    """A set whose drifts level off when that comes nearest to the data, where this gains more than a ``price`` (twice the log likelihood)."""
    for i, effect in enumerate(candidate.effects):
        if isinstance(effect, Levelling):
            straight = candidate if effect.levelling == 0.0 else with_time(candidate, np.inf, i)
            best = at_best_time(candidate, i)
            candidate = best if straight is None else worth(price, straight, best)
    return candidate


def at_best_time(candidate: C, i: int) -> C:
    """A set with the time constant of drift i that comes nearest to the data: its neighbours, then parabolas."""
    effect = candidate.effects[i]
    assert isinstance(effect, Levelling)
    own = STRAIGHT if effect.levelling == 0.0 else 1.0 / (effect.levelling * longest_run(candidate))
    tried, at = {own: candidate}, partial(with_time, candidate, i=i)
    return nearest_by_parabolas(tried, own / TIMES_APART, at, most=STRAIGHT)


def with_time(candidate: C, share: float, i: int) -> C | None:
    """A set whose drift i levels off with a share of the longest run as time constant; inf: it goes on."""
    return in_form(candidate, i, levelling=1.0 / (share * longest_run(candidate)))


def longest_run(candidate: C) -> float:
    """Duration of the longest run."""
    record = candidate.problem.record
    return float(record.dt * np.max(record.lengths))
