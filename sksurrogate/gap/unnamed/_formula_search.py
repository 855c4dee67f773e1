"""The formulae of most worth at a place: grown under more and more exact noise, the best of every size, none that repeats another.

The free run decides among them (`_formula_fit`).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from sksurrogate.effects._formula import Term
from sksurrogate.gap.unnamed._drivers import Drivers
from sksurrogate.gap.unnamed._formula_beam import Beam
from sksurrogate.gap.unnamed._formula_regression import Draft, Regression
from sksurrogate.gap.unnamed._term_library import Library
from sksurrogate.kernels.disturbance import Noise

#: Formulae that are judged under noise of their own, beside the best of every size.
MOST_JUDGED = 3
#: Share of a formula along the path that is no multiple of another, below which it says the same.
REPEATED = 1e-3
#: Pieces of a free curve; share of the samples beyond either end of it.
SPLINE_PIECES, EDGE = 10, 0.002


def drafts_at(drivers: Drivers) -> list[Draft]:
    """The formulae of most worth at a place, best first, each structure once.

    First under the noise in which a free signal explains the gap, then under the noise that the best formula leaves; at last each of
    the best under the noise that it leaves itself: a formula that is nearly right leaves less noise than any before it.
    """
    if not drivers.moving:
        return []
    library = Library.of(drivers)
    if not len(library.terms):
        return []
    found: dict[Any, Draft] = {}
    noise = drivers.channel.noise
    for first in (True, False):
        regression = Regression(drivers, noise)
        try:
            drafts = Beam(regression, library).drafts(small=first)
        except np.linalg.LinAlgError:
            break
        for draft in drafts:
            found[draft.structure] = draft  # those of the second round are judged under the better noise
        if not drafts:
            break
        noise = noise_beside(drivers, drafts[0])
    final = Regression(drivers, noise)
    judged = [draft for draft in map(final.judged, found.values()) if np.isfinite(draft.worth)]
    ranked = sorted(judged, key=lambda draft: -draft.worth)
    kept: list[Draft] = []
    for draft in ranked:  # a better formula with terms added says nothing new
        if not any(set(other.structure) < set(draft.structure) for other in kept):
            kept.append(draft)
    best = dict.fromkeys([*simplest(kept), *kept[:MOST_JUDGED]])
    alone = [under_its_own_noise(drivers, draft) for draft in best]
    ranked = [*sorted(alone, key=lambda draft: -draft.level), *(draft for draft in kept if draft not in best)]
    return without_repeats(ranked, [one.coefficients @ drivers.values(one.terms) for one in ranked])


def without_repeats(drafts: Sequence[Draft], values: Sequence[np.ndarray]) -> list[Draft]:
    """Formulae without those that are a multiple of one of fewer parameters along the path, nearly: as ``1e9 sin(1e-9 v)`` of ``v``."""
    kept: list[int] = []
    for k in sorted(range(len(drafts)), key=lambda k: len(drafts[k].values)):
        fewer = (values[j] for j in kept if len(drafts[j].values) < len(drafts[k].values))
        if not any(_multiple(values[k], other) for other in fewer):
            kept.append(k)
    return [drafts[k] for k in sorted(kept)]


def _multiple(z: np.ndarray, other: np.ndarray) -> bool:
    """Whether one signal is nearly a multiple of another."""
    left = z - other * (float(z @ other) / max(float(other @ other), 1e-300))
    return bool(np.linalg.norm(left) < REPEATED * np.linalg.norm(z))


def simplest(ranked: Sequence[Draft]) -> list[Draft]:
    """Of formulae, best first, those that no other with as few parameters is better than, best first."""
    front: list[Draft] = []
    for draft in ranked:
        if not front or len(draft.values) < len(front[-1].values):
            front.append(draft)
    return front


def noise_beside(drivers: Drivers, draft: Draft) -> Noise:
    """The noise that a formula leaves."""
    return drivers.channel.settled(drivers.responses(draft.terms))


def under_its_own_noise(drivers: Drivers, draft: Draft) -> Draft:
    """A formula judged, and its constants fitted, under the noise that it leaves."""
    own = Regression(drivers, noise_beside(drivers, draft))
    return own.refined(own.judged(draft))


def curve_at(drivers: Drivers, drafts: Sequence[Draft]) -> Draft | None:
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
    noise = noise_beside(drivers, drafts[0]) if drafts else drivers.channel.noise
    return Regression(drivers, noise).judged(Draft(terms, np.zeros(len(terms)), None))
