"""The grammar of formulae: which terms are tried for a missing law, with a few values of their constants, and what each costs.

A term is a product of shapes of drivers. The price of a term is what it takes to write it down, in nats: the choice of every
shape among all and of every driver among those at hand. Constants and coefficients are paid by the evidence, ``ln(N)/2`` each.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from sksurrogate.effects._formula import SHAPES, Factor, Term, signal_of
from sksurrogate.gap.unnamed._channel import Channel
from sksurrogate.gap.unnamed._drivers import Drivers, past_name

#: Width of a kink, over the spread of its driver: below what data resolve, above what an integrator notices.
KINK = 0.005
#: Quantiles of a driver at which thresholds, and of its size at which limits and dead zones, are tried.
CUTS, LIMITS = (0.1, 0.25, 0.4, 0.55, 0.7, 0.82, 0.92), (0.15, 0.3, 0.5, 0.7, 0.85)
#: Scales of a bend, over the spread (both signs) or the median (one sign).
BENDS, HALVES = (0.15, 0.4, 1.0, 2.5), (0.1, 0.35, 1.0, 3.0)
#: Angles that a range spans.
ANGLES = (1.5, 3.0, 5.0, 8.0, 12.0, 18.0, 26.0)
#: Drivers of which products are formed; shapes of the second factor.
MOST_OF_PRODUCTS = 6
#: Shapes whose product with a square is tried: a rate that depends on a temperature, an opening.
OF_SQUARES = ("v", "activated", "exp", "saturating", "tanh")
#: Shapes of a driver that may begin at a time.
BEGINNING = ("v", "square", "drag")
#: Differences of drivers are drivers too where there are no more than so many of them.
MOST_OF_DIFFERENCES = 5
#: A driver takes both signs where each side of zero reaches this share of its spread, else one: what it reaches beyond is noise.
OTHER_SIDE = 0.2


def structure(terms: Sequence[Term]) -> tuple[tuple[tuple[str, str], ...], ...]:
    """Shapes and drivers of a formula, without its constants."""
    return tuple(sorted(tuple(sorted((f[0], f[1].partition("#")[0]) for f in term.factors)) for term in terms))


def price_of(terms: Sequence[Term], n_drivers: int) -> float:
    """What it takes to write a formula down, in nats; the order of its terms and factors does not matter.

    Examples
    --------
    >>> round(float(price_of([Term((("square", "v", 0.0, 0.0),))], 2) - np.log(2 * len(SHAPES))), 9)
    0.0
    """
    each = np.log(len(SHAPES)) + np.log(max(n_drivers, 1))
    pieces = [term for term in terms if term.factors and term.factors[0][0] == "spline"]
    return float(sum(each * len(term.factors) for term in terms if term not in pieces) + (each if pieces else 0.0))


def terms_of(drivers: Drivers) -> list[Term]:
    """Terms of one driver and of two, plain ones first, and what begins at one of the changes."""
    names = drivers.moving
    now = [name for name in names if name not in drivers.late]
    single = {name: list(_shapes(name, drivers.signals[name])) for name in now}
    out = [Term()] + [Term((factor,)) for name in now for factor in single[name]]
    for name in now:  # a shape times its own driver: v exp(-v^2), v^2 sign(v) ...
        out += [
            Term((factor, _plain("v", name))) for factor in single[name] if factor[0] in ("bell", "exp", "tanh", "size")
        ]
    first = now[:MOST_OF_PRODUCTS]
    for i, a in enumerate(first):
        for b in first[i + 1 :]:
            out.append(Term((_plain("v", a), _plain("v", b))))
        for b in first:
            if a != b:
                out += [Term((factor, _plain("v", b))) for factor in single[a] if factor[0] != "v"]
                out += [Term((factor, _plain("square", b))) for factor in single[a] if factor[0] in OF_SQUARES]
    if len(now) <= MOST_OF_DIFFERENCES:
        for i, a in enumerate(now):
            for b in now[i + 1 :]:
                name = f"{a} - {b}"
                z = signal_of(name, drivers.signals)
                if np.std(z) > 0:
                    out += [Term((factor,)) for factor in _shapes(name, z) if factor[0] != "v"]
    for name in drivers.late:
        if name in names:
            z = drivers.signals[name]
            out += [
                Term((factor,)) for factor in _shapes(name, z) if not SHAPES[factor[0]].bounds or factor[0] == "tanh"
            ]
            own = past_name(name)
            if own in now:
                out.append(Term((_plain("v", name), _plain("v", own))))
    begins = [Term(), *(Term((_plain(shape, name),)) for name in first for shape in BEGINNING)]
    return out + [Term((*term.factors, ("after", "t", float(c), 0.0))) for c in drivers.changes for term in begins]


def _plain(shape: str, name: str) -> Factor:
    """A factor without constants."""
    return shape, name, 0.0, 0.0


def _shapes(name: str, z: np.ndarray) -> Iterator[Factor]:
    """Shapes of one driver with values of their constants."""
    spread, reach = float(np.std(z)), float(np.ptp(z))
    if spread == 0.0:
        return
    width = KINK * spread
    both = bool(z.min() < -OTHER_SIDE * spread and z.max() > OTHER_SIDE * spread)
    positive, away = bool(z.max() > 0.0 and z.min() > -OTHER_SIDE * spread), bool(z.min() > 0.0)
    middle = float(np.median(np.abs(z)))
    yield from (_plain(shape, name) for shape in ("v", "square", "cube"))
    if both:
        yield from ((shape, name, 0.0, width) for shape in ("drag", "sign", "root", "size"))
        yield from (("tanh", name, k * spread, 0.0) for k in BENDS)
        yield from (("bending", name, k * spread, 0.0) for k in BENDS)
        limits = np.unique(np.quantile(np.abs(z), LIMITS))
        yield from ((shape, name, float(c), width) for shape in ("clip", "dead_zone") for c in limits if c > 0)
    if both or positive:
        yield from (("power", name, c, 0.0) for c in (0.5, 1.5, 2.5))
        yield from (("logarithm", name, k * middle, 0.0) for k in HALVES if middle > 0)
        yield from (("fading", name, k * middle, 0.0) for k in HALVES if middle > 0)
        yield from (("resonant", name, k * middle, 0.0) for k in HALVES if middle > 0)
    if positive:
        yield _plain("flow", name)
        yield from (("saturating", name, k * middle, 0.0) for k in HALVES)
        yield from (("hill", name, k * middle, 0.0, n) for k in HALVES for n in (2.0, 4.0))
        if away and z.max() > 1.3 * z.min():  # over less of a range these are straight lines
            yield _plain("inverse", name)
            yield from (("inhibited", name, k * middle, 0.0) for k in HALVES)
            yield from (("activated", name, k * middle, 0.0) for k in (1.0, 3.0, 8.0))
    if reach > 1.0 and float(np.max(np.abs(z))) < 30.0:
        yield from (_plain(shape, name) for shape in ("sine", "cosine"))
    yield from (("wave", name, angle / reach, 0.0) for angle in ANGLES if both)
    yield from (("swing", name, angle / reach, 0.0, phase) for angle in ANGLES for phase in (0.0, 0.8, 1.6, 2.4))
    yield from (("exp", name, k * spread, 0.0) for k in (-2.5, -1.0, -0.4, 0.4, 1.0, 2.5))
    cuts = np.unique(np.quantile(z, CUTS))
    for c in map(float, cuts):
        yield from ((shape, name, c, width) for shape in ("above", "below", "beyond"))
        yield from (("bell", name, c, 0.0, k * spread) for k in (0.3, 0.8, 2.0))
        yield from (("switch", name, c, 0.0, k * spread) for k in (0.1, 0.4))


#: Numbers that all columns together may take (8 bytes each): more terms are thinned to those that follow the smoothed signal.
MOST_NUMBERS = 12_000_000
#: Two columns with a correlation above this on a sample of rows are one: the first, which is the simpler, stays.
SAME = 1.0 - 1e-7
#: Columns that are compared with all before them at once: the square of all would take more memory than all else.
COMPARED_AT_ONCE = 256


@dataclass(frozen=True, eq=False)
class Library:
    """Terms, and what they move the outputs by: (n_terms, n_outputs * n_samples), each for a signal of unit RMS."""

    terms: list[Term]
    late: list[float | None]
    sizes: np.ndarray
    columns: np.ndarray

    @classmethod
    def of(cls, channel: Channel, drivers: Drivers) -> Library:
        """All terms of the grammar that are finite and distinct along the path."""
        terms = terms_of(drivers)
        values = drivers.values(terms, channel.record)
        sizes = np.sqrt(np.mean(values**2, axis=1))
        good = np.isfinite(sizes) & (sizes > 1e-12)
        kept = np.flatnonzero(good)
        unit = values[kept] / sizes[kept, None]
        kept, unit = _distinct(kept, unit)
        most = MOST_NUMBERS // channel.r.size
        if len(kept) > most:
            follows = _correlation(unit, channel.force())
            chosen = np.sort(np.argsort(-follows, kind="stable")[:most])
            kept, unit = kept[chosen], unit[chosen]
        columns = channel.respond(unit).transpose(1, 0, 2).reshape(len(kept), -1)
        finite = np.isfinite(columns).all(axis=1)
        kept, columns = kept[finite], columns[finite]
        return cls([terms[k] for k in kept], [_late(terms[k], drivers) for k in kept], sizes[kept], columns)


#: Where formulae are given.
NO_TERMS = Library([], [], np.zeros(0), np.zeros((0, 0)))


def _late(term: Term, drivers: Drivers) -> float | None:
    """Time constant of the recent past in a term."""
    return next((drivers.late[f[1]] for f in term.factors if f[1] in drivers.late), None)


def _distinct(kept: np.ndarray, unit: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Without columns that repeat an earlier one, up to the sign."""
    sample = unit[:, :: max(unit.shape[1] // 400, 1)]
    sample = sample / np.maximum(np.linalg.norm(sample, axis=1, keepdims=True), 1e-300)
    first = np.zeros(len(kept), bool)
    for a in range(0, len(kept), COMPARED_AT_ONCE):
        some = np.arange(a, min(a + COMPARED_AT_ONCE, len(kept)))
        first[some] = np.argmax(np.abs(sample[some] @ sample[: some[-1] + 1].T) > SAME, axis=1) == some
    return kept[first], unit[first]


def _correlation(unit: np.ndarray, force: np.ndarray) -> np.ndarray:
    """Of columns with a signal."""
    z = unit - unit.mean(axis=1, keepdims=True)
    w = force - force.mean()
    return np.asarray(np.abs(z @ w) / np.maximum(np.linalg.norm(z, axis=1), 1e-300))
