"""Actuators that follow their input: as fast as they can, or with a lag; faster one way, where they fall by themselves or by a spring."""

from __future__ import annotations

from typing import Any

import numpy as np

from sksurrogate.effects._base_effect import Theta
from sksurrogate.effects._input import RememberingActuator, times
from sksurrogate.effects._parts import Parameter, Probe
from sksurrogate.kernels.signals import Signal, lag, rate_limit

#: Largest move over the tenth largest in a hundred, from which jumps are rare among other moves.
RARE = 3.0


class Follower(RememberingActuator):
    """An actuator that follows its input.

    ``location, before``: as in :class:`RememberingActuator`.
    ``falling``: natural logarithm of how many times as fast it falls as it rises; 0: alike. Its parameter is that of the rise.
    """

    def __init__(
        self, location: str | None = None, variable: str | None = None, before: Any = None, falling: float = 0.0
    ):
        super().__init__(location, variable, before)
        self.falling = falling

    @property
    def times_faster(self) -> float:
        """How many times as fast it falls as it rises."""
        return float(np.exp(self.falling))


class RateLimit(Follower):
    """The actuator follows at a limited speed: ``abs(dw/dt) <= c`` towards u, ``w(0) = u(0)``."""

    name = "rate_limit"
    order = 7
    parameters = (Parameter("limit", null=np.inf, low=0.0, unit="u over time"),)
    equation = "abs(dw/dt) <= c towards u, w(0) = u(0)"
    signature = "errors after large moves only, none after small ones"
    twins = ("input_lag", "input_delay", "input_saturation")

    def transform(self, u: Signal, v: Signal | None, theta: Theta, h: float, starts: np.ndarray) -> Signal:
        """Ramps towards u."""
        return rate_limit(u, np.maximum(theta[0], 0.0), h, starts, self.before, self.times_faster)

    def starts(self, probe: Probe) -> list[tuple[float, ...]]:
        """A large move takes from less than one to 25 samples; the largest too, where jumps are rare among small moves."""
        moves = np.delete(np.abs(np.diff(probe.x)), probe.starts[1:] - 1)
        if self.before is not None:
            moves = np.r_[np.abs(probe.x[probe.starts] - self.before), moves]
        moves = moves[moves > 0]
        if not len(moves):
            return []
        large, largest = float(np.quantile(moves, 0.9)), float(np.max(moves))
        sizes = [large] if largest < RARE * large else [largest, large]
        return [(size / (k * probe.dt),) for size in sizes for k in (0.6, 1.5, 4.0, 10.0, 25.0)]


class InputLag(Follower):
    """The actuator is slow: ``c dw/dt + w = u, w(0) = u(0)``."""

    name = "input_lag"
    order = 10
    parameters = (Parameter("time_constant", low=0.0, unit="time"),)
    equation = "c dw/dt + w = u, w(0) = u(0)"
    signature = "errors after edges that die out; fast inputs arrive weaker"
    twins = ("sensor_lag", "input_delay", "sensor_delay", "rate_limit", "parameter_error")

    def transform(self, u: Signal, v: Signal | None, theta: Theta, h: float, starts: np.ndarray) -> Signal:
        """First-order lag."""
        return lag(u, theta[0], h, starts, self.before, self.times_faster)

    def starts(self, probe: Probe) -> list[tuple[float, ...]]:
        """0.3 to 30 samples."""
        return times(probe)
