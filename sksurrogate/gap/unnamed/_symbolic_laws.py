"""Symbolic candidates for a missing term: sums of a few simple physical shapes, chosen on runs left out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sksurrogate.effects._formula import Term

__all__ = ["Library", "Sparse", "library", "sparse_laws"]

#: Most terms of a law; laws that are kept while it grows; terms tried at each.
MOST_SHAPES, SUMS_KEPT, SHAPES_TRIED = 5, 5, 12
#: A further term must raise what is explained on runs left out by this many nats and this share.
LEAST_NATS, LEAST_SHARE = 5.0, 0.01
#: Laws within this share of the best of their size are listed too.
TOLD_TOO = 0.05
#: Most variables of which products are formed.
MOST_VARIABLES = 6


@dataclass(frozen=True, eq=False)
class Library:
    """Terms with their values along the path.

    Attributes
    ----------
    terms : list of Term
    values : ndarray (n_terms, n_samples)
        Each in units of its RMS.
    size : ndarray (n_terms,)
        That RMS.
    """

    terms: list[Term]
    values: np.ndarray
    size: np.ndarray


@dataclass(frozen=True)
class Sparse:
    """A law: places of its terms in the library, and its score on runs left out in nats."""

    chosen: tuple[int, ...]
    score: float


def library(Z: np.ndarray, names: Sequence[str], t: np.ndarray, changes: Sequence[float] = ()) -> Library:
    """Shapes of one variable, products of two, and what switches at a time.

    Parameters
    ----------
    Z : ndarray (n_samples, n_variables)
        Best variables first: products are formed of the first :data:`MOST_VARIABLES`.
    names : sequence of str
    t : ndarray (n_samples,)
    changes : sequence of float
        Times at which something changes.
    """
    one = [_singles(name, z) for name, z in zip(names, Z.T)]
    terms = [Term()] + [term for group in one for term in group]
    first = range(min(len(names), MOST_VARIABLES))
    for i in first:
        for j in first:
            if i != j:
                terms += _pairs(names[i], Z[:, i], names[j], Z[:, j], i < j)
    for moment in changes:
        gate = ("after", "t", float(moment), 0.0)
        some = [Term(), *(term for group in one[:MOST_VARIABLES] for term in group if _plain(term))]
        terms += [Term((*term.factors, gate)) for term in some]
    signals = dict(zip(names, Z.T))
    kept: list[Term] = []
    values: list[np.ndarray] = []
    sizes: list[float] = []
    seen: list[np.ndarray] = []
    for term in terms:
        with np.errstate(all="ignore"):
            value = np.broadcast_to(np.asarray(term.value(signals, t), dtype=float), t.shape)
        size = float(np.sqrt(np.mean(value**2)))
        if not (np.isfinite(size) and size > 1e-12):
            continue
        unit = value / size
        sample = unit[:: max(len(unit) // 500, 1)]
        sample = sample / max(float(np.linalg.norm(sample)), 1e-300)
        if seen and np.max(np.abs(np.stack(seen) @ sample)) > 1.0 - 1e-8:
            continue  # the same on these data as a simpler one
        seen.append(sample)
        kept.append(term)
        values.append(unit)
        sizes.append(size)
    return Library(kept, np.stack(values), np.array(sizes))


def _plain(term: Term) -> bool:
    """Whether a term is worth a switch in time."""
    return len(term.factors) == 1 and term.factors[0][0] in ("v", "sign", "drag", "square")


def _singles(name: str, z: np.ndarray) -> list[Term]:
    """Shapes of one variable."""
    spread = float(np.std(z))
    if spread == 0:
        return []
    w = 0.02 * spread
    positive, both = bool(z.min() > 0), bool(z.min() < -0.2 * spread and z.max() > 0.2 * spread)
    shapes: list[tuple[str, float, float]] = [("v", 0.0, 0.0), ("square", 0.0, 0.0)]
    shapes += [("drag", 0.0, 0.0), ("sign", 0.0, w), ("root", 0.0, w), ("size", 0.0, w)] if both else []
    shapes += [("flow", 0.0, 0.0)] if positive else []
    shapes += [("cube", 0.0, 0.0)]
    if positive and z.max() > 1.3 * z.min():
        shapes += [("saturating", k * float(np.median(z)), 0.0) for k in (0.3, 1.0, 3.0)]
        shapes += [("inverse", 0.0, 0.0)]
        shapes += [("activated", k * float(np.median(z)), 0.0) for k in (1.0, 3.0, 7.0)]
    middle = float(np.median(np.abs(z)))
    if (both or positive) and middle > 0:
        shapes += [("fading", k * middle, 0.0) for k in (0.5, 1.0, 2.0)]
    if np.ptp(z) > 1.0 and np.abs(z).max() < 20.0:
        shapes += [("sine", 0.0, 0.0), ("cosine", 0.0, 0.0)]
        shapes += [("wave", c, 0.0) for c in (0.5, 2.0, 3.0) if 1.5 < c * np.ptp(z) < 40.0]
    cuts = np.unique(np.quantile(z, (0.2, 0.35, 0.5, 0.65, 0.8, 0.9)))
    shapes += [("above", float(c), w) for c in cuts] + [("beyond", float(c), w) for c in cuts]
    shapes += [("below", float(c), w) for c in cuts[:2]]
    return [Term(((shape, name, c, width),)) for shape, c, width in shapes]


def _pairs(a: str, za: np.ndarray, b: str, zb: np.ndarray, first: bool) -> list[Term]:
    """Products of two variables."""
    if np.std(za) == 0 or np.std(zb) == 0:
        return []
    linear = ("v", b, 0.0, 0.0)
    out = [Term(tuple(("v", name, 0.0, 0.0) for name in sorted((a, b))))] if first else []
    out.append(Term((("square", a, 0.0, 0.0), linear)))
    if za.min() < 0 < za.max():
        out.append(Term((("sign", a, 0.0, 0.02 * float(np.std(za))), linear)))
    if za.min() > 0 and za.max() > 1.3 * za.min():
        middle = float(np.median(za))
        out += [Term((("saturating", a, middle, 0.0), linear)), Term((("inverse", a, 0.0, 0.0), linear))]
        out += [Term((("activated", a, k * middle, 0.0), linear)) for k in (1.0, 7.0)]
        out.append(Term((("activated", a, 7.0 * middle, 0.0), ("square", b, 0.0, 0.0))))
    return out


def sparse_laws(grams: np.ndarray, fold: np.ndarray) -> list[Sparse]:
    """Laws with few terms, best first: beam search, scored on folds left out.

    Parameters
    ----------
    grams : ndarray (n_runs, 1 + n_terms, 1 + n_terms)
        Gram matrices of residual and terms, run by run, under the noise.
    fold : ndarray (n_runs,)
    """
    parts = np.stack([grams[fold == k].sum(axis=0) for k in np.unique(fold)])
    whole = parts.sum(axis=0)
    beams: list[Sparse] = [Sparse((), 0.0)]
    path: list[list[Sparse]] = []
    for _ in range(min(MOST_SHAPES, len(whole) - 1)):
        grown: dict[tuple[int, ...], Sparse] = {}
        for law in beams:
            for k in _promising(whole, law.chosen):
                chosen = tuple(sorted((*law.chosen, k)))
                if chosen not in grown:
                    grown[chosen] = Sparse(chosen, _left_out(parts, whole, chosen))
        better = sorted(grown.values(), key=lambda law: -law.score)
        better = sorted({*(_swapped(parts, whole, law) for law in better[:SUMS_KEPT]), *better[:SUMS_KEPT]}, key=_worth)
        last = path[-1][0].score if path else 0.0
        if not better or better[0].score < last + max(LEAST_NATS, LEAST_SHARE * last):
            break
        beams = better[:SUMS_KEPT]
        path.append([law for law in better[:SUMS_KEPT] if law.score > (1 - TOLD_TOO) * better[0].score])
    return [law for size in reversed(path) for law in size]


def _worth(law: Sparse) -> tuple[float, tuple[int, ...]]:
    """Best first."""
    return -law.score, law.chosen


def _swapped(parts: np.ndarray, whole: np.ndarray, law: Sparse) -> Sparse:
    """Each term in turn re-chosen with the others kept."""
    for k in law.chosen:
        rest = tuple(c for c in law.chosen if c != k)
        for new in _promising(whole, rest)[: SHAPES_TRIED // 2]:
            chosen = tuple(sorted((*rest, new)))
            score = _left_out(parts, whole, chosen)
            if score > law.score + 1.0:
                return Sparse(chosen, score)
    return law


def _promising(whole: np.ndarray, chosen: tuple[int, ...]) -> list[int]:
    """Terms that explain most of what chosen ones leave."""
    S = [1 + k for k in chosen]
    g, h = whole[0, 1:].copy(), np.diag(whole)[1:].copy()
    if S:
        cross = whole[S, 1:]
        solved = np.linalg.lstsq(whole[np.ix_(S, S)], np.column_stack([whole[S, 0], cross]), rcond=1e-10)[0]
        g -= cross.T @ solved[:, 0]
        h -= np.einsum("sk,sk->k", cross, solved[:, 1:])
    own = np.diag(whole)[1:]
    gain = np.where(h > 1e-4 * own, g**2 / np.maximum(h, 1e-300), -np.inf)
    gain[list(chosen)] = -np.inf
    return [int(k) for k in np.argsort(-gain)[:SHAPES_TRIED] if np.isfinite(gain[k])]


def _left_out(parts: np.ndarray, whole: np.ndarray, chosen: tuple[int, ...]) -> float:
    """Nats that the terms explain on folds left out, coefficients from the others."""
    S = [1 + k for k in chosen]
    total = 0.0
    for part in parts:
        train = whole - part if len(parts) > 1 else whole
        H = train[np.ix_(S, S)]
        c = np.linalg.lstsq(H + 1e-9 * np.diag(np.diag(H)), train[S, 0], rcond=1e-10)[0]
        total += float(c @ part[S, 0] - 0.5 * c @ part[np.ix_(S, S)] @ c)
    return total
