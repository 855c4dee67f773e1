"""Names and laws of one place and signal are parts of one curve: which of them only corrects the form of the other, which comes nearest."""

from __future__ import annotations

from itertools import combinations

import numpy as np
from scipy.special import ndtr

from sksurrogate.effects._base_effect import BaseEffect
from sksurrogate.gap.decide._intervals import intervals, not_sized
from sksurrogate.gap.fit._evidence import C, Evidence
from sksurrogate.gap.fit._ode import OdeCandidate
from sksurrogate.gap.results._law import Law
from sksurrogate.gap.search._base import BaseSearch
from sksurrogate.gap.unnamed._law_evidence import place_and_signal
from sksurrogate.gap.unnamed._law_left import LawLeft

#: A law that corrects the form of a name is half normal before any data, with the tolerance as its scale: so many scales hold 95 %.
LARGEST_CORRECTION = 2.0


def moved_by(candidate: OdeCandidate) -> list[np.ndarray | None]:
    """What a unit of the first parameter of each effect moves the outputs by, (1, n_outputs, n_samples); None where that is not known."""
    J = candidate.columns()[1]
    own = [J[:, candidate.slice_of(i)][:, :1] for i in range(len(candidate.effects))]
    return [one[:, 0] if one.any() and np.isfinite(one).all() else None for one in own]


def redundant_effect(final: Evidence[OdeCandidate]) -> int | None:
    """Position of the effect that only corrects the form of another; None where there is none.

    There are two kinds. The interval of its magnitude holds the value at which it does nothing. Or two effects of one signal at one
    place cancel: each of them moves the outputs by more than both together. Then they are two terms of one curve, and the smaller
    one is redundant.
    """
    candidate = final.candidate
    low, high = intervals(final)
    unsure = {}
    for i in not_sized(candidate.effects, low, high):
        first, null = candidate.slice_of(i).start, candidate.effects[i].parameters[0].null
        if np.isfinite(null):
            unsure[i] = (high[first] - low[first]) / max(abs(final.fit.theta[first] - null), 1e-300)
    if unsure:
        return max(unsure, key=lambda i: unsure[i])
    moved = [None if one is None else one * candidate.theta_of(i)[0] for i, one in enumerate(moved_by(candidate))]
    signals = [place_and_signal(effect) for effect in candidate.effects]
    for i, j in combinations(range(len(moved)), 2):
        one, other = moved[i], moved[j]
        if one is not None and other is not None and signals[i] == signals[j]:
            *sizes, together = (float(np.linalg.norm(outputs)) for outputs in (one, other, one + other))
            if together < min(sizes):
                return i if sizes[0] < sizes[1] else j
    return None


def is_at(effect: BaseEffect, law: Law | LawLeft) -> bool:
    """Whether an effect acts where a law does: a sensor and a balance may have one name.

    >>> from sksurrogate.effects import CATALOGUE
    >>> law = LawLeft("level", "state", "level")
    >>> is_at(CATALOGUE["linear_loss"]("level", "level"), law), is_at(CATALOGUE["sensor_gain"]("level"), law)
    (True, False)
    """
    return effect.location == law.location and (effect.kind == "output") == (law.kind == "output")


def is_like(effect: BaseEffect, law: Law) -> bool:
    """Whether an effect acts at the place of a law, driven by a signal of it.

    >>> from sksurrogate.effects import CATALOGUE, LawEffect
    >>> law = Law("force", "input", ("force",), LawEffect("force"), {}, {})
    >>> [is_like(CATALOGUE[name](at), law) for name, at in (("input_saturation", "force"), ("sensor_gain", "force"))]
    [True, False]
    """
    return is_at(effect, law) and not set(effect.signals or place_and_signal(effect)[1:]).isdisjoint(law.variables)


def nearest_name(search: BaseSearch[C], law: Law) -> C | None:
    """The single effect that comes nearest to a law that has no name, fitted.

    None where each leaves more of the gap than a correction of its form may be.
    """
    fitted = [one for keys, one in search.fitted.items() if len(keys) == 1 and is_like(one.effects[0], law)]
    alone = [one for one in fitted if search.plausible(one)]
    nearest = min(alone, key=lambda one: one.fit.cost, default=None)
    return nearest if nearest is not None and nearest.fit.cost < LARGEST_CORRECTION**2 * search.tolerated_cost else None


def form_holds(effect: BaseEffect, law: LawLeft, tolerance: float) -> float:
    """Probability that the law beside a name leaves the name its form.

    A name and a law of its own place and signal are one curve. A small law corrects the form of the name, for no form is exact; a larger one is
    a curve of another form, of which the name is a part at best. Laws elsewhere say nothing of the name, nor does any law of a force that
    depends on no signal. A parameter may be off whatever the law of its element.

    >>> from sksurrogate.effects import CATALOGUE
    >>> leak, law = CATALOGUE["sqrt_leak"]("speed", "speed"), LawLeft("speed", "state", "speed", size=0.3, spread=0.01)
    >>> form_holds(leak, law, 0.1) < 1e-9, form_holds(leak, LawLeft("speed", "state", "force", size=0.3), 0.1)
    (True, 1.0)
    """
    without_form = effect.kind == "parameter" or (effect.kind == "state" and effect.variable is None)
    own = is_at(effect, law) and place_and_signal(effect)[1] == law.signal
    if without_form or not own:
        return 1.0
    return float(ndtr((LARGEST_CORRECTION * tolerance - law.size) / max(law.spread, 1e-300)))
