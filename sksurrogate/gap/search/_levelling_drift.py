"""When a drift levels off: its time constant, fitted by itself as other shapes of effects are."""

from __future__ import annotations

from functools import partial

import numpy as np

from sksurrogate.effects._levelling import Levelling
from sksurrogate.gap.fit._evidence import C
from sksurrogate.gap.search._restart import WORTH_A_FIT
from sksurrogate.gap.search._softer import MOST_BETWEEN, in_form, lowest, worth

#: Time constant over the longest run of a drift that is straight to the data; the factor between two that are tried.
STRAIGHT, TIMES_APART = 16.0, 3.0


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
    share = own / TIMES_APART
    for _ in range(MOST_BETWEEN):
        found = at(share)
        if found is None:
            break
        before, tried[share] = min(one.fit.cost for one in tried.values()), found
        costs = {s: one.fit.cost for s, one in tried.items()}
        share = lowest(costs)
        if share in tried:  # at an end: further that way, as long as the drift is none that is straight
            share *= TIMES_APART if share == max(tried) else 1.0 / TIMES_APART
            if share > STRAIGHT or min(costs.values()) == found.fit.cost > before - WORTH_A_FIT:
                break
    return min(tried.values(), key=lambda one: one.fit.cost)


def with_time(candidate: C, share: float, i: int) -> C | None:
    """A set whose drift i levels off with a share of the longest run as time constant; inf: it goes on."""
    return in_form(candidate, i, levelling=1.0 / (share * longest_run(candidate)))


def longest_run(candidate: C) -> float:
    """Duration of the longest run."""
    record = candidate.problem.record
    return float(record.dt * np.max(record.lengths))
