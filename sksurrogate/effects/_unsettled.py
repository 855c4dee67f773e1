"""An actuator or sensor in motion where a run begins, as in a record that begins amid an operation."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np

from sksurrogate.effects._base_effect import BaseEffect
from sksurrogate.effects._families import HiddenEffect
from sksurrogate.effects._followers import InputLag, RateLimit
from sksurrogate.effects._hidden import FORGETS, HiddenMode, HiddenRelaxation, Hysteresis
from sksurrogate.effects._parts import Probe
from sksurrogate.effects._sensor import SensorLag
from sksurrogate.effects._smooth import TINY, WITHIN_SAMPLE, follow
from sksurrogate.physics._simulator import Plant

#: What is said of an effect wherever it begins.
_TOLD = ("name", "parameters", "equation", "signature", "twins", "rarity")


class _Unsettled(HiddenEffect):
    """An effect with a memory, from where this stood when a run began: a hidden state in place of a known start."""

    known: ClassVar[type[InputLag | RateLimit | SensorLag]]  #: The effect that begins at rest

    def __init_subclass__(cls) -> None:
        """It is told as the effect is."""
        super().__init_subclass__()
        for attribute in _TOLD if "known" in vars(cls) else ():
            setattr(cls, attribute, getattr(cls.known, attribute))

    def __init__(self, location: str | None = None):
        super().__init__(location, location, settled=False)

    @property
    def key(self) -> tuple[str, str | None, str | None]:
        """That of the effect: no other signal drives it."""
        return self.name, self.location, None

    @property
    def settled_form(self) -> BaseEffect:
        """From the first value of what it follows."""
        return self.known(self.location)

    def rest(self, v: np.ndarray, theta: Sequence[Any]) -> Sequence[Any]:
        """``w(0) = v(0)``."""
        return [v]

    def force(self, z: np.ndarray, v: np.ndarray, theta: Sequence[Any]) -> Any:
        """``w - v``."""
        return z[0] - v

    def starts(self, probe: Probe) -> list[tuple[float, ...]]:
        """As of the effect."""
        return self.known(self.location).starts(probe)


class _UnsettledLag(_Unsettled):
    """A lag: ``c dw/dt + w = v``, ``w(0)`` any."""

    def rates(
        self, z: np.ndarray, t: Any, v: np.ndarray, dv: np.ndarray, theta: Sequence[Any], width: float
    ) -> Sequence[Any]:
        """``(v - w) / c``."""
        return [(v - z[0]) / np.maximum(theta[0], TINY)]

    def rates_within(
        self, z: np.ndarray, t: Any, v: np.ndarray, dv: np.ndarray, theta: Sequence[Any], width: float, h: float
    ) -> Sequence[Any]:
        """What is much faster than a step keeps up."""
        return [follow(h / np.maximum(theta[0], TINY)) * rate for rate in self.rates(z, t, v, dv, theta, width)]

    def plausible(self, theta: Sequence[float], probe: Probe) -> bool:
        """What is slower than a third of a run is a constant of the run, what is faster than a sample shows no start."""
        return WITHIN_SAMPLE * probe.dt < theta[0] < max(probe.duration, probe.dt) / FORGETS


class UnsettledInputLag(_UnsettledLag):
    """The lag of an input, from where its actuator stood when a run began: ``c dw/dt + w = u``, ``w(0)`` any.

    It is :class:`~sksurrogate.effects._input.InputLag` but for its start: at the port of the input it adds ``w - u``.

    Examples
    --------
    >>> UnsettledInputLag("u").key
    ('input_lag', 'u', None)
    """

    known = InputLag
    typical = "the actuator follows within the runs, and not within a sample"


class UnsettledSensorLag(_UnsettledLag):
    """The lag of a sensor that shows a state, from what it showed when a run began: ``c dw/dt + w = y``, ``w(0)`` any.

    It is :class:`~sksurrogate.effects._sensor.SensorLag` but for its start: the reading is ``y + (w - y)``.

    Examples
    --------
    >>> UnsettledSensorLag("y").key
    ('sensor_lag', 'y', None)
    """

    kind = "output"
    known = SensorLag
    typical = "the sensor follows within the runs, and not within a sample"


class UnsettledRateLimit(_Unsettled):
    """The limited speed of an actuator, from where this stood when a run began: ``abs(dw/dt) <= c`` towards u, ``w(0)`` any.

    It is :class:`~sksurrogate.effects._input.RateLimit` but for its start: at the port of the input it adds ``w - u``.

    Examples
    --------
    >>> UnsettledRateLimit("u").key
    ('rate_limit', 'u', None)
    """

    known = RateLimit

    def rates(
        self, z: np.ndarray, t: Any, v: np.ndarray, dv: np.ndarray, theta: Sequence[Any], width: float
    ) -> Sequence[Any]:
        """The limit, towards u."""
        return [theta[0] * np.sign(v - z[0])]

    def rates_within(
        self, z: np.ndarray, t: Any, v: np.ndarray, dv: np.ndarray, theta: Sequence[Any], width: float, h: float
    ) -> Sequence[Any]:
        """What w is away by less than a step's way is made up for within a step."""
        limit = np.maximum(theta[0], 0.0)
        return [np.clip((v - z[0]) / h, -limit, limit)]


#: Effects with a hidden state, which need not be at rest where a run begins; and those that get one for it.
_REMEMBERING = (Hysteresis, HiddenRelaxation, HiddenMode)
_WITH_A_STATE: dict[type[BaseEffect], type[_Unsettled]] = {
    kind.known: kind for kind in (UnsettledInputLag, UnsettledRateLimit, UnsettledSensorLag)
}


def in_motion(effect: BaseEffect, plant: Plant) -> BaseEffect | None:
    """The effect from wherever its memory stood when a run began; None where it has none, or needs no other start.

    The state of a sensor is shown in the place of a state, by simulators that give their states.
    """
    if isinstance(effect, _REMEMBERING):
        return type(effect)(effect.location, effect.variable, settled=False) if effect.settled else None
    kind = _WITH_A_STATE.get(type(effect)) if effect.at_rest else None
    hidden = plant.output_states is None or plant.access == "trajectory"
    return None if kind is None or (effect.kind == "output" and hidden) else kind(effect.location)
