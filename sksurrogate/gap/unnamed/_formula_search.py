"""Formulae for what is missing at a place, by generalised least squares through the known dynamics.

``r = J theta + sum_j c_j G f_j(z; k_j) + noise``: G carries a signal at the place to the outputs. The terms of the grammar are
columns; sums of few of them grow in a beam by what they explain less what they cost, in nats; the constants inside the shapes
follow by Gauss-Newton. The free run decides among the best (`_formula_fit`).

References
----------
Brunton, Proctor, Kutz, *Discovering governing equations from data by sparse identification*, PNAS 113 (2016); Golub, Pereyra,
*Separable nonlinear least squares*, Inverse Problems 19 (2003); Grunwald, *The minimum description length principle* (2007).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from sksurrogate.effects._formula import Term, equation_of
from sksurrogate.gap.fit._normal_equations import inverse
from sksurrogate.gap.fit._ode import REACH
from sksurrogate.gap.fit._pushes import STEP_OF_SLOPES
from sksurrogate.gap.unnamed._channel import Channel
from sksurrogate.gap.unnamed._drivers import Drivers
from sksurrogate.gap.unnamed._grammar import price_of, structure
from sksurrogate.gap.unnamed._term_library import NO_TERMS, Library
from sksurrogate.kernels.disturbance import Noise

#: Terms of a formula; formulae kept while it grows; further terms tried for each.
MOST_TERMS, BEAM, TRIED = 5, 6, 6
#: Formulae whose constants are fitted; steps of Gauss-Newton; halvings of a step.
REFINED, CONSTANT_STEPS, HALVINGS = 10, 6, 3
#: Formulae whose terms are chosen again, and rounds of it.
SWAPPED, SWAPS = 3, 4
#: Terms of an affine beginning.
MOST_AFFINE = 4
#: A column of which less than this share (power) is its own beside others tells nothing more.
OWN = 1e-5
#: Pieces of a free curve; share of the samples beyond either end of it.
SPLINE_PIECES, EDGE = 10, 0.002


@dataclass(frozen=True, eq=False)
class Draft:
    """A formula at a place, before its free run."""

    terms: tuple[Term, ...]
    coefficients: np.ndarray  #: (n_terms,)
    late: float | None  #: Time constant of the recent past that it holds
    nats: float  #: What it explains beside parameters of the simulator
    worth: float  #: The same less the price of the formula and of its constants

    price: float = 0.0  #: That of the formula
    level: float = -np.inf  #: Log likelihood less that price: comparable between places, which have noise of their own

    @property
    def values(self) -> np.ndarray:
        """Coefficients, constants and the time constant, as the parameters of the effect."""
        constants = [c for term in self.terms for c in term.constants]
        return np.array([*self.coefficients, *constants, *([] if self.late is None else [self.late])], dtype=float)

    @property
    def coefficients_alone(self) -> np.ndarray:
        """Coefficients and the time constant: the parameters of the effect whose other constants stand."""
        return np.array([*self.coefficients, *([] if self.late is None else [self.late])], dtype=float)

    @property
    def text(self) -> str:
        """The formula with its numbers."""
        return equation_of(self.terms, [float(c) for c in self.coefficients])

    @property
    def structure(self) -> Any:
        """Its shapes and drivers."""
        return structure(self.terms)


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
        regression = _Regression(channel, drivers, library, noise)
        try:
            drafts = regression.drafts()
        except np.linalg.LinAlgError:
            break
        for draft in drafts:
            found[draft.structure] = draft  # those of the second round are judged under the better noise
        if not drafts:
            break
        noise = channel.settled(regression.responses(drafts[0].terms, drafts[0].late))
    final = _Regression(channel, drivers, library, noise)
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
        noise = channel.settled(
            _Regression(channel, drivers, NO_TERMS, noise).responses(drafts[0].terms, drafts[0].late)
        )
    draft = Draft(terms, np.zeros(len(terms)), None, 0.0, 0.0)
    return _Regression(channel, drivers, NO_TERMS, noise).judged(draft)


@dataclass(eq=False)
class _Regression:
    """A residual explained by parameters of the simulator and by terms, under one noise."""

    channel: Channel
    drivers: Drivers
    library: Library
    noise: Noise
    weighted: dict[int, np.ndarray] = field(default_factory=dict)

    def __post_init__(self) -> None:
        channel = self.channel
        known = channel.linear.known
        self.factor = channel.D.factor(self.noise)
        self.base = self.weights(known)  # S^-1 [r, J]
        self.K = self.base @ known.transpose(1, 0, 2).reshape(known.shape[1], -1).T
        self.half_log = 0.5 * np.log(channel.r.size)
        self.n_drivers, self.log_det = len(self.drivers.moving), 0.0
        self.linear_forms = [(), *((("v", name),) for name in self.drivers.present)]

    def weights(self, columns: np.ndarray) -> np.ndarray:
        """``S^-1`` of columns (n_outputs, n_columns, n_samples): (n_columns, n_outputs * n_samples)."""
        return (
            self.channel.D.weighted(columns, self.noise, self.factor).transpose(1, 0, 2).reshape(columns.shape[1], -1)
        )

    def column(self, k: int) -> np.ndarray:
        """``S^-1`` of a term of the library."""
        if k not in self.weighted:
            shape = len(self.channel.r), 1, -1
            self.weighted[k] = self.weights(self.library.columns[k].reshape(shape))[0]
        return self.weighted[k]

    # ---- the beam ---------------------------------------------------------------------------------------------------
    def drafts(self) -> list[Draft]:
        """Formulae that grow term by term; the best of all sizes with their constants fitted."""
        library = self.library
        F = library.columns
        self.rows = self.base @ F.T
        self.diagonal = self.channel.D.gram_rows(F.reshape(len(F), len(self.channel.r), -1), self.noise, 1)[1]
        self.costs = np.array(
            [price_of([t], self.n_drivers) + self.half_log * (1 + len(t.constants)) for t in library.terms]
        )
        everything: dict[tuple[int, ...], float] = {}
        for start in dict.fromkeys([(), self.affine()]):
            everything.update(self.beam(start))
        for chosen in self.apart(sorted(everything, key=lambda one: -everything[one]), SWAPPED):
            everything.update(self.swapped(chosen, everything[chosen]))
        best_first = sorted(everything, key=lambda chosen: -everything[chosen])
        refined = [self.refined(self.draft_of(chosen)) for chosen in self.apart(best_first, REFINED)]
        return sorted(refined, key=lambda draft: -draft.worth)

    def affine(self) -> tuple[int, ...]:
        """A constant and the drivers as they are, where they are few: a simulator that was linearised lacks these too."""
        plain = [k for k, term in enumerate(self.library.terms) if structure([term])[0] in self.linear_forms]
        return (
            tuple(plain)
            if len(plain) <= MOST_AFFINE and self.drivers.allows([self.library.terms[k] for k in plain])
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
        F = self.library.columns
        own = np.array([self.column(k) for k in chosen]).reshape(len(chosen), F.shape[1])
        A = np.concatenate([self.rows[1:], own @ F.T])  # of parameters and chosen terms with all terms
        H = np.zeros((len(A), len(A)))
        p = len(self.K) - 1
        H[:p, :p] = self.K[1:, 1:] + np.diag(self.channel.linear.precision)
        H[p:, :p] = A[:p, list(chosen)].T
        H[:p, p:] = A[:p, list(chosen)]
        H[p:, p:] = A[p:, list(chosen)]
        g = np.r_[self.K[1:, 0] + self.channel.linear.pull, self.rows[0, list(chosen)]]
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
            if form not in seen and self.drivers.allows([self.library.terms[c] for c in (*chosen, k)]):
                seen.add(form)
                out[tuple(sorted((*chosen, int(k))))] = float(worth[k])
        return out

    # ---- constants --------------------------------------------------------------------------------------------------
    def draft_of(self, chosen: Sequence[int]) -> Draft:
        """Terms of the library as a formula."""
        late = next((self.library.late[k] for k in chosen if self.library.late[k] is not None), None)
        return self.judged(Draft(tuple(self.library.terms[k] for k in chosen), np.zeros(len(chosen)), late, 0.0, 0.0))

    def responses(self, terms: Sequence[Term], late: float | None) -> np.ndarray:
        """What terms move the outputs by: (n_outputs, n_terms, n_samples)."""
        return self.channel.respond(self.values(terms, late))

    def values(self, terms: Sequence[Term], late: float | None) -> np.ndarray:
        """Terms along the path (n_terms, n_samples)."""
        return self.drivers.values(terms, self.channel.record)

    def solved(self, J: np.ndarray) -> tuple[float, np.ndarray]:
        """Nats that columns J explain beside the parameters, and their weights, the parameters first."""
        both = self.channel.linear.beside(J)
        known = both.known
        if not np.isfinite(known).all():
            return -np.inf, np.zeros(known.shape[1] - 1)
        G, self.log_det = self.channel.D.gram(known, self.noise, self.factor)
        theta = both.weights(G)
        return 0.5 * float((G[1:, 0] + both.pull) @ theta), theta

    def judged(self, draft: Draft) -> Draft:
        """Coefficients and worth of a formula with its constants as they are."""
        nats, theta = self.solved(self.responses(draft.terms, draft.late))
        k = sum(1 + len(term.constants) for term in draft.terms) + (draft.late is not None)
        price = price_of(draft.terms, self.n_drivers)
        own = theta[len(self.channel.linear.precision) :]
        cost = price + self.half_log * k
        level = nats - cost - 0.5 * (self.K[0, 0] + self.log_det)
        return replace(draft, coefficients=own, nats=nats, worth=nats - cost, price=price, level=float(level))

    def refined(self, draft: Draft) -> Draft:
        """A formula with its constants fitted: Gauss-Newton with coefficients and parameters beside them, steps halved."""
        constants = np.array([c for term in draft.terms for c in term.constants])
        if not len(constants):
            return draft
        low, high = np.array([b for term in draft.terms for b in term.bounds]).T
        spread = {name: float(np.std(z)) for name, z in self.drivers.signals.items()}
        unit = np.maximum(np.abs(constants), 0.1 * max(spread.values()) if any(constants == 0) else 1e-12)
        for _ in range(CONSTANT_STEPS):
            J = self.responses(draft.terms, draft.late)
            slopes = self.slopes(draft, constants, unit, J)
            if not np.isfinite(slopes).all():
                break
            _, theta = self.solved(np.concatenate([J, slopes], axis=1))
            step = np.clip(theta[len(theta) - len(constants) :], -REACH * unit, REACH * unit)
            better = None
            for halving in range(HALVINGS):
                trial = np.clip(constants + step / 4.0**halving, low, high)
                other = self.judged(replace(draft, terms=_at(draft.terms, trial)))
                if other.nats > draft.nats:
                    better = other, trial
                    break
            if better is None:
                break
            gained = better[0].nats - draft.nats
            draft, constants = better
            unit = np.maximum(np.abs(constants), 0.1 * unit)
            if gained < 0.05:
                break
        return draft

    def slopes(self, draft: Draft, constants: np.ndarray, unit: np.ndarray, J: np.ndarray) -> np.ndarray:
        """Sensitivities of the outputs in the constants (n_outputs, n_constants, n_samples)."""
        here = draft.coefficients @ self.values(draft.terms, draft.late)
        moved = []
        for k, size in enumerate(unit):
            other = constants.copy()
            other[k] += STEP_OF_SLOPES * size
            there = draft.coefficients @ self.values(_at(draft.terms, other), draft.late)
            moved.append((there - here) / (STEP_OF_SLOPES * size))
        return self.channel.respond(np.stack(moved))


def _at(terms: Sequence[Term], constants: np.ndarray) -> tuple[Term, ...]:
    """The same terms with other constants."""
    out, left = [], list(map(float, constants))
    for term in terms:
        n = len(term.constants)
        out.append(term.at(left[:n]))
        left = left[n:]
    return tuple(out)
