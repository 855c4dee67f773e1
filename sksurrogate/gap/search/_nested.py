"""Effects whose forms contain one another."""

from __future__ import annotations

from collections.abc import Collection

from sksurrogate.effects._base_effect import BaseEffect
from sksurrogate.effects._families import BalanceEffect, HiddenEffect, LimitEffect, SensorEffect
from sksurrogate.effects._input import InputBias, InputQuantization, RememberingActuator
from sksurrogate.effects._sensor import SensorBias, SensorQuantization

#: Effects that round: steps are what no other form leaves.
QUANTIZERS = InputQuantization, SensorQuantization
#: Effects that are no curve of a signal or of time: they remember, stop a state, or round.
NO_CURVES = HiddenEffect, LimitEffect, RememberingActuator, *QUANTIZERS

#: Parameters of what the clock drives.
CLOCKS = "rate", "time", "phase"


def richer(effect: BaseEffect, simple: BaseEffect) -> bool:
    """Whether an effect is a richer form of a simple one: at its place, in its variable.

    One that begins or ends is a richer form of itself in all rows.
    """
    in_a_window = effect.name == simple.name and len(effect.key) > len(simple.key)
    return contains(effect, simple) and (simple.name in effect.nests or in_a_window)


def contains(effect: BaseEffect, simple: BaseEffect) -> bool:
    """Whether an effect may come down to a simpler one by place and variable."""
    return effect.location == simple.location and simple.variable in (effect.variable, None)


def of_one_law(one: BaseEffect, other: BaseEffect) -> bool:
    """Whether two effects at one place nest each other or a form in common: in one variable, or frictions that remember a motion.

    >>> from sksurrogate.effects import CATALOGUE
    >>> loop, bristles, loss = (
    ...     CATALOGUE[name]("v", of) for name, of in (("hysteresis", "y"), ("lugre_friction", "v"), ("linear_loss", "y"))
    ... )
    >>> of_one_law(loop, bristles), of_one_law(loop, loss)
    (True, False)
    """
    same = one.variable == other.variable or None in (one.variable, other.variable)
    remember = isinstance(one, HiddenEffect) and isinstance(other, HiddenEffect)
    forms = {one.name, *one.nests} & {other.name, *other.nests}
    return (same or remember) and bool(forms) and one.location == other.location and one.name != other.name


def of_one_curve(one: BaseEffect, other: BaseEffect) -> bool:
    """Whether two effects are curves of one signal, or of time, at one place: there both together are one curve, and the smaller is a part of it.

    >>> from sksurrogate.effects import CATALOGUE
    >>> friction, tilt, loop = (CATALOGUE[name]("v", "v") for name in ("coulomb_friction", "gravity_tilt", "hysteresis"))
    >>> of_one_curve(friction, tilt), of_one_curve(friction, loop)
    (True, False)
    """
    same = (one.kind, one.location, one.variable) == (other.kind, other.location, other.variable)
    return same and _is_curve(one) and _is_curve(other)


def drivers(effect: BaseEffect) -> frozenset[str]:
    """The signals that drive an effect; none is time.

    >>> from sksurrogate.effects import CATALOGUE
    >>> sorted(drivers(CATALOGUE["bilinear"]("v", "u*v"))), drivers(CATALOGUE["input_gain"]("u"))
    (['u', 'v'], frozenset({'u'}))
    >>> drivers(CATALOGUE["drift"]("v"))
    frozenset()
    """
    if effect.signals:
        return frozenset(effect.signals)
    at_a_signal = effect.kind in ("input", "output") and not has_a_clock(effect)
    return frozenset([str(effect.location)] if at_a_signal else [])


def has_a_clock(effect: BaseEffect) -> bool:
    """Whether an effect changes with the time, whatever the signals do."""
    return any(parameter.name in CLOCKS for parameter in effect.parameters)


def may_be_of(effect: BaseEffect, signals: Collection[str]) -> bool:
    """Whether an effect may be a part of a law of some signals: nothing else drives it, and no clock does. A constant may be a part of any.

    >>> from sksurrogate.effects import CATALOGUE
    >>> friction, step, bias = CATALOGUE["coulomb_friction"]("v", "v"), CATALOGUE["step_disturbance"]("v"), CATALOGUE["input_bias"]("u")
    >>> may_be_of(friction, {"v"}), may_be_of(friction, {"u"}), may_be_of(step, {"v"}), may_be_of(bias, {"v"})
    (True, False, False, True)
    """
    return not has_a_clock(effect) and (isinstance(effect, (InputBias, SensorBias)) or drivers(effect) <= set(signals))


def driven_alike(one: BaseEffect, other: BaseEffect) -> bool:
    """Whether a signal drives both of two effects, or nothing but time.

    >>> from sksurrogate.effects import CATALOGUE
    >>> wave, drift, loss = (CATALOGUE[name]("v") for name in ("periodic_disturbance", "drift", "sensor_nonlinearity"))
    >>> driven_alike(wave, drift), driven_alike(wave, loss), driven_alike(loss, CATALOGUE["bilinear"]("y", "u*v"))
    (True, False, True)
    """
    return drivers(one) == drivers(other) or bool(drivers(one) & drivers(other))


def _is_curve(effect: BaseEffect) -> bool:
    remembers = isinstance(effect, SensorEffect) and effect.memory
    of_two = isinstance(effect, BalanceEffect) and effect.of_load
    return not (remembers or of_two or isinstance(effect, NO_CURVES))
