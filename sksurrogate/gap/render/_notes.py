"""Notes of a report that are about how it came about."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from sksurrogate.effects._base_effect import BaseEffect
from sksurrogate.effects._catalogue import name_of
from sksurrogate.gap.decide._rules import PRACTICAL
from sksurrogate.gap.render._values import capitalised, percent
from sksurrogate.gap.results._next_experiment import first_of
from sksurrogate.gap.results._shrink import Shrink
from sksurrogate.gap.results._table import Table
from sksurrogate.kernels.readings import out_of_reach


def interruption(complete: bool, time_limit: float | None, cut: Sequence[str]) -> list[str]:
    """What ended the diagnosis early: a time limit at some stages, or an interrupt."""
    if cut and time_limit is not None:
        return [
            f"The time limit of {time_limit:g} s ended the diagnosis early; not or not fully answered: {', '.join(cut)}. Give it "
            "more time for the rest."
        ]
    return [] if complete else ["The diagnosis was interrupted: questions after that point are not answered."]


def disturbed(shares: Mapping[str, float]) -> str:
    """What was taken for a disturbance, as shares of the deviation of each output.

    >>> disturbed({"speed": 0.29})[:67]
    'A disturbance moves the outputs (29.0 % of the deviation of speed).'
    """
    sizes = ", ".join(f"{percent(share)} of the deviation of {name}" for name, share in shares.items())
    return (
        f"A disturbance moves the outputs ({sizes}). It follows no candidate and counts as noise here: what is closed is closed "
        "beyond it. Repeat a run with the same inputs to see whether it is one."
    )


def failed_stages(failed: Mapping[str, str]) -> list[str]:
    """Stages that the linear algebra of a model broke: the rest of the report stands without them.

    >>> failed_stages({"law": "the matrix is singular"})[0][:49]
    'Not answered, because the simulator is not finite'
    """
    if not failed:
        return []
    parts = "; ".join(f"{name} ({why})" for name, why in failed.items())
    return [f"Not answered, because the simulator is not finite or too stiff along the path that was needed: {parts}."]


def at_a_bound(retuned: Table) -> list[str]:
    """Free parameters that ended at a bound.

    >>> at_a_bound(Table(({"parameter": "k", "value": 2.0, "at_bound": True},)))[0][:29]
    'Re-tuned to a bound: k = 2. T'
    """
    held = [f"{row['parameter']} = {row['value']:.4g}" for row in retuned if row["at_bound"]]
    if not held:
        return []
    return [
        f"Re-tuned to a bound: {', '.join(held)}. The data ask for a value beyond it: the bound is too tight (where "
        "none was given, it is 55 times or 1/55 of the nominal value), or the parameter makes up for something else."
    ]


def changed_signs(nominal: Mapping[str, float], errors: Mapping[str, float]) -> list[str]:
    """Parameters whose relative errors, by name, give them another sign.

    >>> changed_signs({"k": 2.0, "b": 400.0}, {"k": -0.1, "b": -1.2225})[0][:43]
    'b has the other sign (400 -> -89): a mistak'
    """
    other = {name: nominal[name] * (1.0 + error) for name, error in errors.items() if error < -1.0 and nominal[name]}
    found = [f"{name} has the other sign ({nominal[name]:.4g} -> {value:.4g})" for name, value in other.items()]
    if not found:
        return []
    return [f"{'; '.join(found)}: a mistaken sign in the simulator, or the parameter makes up for something else."]


def lost_candidates(said: Sequence[str], names: Sequence[str] = ()) -> list[str]:
    """What the simulator raised, the first three of it, and the candidates without a fit, the first of them.

    >>> print(lost_candidates(["ValueError: the level is negative"], ["drift at level"])[0])
    The simulator failed where some candidates needed it, and what could not be simulated was left out (drift at level): ValueError: the level is negative.
    """
    if not said:
        return []
    more = f", and {len(said) - 3} more" if len(said) > 3 else ""
    return [
        "The simulator failed where some candidates needed it, and what could not be simulated was left "
        f"out{f' ({first_of(names)})' if names else ''}: {'; '.join(said[:3])}{more}."
    ]


#: Errors that no value of a state, input or parameter is the reason of.
MISTAKES = ("TypeError", "NameError", "UnboundLocalError", "AttributeError", "ImportError", "ModuleNotFoundError")


def mistakes(said: Sequence[str]) -> tuple[str, ...]:
    """What the simulator raised that is a mistake in it: no refusal of a point.

    >>> mistakes(["ValueError: the level is negative", "NameError: name 'level' is not defined"])
    ("NameError: name 'level' is not defined",)
    """
    return tuple(one for one in said if one.partition(":")[0] in MISTAKES)


def of_the_inputs(names: Sequence[str], u: np.ndarray) -> list[str]:
    """Inputs (n_inputs, n_samples) that never move, and those with values that look like a code for "no reading".

    >>> u = np.sin(np.arange(50.0))
    >>> u[7] = -9999.0
    >>> of_the_inputs(["force"], u[None])[0][:54]
    "Input 'force' is far from all its other values in 1 of"
    """
    still = [name for name, signal in zip(names, u) if np.ptp(signal) == 0]
    far = {name: signal[out_of_reach(signal)] for name, signal in zip(names, u)}
    return [f"Input {name!r} never moves: these data say nothing about its effects." for name in still] + [
        f"Input {name!r} is far from all its other values in {len(values)} of {u.shape[1]} rows ({values[0]:.4g}). If the "
        "plant was not given that, the gap after it is a fault of the record: make them nan and use Interpolator."
        for name, values in far.items()
        if len(values)
    ]


def on_none(shrink: Shrink) -> list[str]:
    """Why a gap above the noise floor has no name: it is below the practical bar, or no law explains it."""
    if not shrink.measurable:
        return []
    above = "The free run is above the noise floor, but"
    if shrink.before < PRACTICAL:
        return [
            f"{above} it misses the outputs by only {100 * shrink.before:.2g} % of their deviation. The practical bar is "
            f"{100 * PRACTICAL:g} %."
        ]
    return [
        f"{above} no law explains it better than a disturbance. Repeat a run with the same inputs to tell a disturbance from an "
        "effect."
    ]


def nearest(effect: BaseEffect, theta: Sequence[float], left: float) -> str:
    """The effect of the catalogue that comes nearest to a law without a name, and the share of the gap (amplitude) that it leaves.

    >>> from sksurrogate.effects import CATALOGUE
    >>> nearest(CATALOGUE["input_saturation"]("force"), (2.5,), 0.17)[:91]
    'The law has no name. Of the catalogue, input saturation at force (limit 2.5) comes nearest:'
    """
    return (
        f"The law has no name. Of the catalogue, {with_values(effect, theta)} comes nearest: alone it "
        f"leaves {percent(left)} of the gap in the data that it was fitted to."
    )


def nearer(effect: BaseEffect, theta: Sequence[float], closed: float, closed_by_law: float) -> str:
    """The effect that closes more of the gap (amplitude) on runs left out than the law that was found, and why it is not named.

    >>> from sksurrogate.effects import CATALOGUE
    >>> print(nearer(CATALOGUE["rate_limit"]("command"), (2.5,), 0.789, 0.266))
    Rate limit at command (limit 2.5) closes 78.9 % of the gap on held-out runs, the law 26.6 %. It is not named: along the measured data a law without a name is as likely in its place.
    """
    law = f"the law {percent(closed_by_law)}" if np.isfinite(closed_by_law) else "and no law was found"
    return (
        f"{capitalised(with_values(effect, theta))} closes {percent(closed)} of the gap on held-out runs, {law}. It is not named: "
        "along the measured data a law without a name is as likely in its place."
    )


def with_values(effect: BaseEffect, theta: Sequence[float]) -> str:
    """An effect with its parameters."""
    values = ", ".join(f"{parameter.name} {value:.4g}" for parameter, value in zip(effect.parameters, theta))
    return f"{name_of(effect)} ({values})"


def not_shown(effects: Sequence[BaseEffect]) -> list[str]:
    """Effects whose typical form the data do not show, and what that is.

    >>> from sksurrogate.effects import CATALOGUE
    >>> not_shown([CATALOGUE["power_law"]("v", "v")])
    ['Of power law at v the data do not show that the exponent is within its bounds, and nothing jumps at zero.']
    """
    return [f"Of {name_of(effect)} the data do not show that {effect.typical}." for effect in effects if effect.typical]


def too_little(names: Sequence[str], where: str = "in the data") -> str:
    """Said of names that are withdrawn.

    >>> too_little(["input delay at force"])
    'Input delay at force passed the evidence but closed too little of the gap in the data; no name is given.'
    """
    return f"{capitalised('; '.join(names))} passed the evidence but closed too little of the gap {where}; no name is given."
