"""Effects on an input: what the actuator does before the simulator sees it. They act in the order of their :attr:`order`."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from typing import Any

import numpy as np

from sksurrogate.effects._base_effect import BaseEffect, Theta
from sksurrogate.effects._families import InputEffect
from sksurrogate.effects._lattice import COARSE, likely_steps
from sksurrogate.effects._parts import Parameter, Probe
from sksurrogate.effects._smooth import clip
from sksurrogate.kernels.signals import Signal, delay, play, pointwise
from sksurrogate.physics._simulator import Plant

#: Steps to the largest value: half a step is rounded to 0, steps finer than the last round nothing that can be seen.
COARSEST, FINEST = 0.55, 40.0
#: Largest value over the range of a signal, beyond which no finer steps are tried.
LARGEST_STEP_RANGE = 4.0
#: Depths of limits below the top of a range, over the range, that cut off little.
SHALLOW = (0.002, 0.008)
#: Share of a step by which a quantizer that rounds down is below one that rounds to the nearest.
ROUNDING_DOWN = 0.5


def quantize(u: np.ndarray, step: Any, lower: float = 0.0) -> np.ndarray:
    """``c round(u / c - lower)``; u itself where c is 0.

    >>> quantize(np.array([0.6, 0.9]), 0.5), quantize(np.array([0.6, 0.9]), 0.5, ROUNDING_DOWN)
    (array([0.5, 1. ]), array([0.5, 0.5]))
    """
    step = np.abs(step)
    return np.where(step > 0, step * np.round(u / np.where(step > 0, step, 1.0) - lower), u)


def rounding_down(effect: Any) -> InputQuantization | None:
    """An actuator that moves in steps and rounds down; None for other effects."""
    if type(effect) is not InputQuantization or effect.lower:
        return None
    return InputQuantization(effect.location, effect.variable, lower=ROUNDING_DOWN)


def size_of(signal: np.ndarray) -> float:
    """Root mean square, 1 where the signal is nil."""
    size = float(np.sqrt(np.mean(np.square(signal)))) if signal.size else 0.0
    return size if size > 0 else 1.0


def times(probe: Probe, samples: Sequence[float] = (0.3, 1.0, 2.0, 4.0, 8.0, 16.0, 30.0)) -> list[tuple[float, ...]]:
    """Time constants to try: 0.3 to 30 samples."""
    longest = max(probe.duration / 3, probe.dt)
    return [(k * probe.dt,) for k in samples if k * probe.dt <= longest]


def delays(probe: Probe) -> list[tuple[float, ...]]:
    """Delays to try, at first amid each sample: an output that shows an input jumps from sample to sample."""
    return times(probe, (0.3, *np.arange(1.5, 13.0), 16.5, 22.5, 30.0))


def step_sizes(signal: np.ndarray, slope: tuple[np.ndarray, np.ndarray] | None = None) -> list[tuple[float, ...]]:
    """Steps of a quantisation to try: 0.55 to 40 steps to the largest value, more where the signal moves about an offset.

    Close together: a step that is off shifts the rounding of large values by a whole step. Where the slope of the log
    likelihood is known, of more than 10 steps those that go with it.
    """
    largest = float(np.max(np.abs(signal), initial=0.0))
    if largest <= 0:
        return []
    counts = np.r_[np.arange(COARSEST, 1.0, 0.05), np.arange(1.0, COARSE, 0.2)]
    if slope is None:
        offset = min(largest / max(float(np.ptp(signal)), 1e-300), LARGEST_STEP_RANGE)
        counts = np.r_[counts, np.arange(COARSE, FINEST * max(offset, 1.0), 0.4)]
    finer = [] if slope is None else likely_steps(*slope)
    return [(step,) for step in [*(largest / float(count) for count in counts), *finer]]


def neighbouring_steps(step: float) -> list[tuple[float, ...]]:
    """Steps up to 4 % off, close together near: one value that rounds otherwise makes a local minimum."""
    off = 2e-5 * 2.0 ** np.arange(12)
    return [(step * float(factor),) for factor in np.r_[1 - off, 1 + off]]


def levels_inside(signal: np.ndarray) -> list[tuple[float, ...]]:
    """Limits to try: just below the quantiles of the reached range, so that a signal of few levels reaches them too."""
    found = np.quantile(signal, (0.998, 0.97, 0.9, 0.75, 0.5))
    spread = float(np.ptp(signal))
    limits = dict.fromkeys(float(value - 0.03 * spread) for value in found)
    shallow = [float(np.max(signal, initial=0.0)) - depth * spread for depth in SHALLOW]
    return [(limit,) for limit in [*limits, *shallow] if spread > 0 and np.any(signal > limit)]


class InputGain(InputEffect):
    """The actuator's gain is off: ``(1 + c) u``."""

    name = "input_gain"
    order = 0
    parameters = (Parameter("relative_error"),)
    equation = "(1 + c) u"
    signature = "a scaled copy of the response to this input"
    twins = ("sensor_gain", "parameter_error", "linear_loss", "input_saturation")
    linear = True

    def transform(self, u: Signal, v: Signal | None, theta: Theta, h: float, starts: np.ndarray) -> Signal:
        factor = 1 + theta[0]
        return Signal(factor * u.mean, None if u.half is None else factor * u.half, factor * u.at_samples())

    def starts(self, probe: Probe) -> list[tuple[float, ...]]:
        """A tenth."""
        return [(0.1,)]


class InputBias(InputEffect):
    """The actuator has an offset: ``u + c``."""

    name = "input_bias"
    order = 1
    parameters = (Parameter("value", unit="u"),)
    equation = "u + c"
    signature = "a transient after the start of every run that settles at an offset"
    twins = ("constant_bias", "sensor_bias", "parameter_error")
    linear = True

    def transform(self, u: Signal, v: Signal | None, theta: Theta, h: float, starts: np.ndarray) -> Signal:
        return Signal(u.mean + theta[0], u.half, u.at_samples() + theta[0])

    def starts(self, probe: Probe) -> list[tuple[float, ...]]:
        """A tenth of the input's size."""
        return [(0.1 * size_of(probe.x),)]


class InputCurve(InputEffect):
    """The characteristic of a valve or thruster is bent: ``u + c u abs(u)``."""

    name = "input_curve"
    order = 2
    parameters = (Parameter("coefficient", unit="1 over u"),)
    equation = "u + c u abs(u)"
    signature = "a gain that depends on the amplitude of the input"
    twins = ("input_gain", "input_saturation", "input_dead_zone", "bilinear")
    linear = True

    def transform(self, u: Signal, v: Signal | None, theta: Theta, h: float, starts: np.ndarray) -> Signal:
        return pointwise(lambda value: value + theta[0] * value * np.abs(value), u)

    def starts(self, probe: Probe) -> list[tuple[float, ...]]:
        """A tenth at the input's size."""
        return [(0.1 / size_of(probe.x),)]


class InputCoupling(InputEffect):
    """Another input leaks in: ``u + c v``."""

    name = "input_coupling"
    rarity = 10.0
    order = 3
    parameters = (Parameter("coefficient", unit="u over v"),)
    equation = "u + c v, v another input"
    signature = "a residual that follows another input through this one's path"
    twins = ("linear_loss", "sensor_coupling", "parameter_error")
    linear = True

    @classmethod
    def variables(cls, plant: Plant, location: str) -> Sequence[str | None]:
        """The other inputs."""
        return tuple(name for name in plant.inputs if name != location)

    def transform(self, u: Signal, v: Signal | None, theta: Theta, h: float, starts: np.ndarray) -> Signal:
        assert v is not None
        half = u.half if v.half is None else theta[0] * v.half + (0.0 if u.half is None else u.half)
        return Signal(u.mean + theta[0] * v.mean, half, u.at_samples() + theta[0] * v.at_samples())

    def starts(self, probe: Probe) -> list[tuple[float, ...]]:
        """A tenth of this input at the other one's size."""
        assert probe.v is not None
        return [(0.1 * size_of(probe.x) / size_of(probe.v),)]


class LimitedActuator(InputEffect):
    """An actuator that is limited, or opens, at a value of its input.

    ``location``: the input.
    ``corner``: how its characteristic bends there, from 0, a corner, to 1, ``tanh``.
    """

    def __init__(self, location: str | None = None, variable: str | None = None, corner: float = 0.0):
        super().__init__(location, variable)
        self.corner = corner


class InputDeadZone(LimitedActuator):
    """Small inputs do nothing: ``sign(u) max(abs(u) - c, 0)``."""

    name = "input_dead_zone"
    order = 4
    parameters = (Parameter("half_width", low=0.0, unit="u"),)
    equation = "sign(u) max(abs(u) - c, 0)"
    signature = "no response to small inputs, a constant lack with large ones"
    twins = ("coulomb_friction", "input_gain", "input_backlash", "input_quantization")

    def transform(self, u: Signal, v: Signal | None, theta: Theta, h: float, starts: np.ndarray) -> Signal:
        """``u - clip(u, -c, c)``."""
        width = np.maximum(theta[0], 0.0)
        return pointwise(lambda value: value - clip(value, width, self.corner), u)

    def starts(self, probe: Probe) -> list[tuple[float, ...]]:
        """Parts of the largest input."""
        largest = float(np.max(np.abs(probe.x), initial=0.0))
        return [(share * largest,) for share in (0.03, 0.1, 0.25, 0.5)] if largest > 0 else []


class RememberingActuator(InputEffect):
    """An actuator whose output depends on the past, also on that before the record.

    ``location``: the input.
    ``before``: the input before the first row of every run, as 0 where a run begins with a step from rest. None: the
        value of the first row. ``w(0)`` of the equation is the same.
    """

    def __init__(self, location: str | None = None, variable: str | None = None, before: Any = None):
        super().__init__(location, variable)
        self.before = before

    @property
    def at_rest(self) -> bool:
        """At the first value of its input."""
        return self.before is None


def within_runs(effect: BaseEffect, whole: np.ndarray) -> Any:
    """The effect where some runs are pieces from within a recorded one: what was before the run was not before these.

    ``whole`` (n_runs,): which runs begin where a recorded one does.

    >>> late = within_runs(InputDelay("u", before=0.0), np.array([True, False]))
    >>> late.before
    array([ 0., nan])
    """
    if not isinstance(effect, RememberingActuator) or effect.before is None or whole.all():
        return effect
    out = copy.copy(effect)
    out.before = np.where(whole, effect.before, np.nan)
    return out


class InputBacklash(RememberingActuator):
    """Play in a gear, twice the half width wide: ``w = clip(w before, u - c, u + c)``, ``w(0) = u(0)``."""

    name = "input_backlash"
    order = 5
    parameters = (Parameter("half_width", low=0.0, unit="u"),)
    equation = "play operator of half width c: w = clip(w before, u - c, u + c), w(0) = u(0)"
    signature = "lag at reversals only, the less the larger the input"
    twins = ("input_delay", "input_lag", "coulomb_friction", "input_dead_zone", "hysteresis")

    def transform(self, u: Signal, v: Signal | None, theta: Theta, h: float, starts: np.ndarray) -> Signal:
        """Play."""
        return play(u, np.maximum(theta[0], 0.0), starts, self.before)

    def starts(self, probe: Probe) -> list[tuple[float, ...]]:
        """Parts of half the range."""
        half = float(np.ptp(probe.x)) / 2
        return [(share * half,) for share in (0.03, 0.1, 0.25, 0.5)] if half > 0 else []


class InputSaturation(LimitedActuator):
    """The actuator has limits: ``clip(u, -c, c)``."""

    name = "input_saturation"
    order = 6
    parameters = (Parameter("limit", null=np.inf, low=0.0, unit="u"),)
    equation = "clip(u, -c, c)"
    signature = "nothing until the input is large, then a lack that grows with it"
    twins = ("input_gain", "input_curve", "rate_limit", "sensor_saturation", "state_saturation")

    def transform(self, u: Signal, v: Signal | None, theta: Theta, h: float, starts: np.ndarray) -> Signal:
        limit = np.maximum(theta[0], 0.0)
        return pointwise(lambda value: clip(value, limit, self.corner), u)

    def starts(self, probe: Probe) -> list[tuple[float, ...]]:
        """Limits within the reached range."""
        size = np.abs(probe.x)
        limits = [*levels_inside(size), (0.6 * float(np.max(size, initial=0.0)),)]
        return [start for start in dict.fromkeys(limits) if start[0] > 0]


class InputQuantization(InputEffect):
    """The actuator moves in steps: ``c round(u / c)``.

    ``location``: the input.
    ``lower``: share of a step by which it rounds lower: 0 to the nearest step, 0.5 down, as a bank of valves that are open or shut.
    """

    name = "input_quantization"
    order = 8
    parameters = (Parameter("step", low=0.0, unit="u"),)
    equation = "c round(u / c)"
    signature = "a saw tooth in the input that never exceeds half a step"
    twins = ("input_dead_zone", "sensor_quantization")

    def __init__(self, location: str | None = None, variable: str | None = None, lower: float = 0.0):
        super().__init__(location, variable)
        self.lower = lower

    def transform(self, u: Signal, v: Signal | None, theta: Theta, h: float, starts: np.ndarray) -> Signal:
        return pointwise(lambda value: quantize(value, theta[0], self.lower), u)

    def starts(self, probe: Probe) -> list[tuple[float, ...]]:
        """From half a step to 40 steps to the largest input; finer ones where the slope of the likelihood shows them."""
        return step_sizes(probe.x, None if self.lower else probe.slope)

    def scan(self, theta: Sequence[float]) -> list[tuple[float, ...]]:
        """Steps up to 4 % off."""
        return neighbouring_steps(theta[0])


class InputDelay(RememberingActuator):
    """The input arrives late: ``u(t - c)``; before the first row its value."""

    name = "input_delay"
    order = 9
    parameters = (Parameter("delay", low=0.0, unit="time"),)
    equation = "u(t - c)"
    signature = "minus the delay times the slope of the response: largest right after edges"
    twins = ("sensor_delay", "input_lag", "sensor_lag", "input_backlash")

    def transform(self, u: Signal, v: Signal | None, theta: Theta, h: float, starts: np.ndarray) -> Signal:
        return delay(u, theta[0], h, starts, self.before)

    def starts(self, probe: Probe) -> list[tuple[float, ...]]:
        """0.3 to 30 samples, at first amid each."""
        return delays(probe)
