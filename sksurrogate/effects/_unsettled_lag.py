"""A slow actuator or sensor in motion where a run begins, as in a record that begins amid an operation."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np

from sksurrogate.effects._base_effect import BaseEffect
from sksurrogate.effects._families import HiddenEffect
from sksurrogate.effects._hidden import FORGETS
from sksurrogate.effects._input import InputLag
from sksurrogate.effects._parts import Probe
from sksurrogate.effects._sensor import SensorLag
from sksurrogate.effects._smooth import TINY, WITHIN_SAMPLE, follow


class _UnsettledLag(HiddenEffect):
    """A lag from where its memory stood when a run began: a hidden state in place of a known start."""

    lag: ClassVar[type[InputLag | SensorLag]]  #: That begins at rest

    def __init__(self, location: str | None = None):
        super().__init__(location, location, settled=False)

    @property
    def key(self) -> tuple[str, str | None, str | None]:
        """That of the lag: no other signal drives it."""
        return self.name, self.location, None

    @property
    def settled_form(self) -> BaseEffect:
        """The lag from the first value of what it follows."""
        return self.lag(self.location)

    def rest(self, v: np.ndarray, theta: Sequence[Any]) -> Sequence[Any]:
        """``w(0) = v(0)``."""
        return [v]

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

    def force(self, z: np.ndarray, v: np.ndarray, theta: Sequence[Any]) -> Any:
        """``w - v``."""
        return z[0] - v

    def plausible(self, theta: Sequence[float], probe: Probe) -> bool:
        """What is slower than a third of a run is a constant of the run, what is faster than a sample shows no start."""
        return WITHIN_SAMPLE * probe.dt < theta[0] < max(probe.duration, probe.dt) / FORGETS

    def starts(self, probe: Probe) -> list[tuple[float, ...]]:
        """As of the lag."""
        return self.lag(self.location).starts(probe)


class UnsettledInputLag(_UnsettledLag):
    """The lag of an input, from where its actuator stood when a run began: ``c dw/dt + w = u``, ``w(0)`` any.

    It is :class:`~sksurrogate.effects._input.InputLag` but for its start: at the port of the input it adds ``w - u``.

    Examples
    --------
    >>> UnsettledInputLag("u").key
    ('input_lag', 'u', None)
    """

    lag = InputLag
    name = InputLag.name
    parameters = InputLag.parameters
    equation = InputLag.equation
    signature = InputLag.signature
    typical = "the actuator follows within the runs, and not within a sample"
    twins = InputLag.twins
    rarity = InputLag.rarity


class UnsettledSensorLag(_UnsettledLag):
    """The lag of a sensor that shows a state, from what it showed when a run began: ``c dw/dt + w = y``, ``w(0)`` any.

    It is :class:`~sksurrogate.effects._sensor.SensorLag` but for its start: the reading is ``y + (w - y)``.

    Examples
    --------
    >>> UnsettledSensorLag("y").key
    ('sensor_lag', 'y', None)
    """

    kind = "output"
    lag = SensorLag
    name = SensorLag.name
    parameters = SensorLag.parameters
    equation = SensorLag.equation
    signature = SensorLag.signature
    typical = "the sensor follows within the runs, and not within a sample"
    twins = SensorLag.twins
    rarity = SensorLag.rarity
