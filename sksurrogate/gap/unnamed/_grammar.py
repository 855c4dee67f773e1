"""The grammar of formulae: which terms are tried for a missing law, with a few values of their constants, and what each costs.

A term is a product of shapes of drivers. The price of a term is what it takes to write it down, in nats: the choice of every
shape among all and of every driver among those at hand. Constants and coefficients are paid by the evidence, ``ln(N)/2`` each.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations

import numpy as np

from sksurrogate.effects._formula import SHAPES, Factor, Term, signal_names, signal_of
from sksurrogate.gap.unnamed._drivers import Drivers, past_name
from sksurrogate.gap.unnamed._families import factors_of

#: Drivers of which products are formed.
MOST_OF_PRODUCTS = 6
#: Shapes whose product with a square is tried: a rate that depends on a temperature, an opening.
OF_SQUARES = ("v", "sign", "activated", "exp", "saturating", "tanh")
#: Shapes that are multiplied by their own driver: v exp(-v^2), v^2 sign(v).
TIMES_ITSELF = ("bell", "exp", "tanh", "size")
#: Shapes of a driver that may begin at a time.
BEGINNING = ("v", "square", "drag")
#: Differences of drivers are drivers too where there are no more than so many of them.
MOST_OF_DIFFERENCES = 5


def structure(terms: Sequence[Term]) -> tuple[tuple[tuple[str, str], ...], ...]:
    """Shapes and drivers of a formula, without its constants."""
    return tuple(sorted(tuple(sorted((f[0], f[1].partition("#")[0]) for f in term.factors)) for term in terms))


def price_of(terms: Sequence[Term], n_drivers: int) -> float:
    """What it takes to write a formula down, in nats; the order of its terms and factors does not matter.

    >>> bool(np.isclose(price_of([Term((("square", "v", 0.0, 0.0),))], 2), np.log(2 * len(SHAPES))))
    True
    """
    each = np.log(len(SHAPES)) + np.log(max(n_drivers, 1))
    pieces = [term for term in terms if term.factors and term.factors[0][0] == "spline"]
    return float(sum(each * len(term.factors) for term in terms if term not in pieces) + (each if pieces else 0.0))


def terms_of(drivers: Drivers) -> list[Term]:
    """Terms of one driver and of two, plain ones first, and what begins at one of the changes."""
    now = drivers.present
    late = [name for name in drivers.moving if name in drivers.late]
    single = {name: list(factors_of(name, drivers.signals[name])) for name in now}
    apart, first = _differences(now, drivers), now[:MOST_OF_PRODUCTS]
    begins = [Term(), *(Term((_plain(shape, name),)) for name in first for shape in BEGINNING)]
    return [
        Term(),
        *(Term((factor,)) for name in now for factor in single[name]),
        *(Term((f, _plain("v", name))) for name in now for f in single[name] if f[0] in TIMES_ITSELF),
        *_products(single, first),
        *_under_a_load({name: single[name] for name in first}, apart),
        *(Term((factor,)) for factors in apart.values() for factor in factors if factor[0] != "v"),
        *(term for name in late for term in _of_the_past(name, drivers.signals[name], now)),
        *(Term((*term.factors, ("after", "t", float(c), 0.0))) for c in drivers.changes for term in begins),
    ]


def _products(single: Mapping[str, Sequence[Factor]], names: Sequence[str]) -> Iterator[Term]:
    """Two drivers, one of them in any shape."""
    for i, a in enumerate(names):
        yield from (Term((_plain("v", a), _plain("v", b))) for b in names[i + 1 :])
        for b in names:
            if a != b:
                yield from (Term((factor, _plain("v", b))) for factor in single[a] if factor[0] != "v")
                yield from (Term((factor, _plain("square", b))) for factor in single[a] if factor[0] in OF_SQUARES)


def _under_a_load(single: Mapping[str, Sequence[Factor]], apart: Mapping[str, Sequence[Factor]]) -> Iterator[Term]:
    """The direction of one driver times the size of another, or of a difference of two: a friction that grows with a load."""
    sizes = [f for factors in (*single.values(), *apart.values()) for f in factors if f[0] == "size"]
    ways = [f for factors in single.values() for f in factors if f[0] == "sign"]
    yield from (Term((way, size)) for way in ways for size in sizes if way[1] not in signal_names(size[1]))


def _differences(names: Sequence[str], drivers: Drivers) -> dict[str, list[Factor]]:
    """Shapes of the difference of two drivers, of one unit where units are known; none of many drivers."""
    pairs = combinations(names, 2) if len(names) <= MOST_OF_DIFFERENCES else ()
    apart = [f"{a} - {b}" for a, b in pairs if drivers.comparable(a, b)]
    return {name: list(factors_of(name, signal_of(name, drivers.signals))) for name in apart}


def _of_the_past(name: str, z: np.ndarray, now: Sequence[str]) -> Iterator[Term]:
    """Shapes without thresholds of the recent past of a signal, and its product with the signal."""
    yield from (Term((f,)) for f in factors_of(name, z) if not SHAPES[f[0]].bounds or f[0] == "tanh")
    if past_name(name) in now:
        yield Term((_plain("v", name), _plain("v", past_name(name))))


def _plain(shape: str, name: str) -> Factor:
    """A factor without constants."""
    return shape, name, 0.0, 0.0
