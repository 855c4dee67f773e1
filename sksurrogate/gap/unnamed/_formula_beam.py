"""Formulae as sums of terms that grow in a beam.

The terms of the grammar are columns of a regression (`_formula_regression`); sums of few of them grow by what they explain less what
they cost, in nats.

References
----------
Brunton, Proctor, Kutz, *Discovering governing equations from data by sparse identification*, PNAS 113 (2016).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sksurrogate.gap.fit._normal_equations import eliminate, eliminate_rows, inverse
from sksurrogate.gap.unnamed._formula_regression import Draft, Regression
from sksurrogate.gap.unnamed._grammar import price_of, structure
from sksurrogate.gap.unnamed._term_library import Library

#: Terms of a formula; formulae kept while it grows; further terms tried for each.
MOST_TERMS, BEAM, TRIED = 5, 6, 6
#: Formulae whose constants are fitted; of all, of single terms and of pairs whose constants take one step before the best of these are
#: fitted too: none of the few values in the library may be near.
REFINED, NEAR_ONES = 10, 24
#: Formulae whose terms are chosen again, and rounds of it.
SWAPPED, SWAPS = 3, 4
#: Terms of an affine beginning.
MOST_AFFINE = 4
#: Terms whose pairs with all others are compared at once: the square of all takes more memory than all else.
PAIRED_AT_ONCE = 64
#: A column of which less than this share (power) is its own beside others tells nothing more.
OWN = 1e-5


@dataclass(eq=False)
class Beam:
    """Formulae that grow term by term from a library, under the noise of a regression."""

    regression: Regression
    library: Library
    weighted: dict[int, np.ndarray] = field(default_factory=dict)
    products: dict[int, np.ndarray] = field(default_factory=dict)

    def __post_init__(self) -> None:
        one, F = self.regression, self.library.columns
        self.rows = one.base @ F.T
        self.diagonal = one.channel.D.gram_rows(F.reshape(len(F), len(one.channel.r), -1), one.noise, 1)[1]
        self.costs = np.array(
            [price_of([t], one.n_drivers) + one.half_log * (1 + len(t.constants)) for t in self.library.terms]
        )

    def columns(self, some: Sequence[int]) -> np.ndarray:
        """``S^-1`` of terms of the library, (n_terms, n_outputs * n_samples)."""
        new = [k for k in some if k not in self.weighted]
        if new:
            F = self.library.columns[new].reshape(len(new), len(self.regression.channel.r), -1)
            self.weighted.update(zip(new, self.regression.weights(F.transpose(1, 0, 2))))
        return np.array([self.weighted[k] for k in some]).reshape(len(some), self.library.columns.shape[1])

    def products_of(self, some: Sequence[int]) -> np.ndarray:
        """``f' S^-1 g`` of terms of the library with all of it, (n_terms, n_all)."""
        new = [k for k in some if k not in self.products]
        if new:
            self.products.update(zip(new, self.columns(new) @ self.library.columns.T))
        return np.array([self.products[k] for k in some]).reshape(len(some), len(self.library.terms))

    def drafts(self, small: bool) -> list[Draft]:
        """Formulae that grow term by term; the best of all with their constants fitted, and the best of one and of two terms if ``small``."""
        alone = self.grown((), None)
        plain = {k for k, term in enumerate(self.library.terms) if len(term.factors) < 2}
        pairs = self.pairs(sorted(plain | {k for (k,) in alone})) if small else {}
        everything, affine = alone | pairs, self.affine()
        for starts in (self.apart(best_first(everything), BEAM), [affine] if affine else []):
            everything.update(self.beam(starts, max((everything.get(one, 0.0) for one in starts), default=0.0)))
        for chosen in self.apart(best_first(everything), SWAPPED):
            everything.update(self.swapped(chosen, everything[chosen]))
        return self.with_constants(everything, (everything, alone, pairs) if small else (everything,))

    def with_constants(
        self, everything: Mapping[tuple[int, ...], float], groups: Sequence[Mapping[tuple[int, ...], float]]
    ) -> list[Draft]:
        """The best of all formulae with their constants fitted, and the best of each group after one step of the constants."""
        refined, first = self.regression.refined, self.apart(best_first(everything), REFINED)
        near = [one for group in groups for one in self.apart(best_first(group), NEAR_ONES)]
        further = [one for one in dict.fromkeys(near) if one not in first]
        looked = sorted((refined(self.draft_of(one), 1) for one in further), key=lambda draft: -draft.worth)
        drafts = [*(refined(self.draft_of(one)) for one in first), *map(refined, looked[:REFINED])]
        return sorted(drafts, key=lambda draft: -draft.worth)

    def pairs(self, some: Sequence[int]) -> dict[tuple[int, ...], float]:
        """The best of all sums of two of some terms: two may explain together what neither explains alone."""
        one, linear = self.regression, self.regression.channel.linear
        at, k = np.array(some, dtype=int), len(one.K)
        F, weighted, A, costs = self.library.columns[at], self.columns(some), self.rows[:, at], self.costs[at]
        rows = np.concatenate([one.K, A], axis=1)
        squares = np.r_[np.diag(one.K), np.einsum("ij,ij->i", weighted, F)]
        rest, size = eliminate_rows(rows, squares, linear.precision, linear.pull)
        follow = inverse(one.K[1:, 1:] + np.diag(linear.precision)) @ A[1:] if k > 1 else A[1:]
        explained = 0.5 * float(one.K[0, 0] - eliminate(one.K, k - 1, linear.precision, linear.pull)[0, 0])
        known = size > OWN * self.diagonal[at]
        best: list[tuple[float, int, int]] = []
        for a in range(0, len(at), PAIRED_AT_ONCE):
            b = min(a + PAIRED_AT_ONCE, len(at))
            own = weighted[a:b] @ F[a:].T - A[1:, a:b].T @ follow[:, a:]
            both, det = np.outer(size[a:b], size[a:]), np.outer(size[a:b], size[a:]) - own**2
            gain = np.outer(rest[a:b] ** 2, size[a:]) - 2.0 * np.outer(rest[a:b], rest[a:]) * own
            gain = 0.5 * (gain + np.outer(size[a:b], rest[a:] ** 2))
            worth = gain / np.maximum(det, 1e-300) - costs[a:b, None] - costs[a:] + explained
            apart = np.triu(np.outer(known[a:b], known[a:]) & (det > OWN * both), 1)
            i, j = np.nonzero(apart & np.isfinite(worth))
            value = worth[i, j]
            first = np.argsort(-value, kind="stable")[: TRIED * BEAM]
            best += zip((-value[first]).tolist(), at[a + i[first]].tolist(), at[a + j[first]].tolist())
        found = {(i, j): -value for value, i, j in sorted(best)[: TRIED * BEAM]}
        return {pair: value for pair, value in found.items() if self.allows(pair)}

    def allows(self, chosen: Sequence[int]) -> bool:
        """Whether an effect can hold these terms."""
        return self.regression.drivers.allows([self.library.terms[k] for k in chosen])

    def affine(self) -> tuple[int, ...]:
        """A constant and the drivers as they are, where they are few: a simulator that was linearised lacks these too."""
        forms = [(), *((("v", name),) for name in self.regression.drivers.present)]
        plain = [k for k, term in enumerate(self.library.terms) if structure([term])[0] in forms]
        return tuple(plain) if len(plain) <= MOST_AFFINE and self.allows(plain) else ()

    def beam(self, beams: Sequence[tuple[int, ...]], best: float) -> dict[tuple[int, ...], float]:
        """Formulae that grow from some, the best of every size, as long as that gains on the best."""
        everything: dict[tuple[int, ...], float] = {}
        for _ in range(MOST_TERMS):
            grown: dict[tuple[int, ...], float] = {}
            for chosen in beams:
                grown.update(self.grown(chosen))
            beams = self.apart(best_first(grown), BEAM)
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
        first: dict[Any, tuple[int, ...]] = {}
        for chosen in ranked:
            first.setdefault(structure([self.library.terms[k] for k in chosen]), chosen)
            if len(first) == most:
                break
        return list(first.values())

    def grown(self, chosen: tuple[int, ...], most: int | None = 4 * TRIED) -> dict[tuple[int, ...], float]:
        """A formula with one term more, the best by what all of it is worth; every structure of the new term once."""
        K, linear, some = self.regression.K, self.regression.channel.linear, list(chosen)
        # Products of r, J and the chosen terms with all terms, and with one another.
        A = np.concatenate([self.rows, self.products_of(chosen)])
        H = np.concatenate([np.concatenate([K, self.rows[:, some].T]), A[:, some]], axis=1)
        precision, pull = (np.r_[part, np.zeros(len(some))] for part in (linear.precision, linear.pull))
        explained = 0.5 * float(K[0, 0] - eliminate(H, len(H) - 1, precision, pull)[0, 0])
        of_all = np.concatenate([H, A], axis=1), np.r_[np.diag(H), self.diagonal]
        rest, left = eliminate_rows(*of_all, precision, pull)
        gain = np.where(left > OWN * self.diagonal, 0.5 * rest**2 / np.maximum(left, 1e-300), -np.inf)
        gain[some] = -np.inf
        worth = explained + gain - self.costs - sum(self.costs[k] for k in chosen)
        out: dict[tuple[int, ...], float] = {}
        seen: set = set()
        for k in np.argsort(-worth):
            form = structure([self.library.terms[k]])
            if not np.isfinite(worth[k]) or len(out) == most:
                break
            if form not in seen and self.allows((*chosen, int(k))):
                seen.add(form)
                out[tuple(sorted((*chosen, int(k))))] = float(worth[k])
        return out

    def draft_of(self, chosen: Sequence[int]) -> Draft:
        """Terms of the library as a formula."""
        terms = tuple(self.library.terms[k] for k in chosen)
        return self.regression.judged(Draft(terms, np.zeros(len(chosen)), self.regression.drivers.time_constant(terms)))


def best_first(worth: Mapping[tuple[int, ...], float]) -> list[tuple[int, ...]]:
    """Formulae by what they are worth."""
    return sorted(worth, key=lambda one: -worth[one])
