"""Numbers of a report in words: changes before and after, intervals, probabilities."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from sksurrogate.effects._catalogue import in_words
from sksurrogate.effects._onset import WINDOW
from sksurrogate.effects._parameter import ParameterDependence
from sksurrogate.gap.render._units import TIME, parameter_unit, variable_unit, with_unit
from sksurrogate.gap.results._effect_estimate import EffectEstimate, circumstances
from sksurrogate.gap.results._report_data import ReportData
from sksurrogate.gap.results._table import Table

#: Probability from which a word applies, the first that is reached: the words of the reports on climate change (IPCC).
MORE_LIKELY_THAN_NOT = 0.5
WORDS = ((0.9, "very likely"), (0.66, "likely"), (MORE_LIKELY_THAN_NOT, "more likely than not"), (0.0, "uncertain"))


def number(value: float, digits: int = 4) -> str:
    """A number in few digits; a dash where it is not known.

    >>> number(99.9713), number(0.0), number(float("nan")), number(1e-320)
    ('99.97', '0', '-', '0')
    """
    if value is None or np.isnan(value):
        return "-"
    return format(0.0 if abs(value) < 1e-200 else float(value), f".{digits}g")


def quantity(value: float, unit: str) -> str:
    """A number in few digits with its unit."""
    return with_unit(number(value), unit)


def percent(share: float) -> str:
    """A share in per cent.

    >>> percent(0.9876), percent(1e-5), percent(float("nan"))
    ('98.8 %', '< 0.1 %', '-')
    """
    if not np.isfinite(share):
        return "-"
    return "< 0.1 %" if 0 < share < 0.001 else f"{100 * share:.1f} %"


#: A part of the samples whose share of the gap differs by less than this stands out in nothing.
EVEN_WITHIN = 0.05
EVENLY = "The gap is spread evenly over the operating range: no part of it stands out."


def spread_evenly(by_region: Table) -> bool:
    """Whether every part of the operating range has the share of the gap that its samples alone would give it.

    >>> rows = {"rule": "v > 1", "share": 0.58, "samples": 0.6}, {"rule": "v <= 1", "share": 0.42, "samples": 0.4}
    >>> spread_evenly(Table(rows)), spread_evenly(Table(({**rows[0], "share": 0.8}, {**rows[1], "share": 0.2})))
    (True, False)
    """
    return len(by_region) > 1 and all(abs(row["share"] - row["samples"]) < EVEN_WITHIN for row in by_region)


def piece(report: ReportData) -> str:
    """What is left out of a fit and drawn by itself: a run, or a block where there were too few runs and they were cut."""
    return "block" if len(report.traces) > report.provenance.n_runs > 0 else "run"


def held_out(report: ReportData) -> str:
    """The data that a fit did not see, in words."""
    return f"held-out {piece(report)}s"


#: Ratio of the ends of an interval from which a value may be any, and what is said of it.
ANY, NOT_DETERMINED = 1e6, "not determined by these data"


def interval_text(low: float, high: float) -> str:
    """An interval in as many digits as tell its ends apart, empty where it is not known.

    >>> interval_text(1.0, float("inf")), interval_text(float("nan"), 2.0), interval_text(1.09972, 1.10031)
    ('[1, inf]', '', '[1.0997, 1.1003]')
    """
    if np.isnan(low) or np.isnan(high):
        return ""
    ends = ((number(low, digits), number(high, digits)) for digits in range(4, 17))
    first, last = next((pair for pair in ends if pair[0] != pair[1]), (number(low), number(high)))
    return f"[{first}, {last}]"


def confidence(probability: float) -> str:
    """A probability as a word and a number.

    >>> confidence(0.96), confidence(0.7), confidence(0.2), confidence(float("nan"))
    ('very likely (probability 0.96)', 'likely (probability 0.70)', 'uncertain (probability 0.20)', 'probability not known yet')
    >>> confidence(0.0004)
    'uncertain (probability below 0.01)'
    """
    if np.isnan(probability):
        return "probability not known yet"
    word = next(text for least, text in WORDS if probability >= least)
    rounded = f"{probability:.2f}"
    return f"{word} (probability {'below 0.01' if rounded == '0.00' else rounded})"


def capitalised(text: str) -> str:
    """A text as the beginning of a sentence.

    >>> capitalised("rate limit at Kp")
    'Rate limit at Kp'
    """
    return text[:1].upper() + text[1:]


def readable(name: str) -> str:
    """A name of the catalogue as words."""
    return name.replace("_", " ")


def effect_text(effect: EffectEstimate) -> str:
    """Effect, place and driving signal.

    >>> effect_text(EffectEstimate("linear_loss", "speed", "level", 1.0, {}, {}, 1.0))
    'linear loss at speed, driven by level'
    >>> effect_text(EffectEstimate("linear_loss", "speed", "speed", 1.0, {}, {}, 1.0))
    'linear loss at speed'
    """
    return key_text((effect.name, effect.location, effect.variable)) + circumstances(effect)


def key_text(key: Sequence[str | None]) -> str:
    """Name, place and driving signal of an effect, by its key."""
    return in_words(str(key[0]), key[1], key[2])


def is_wrong_parameter(effect: EffectEstimate) -> bool:
    """Whether it is a parameter of the simulator that is wrong all along, not from a time on."""
    return effect.name == "parameter_error" and not set(WINDOW) & set(effect.params)


def change_of(
    effect: EffectEstimate,
    nominal: Mapping[str, float],
    units: Mapping[str, str],
    ranges: Mapping[str, tuple[float, float]] = MappingProxyType({}),
    retuned: Mapping[str, float] = MappingProxyType({}),
) -> list[str]:
    """What the effect changes, one line a parameter: *before -> after* of the simulator's own, else value and interval.

    ``nominal``: parameters of the simulator as it was given.
    ``ranges``: of the signals along the data; of a parameter that depends on one its values at both ends.
    ``retuned``: values of free parameters, which such a dependence multiplies.

    >>> wrong = EffectEstimate("parameter_error", "length", None, 1.0, {"relative_error": 0.25}, {"relative_error": (0.2, 0.3)}, 1.0)
    >>> change_of(wrong, {"length": 2.0}, {"length": "m"})
    ['length: 2 -> 2.5 m [2.4, 2.6]']
    >>> bias = EffectEstimate("sensor_bias", "level", None, 1.0, {"value": 0.5}, {"value": (0.4, 0.6)}, 1.0)
    >>> change_of(bias, {}, {"level": "cm"})
    ['value: 0.5 cm [0.4, 0.6]']
    >>> bristles = EffectEstimate("lugre_friction", "v", "v", 1.0, {"velocity": 1e5}, {"velocity": (1e-12, 4e14)}, 1.0)
    >>> change_of(bristles, {}, {"v": "m/s"})
    ['velocity: not determined by these data']
    """
    before, driver = nominal.get(effect.location), str(effect.variable)
    if before is not None and effect.name == "parameter_dependence" and driver in ranges:
        rest = {name: value for name, value in effect.params.items() if name != "relative_error"}
        along = _along(effect, before, retuned.get(effect.location, before), ranges[driver], units)
        return [along, *change_of(replace(effect, params=rest), {}, units)]
    if before is not None and effect.name == "parameter_error" and "relative_error" in effect.params:
        rest = {name: value for name, value in effect.params.items() if name != "relative_error"}
        return [_moved(effect, before, units), *change_of(replace(effect, params=rest), {}, units)]
    if before is not None and effect.name == "parameter_step":
        when = quantity(effect.params["time"], units.get(TIME, ""))
        return [f"{_moved(effect, before, units)} from t = {when} on"]
    lines = []
    for name, value in effect.params.items():
        low, high = effect.intervals.get(name, (np.nan, np.nan))
        text = quantity(value, parameter_unit(effect, name, units))
        known = f"{text} {interval_text(low, high)}".rstrip()
        lines.append(f"{readable(name)}: {NOT_DETERMINED if 0.0 < low * ANY < high else known}")
    return lines


def _along(
    effect: EffectEstimate, before: float, fitted: float, ends: tuple[float, float], units: Mapping[str, str]
) -> str:
    """A parameter of the simulator, and what it is where the signal that it depends on has its least and its largest value.

    >>> warm = EffectEstimate("parameter_dependence", "R", "T", 1.0, {"slope": 0.01, "relative_error": -0.2}, {}, 1.0)
    >>> _along(warm, 5.0, 5.0, (20.0, 60.0), {"R": "ohm", "T": "degC"})
    'R: 5 ohm -> 5 ohm at T = 20 degC, 7 ohm at T = 60 degC'
    >>> _along(warm, 5.0, 4.0, (20.0, 60.0), {})  # re-tuned besides
    'R: 5 -> 4 at T = 20, 5.6 at T = 60'
    """
    form, name = ParameterDependence(curvature=effect.curvature), str(effect.variable)
    theta, unit = (effect.params["slope"], effect.params["relative_error"]), units.get(effect.location, "")
    values = [float(form.value(fitted, 0.0, theta, 0.0, v)) for v in ends]
    at = (f"{quantity(p, unit)} at {name} = {quantity(v, variable_unit(name, units))}" for p, v in zip(values, ends))
    return f"{effect.location}: {quantity(before, unit)} -> {', '.join(at)}"


def _moved(effect: EffectEstimate, before: float, units: Mapping[str, str]) -> str:
    """A wrong parameter of the simulator before and after its relative change."""

    def at(change: float) -> float:
        return change if before == 0 else before * (1 + change)

    ends = [at(end) for end in effect.intervals.get("relative_error", (np.nan, np.nan))]
    return moved_text(
        effect.location, before, at(effect.params["relative_error"]), ends, units.get(effect.location, "")
    )


def moved_text(name: str, before: float, after: float, ends: Sequence[float], unit: str) -> str:
    """A parameter before and after, and the ends of its interval in any order.

    >>> moved_text("mass", 2.0, 2.5, (2.6, 2.4), "kg")
    'mass: 2 -> 2.5 kg [2.4, 2.6]'
    """
    low, high = sorted(ends)
    return f"{name}: {number(before)} -> {quantity(after, unit)} {interval_text(low, high)}".rstrip()
