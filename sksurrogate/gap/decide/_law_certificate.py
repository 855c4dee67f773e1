"""The certificate of a law without a name: chosen among the formulae and fitted on some runs, simulated on the others."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sksurrogate._units import over, times, to_power
from sksurrogate.effects._formula import SHAPES, separate_parts, signal_names
from sksurrogate.effects._law import AnyLaw
from sksurrogate.gap.decide._held_out import HeldOut
from sksurrogate.gap.decide._intervals import intervals
from sksurrogate.gap.fit._evidence import CERTAIN, Evidence
from sksurrogate.gap.results._effect_estimate import BAND
from sksurrogate.gap.results._law import Law
from sksurrogate.gap.results._shrink import Shrink
from sksurrogate.gap.search._base import BaseSearch
from sksurrogate.gap.unnamed._formula_fit import FittedLaw
from sksurrogate.physics._simulator import Plant, units_of

#: Share of what is left beside the names (amplitude) that a law must close on runs left out.
CERTIFICATE = 0.15

#: The effect that adds a constant, by the kind of its place.
CONSTANTS = {"state": "constant_bias", "input": "input_bias", "output": "sensor_bias", "parameter": "parameter_error"}


@dataclass(frozen=True, eq=False)
class CertifiedLaw:
    """A law and its free runs on runs left out."""

    law: FittedLaw  #: On the record of the search
    held: HeldOut
    fitted: Evidence[Any]  #: The same on more of a long record
    evidence: float  #: Nats by which it is likelier than no law, its price paid


def takes_the_place(
    search: BaseSearch[Any], law: FittedLaw, final: Evidence[Any], rest: FittedLaw | None = None
) -> bool:
    """Whether a formula on top of nothing, of fewer parts than names and law, stands in their place.

    It does if it is clearly likelier than the names alone, or likelier than these with the law that they leave, which has its parts too. All
    with the price of their choice.
    """
    if law.curve or n_parts(law, final) >= len(final.effects) + (rest is not None):
        return False
    named = final if rest is None else rest.found
    score = search.order([law.found.candidate, named.candidate])
    price = len(final.effects) * np.log(len(search.library)) + (0.0 if rest is None else rest.price)
    needed = CERTAIN if rest is None else 0.0
    return bool(score(law.found.candidate) - law.price > score(named.candidate) - price + needed)


def n_parts(law: FittedLaw, final: Evidence[Any]) -> int:
    """Number of effects that a formula is worth beside names: its parts that share no signal, and a constant that is one of the names."""
    names = {(effect.name, effect.location) for effect in final.effects}
    has_a_constant = any(not term.factors for term in law.effect.terms)
    return separate_parts(law.effect.terms) + (has_a_constant and (CONSTANTS[law.kind], law.location) in names)


def closes_clearly_more(one: float, other: float) -> bool:
    """Whether one share of the gap (amplitude, on runs left out) exceeds another by a practical share of what that leaves.

    >>> closes_clearly_more(0.7, 0.6), closes_clearly_more(0.65, 0.6), closes_clearly_more(0.2, float("nan"))
    (True, False, True)
    """
    least = other if np.isfinite(other) else 0.0
    return bool(one > least + CERTIFICATE * (1.0 - least))


def certified_law(shrink: Shrink) -> bool:
    """Whether a law closes a practical share of what is left on runs left out."""
    return closes_clearly_more(shrink.fraction_law, shrink.fraction)


def share_of_law(shrink: Shrink) -> float:
    """Share of the gap's power that a law closes beside what is named; nan where that is not known."""
    closed = shrink.fraction_power_law - (shrink.fraction_power if np.isfinite(shrink.fraction_power) else 0.0)
    return float(np.clip(closed, 0.0, 1.0)) if np.isfinite(closed) else float("nan")


def law_of(beside: CertifiedLaw, plant: Plant, shrink: Shrink) -> Law:
    """The law as a result, with what it closes on runs left out."""
    fitted, final = beside.law, beside.fitted
    candidate = final.candidate
    i = len(candidate.effects) - 1
    effect = replace(fitted, found=final).effect
    low, high = (ends[candidate.slice_of(i)] for ends in intervals(final))
    theta = candidate.theta_of(i)
    spread = np.maximum(high - theta, theta - low) / BAND
    names = [p.name for p in effect.parameters]
    signals = candidate.signals | (dict(zip(plant.outputs, candidate.fit.y)) if fitted.kind == "output" else {})
    drivers = sorted({n for term in effect.terms for f in term.factors for n in signal_names(f[1])} & set(signals))
    return Law(
        fitted.location,
        fitted.kind,
        tuple(drivers),
        effect,
        dict(zip(names, map(float, theta))),
        dict(zip(names, (float(s) if np.isfinite(s) else float("nan") for s in spread))),
        units_of_law(effect, fitted.kind, plant),
        share_of_law(shrink),
        {name: (float(np.min(signals[name])), float(np.max(signals[name]))) for name in drivers},
        fitted.curve,
        certified_law(shrink),
        float(beside.evidence),
    )


def units_of_law(effect: AnyLaw, kind: str, plant: Plant) -> dict[str, str]:
    """Units of the parameters, as far as the simulator names those of its signals; empty where they do not follow."""
    given = units_of(plant.simulator)
    time, own = given.get("time", ""), given.get(str(effect.location), "")
    placed = over(own, time) if kind == "state" else own
    coefficients, constants = [], []
    for term in effect.terms:
        unit = placed
        for shape, name, *_ in term.factors:
            v, function = given.get(signal_names(name)[0], ""), SHAPES[shape]
            if function.power:
                unit = (over if function.power > 0 else times)(unit, to_power(v, abs(function.power)))
            unit = "" if function.power is None else unit
            powers = zip(function.constant_powers, function.bounds)
            constants += ["1" if p == 0 else v if p == 1 else over("1", v) for p, _ in powers]
        coefficients.append(unit)
    known = [*coefficients, *(constants if effect.free else [])]
    names = [p.name for p in effect.parameters]
    return dict(zip(names, [*known, *[time] * (len(names) - len(known))]))
