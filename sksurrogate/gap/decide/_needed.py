"""Which of several names are needed: those without which, the rest fitted again, more than the tolerance is left."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import combinations
from typing import Any

from sksurrogate.effects._base_effect import BaseEffect
from sksurrogate.gap.decide._intervals import not_sized_beside_others
from sksurrogate.gap.decide._one_factor import parts_of_one_factor
from sksurrogate.gap.fit._closeness import FAR, MOST_LEFT, SETTLED
from sksurrogate.gap.fit._evidence import C, Evidence, estimate_noise
from sksurrogate.gap.search._nested import QUANTIZERS, driven_alike, of_one_curve, of_one_law
from sksurrogate.gap.search._related_forms import from_rest
from sksurrogate.gap.search._set_search import COMES_BACK, SetSearch
from sksurrogate.gap.search._stopping import STACK


def taken(search: SetSearch[C], candidate: C, before: Evidence[C]) -> Evidence[C]:
    """A smaller set that takes the place of another, under its own noise: that of the larger one knows less to explain.

    Its memories begin at rest where that is as likely: one in motion may have stood for what was taken out.
    """
    search.judge(estimate_noise(candidate, before.noise, before.curvature))
    return search.stand(from_rest(search, search.polish(candidate)))


def needed_only(search: SetSearch[C], final: Evidence[C]) -> Evidence[C]:
    """A set without effects that the tolerance does not need, the least needed first.

    A set that leaves more than the noise is not exact: there a small effect may only correct the form of the others. Of two forms
    of one law, and of two curves of one signal at one place, one is enough where it closes the gap up to the tolerance: no form is exact
    on a real plant, unless both together are at the noise and one alone is far from it. So it is of effects whose magnitudes these data do not show beside each other, and of a rare one that is needed
    least of all and is driven as another: what has a state, a clock or two signals follows what the form of that one leaves.
    Parameters that act alike and follow one signal are one: both are never named.

    What is taken out is compared with the whole set: several effects may be needed where none of them alone is. At the noise an effect whose
    magnitude the data do not show at all, as one whose states imitate initial states, is taken out where it closes less than the tolerance.
    """
    whole = final.fit.cost
    while (fewer := _without_needless(search, final, whole)) is not None:
        final = taken(search, fewer, final)
    return final


def _without_needless(search: SetSearch[C], final: Evidence[C], whole: float) -> C | None:
    """The set without the effect that is needed least, or the one of this size that stood and is nearer; None where all are needed.

    ``whole``: cost of the set before any was taken out.
    """
    if len(final.effects) < 2:
        return None
    one_factor = _nearest_without(search, final, parts_of_one_factor(final.candidate, search.tolerance))
    if one_factor is not None:
        return one_factor
    among_others, not_at_all = not_sized_beside_others(final)
    not_shown = _nearest_without(search, final, not_at_all) if final.left <= SETTLED else None
    if not_shown is not None and not_shown.fit.cost - final.fit.cost <= search.tolerated_cost:
        return not_shown
    one_form = _nearest_without(search, final, _of_which_one_is_enough(final, among_others))
    if one_form is not None and one_form.fit.cost <= search.tolerated_cost and not _is_exact(search, final, one_form):
        return one_form
    following = _that_may_follow_others(final)
    if not following and final.left <= SETTLED:
        return None
    fewer = _nearest_without(search, final, range(len(final.effects)))
    if fewer is not None and following and fewer.fit.cost <= search.tolerated_cost:
        if following.issuperset(set(final.candidate.keys).difference(fewer.keys)):
            return fewer
    if final.left <= SETTLED:
        return None
    before = search.stood.get(len(final.effects) - 1)
    if fewer is not None and before is not None and before.fit.cost < COMES_BACK * fewer.fit.cost:
        fewer = before
    return None if fewer is None or is_needed(whole, fewer.fit.cost, search.tolerated_cost) else fewer


def _is_exact(search: SetSearch[C], final: Evidence[C], fewer: C) -> bool:
    """Whether the data show that a set has the forms of the plant: it is at the noise, and one without an effect is far from it."""
    return final.left <= SETTLED and fewer.fit.cost > FAR**2 * search.n_values


def _of_which_one_is_enough(final: Evidence[C], not_sized: Iterable[int]) -> list[int]:
    """Positions of the effects that share a law or a curve with another, or have no magnitude of their own in these data (``not_sized``).

    A stack of laws in one balance is an expansion of one of them.
    """
    pairs = combinations(range(len(final.effects)), 2)
    forms = {i for pair in pairs if _one_of_two(*(final.effects[k] for k in pair)) for i in pair}
    balances = [e.location if e.kind == "state" and e.variable else None for e in final.effects]
    stacked = (i for i, name in enumerate(balances) if name is not None and balances.count(name) >= STACK)
    return sorted(forms.union(not_sized, stacked))


def _that_may_follow_others(final: Evidence[C]) -> set[Any]:
    """Keys of the rare effects that the signals of another one drive, or time as another one.

    A mirror has no form that another could follow, and no other form leaves the steps of a rounding.
    """
    effects = final.effects
    return {
        one.key
        for one in effects
        if one.rarity > 1.0
        and not isinstance(one, QUANTIZERS)
        and any(driven_alike(one, other) for other in effects if other is not one and other.parameters)
    }


def _one_of_two(one: BaseEffect, other: BaseEffect) -> bool:
    """Whether one of two effects may be enough: of two forms of a law, and of two curves of one signal at one place."""
    return of_one_law(one, other) or of_one_curve(one, other)


def _nearest_without(search: SetSearch[C], final: Evidence[C], positions: Iterable[int]) -> C | None:
    """The set without the effect at one of some positions that comes nearest to the data; None where there is none."""
    sets = [search.without(final.candidate, i) for i in positions]
    known = [one for one in sets if one is not None and one.effects and search.plausible(one)]
    return min(known, key=lambda one: one.fit.cost, default=None)


def is_needed(whole: float, fewer: float, tolerated: float) -> bool:
    """Whether a set that leaves ``whole`` needs an effect without which, fitted again, it leaves ``fewer``.

    Squared errors; ``tolerated``: the tolerance in power. It does if more than the tolerance is left without it, and the effect closes most
    of that.

    >>> is_needed(10.0, 104.0, tolerated=100.0), is_needed(90.0, 204.0, tolerated=100.0), is_needed(10.0, 90.0, tolerated=100.0)
    (True, False, False)
    """
    return fewer > tolerated and whole < MOST_LEFT**2 * fewer
