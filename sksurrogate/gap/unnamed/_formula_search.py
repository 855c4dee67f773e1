"""Formulae for what is missing at a place: sums of terms that grow in a beam.

The terms of the grammar are columns of a regression (`_formula_regression`); sums of few of them grow by what they explain less what
they cost, in nats. The free run decides among the best (`_formula_fit`).

References
----------
Brunton, Proctor, Kutz, *Discovering governing equations from data by sparse identification*, PNAS 113 (2016).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sksurrogate.effects._formula import Term
from sksurrogate.gap.fit._normal_equations import inverse
from sksurrogate.gap.unnamed._channel import Channel
from sksurrogate.gap.unnamed._drivers import Drivers
from sksurrogate.gap.unnamed._formula_regression import Draft, Regression
from sksurrogate.gap.unnamed._grammar import price_of, structure
from sksurrogate.gap.unnamed._term_library import Library

#: Terms of a formula; formulae kept while it grows; further terms tried for each.
MOST_TERMS, BEAM, TRIED = 5, 6, 6
#: Formulae whose constants are fitted.
REFINED = 10
#: Formulae whose terms are chosen again, and rounds of it.
SWAPPED, SWAPS = 3, 4
#: Terms of an affine beginning.
MOST_AFFINE = 4
#: A column of which less than this share (power) is its own beside others tells nothing more.
OWN = 1e-5
#: Pieces of a free curve; share of the samples beyond either end of it.
SPLINE_PIECES, EDGE = 10, 0.002


def drafts_at(channel: Channel, drivers: Drivers) -> list[Draft]:
    """The formulae of most worth at a place, best first, each structure once.

    First under the noise in which a free signal explains the gap, then under the noise that the best formula leaves.
    """
    if not drivers.moving:
        return []
    library = Library.of(channel, drivers)
    if not len(library.terms):
        return []
    found: dict[Any, Draft] = {}
    noise = channel.noise
    for _ in range(2):
        regression = Regression(channel, drivers, noise)
        try:
            drafts = _Beam(regression, library).drafts()
        except np.linalg.LinAlgError:
            break
        for draft in drafts:
            found[draft.structure] = draft  # those of the second round are judged under the better noise
        if not drafts:
            break
        noise = channel.settled(regression.responses(drafts[0].terms, drafts[0].late))
    final = Regression(channel, drivers, noise)
    judged = [draft for draft in map(final.judged, found.values()) if np.isfinite(draft.worth)]
    ranked = sorted(judged, key=lambda draft: -draft.worth)
    kept: list[Draft] = []
    for draft in ranked:  # a better formula with terms added says nothing new
        if not any(set(other.structure) < set(draft.structure) for other in kept):
            kept.append(draft)
    return kept


def curve_at(channel: Channel, drivers: Drivers, drafts: Sequence[Draft]) -> Draft | None:
    """A smooth curve of the driver that the best formula holds: cubic B-splines over the range that it covers."""
    names = [name for draft in drafts for term in draft.terms for name in term.variables if name in drivers.signals]
    names += drivers.present
    if not names:
        return None
    z = drivers.signals[names[0]]
    low, high = np.quantile(z, (EDGE, 1.0 - EDGE))
    if not high > low:
        return None
    step = (high - low) / (SPLINE_PIECES - 3)
    centres = low + step * np.arange(-1, SPLINE_PIECES - 1)
    terms = tuple(Term((("spline", names[0], float(c), 0.0, float(step)),)) for c in centres)
    noise = channel.noise
    if drafts:
        noise = channel.settled(Regression(channel, drivers, noise).responses(drafts[0].terms, drafts[0].late))
    return Regression(channel, drivers, noise).judged(Draft(terms, np.zeros(len(terms)), None))


@dataclass(eq=False)
class _Beam:
    """Formulae that grow term by term from a library, under the noise of a regression."""

    regression: Regression
    library: Library
    weighted: dict[int, np.ndarray] = field(default_factory=dict)

    def __post_init__(self) -> None:
        one, F = self.regression, self.library.columns
        self.rows = one.base @ F.T
        self.diagonal = one.channel.D.gram_rows(F.reshape(len(F), len(one.channel.r), -1), one.noise, 1)[1]
        self.costs = np.array(
            [price_of([t], one.n_drivers) + one.half_log * (1 + len(t.constants)) for t in self.library.terms]
        )

    def column(self, k: int) -> np.ndarray:
        """``S^-1`` of a term of the library."""
        if k not in self.weighted:
            shape = len(self.regression.channel.r), 1, -1
            self.weighted[k] = self.regression.weights(self.library.columns[k].reshape(shape))[0]
        return self.weighted[k]

    def drafts(self) -> list[Draft]:
        """Formulae that grow term by term; the best of all sizes with their constants fitted."""
        everything: dict[tuple[int, ...], float] = {}
        for start in dict.fromkeys([(), self.affine()]):
            everything.update(self.beam(start))
        for chosen in self.apart(sorted(everything, key=lambda one: -everything[one]), SWAPPED):
            everything.update(self.swapped(chosen, everything[chosen]))
        best_first = sorted(everything, key=lambda chosen: -everything[chosen])
        refined = [self.regression.refined(self.draft_of(chosen)) for chosen in self.apart(best_first, REFINED)]
        return sorted(refined, key=lambda draft: -draft.worth)

    def affine(self) -> tuple[int, ...]:
        """A constant and the drivers as they are, where they are few: a simulator that was linearised lacks these too."""
        forms = [(), *((("v", name),) for name in self.regression.drivers.present)]
        plain = [k for k, term in enumerate(self.library.terms) if structure([term])[0] in forms]
        return (
            tuple(plain)
            if len(plain) <= MOST_AFFINE and self.regression.drivers.allows([self.library.terms[k] for k in plain])
            else ()
        )

    def beam(self, start: tuple[int, ...]) -> dict[tuple[int, ...], float]:
        """Formulae that grow from some terms, the best of every size."""
        beams, everything, best = [start], dict[tuple[int, ...], float](), 0.0
        for _ in range(MOST_TERMS):
            grown: dict[tuple[int, ...], float] = {}
            for chosen in beams:
                grown.update(self.grown(chosen))
            beams = self.apart(sorted(grown, key=lambda one: -grown[one]), BEAM)
            everything.update({chosen: grown[chosen] for chosen in beams})
            if not beams or grown[beams[0]] < best + 1.0:
                break
            best = grown[beams[0]]
        return everything

    def swapped(self, chosen: tuple[int, ...], worth: float) -> dict[tuple[int, ...], float]:
        """A formula with terms chosen again, one at a time with the others kept, as long as that gains."""
        out: dict[tuple[int, ...], float] = {}
        for _ in range(SWAPS):
            others = [self.grown(tuple(k for k in chosen if k != out_of)) for out_of in chosen]
            tried = [one for found in others for one in found.items()]
            best, value = max(tried, key=lambda one: one[1], default=(chosen, worth))
            if value < worth + 1.0:
                break
            chosen, worth = best, value
            out[chosen] = worth
        return out

    def apart(self, ranked: Sequence[tuple[int, ...]], most: int) -> list[tuple[int, ...]]:
        """The best of every structure."""
        seen: set = set()
        out = []
        for chosen in ranked:
            form = structure([self.library.terms[k] for k in chosen])
            if form not in seen:
                seen.add(form)
                out.append(chosen)
            if len(out) == most:
                break
        return out

    def grown(self, chosen: tuple[int, ...]) -> dict[tuple[int, ...], float]:
        """A formula with one term more, the best by what all of it is worth; every structure of the new term once."""
        F, K, linear = self.library.columns, self.regression.K, self.regression.channel.linear
        own = np.array([self.column(k) for k in chosen]).reshape(len(chosen), F.shape[1])
        A = np.concatenate([self.rows[1:], own @ F.T])  # of parameters and chosen terms with all terms
        H = np.zeros((len(A), len(A)))
        p = len(K) - 1
        H[:p, :p] = K[1:, 1:] + np.diag(linear.precision)
        H[p:, :p] = A[:p, list(chosen)].T
        H[:p, p:] = A[:p, list(chosen)]
        H[p:, p:] = A[p:, list(chosen)]
        g = np.r_[K[1:, 0] + linear.pull, self.rows[0, list(chosen)]]
        explained, cross = 0.0, np.zeros_like(A)
        rest, left = self.rows[0].copy(), self.diagonal.copy()
        if len(A):
            solution = inverse(H)
            explained = 0.5 * float(g @ solution @ g)
            cross = solution @ A
            rest, left = rest - g @ cross, left - np.einsum("ak,ak->k", A, cross)
        gain = np.where(left > OWN * self.diagonal, 0.5 * rest**2 / np.maximum(left, 1e-300), -np.inf)
        gain[list(chosen)] = -np.inf
        worth = explained + gain - self.costs - sum(self.costs[k] for k in chosen)
        out: dict[tuple[int, ...], float] = {}
        seen: set = set()
        for k in np.argsort(-worth):
            form = structure([self.library.terms[k]])
            if not np.isfinite(worth[k]) or len(out) == 4 * TRIED:
                break
            if form not in seen and self.regression.drivers.allows([self.library.terms[c] for c in (*chosen, k)]):
                seen.add(form)
                out[tuple(sorted((*chosen, int(k))))] = float(worth[k])
        return out

    def draft_of(self, chosen: Sequence[int]) -> Draft:
        """Terms of the library as a formula."""
        late = next((self.library.late[k] for k in chosen if self.library.late[k] is not None), None)
        terms = tuple(self.library.terms[k] for k in chosen)
        return self.regression.judged(Draft(terms, np.zeros(len(chosen)), late))
