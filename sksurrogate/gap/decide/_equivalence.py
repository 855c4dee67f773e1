"""What these data cannot tell apart: the candidates that could stand in the place of each name, which of them is named, how probable it is."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import Any, Generic

import numpy as np
from scipy.special import softmax

from sksurrogate.effects._base_effect import BaseEffect
from sksurrogate.effects._catalogue import CATALOGUE
from sksurrogate.effects._onset import Starting
from sksurrogate.gap.decide._contenders import swaps
from sksurrogate.gap.decide._one_factor import is_same_factor
from sksurrogate.gap.decide._posterior import Posterior
from sksurrogate.gap.fit._backend import BaseCandidate
from sksurrogate.gap.fit._closeness import MOST_LEFT
from sksurrogate.gap.fit._evidence import FEW_STEPS, C, Evidence, estimate_noise, judged_under
from sksurrogate.gap.search._base import EQUAL, BaseSearch
from sksurrogate.gap.search._nested import of_one_curve, richer
from sksurrogate.gap.search._related_forms import hardly_more

#: Candidates further than this under the final noise are not judged under their own; nor are more than this many.
MAY_CATCH_UP, MOST_JUDGED = 40.0, 8
#: Squares of errors over the noise within which the named effect, fitted as its candidates are, came as near again.
CLOSE = 0.5
#: Nats by which a form with more parameters may be less likely than the named one and yet be of its class.
NEARLY_AS_LIKELY = 1.0
#: Outputs closer than this share of the noise are the same prediction.
SAME_PREDICTION = 0.02


@dataclass(frozen=True, eq=False)
class Twin(Generic[C]):
    """A candidate with another effect in the place of a named one, the last."""

    candidate: C
    same: bool  #: Whether its prediction is the same within a fraction of the noise
    #: Whether it is the named effect at a parameter that acts alike: only knowledge of the plant decides
    one_factor: bool = False

    @property
    def effect(self) -> BaseEffect:
        """The other effect."""
        return self.candidate.effects[-1]


@dataclass(frozen=True, eq=False)
class EquivalenceClass(Generic[C]):
    """One named effect and the candidates that could stand in its place."""

    index: int
    twins: list[Twin[C]]  #: Those that these data cannot reject
    own: C | None = None  #: With the named effect itself in the last place; None where it was not fitted so

    @property
    def keys(self) -> set[tuple]:
        """Keys of the other effects."""
        return {twin.effect.key for twin in self.twins}


def _with_as_likely(
    its_class: EquivalenceClass[C], final: Evidence[C], as_likely: Sequence[Any]
) -> EquivalenceClass[C]:
    """A class with the other effects that are as likely in the place of its own."""
    own = final.effects[its_class.index].key
    beside, known = set(final.candidate.keys) - {own}, {own, *its_class.keys}
    more = [one for one in as_likely if set(one.keys[:-1]) == beside and one.keys[-1] not in known]
    return replace(its_class, twins=[*its_class.twins, *(Twin(one, predicts_the_same(one, final)) for one in more)])


def _class_in_place(search: BaseSearch[C], final: Evidence[C], i: int) -> EquivalenceClass[C]:
    """What could stand in the place of effect i: candidates fitted there that are within :data:`EQUAL` under the final noise model.

    Parameters that act alike are one factor: the curve that each gives it does not tell them apart.
    """
    named, own = final.candidate, final.effects[i].key

    def worth(candidate: C) -> float:
        return judged_under(candidate, [final.noise]).log_likelihood - 0.5 * search.prior_cost(candidate)

    level, found, itself = worth(named), [], named if named.keys[-1] == own else None
    for candidate in search.in_place_of(final, i):
        value = worth(candidate)
        if candidate.effects[-1].key != own:
            found.append((value, candidate))
        elif candidate.fit.cost < final.fit.cost + CLOSE:
            # Readings in steps have slopes that promise what no fit keeps.
            level, itself = min(level, value), itself or candidate
    found = _with_own_noise(search, final, level, found)
    twins: list[Twin[C]] = []
    size = len(final.effects[i].parameters)
    for value, candidate in found:
        same = predicts_the_same(candidate, final)
        # With more parameters a form must be as likely, and predict something else than a limit that is never reached.
        more = len(candidate.effects[-1].parameters) > size
        if more and (same or value < level - NEARLY_AS_LIKELY):
            if richer(candidate.effects[-1], final.effects[i]):
                search.richer.setdefault(final.effects[i].key, []).append(candidate.effects[-1].key)
        else:
            twins.append(Twin(candidate, same))
    known = {twin.effect.key for twin in twins}
    fitted = [one for one in swaps(search, named) if own not in one.keys and one.keys[-1] not in known]
    alike = [one for one in fitted if is_same_factor(one, named, i, search.tolerance)]
    return EquivalenceClass(i, [*twins, *(Twin(one, False, one_factor=True) for one in alike)], itself)


def predicts_the_same(candidate: BaseCandidate, final: Evidence) -> bool:
    """Whether no output differs by more than :data:`SAME_PREDICTION` of its noise."""
    apart = np.sqrt(np.mean((candidate.fit.y - final.fit.y) ** 2, axis=1)) / final.noise.sigma
    return bool(np.max(apart) < SAME_PREDICTION)


def _with_own_noise(
    search: BaseSearch[C], final: Evidence[C], level: float, found: list[tuple[float, C]]
) -> list[tuple[float, C]]:
    """The candidates within :data:`EQUAL`, best first; near ones are judged under their own noise, as the final candidate is.

    Those that predict the same, with free parameters as likely, are in it whatever a force or an initial state would do.
    """
    found.sort(key=lambda item: -item[0])
    judged = []
    for place, (value, candidate) in enumerate(found):
        missing = 2.0 * (level - value)
        if EQUAL < missing <= MAY_CATCH_UP and place < MOST_JUDGED:
            again = search.judge(estimate_noise(candidate, final.noise, final.curvature, max_iterations=FEW_STEPS))
            value = max(value, again.log_likelihood - 0.5 * search.prior_cost(candidate))
        cheap = search.prior_cost(candidate) <= search.prior_cost(final.candidate) + EQUAL
        if 2.0 * (level - value) <= EQUAL or (cheap and predicts_the_same(candidate, final)):
            judged.append((value, candidate))
    return sorted(judged, key=lambda item: -item[0])


#: Places in the order in which twins are named: what the simulator has already comes first.
_ORDER_OF_KINDS = ("parameter", "state", "input", "output")
_PLACE = {name: i for i, name in enumerate(CATALOGUE)}


def rank(effect: BaseEffect, positions: Collection[str] = ()) -> tuple[int, float, bool, int, int, str, str, str]:
    """What twins are ordered by: the number of parameters, the prior odds, an onset last, the place, the catalogue, the name.

    ``positions``: states that are integrals of others.

    >>> rank(CATALOGUE["input_bias"]("valve")) < rank(CATALOGUE["sensor_bias"]("level"))
    True
    >>> rank(CATALOGUE["input_gain"]("voltage")) < rank(CATALOGUE["linear_loss"]("current", "voltage"))  # of its own level
    True
    """
    kind = _ORDER_OF_KINDS.index(effect.kind)
    place = _PLACE.get(effect.name, len(_PLACE))
    before = -effect.prior_weight(positions)
    begins = isinstance(effect, Starting)  # after a load or a parameter that jumps
    return len(effect.parameters), before, begins, kind, place, effect.name, str(effect.location), effect.variable or ""


def canonical_classes(search: BaseSearch[C], posterior: Posterior) -> tuple[list[EquivalenceClass[C]], Posterior]:
    """The class of every named effect; where an exact or a simpler twin comes first by :func:`rank`, that stands, and is settled.

    Which of two twins a search meets first hangs on rounding, and so on the unit of time and on the order of the states.

    ``search``: its ``final`` may become another.
    ``posterior``: of what stands.
    Returns ``classes``: in the order of the effects that stand then.
    Returns ``posterior``: in the same order.
    """
    final = search.standing
    found = [_class_in_place(search, final, i) for i in range(len(final.effects))]
    classes = [_with_as_likely(its_class, final, posterior.as_likely) for its_class in found]
    kept = list(posterior.probabilities)
    for own in final.effects:
        i = [effect.key for effect in final.effects].index(own.key)
        twin = _first_twin(search, final, classes[i], own)
        first = None if twin is None else _beside_the_others(search, final, i, twin.candidate)
        if twin is None or first is None:
            continue
        final = search.final = search.judge(
            estimate_noise(first, final.noise, final.curvature, max_iterations=FEW_STEPS)
        )
        contained = [*([own.key] if classes[i].own is None else []), *search.richer.get(own.key, [])]
        search.richer.setdefault(first.effects[-1].key, []).extend(contained)
        order = [*(k for k in range(len(classes)) if k != i), i]  # the twin stands last in its candidate
        classes = [replace(classes[k], index=n) for n, k in enumerate(order)]
        classes[-1] = _seen_from(classes[-1], twin)
        kept = [kept[k] for k in order] if kept else kept
    search.settle()
    return classes, replace(posterior, probabilities=tuple(kept))


def _first_twin(
    search: BaseSearch[C], final: Evidence[C], its_class: EquivalenceClass[C], own: BaseEffect
) -> Twin[C] | None:
    """The twin that comes before the named effect: an exact one, or one with fewer parameters. None where that is the first itself.

    One with fewer parameters must not leave much more; far from the data it must leave hardly more of the gap, or no more than the tolerance.
    What makes one characteristic of an input or a sensor with another name comes before what acts elsewhere: one cause, not two.
    """
    far, beside = search.is_far(final.candidate), [effect for effect in final.effects if effect is not own]
    near = max(hardly_more(final.fit.cost, search.gap_cost), search.tolerated_cost)
    most = near if far else final.fit.cost / MOST_LEFT**2

    def place(effect: BaseEffect) -> tuple[Any, ...]:
        of_itself = effect.kind not in ("input", "output") or not any(of_one_curve(effect, other) for other in beside)
        size, *others = rank(effect, search.positions)
        return size, of_itself, *others

    def is_simpler(twin: Twin[C]) -> bool:
        return len(twin.effect.parameters) < size and twin.candidate.fit.cost <= most

    before, size = place(own), len(own.parameters)
    ahead = [
        twin
        for twin in its_class.twins
        if (twin.same and its_class.own is not None and place(twin.effect) < before) or is_simpler(twin)
    ]
    return min(ahead, key=lambda twin: place(twin.effect), default=None)


def _beside_the_others(search: BaseSearch[C], final: Evidence[C], i: int, twin: C) -> C | None:
    """A twin of effect i beside the other effects that stand; fitted again where one of these was replaced by a twin of its own."""
    others = {effect.key for k, effect in enumerate(final.effects) if k != i}
    if others == set(twin.keys[:-1]):
        return twin
    again = (one for one in search.in_place_of(final, i) if one.keys[-1] == twin.keys[-1])
    return next(again, None)


def _seen_from(its_class: EquivalenceClass[C], twin: Twin[C]) -> EquivalenceClass[C]:
    """The same class with a twin as the named effect."""
    named = [] if its_class.own is None else [Twin(its_class.own, twin.same)]
    others = [one for one in its_class.twins if one is not twin]
    return replace(its_class, twins=[*named, *others], own=twin.candidate)


def probabilities(
    search: BaseSearch[C], final: C, classes: Sequence[EquivalenceClass[C]], posterior: Posterior
) -> list[float]:
    """Probability that each effect, or one of its class, acts in the plant, whatever else acts.

    ``posterior``: of each effect against none and against a law without a name in its place (:func:`weigh`), and sets
        that differ in several effects.
    """
    own = search.score(final)
    out = []
    for its_class, chance in zip(classes, posterior.probabilities):
        ours = [own, *(_score(search, twin.candidate, final) for twin in its_class.twins)]
        named = {final.effects[its_class.index].key, *its_class.keys}
        against = _rejected(search, final, its_class)
        against += [own + more for keys, more in posterior.elsewhere if not keys & named]
        out.append(chance * float(np.sum(softmax([*ours, *against])[: len(ours)])))
    return out


def _score(search: BaseSearch[C], candidate: C, final: C) -> float:
    """Of a tied candidate; one that was not given a noise of its own predicts the same as the final one."""
    if search.own(candidate) is not None:
        return search.score(candidate)
    return search.score(final) - 0.5 * (candidate.n_parameters - final.n_parameters) * float(np.log(search.n_values))


def _rejected(search: BaseSearch[C], final: C, its_class: EquivalenceClass[C]) -> list[float]:
    """Scores of the candidates in one place that the data reject, at least :data:`EQUAL` below the final one."""
    own = final.effects[its_class.index].key
    beside, taken = set(final.keys) - {own}, {own, *its_class.keys}
    scores = [search.score(one) for one in swaps(search, final) if not (set(one.keys) - beside) & taken]
    return [min(score, search.score(final) - EQUAL) for score in scores if np.isfinite(score)]
