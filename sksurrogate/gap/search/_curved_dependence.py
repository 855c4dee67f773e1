"""How a parameter depends on a signal: in a straight line, exponentially, as one over a straight line, as a square root or as another power.

A rate of reaction is exponential in the temperature, a conductance one over a resistance that grows in proportion to it, a speed of sound
its root, a heat transfer the power 0.8 of a flow. Over a range in which the parameter doubles these are different curves.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sksurrogate.effects._parameter import ParameterDependence
from sksurrogate.effects._variable import driver_of
from sksurrogate.gap.fit._evidence import C
from sksurrogate.gap.search._softer import at_noise, in_form, nearest_by_parabolas, worth

#: Of an exponential and of one over a straight line, more and more curved upwards; of a square root. A straight line has 0.
UPWARDS, DOWNWARDS = (1.0, 2.0), (-1.0,)
#: The factor between the exponentials of two curvatures that are tried where none with a name is near enough.
BETWEEN = float(np.sqrt(np.e))


def curved_where_nearer(candidate: C, price: float) -> C:
    """A set whose dependences are as curved as the data show: where that gains more than a ``price`` (twice the log likelihood).

    First the curves that have a name, more and more curved as long as that leads nearer to the data; then those between and beyond
    them. Not asked at the noise.
    """
    for i, effect in enumerate(candidate.effects):
        if not isinstance(effect, ParameterDependence) or at_noise(candidate):
            continue
        if effect.curvature == 0.0:
            ways = (as_far_as_nearer(candidate, way, i) for way in (UPWARDS, DOWNWARDS))
            candidate = worth(price, candidate, min(ways, key=lambda one: one.fit.cost))
        if not at_noise(candidate):
            candidate = worth(price, candidate, between_curves(candidate, i))
    return candidate


def between_curves(candidate: C, i: int) -> C:
    """A set with the curvature of dependence i that comes nearest to the data."""
    effect = candidate.effects[i]
    assert isinstance(effect, ParameterDependence)
    own = float(np.exp(effect.curvature))

    def at(number: float) -> C | None:
        return with_curvature(candidate, float(np.log(number)), i)

    return nearest_by_parabolas({own: candidate}, own * BETWEEN, at, BETWEEN)


def as_far_as_nearer(candidate: C, curvatures: Sequence[float], i: int) -> C:
    """A set whose dependence i is more and more curved, as long as that leads nearer to the data."""
    nearest = candidate
    for curvature in curvatures:
        curved = with_curvature(candidate, curvature, i)
        if curved is None or curved.fit.cost >= nearest.fit.cost:
            break
        nearest = curved
    return nearest


def with_curvature(candidate: C, curvature: float, i: int) -> C | None:
    """A set fitted with another curvature of dependence i, from where it stands at the signal's mean; None where it breaks the arithmetic."""
    effect, place = candidate.effects[i], candidate.slice_of(i)
    assert isinstance(effect, ParameterDependence)
    mean = float(np.mean(driver_of(effect.variable, [candidate.signals[name] for name in effect.signals])))
    own = effect.as_curved(candidate.theta_of(i), mean, curvature)
    if own is None:
        return None
    theta = candidate.fit.theta.copy()
    theta[place][: len(own)] = own
    return in_form(candidate, i, theta, curvature=curvature)
