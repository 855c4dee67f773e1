"""The best formulae and a free curve as effects in the free run, judged by the evidence as names are.

Every formula is an effect: its coefficients and constants are fitted through the free run with initial states and free
parameters, under its own noise. The price of its structure stands beside the evidence, and so the simplest formula that does
as well is preferred; a free curve competes as one formula of many coefficients.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sksurrogate.effects._law import AnyLaw
from sksurrogate.gap.fit._evidence import OUT_OF_REACH, C, Evidence
from sksurrogate.gap.results._next_experiment import NATS_THAT_SETTLE
from sksurrogate.gap.search._set_search import SetSearch
from sksurrogate.gap.unnamed._channels import Channels
from sksurrogate.gap.unnamed._drivers import Drivers
from sksurrogate.gap.unnamed._formula_regression import Draft
from sksurrogate.gap.unnamed._formula_search import curve_at, simplest
from sksurrogate.gap.unnamed._grammar import price_of

#: Places that are compared; formulae that are fitted in the free run at the likeliest place, and at each of the others.
MOST_PLACES, FITTED_HERE, FITTED_ELSEWHERE = 3, 4, 2


@dataclass(frozen=True, eq=False)
class FittedLaw:
    """A law fitted in the free run."""

    found: Evidence[Any]  #: The base with the law as its last effect
    drivers: Drivers  #: Signals that it was chosen from
    price: float  #: Of its structure, in nats
    curve: bool  #: Whether it is a free curve

    @property
    def location(self) -> str:
        """Where it stands."""
        return self.drivers.channel.location

    @property
    def kind(self) -> str:
        """Kind of that place."""
        return self.drivers.channel.kind

    @property
    def effect(self) -> AnyLaw:
        """The law with the parameters found."""
        last = self.found.candidate.effects[-1]
        assert isinstance(last, AnyLaw)
        values = tuple(float(v) for v in self.found.candidate.theta_of(len(self.found.effects) - 1))
        return type(last)(last.location, last.variable, last.terms, values, last.free)


def fitted_laws(
    search: SetSearch[C], base: Evidence[C], channels: Channels[C], places: Sequence[tuple[str, str]]
) -> list[FittedLaw]:
    """Laws on top of a base at some places, the best first.

    ``base``: what is named, or nothing.
    ``channels``: of the base.
    ``places``: the likeliest first.
    """
    fits: list[FittedLaw] = []
    best = -np.inf
    for rank, (location, kind) in enumerate(places[:MOST_PLACES]):
        channel = channels.at(location, kind)
        if channel is None:
            continue
        drivers = channels.drivers(channel)
        found = channels.drafts(location, kind)
        drafts = [one for one in found if search.carries(drivers.effect(one.terms, one.values, True))]
        if not drafts:
            continue
        best = max([best, *(draft.level for draft in drafts)])
        near = [draft for draft in drafts if draft.level > best - OUT_OF_REACH]
        chosen = near[:FITTED_ELSEWHERE] if rank else [*near[:FITTED_HERE], *simplest(drafts)[:FITTED_HERE]]
        curve = None if rank else curve_at(drivers, drafts)
        for draft in dict.fromkeys([*chosen, *([] if curve is None else [curve])]):
            fitted = fitted_draft(search, base, channel.x, draft, drivers)
            if fitted is not None:
                unjudged = Evidence(fitted, base.noise, -np.inf)
                fits.append(FittedLaw(unjudged, drivers, draft.price, draft is curve))
    laws = ranked_laws(search, base, fits)
    if not laws:
        return []
    first = pruned(search, base, laws[0])
    polished = search.polish(first.found.candidate)
    return [replace(first, found=search.judged[polished]), *laws[1:]]


def pruned(search: SetSearch[C], base: Evidence[C], law: FittedLaw) -> FittedLaw:
    """A formula without the terms that the free run does not need."""
    effect, values = law.effect, law.found.candidate.theta_of(len(law.found.effects) - 1)
    if law.curve or len(effect.terms) == 1:
        return law
    fewer = []
    for i in range(len(effect.terms)):
        filled = [one for k, one in enumerate(effect.filled(values.tolist())) if k != i]
        terms = tuple(term for _, term in filled)
        late = float(values[-1]) if any(f[1].startswith("lag(") for t in terms for f in t.factors) else None
        price = price_of(terms, len(law.drivers.moving))
        draft = Draft(terms, np.array([float(c) for c, _ in filled]), late, price=price)
        fitted = fitted_draft(search, base, law.found.candidate.path, draft, law.drivers)
        if fitted is not None:
            fewer.append(replace(law, found=Evidence(fitted, base.noise, -np.inf), price=price))
    best = ranked_laws(search, base, [law, *fewer])[0]
    return law if best.found.candidate is law.found.candidate else pruned(search, base, best)


def ranked_laws(search: SetSearch[C], base: Evidence[C], fits: list[FittedLaw]) -> list[FittedLaw]:
    """Best first, under their own noise; of those that are as good the one with the fewest parameters, at the place that came first.

    An input and the balance that it alone pushes are one place to the data: rounding must not choose between them.
    """
    candidates = [law.found.candidate for law in fits]
    kept = search.ranked(candidates, base.candidate)
    fits = [replace(law, found=search.judged[law.found.candidate]) for law in fits if law.found.candidate in kept]
    if not fits:
        return []
    places = list(dict.fromkeys((law.location, law.kind) for law in fits))
    score = search.order([law.found.candidate for law in fits])
    value = {id(law): score(law.found.candidate) - law.price for law in fits}
    fits.sort(key=lambda law: -value[id(law)])
    best = value[id(fits[0])]
    near = [law for law in fits if value[id(law)] >= best - NATS_THAT_SETTLE]
    first = min(near, key=lambda law: (law.found.candidate.n_parameters, places.index((law.location, law.kind))))
    return [first, *(law for law in fits if law is not first)]


def fitted_draft(
    search: SetSearch[C], base: Evidence[C], x: np.ndarray | None, draft: Draft, drivers: Drivers
) -> C | None:
    """A formula as an effect on top of the base, fitted in the free run from a path x."""
    effect = drivers.effect(draft.terms, draft.values, True)
    try:
        with np.errstate(all="ignore"):
            return search.with_effect(base.candidate, effect, draft.values, x)
    except (np.linalg.LinAlgError, FloatingPointError):  # a law that breaks the arithmetic is out
        return None
