"""Effects on the balance of a state: a term of states and inputs is missing in dx/dt."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import Any

import numpy as np

from sksurrogate.effects._exchange import others
from sksurrogate.effects._families import BalanceEffect
from sksurrogate.effects._parts import Parameter, Probe
from sksurrogate.effects._smooth import WITHIN_SAMPLE, positive, power, sign, stable_power
from sksurrogate.effects._stribeck_curve import LEAST_RATIO, larger_at_rest, stribeck_curve
from sksurrogate.physics._simulator import Plant

#: Levels of dry friction that may stop a state, over that of a tenth of its balance (a state that sticks hardly moves,
#: whatever drives it). Within a sample they take at least the second share of its RMS.
STOPPING, STOPPED_WITHIN_SAMPLE = 2.0 ** np.arange(1, 7), 0.04
#: A stop that pushes in this share of the samples is none.
ALWAYS = 0.95


class ConstantBias(BalanceEffect):
    """A constant force or flow: ``+ c``."""

    name = "constant_bias"
    drivers = ()
    at_port = ("constant",)
    parameters = (Parameter("value", unit="dx/dt"),)
    equation = "+ c"
    signature = "a transient after the start of every run that settles at an offset, whatever the input does"
    twins = ("input_bias", "sensor_bias", "gravity_tilt", "drift", "parameter_error")

    def term(self, t: Any, x: np.ndarray, v: Any, theta: Sequence[Any], width: float) -> Any:
        """``c``."""
        return theta[0] + np.zeros_like(x)


class LinearLoss(BalanceEffect):
    """Viscous friction or first-order decay: ``- c v``."""

    name = "linear_loss"
    natural_drivers = ("own", "position")
    drivers = ("state", "input")
    at_port = ("speed", "position", "level", "coupled")
    parameters = (Parameter("coefficient", unit="dx/dt over v"),)
    equation = "- c v"
    signature = "in proportion to v: energy is lost at resonance, steps settle lower"
    twins = ("parameter_error", "quadratic_drag", "exchange", "input_gain")

    def term(self, t: Any, x: np.ndarray, v: Any, theta: Sequence[Any], width: float) -> Any:
        return -theta[0] * v


class QuadraticLoss(BalanceEffect):
    """A loss that grows with the square, whatever the sign: ``- c v^2``."""

    name = "quadratic_loss"
    natural_drivers = ("own",)
    drivers = ("state", "input")
    at_port = ("level",)
    parameters = (Parameter("coefficient", unit="dx/dt over v^2"),)
    equation = "- c v^2"
    signature = "even harmonics and a shift of the mean with the amplitude of v"
    twins = ("quadratic_drag", "constant_bias", "bilinear", "input_curve", "power_law")

    def term(self, t: Any, x: np.ndarray, v: Any, theta: Sequence[Any], width: float) -> Any:
        return -theta[0] * v * v


class QuadraticDrag(BalanceEffect):
    """Drag of a turbulent flow: ``- c v abs(v)``."""

    name = "quadratic_drag"
    natural_drivers = ("own",)
    at_port = ("speed", "level")
    parameters = (Parameter("coefficient", low=0.0, unit="dx/dt over v^2"),)
    equation = "- c v abs(v)"
    signature = "odd in v; strong when fast, gone when slow"
    twins = ("linear_loss", "coulomb_friction", "quadratic_loss", "cubic_stiffness", "power_law")

    def term(self, t: Any, x: np.ndarray, v: Any, theta: Sequence[Any], width: float) -> Any:
        return -theta[0] * v * np.abs(v)


def stopping(effect: BalanceEffect, probe: Probe) -> list[float]:
    """Levels of dry friction that stop the state of its balance now and then: within a sample it loses a share of its speed."""
    gain = probe.feedback if probe.feedback is not None else float(effect.variable == effect.location)
    if not gain or probe.v is None:
        return []
    speed, unit = float(np.sqrt(np.mean(probe.v**2))), probe.unit(np.sign(probe.v))
    return [c for c in unit * STOPPING if c * gain * probe.dt > STOPPED_WITHIN_SAMPLE * speed]


class _DryFriction(BalanceEffect):
    """Friction whose first parameter is its level c: the term jumps by 2 c where v changes its sign."""

    natural_drivers = ("own",)
    implausible = ("position",)

    def jump(self, theta: Sequence[Any], load: Any = 0.0) -> Any:
        """``c``."""
        return theta[0]

    def starts(self, probe: Probe) -> list[tuple[float, ...]]:
        """A tenth of the balance, and levels that stop the state."""
        rest = [p.null for p in self.parameters[1:]]
        return [*super().starts(probe), *((c, *rest) for c in stopping(self, probe))]


class CoulombFriction(_DryFriction):
    """Dry friction: ``- c sign(v)``."""

    name = "coulomb_friction"
    at_port = ("speed", "level")
    parameters = (Parameter("level", low=0.0, unit="dx/dt"),)
    equation = "- c sign(v)"
    signature = "a square wave with the sign of v; free motion stops in finite time; worst at small amplitudes"
    twins = (
        "asymmetric_friction",
        "stribeck_friction",
        "linear_loss",
        "lugre_friction",
        "input_dead_zone",
        "input_backlash",
    )

    def term(self, t: Any, x: np.ndarray, v: Any, theta: Sequence[Any], width: float) -> Any:
        return -theta[0] * sign(v, width)


class AsymmetricFriction(_DryFriction):
    """Dry friction that differs by direction: ``- c sign(v) - c2``."""

    name = "asymmetric_friction"
    at_port = ("speed", "level")
    parameters = (Parameter("level", low=0.0, unit="dx/dt"), Parameter("offset", unit="dx/dt"))
    equation = "- c sign(v) - c2"
    acts_at_null = True
    signature = "a square wave with the sign of v about a mean that is not zero"
    twins = ("coulomb_friction", "constant_bias", "stribeck_friction")
    nests = ("coulomb_friction",)

    def term(self, t: Any, x: np.ndarray, v: Any, theta: Sequence[Any], width: float) -> Any:
        return -theta[0] * sign(v, width) - theta[1]


class StribeckFriction(BalanceEffect):
    """Dry friction that is larger when slow: ``- (c + (cs - c) exp(-(v/vs)^2)) sign(v)``, with ``cs`` at least ``c``.

    Dry friction is never smaller at rest than in motion: a ``static_level`` below ``level`` counts as ``level``.
    """

    name = "stribeck_friction"
    natural_drivers = ("own",)
    at_port = ("speed", "level")
    implausible = ("position",)
    parameters = (
        Parameter("level", low=0.0, unit="dx/dt"),
        Parameter("static_level", low=0.0, unit="dx/dt"),
        Parameter("velocity", null=1.0, low=0.0, unit="v"),
    )
    equation = "- (c + (cs - c) exp(-(v/vs)^2)) sign(v), cs >= c"
    signature = "stick and slip at reversals; less friction once it moves"
    typical = "the friction is larger when slow, for longer than a part of a sample"
    twins = ("coulomb_friction", "asymmetric_friction", "lugre_friction")
    nests = ("coulomb_friction",)
    linear = False

    def term(self, t: Any, x: np.ndarray, v: Any, theta: Sequence[Any], width: float) -> Any:
        return -stribeck_curve(v, *theta) * sign(v, width)

    def jump(self, theta: Sequence[Any], load: Any = 0.0) -> Any:
        """The larger of both levels."""
        return np.maximum(theta[0], theta[1])

    def plausible(self, theta: Sequence[float], probe: Probe) -> bool:
        """Friction is larger when slow, and the variable takes more than a part of a sample to pass that velocity."""
        assert probe.v is not None
        change = float(np.sqrt(np.mean(np.diff(probe.v) ** 2))) if len(probe.v) > 1 else 0.0
        return bool(theta[1] > LEAST_RATIO * theta[0] and theta[2] > WITHIN_SAMPLE * change)

    def identifiable(self, theta: Sequence[float]) -> tuple[float, ...]:
        """Larger when slow."""
        level, static, velocity = theta
        return level, larger_at_rest(level, static), velocity

    def canonical(self, theta: Sequence[float]) -> tuple[float, ...]:
        """No less at rest than in motion."""
        level, static, velocity = theta
        return level, max(static, level), velocity

    def starts(self, probe: Probe) -> list[tuple[float, ...]]:
        """Two levels, friction at rest hardly and twice as large, two velocities on the reached range; levels that stop the state."""
        assert probe.v is not None
        speed = float(np.sqrt(np.mean(probe.v**2)))
        level = probe.unit(np.sign(probe.v))
        if speed == 0:
            return []
        levels = (0.5 * level, 2 * level)
        slowing = [(c, ratio * c, share * speed) for c in levels for ratio in (2.0, 1.2) for share in (0.15, 0.6)]
        return [*slowing, *((c, 2 * c, share * speed) for c in stopping(self, probe) for share in (0.15, 0.6))]


class CubicStiffness(BalanceEffect):
    """A hardening spring: ``- c v^3``."""

    name = "cubic_stiffness"
    natural_drivers = ("own", "position")
    at_port = ("position",)
    parameters = (Parameter("coefficient", low=0.0, unit="dx/dt over v^3"),)
    equation = "- c v^3"
    signature = "third harmonic; the resonance moves with the amplitude"
    twins = ("linear_loss", "quadratic_drag", "end_stop", "parameter_error")

    def term(self, t: Any, x: np.ndarray, v: Any, theta: Sequence[Any], width: float) -> Any:
        return -theta[0] * v * v * v


class SqrtLeak(BalanceEffect):
    """Outflow through an orifice: ``- c sqrt(max(v, 0))``."""

    name = "sqrt_leak"
    natural_drivers = ("own",)
    at_port = ("level",)
    parameters = (Parameter("coefficient", low=0.0, unit="dx/dt over sqrt(v)"),)
    equation = "- c sqrt(max(v, 0))"
    signature = "an outflow that grows ever more slowly with the level"
    twins = ("linear_loss", "power_law", "constant_bias", "parameter_error")

    def term(self, t: Any, x: np.ndarray, v: Any, theta: Sequence[Any], width: float) -> Any:
        return -theta[0] * np.sqrt(positive(v))

    def starts(self, probe: Probe) -> list[tuple[float, ...]]:
        """A tenth of the balance; none where v never is positive."""
        assert probe.v is not None
        return super().starts(probe) if np.any(probe.v > 0) else []


#: An odd power below this one jumps at zero: at a hundredth of its signal's size it has a third of its force.
LEAST_ODD_EXPONENT = 0.25


class PowerLaw(BalanceEffect):
    """A loss with an unknown exponent: ``- c v^m``, or ``- c v^m w`` of two signals; odd: ``v^m`` is ``sign(v) |v|^m``."""

    name = "power_law"
    natural_drivers = ("own", "position")
    drivers = ("state",)
    at_port = ("speed", "level")
    parameters = (
        Parameter("coefficient", low=0.0, unit="dx/dt over v^m (w)"),
        Parameter("exponent", null=1.0, low=0.05, high=8.0),
    )
    equation = "- c sign(v) abs(v)^m (times w for v*w)"
    signature = "a loss that is not a straight line in the level: kinetics, valves, natural convection"
    typical = "the exponent is within its bounds, and nothing jumps at zero"
    twins = ("linear_loss", "sqrt_leak", "quadratic_loss", "bilinear", "parameter_error")
    nests = ("linear_loss", "quadratic_loss", "quadratic_drag", "cubic_stiffness", "sqrt_leak")

    def term(self, t: Any, x: np.ndarray, v: Any, theta: Sequence[Any], width: float) -> Any:
        """``- c sign(v) |v|^m``, times w where there are two signals."""
        coefficient, exponent = theta
        if isinstance(v, tuple):
            return -coefficient * power(v[0], exponent, 0.0) * v[1]
        return -coefficient * power(v, exponent, width)

    def gain(self, theta: Any, size: float) -> Any:
        """``size^m``."""
        return size ** theta[1]

    def smoothed(self, theta: Sequence[Any], width: float, h: float) -> Any:
        """Where the slope of ``|v|^m``, m < 1, is too steep for steps ``h``; 0 where it is against another variable."""
        coefficient, exponent = theta
        return stable_power(coefficient, exponent, h)

    @classmethod
    def variables(cls, plant: Plant, location: str) -> Sequence[str | None]:
        """Any state; the location's state times another (a reaction that uses it up) or an input (an opening)."""
        apart = others(plant.states, location)
        used = tuple(f"{location}*{w}" for w in apart + plant.inputs)
        return (*plant.states, *used, *(f"{w}*{location}" for w in apart))

    def plausible(self, theta: Sequence[float], probe: Probe) -> bool:
        """No jump at zero: that is a dry friction, which has a width on a real plant. An exponent at its bound: a stop that begins."""
        assert probe.v is not None
        v = probe.factors[0] if len(probe.factors) == 2 else probe.v
        jumps = theta[1] <= LEAST_ODD_EXPONENT and np.min(v) < 0.0 < np.max(v)
        return not jumps and bool(theta[1] < 0.999 * self.parameters[1].high)

    def starts(self, probe: Probe) -> list[tuple[float, ...]]:
        """Exponents below and above one; none where v never is positive: there the loss would be a gain."""
        assert probe.v is not None
        v: Any = probe.factors if len(probe.factors) == 2 else (probe.v, np.ones_like(probe.v))
        if not np.any(v[0] > 0):
            return []
        forms = {m: self.term(0.0, probe.x, v, (1.0, m), 0.0) for m in (0.5, 1.5, 2.5)}
        return [(probe.unit(form), m) for m, form in forms.items()]


class Bilinear(BalanceEffect):
    """A product of two signals: ``+ c v w``."""

    name = "bilinear"
    rarity = 10.0
    at_port = ()
    parameters = (Parameter("coefficient", unit="dx/dt over v w"),)
    equation = "+ c v w (variable v*w, names sorted)"
    signature = "a response to one signal that depends on the level of the other"
    twins = ("linear_loss", "quadratic_loss", "power_law", "input_curve", "parameter_error")

    def term(self, t: Any, x: np.ndarray, v: Any, theta: Sequence[Any], width: float) -> Any:
        """``c v w``; a single array counts as the product."""
        return theta[0] * (v[0] * v[1] if isinstance(v, tuple) else v)

    @classmethod
    def variables(cls, plant: Plant, location: str) -> Sequence[str | None]:
        """All pairs of signals (a flow times its temperature may be two inputs)."""
        return tuple(f"{a}*{b}" for a, b in combinations(sorted({*plant.states, *plant.inputs}), 2))


class GravityTilt(BalanceEffect):
    """Weight along an angle: ``- c sin(v)``."""

    name = "gravity_tilt"
    natural_drivers = ("own", "position")
    drivers = ("state", "input")
    at_port = ("position",)
    implausible = ("speed",)
    parameters = (Parameter("level", low=0.0, unit="dx/dt"),)
    equation = "- c sin(v)"
    signature = "a restoring term that bends over at large angles"
    twins = ("linear_loss", "cubic_stiffness", "constant_bias", "parameter_error")

    def term(self, t: Any, x: np.ndarray, v: Any, theta: Sequence[Any], width: float) -> Any:
        return -theta[0] * np.sin(v)


class EndStop(BalanceEffect):
    """An elastic stop: ``- c max(v - edge, 0)``."""

    name = "end_stop"
    natural_drivers = ("own", "position")
    at_port = ("position",)
    parameters = (Parameter("stiffness", low=0.0, unit="dx/dt over v"), Parameter("edge", unit="v"))
    equation = "- c max(v - edge, 0)"
    signature = "one-sided pushes where v is largest, nothing elsewhere"
    typical = "the stop is left at times"
    twins = ("cubic_stiffness", "state_saturation", "quadratic_loss")
    nests = ("state_saturation",)

    def term(self, t: Any, x: np.ndarray, v: Any, theta: Sequence[Any], width: float) -> Any:
        return -theta[0] * np.maximum(v - theta[1], 0.0)

    def plausible(self, theta: Sequence[float], probe: Probe) -> bool:
        """The stop is left at times: one that always pushes is a loss and an offset."""
        assert probe.v is not None
        return bool(np.mean(probe.v > theta[1]) < ALWAYS)

    def starts(self, probe: Probe) -> list[tuple[float, ...]]:
        """Edges within the reached range."""
        assert probe.v is not None
        edges = probe.quantiles(probe.v, 0.97, 0.9, 0.75, 0.5, 0.25)
        return [(probe.unit(np.maximum(probe.v - edge, 0.0)), edge) for edge in edges if np.any(probe.v > edge)]
