"""Shapes of one driver that a formula is built of: a table of families, each with the drivers that it suits and its constants."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import product
from typing import NamedTuple

import numpy as np

from sksurrogate.effects._formula import Factor

#: Width of a kink, over the spread of its driver: below what data resolve, above what an integrator notices.
KINK = 0.005
#: A driver takes both signs where each side of zero reaches this share of its spread, else one: what it reaches beyond is noise.
OTHER_SIDE = 0.2
#: Largest over smallest value of a driver from which on a reciprocal is more than a straight line.
BENT = 1.3
#: Least range, and largest value, of a driver that may be an angle.
ANGLE = (1.0, 30.0)
#: Quantiles of a driver at which thresholds, and of its size at which limits and dead zones, are tried.
CUTS, LIMITS = (0.1, 0.25, 0.4, 0.55, 0.7, 0.82, 0.92), (0.15, 0.3, 0.5, 0.7, 0.85)
#: Scales of a bend, over the spread (both signs) or the median (one sign); of an activation and of an exponential.
BENDS, HALVES, ACTIVATIONS, RATES = (
    (0.15, 0.4, 1.0, 2.5),
    (0.1, 0.35, 1.0, 3.0),
    (1.0, 3.0, 8.0),
    (-2.5, -1.0, -0.4, 0.4, 1.0, 2.5),
)
#: Exponents of a power and of a Hill curve.
EXPONENTS, STEEPNESS = (0.5, 1.5, 2.5), (2.0, 4.0)
#: Angles that a range spans, and phases of a swing.
ANGLES, PHASES = (1.5, 3.0, 5.0, 8.0, 12.0, 18.0, 26.0), (0.0, 0.8, 1.6, 2.4)
#: Widths of a bell and of a switch, over the spread.
BELLS, SWITCHES = (0.3, 0.8, 2.0), (0.1, 0.4)

#: Constants of a factor behind its driver.
Constants = tuple[float, ...]
PLAIN: list[Constants] = [(0.0, 0.0)]


class Driver(NamedTuple):
    """What a signal that drives a law covers."""

    spread: float
    reach: float  #: Largest less smallest value
    middle: float  #: Median of its size
    width: float  #: Of a kink
    both: bool  #: Takes both signs
    positive: bool
    bent: bool  #: Covers so much of a range above zero that reciprocals are no straight lines
    angular: bool  #: May be an angle
    cuts: list[float]  #: Thresholds
    limits: list[float]  #: Levels of its size

    @classmethod
    def of(cls, z: np.ndarray) -> Driver:
        """A signal (n_samples,)."""
        size, spread, reach, low, high = np.abs(z), float(np.std(z)), float(np.ptp(z)), z.min(), z.max()
        both = bool(low < -OTHER_SIDE * spread and high > OTHER_SIDE * spread)
        positive = bool(high > 0.0 and low > -OTHER_SIDE * spread)
        bent, angular = bool(low > 0.0 and high > BENT * low), bool(reach > ANGLE[0] and size.max() < ANGLE[1])
        cuts, limits = (np.unique(np.quantile(v, q)).tolist() for v, q in ((z, CUTS), (size, LIMITS)))
        middle = float(np.median(size))
        return cls(
            spread, reach, middle, KINK * spread, both, positive, bent, angular, cuts, [c for c in limits if c > 0]
        )


class Family(NamedTuple):
    """Shapes with the same constants."""

    shapes: tuple[str, ...]
    suits: Callable[[Driver], bool]
    constants: Callable[[Driver], list[Constants]]


def multiples_of(scales: Constants, unit: Callable[[Driver], float]) -> Callable[[Driver], list[Constants]]:
    """One constant, some scales times a size of the driver."""
    return lambda d: [(k * unit(d), 0.0) for k in scales]


#: In the order in which they are tried: of two that move the outputs alike the first stays.
FAMILIES = (
    Family(("v", "square", "cube"), lambda d: True, lambda d: PLAIN),
    Family(("drag", "sign", "root", "size"), lambda d: d.both, lambda d: [(0.0, d.width)]),
    Family(("tanh", "bending"), lambda d: d.both, multiples_of(BENDS, lambda d: d.spread)),
    Family(("clip", "dead_zone"), lambda d: d.both, lambda d: [(c, d.width) for c in d.limits]),
    Family(("power",), lambda d: d.both or d.positive, lambda d: [(k, 0.0) for k in EXPONENTS]),
    Family(
        ("logarithm", "fading", "resonant"),
        lambda d: (d.both or d.positive) and d.middle > 0,
        multiples_of(HALVES, lambda d: d.middle),
    ),
    Family(("flow",), lambda d: d.positive, lambda d: PLAIN),
    Family(("saturating",), lambda d: d.positive, multiples_of(HALVES, lambda d: d.middle)),
    Family(("hill",), lambda d: d.positive, lambda d: [(k * d.middle, 0.0, n) for k, n in product(HALVES, STEEPNESS)]),
    Family(("inverse", "inverse_square"), lambda d: d.bent, lambda d: PLAIN),
    Family(("inhibited",), lambda d: d.bent, multiples_of(HALVES, lambda d: d.middle)),
    Family(("activated",), lambda d: d.bent, multiples_of(ACTIVATIONS, lambda d: d.middle)),
    Family(("sine", "cosine"), lambda d: d.angular, lambda d: PLAIN),
    Family(("wave",), lambda d: d.both, lambda d: [(k / d.reach, 0.0) for k in ANGLES]),
    Family(("swing",), lambda d: True, lambda d: [(k / d.reach, 0.0, phase) for k, phase in product(ANGLES, PHASES)]),
    Family(("exp",), lambda d: True, multiples_of(RATES, lambda d: d.spread)),
    Family(("above", "below", "beyond"), lambda d: True, lambda d: [(c, d.width) for c in d.cuts]),
    Family(("bell",), lambda d: True, lambda d: [(c, 0.0, k * d.spread) for c, k in product(d.cuts, BELLS)]),
    Family(("switch",), lambda d: True, lambda d: [(c, 0.0, k * d.spread) for c, k in product(d.cuts, SWITCHES)]),
)


def factors_of(name: str, z: np.ndarray) -> Iterator[Factor]:
    """All shapes of a driver (n_samples,) with values of their constants; none where it stands still.

    >>> [shape for shape, *_ in factors_of("v", np.linspace(-1.0, 1.0, 9))][:5]
    ['v', 'square', 'cube', 'drag', 'sign']
    """
    driver = Driver.of(z)
    if driver.spread > 0.0:
        for family in FAMILIES:
            if family.suits(driver):
                for shape, constants in product(family.shapes, family.constants(driver)):
                    yield (shape, name, *constants)  # type: ignore[misc]
