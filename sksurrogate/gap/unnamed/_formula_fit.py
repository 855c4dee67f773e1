"""The best formulae and a free curve as effects in the free run, judged by the evidence as names are.

Every formula is an effect: its coefficients and constants are fitted through the free run with initial states and free
parameters, under its own noise. The price of its structure stands beside the evidence, and so the simplest formula that does
as well is preferred; a free curve competes as one formula of many coefficients.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sksurrogate.effects._law import InputLawEffect, LawEffect, MemoryLawEffect, SensorLawEffect, law_effect
from sksurrogate.gap.fit._evidence import Evidence
from sksurrogate.gap.fit._ode import OdeCandidate
from sksurrogate.gap.search._fits import fit_last
from sksurrogate.gap.search._search import Search
from sksurrogate.gap.unnamed._disturbance_channel import Channels
from sksurrogate.gap.unnamed._formula_search import Draft, curve_at, drafts_at
from sksurrogate.gap.unnamed._grammar import Drivers, as_written, price_of
from sksurrogate.gap.unnamed._law_shapes import at_end
from sksurrogate.gap.unnamed._shape import Channel
from sksurrogate.kernels.banded import first_order_scan
from sksurrogate.kernels.record import Record

__all__ = ["AnyLaw", "FittedLaw", "drivers_at", "fitted_laws"]

AnyLaw = LawEffect | MemoryLawEffect | InputLawEffect | SensorLawEffect
#: Time constants of the recent past, in samples, and the share of the longest run up to which they are tried.
LATE, LATEST = (3.0, 10.0, 30.0, 100.0), 0.25
#: Places that are compared; formulae that are fitted in the free run at the likeliest place, and at each of the others.
MOST_PLACES, FITTED_HERE, FITTED_ELSEWHERE = 3, 4, 2
#: A draft this many nats below the best is not fitted.
HOPELESS_DRAFT = 200.0
#: Formulae within so many nats of the best are as good: the one with the fewest parameters is given.
AS_GOOD = 3.0


@dataclass(frozen=True, eq=False)
class FittedLaw:
    """A law fitted in the free run.

    Attributes
    ----------
    found : Evidence
        The base with the law as its last effect.
    location, kind : str
    price : float
        Of its structure, in nats.
    curve : bool
        Whether it is a free curve.
    n_drivers : int
        Signals that it was chosen from.
    """

    found: Evidence[OdeCandidate]
    location: str
    kind: str
    price: float
    curve: bool
    n_drivers: int = 1

    @property
    def effect(self) -> AnyLaw:
        """The law with the parameters found."""
        last = self.found.candidate.effects[-1]
        assert isinstance(last, AnyLaw)
        values = tuple(float(v) for v in self.found.candidate.theta_of(len(self.found.effects) - 1))
        return type(last)(last.location, last.variable, last.terms, values, last.free)


def fitted_laws(
    search: Search, base: Evidence[OdeCandidate], channels: Channels, places: Sequence[tuple[str, str]]
) -> list[FittedLaw]:
    """Laws on top of a base at some places, the best first.

    Parameters
    ----------
    search : Search
    base : Evidence
        What is named, or nothing.
    channels : Channels
        Of the base.
    places : sequence of (location, kind)
        The likeliest first.
    """
    fits: list[FittedLaw] = []
    best = -np.inf
    for rank, (location, kind) in enumerate(places[:MOST_PLACES]):
        channel = channels.at(location, kind)
        if channel is None:
            continue
        drivers = drivers_at(base.candidate, channel, location, kind)
        drafts = drafts_at(channel, drivers)
        best = max([best, *(draft.level for draft in drafts)])
        chosen = [draft for draft in drafts if draft.level > best - HOPELESS_DRAFT]
        chosen = chosen[: FITTED_ELSEWHERE if rank else FITTED_HERE]
        curve = None if rank else curve_at(channel, drivers, drafts)
        for draft in [*chosen, *([] if curve is None else [curve])]:
            fitted = fitted_draft(search, base, channel.x, draft, location, kind)
            if fitted is not None:
                found = Evidence(fitted, base.noise, -np.inf)
                fits.append(FittedLaw(found, location, kind, draft.price, draft is curve, len(drivers.moving)))
    laws = ranked_laws(search, base, fits)
    if not laws:
        return []
    first = pruned(search, base, laws[0])
    polished = search.polish(first.found.candidate)
    return [replace(first, found=search.judged[polished]), *laws[1:]]


def pruned(search: Search, base: Evidence[OdeCandidate], law: FittedLaw) -> FittedLaw:
    """A formula without the terms that the free run does not need."""
    effect, values = law.effect, law.found.candidate.theta_of(len(law.found.effects) - 1)
    if law.curve or len(effect.terms) == 1:
        return law
    fewer = []
    for i in range(len(effect.terms)):
        filled = [one for k, one in enumerate(effect.filled(values.tolist())) if k != i]
        terms = tuple(term for _, term in filled)
        late = float(values[-1]) if any(f[1].startswith("lag(") for t in terms for f in t.factors) else None
        price = price_of(terms, law.n_drivers)
        draft = Draft(terms, np.array([float(c) for c, _ in filled]), late, 0.0, 0.0, price)
        fitted = fitted_draft(search, base, law.found.candidate.fit.x, draft, law.location, law.kind)
        if fitted is not None:
            fewer.append(replace(law, found=Evidence(fitted, base.noise, -np.inf), price=price))
    best = ranked_laws(search, base, [law, *fewer])[0]
    return law if best.found.candidate is law.found.candidate else pruned(search, base, best)


def ranked_laws(search: Search, base: Evidence[OdeCandidate], fits: list[FittedLaw]) -> list[FittedLaw]:
    """Best first, under their own noise; of those that are as good the one with the fewest parameters."""
    candidates = [law.found.candidate for law in fits]
    kept = search.ranked(candidates, base.candidate)
    fits = [replace(law, found=search.judged[law.found.candidate]) for law in fits if law.found.candidate in kept]
    if not fits:
        return []
    score = search.order([law.found.candidate for law in fits])
    value = {id(law): score(law.found.candidate) - law.price for law in fits}
    fits.sort(key=lambda law: -value[id(law)])
    best = value[id(fits[0])]
    near = [law for law in fits if value[id(law)] > best - AS_GOOD]
    first = min(near, key=lambda law: law.found.candidate.n_parameters)
    return [first, *(law for law in fits if law is not first)]


def fitted_draft(
    search: Search, base: Evidence[OdeCandidate], x: np.ndarray | None, draft: Draft, location: str, kind: str
) -> OdeCandidate | None:
    """A formula as an effect on top of the base, fitted in the free run from a path x."""
    candidate = base.candidate
    effect = law_effect(kind, location, as_written(draft.terms), tuple(map(float, draft.values)), free=True)
    problem, split = search.searching(candidate), candidate.n_parameters
    theta = np.concatenate([candidate.fit.theta[:split], draft.values, candidate.fit.theta[split:]])
    assert x is not None
    x = x[: candidate.model.n_nominal]  # hidden states of effects and laws settle along it
    try:
        with np.errstate(all="ignore"):
            return fit_last(problem, (*candidate.effects, effect), theta, x, candidate.fit, np.inf)
    except (np.linalg.LinAlgError, FloatingPointError):  # a law that breaks the arithmetic is out
        return None


def drivers_at(base: OdeCandidate, channel: Channel, location: str, kind: str) -> Drivers:
    """Signals that may drive a law at a place: states and inputs in a balance, inputs at an input, outputs at a sensor."""
    problem = base.problem
    plant, record = problem.plant, channel.record
    assert channel.x is not None
    n = len(plant.states)
    if kind == "output":
        return Drivers(dict(zip(plant.outputs, base.fit.y)), {}, own=location)
    if kind == "input":
        signals, held = dict(zip(plant.inputs, record.u)), set(plant.inputs)
        past = _past(record, {location: signals[location]})
    else:
        signals = dict(zip([*plant.states, *plant.inputs], [*channel.x[:n], *record.u]))
        held = set(plant.inputs) if plant.hold == "zoh" else set()
        past = _past(record, signals)
    late = {name: z for name, (z, _) in past.items()}
    now = {**signals, **late}
    ends = {name: z if name in held else at_end(record, z[None])[0] for name, z in now.items()}
    times = {name: c for name, (_, c) in past.items()}
    return Drivers(now, times, ends if kind == "state" else None, location if kind == "input" else None)


def _past(record: Record, signals: dict[str, np.ndarray]) -> dict[str, tuple[np.ndarray, float]]:
    """First-order filters of signals, settled at the start of every run, with their time constants."""
    out = {}
    longest = LATEST * float(record.lengths.max())
    for name, z in signals.items():
        first = z[record.starts][record.run_of_row]
        for k, samples in enumerate(c for c in LATE if c <= longest):
            a = float(np.exp(-1.0 / samples))
            moved = first_order_scan(a, (z - first)[None], record.starts)[0]
            out[f"lag({name})#{k}"] = first + (1.0 - a) * moved, samples * record.dt
    return out
