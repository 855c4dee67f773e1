"""Forms of one effect: the simpler one that does as well, a richer one that starts where the simple one ended."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from sksurrogate.effects._base_effect import BaseEffect
from sksurrogate.gap.fit._evidence import C, arrived
from sksurrogate.gap.search._base import EQUAL, BaseSearch, Wanted
from sksurrogate.gap.search._nested import contains, richer
from sksurrogate.gap.search._set_moves import SetMoves

#: An effect, and its parameters.
PlainForm = tuple[BaseEffect, np.ndarray]

#: A simpler form is named where the richer one removes hardly more than this share of the gap's power.
HARDLY_ANY = 5e-4
#: A form that leaves so many times more than is allowed before it is polished leaves too much afterwards.
UNPOLISHED = 10.0


def simplify(search: SetMoves[C], candidate: C, far: bool = False) -> C:
    """Name the simpler form where the richer one that nests it removes hardly more; the richer stays in its class.

    Far from the data the search goes on with the richer form and ends with this question. Two forms of one law are one.
    """
    if search.is_far(candidate) and not far:
        return candidate
    candidate = from_rest(search, candidate)
    for i, effect in enumerate(candidate.effects):
        shapes = effect.simpler(tuple(candidate.theta_of(i)))
        for name in (*effect.nests, *shapes):
            simple = simpler_forms(search, candidate, i, name)
            base = search.without(candidate, i) if simple else None
            if base is None:
                continue
            others = search.formed(base, simple, shapes.get(name), candidate.fit.cost)
            near = [other for other in others if other.fit.cost < UNPOLISHED * most_left(search, candidate)]
            for other in search.ranked(near, base)[:1]:
                fitted = search.polish(other)
                if as_good(search, fitted, candidate):
                    search.richer.setdefault(fitted.effects[-1].key, []).append(effect.key)
                    return simplify(search, fitted, far)
    return candidate


def from_rest(search: SetMoves[C], candidate: C) -> C:
    """A set whose memories begin at rest, where the data do not tell that they were elsewhere before a run."""

    def at_rest(effect: BaseEffect, theta: np.ndarray) -> PlainForm | None:
        forms = [e for e in search.library if e.key == effect.key and e.at_rest and not effect.at_rest]
        return (forms[0], theta) if forms else None

    return in_plainer_form(search, candidate, at_rest, lambda one, other: search.score(one) > search.score(other))


def in_plainer_form(
    search: SetMoves[C],
    candidate: C,
    plainer: Callable[[BaseEffect, np.ndarray], PlainForm | None],
    better: Callable[[C, C], bool],
) -> C:
    """A set with plainer forms of its effects, one after the other, each fitted from where the set stands, as long as they are better.

    ``plainer``: the plainer form of an effect with these parameters, and its own parameters; None where it has none.
    """
    for i, effect in enumerate(candidate.effects):
        form = plainer(effect, candidate.theta_of(i))
        base = None if form is None else search.without(candidate, i)
        other = None if form is None or base is None else search.with_effect(base, *form, candidate.path)
        for one in search.ranked([other], base) if base is not None and other is not None else ():
            fitted = search.polish(one)
            if better(fitted, candidate):
                return in_plainer_form(search, fitted, plainer, better)
    return candidate


def with_fewer_parameters(search: SetMoves[C], best: C, most: float) -> list[C]:
    """Sets of as many effects with fewer parameters that leave a cost below ``most``, the fewest first."""
    others = [
        candidate
        for keys, candidate in search.fitted.items()
        if len(keys) == len(best.effects)
        and candidate.n_parameters < best.n_parameters
        and candidate.fit.cost < most
        and search.plausible(candidate)
    ]
    return sorted(others, key=lambda candidate: (candidate.n_parameters, candidate.fit.cost))


def enriched(search: SetMoves[C], candidate: C) -> list[C]:
    """Sets with a richer form in the place of one effect, fitted from where the set stands.

    Without the effect the others move away to make up for it, and no fit leads back: a form that contains another must leave no more.
    """
    found: list[C] = []
    for i, effect in enumerate(candidate.effects):
        forms = [form for form in search.library if richer(form, effect) and form.key not in candidate.keys]
        base: Any = candidate.taken_out(i) if forms else None
        if base is not None:
            wanted = Wanted(len(forms), 0, forms, best=candidate.fit.cost)
            found += search.ranked(search.expand(base, wanted), candidate)
    return found


def simpler_forms(search: BaseSearch[C], candidate: C, i: int, name: str) -> list[BaseEffect]:
    """Effects of a name that effect i of a set contains, but those that the set has already."""
    effect, named = candidate.effects[i], [form for form in search.library if form.name == name]
    return [form for form in named if contains(effect, form) and form.key not in candidate.keys]


def special_cases(search: BaseSearch[C], named: C, i: int) -> list[BaseEffect]:
    """Simpler forms of effect i with which the set, fitted again, leaves no more of the gap than the tolerance in addition."""
    beside, most = frozenset(key for j, key in enumerate(named.keys) if j != i), named.fit.cost + search.tolerated_cost
    forms = [form for name in named.effects[i].nests for form in simpler_forms(search, named, i, name)]
    fitted = ((form, search.fitted.get(beside | {form.key})) for form in forms)
    return [form for form, one in fitted if one is not None and one.fit.cost < most]


def hardly_more(cost: float, gap: float) -> float:
    """The cost that leaves hardly more than this one of a gap's power."""
    return cost + HARDLY_ANY * gap


def most_left(search: SetMoves[C], rich: C) -> float:
    """Cost up to which a simpler form leaves hardly more of the gap."""
    return hardly_more(rich.fit.cost, search.retuned_gap_cost)


def as_good(search: SetMoves[C], simple: C, rich: C) -> bool:
    """Whether a simpler form does as well: hardly more gap left, or far from the data no evidence by size."""
    if search.is_far(rich):
        return 2.0 * (search.size_score(rich) - search.size_score(simple)) < EQUAL
    return simple.fit.cost < most_left(search, rich) and not arrived(search.own(rich), simple)
