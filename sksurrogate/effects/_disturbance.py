"""Effects on the balance of a state that come from outside: functions of time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from sksurrogate.effects._families import BalanceEffect
from sksurrogate.effects._levelling import Levelling
from sksurrogate.effects._parameter import JUMPS, within_the_runs
from sksurrogate.effects._parts import Parameter, Probe
from sksurrogate.effects._smooth import after


def frequencies(duration: float, dt: float, most: int = 80) -> np.ndarray:
    """Angular frequencies at which a record of that duration can show a line: its harmonics up to pi / (3 dt).

    Neighbours are one resolution (2 pi / duration) apart, so that every frequency lies in the main lobe of one; above
    ``most`` lines, geometrically spaced from where they would be too many.
    """
    lowest, highest = 2 * np.pi / max(duration, 6 * dt), np.pi / (3 * dt)
    count = int(np.ceil(highest / lowest - 1e-9))
    if count <= most:
        return lowest * np.r_[0.5, 0.75, np.arange(1, max(count, 1) + 1)]
    return lowest * np.r_[0.5, 0.75, np.unique(np.round(np.geomspace(1, count, 2 * most)))][: 2 * most]


class Drift(Levelling, BalanceEffect):
    """A force or flow that grows with time: ``+ c t``; it may level off."""

    name = "drift"
    rarity = 10.0
    drivers = ()
    at_port = ("time",)
    parameters = (Parameter("rate", unit="dx/dt over time"),)
    equation = "+ c t"
    signature = "a residual that grows through the run, filtered by the plant"
    twins = ("sensor_drift", "constant_bias", "parameter_drift", "step_disturbance")

    def term(self, t: Any, x: np.ndarray, v: Any, theta: Sequence[Any], width: float) -> Any:
        """``c t``."""
        return theta[0] * self.elapsed(t) + np.zeros_like(x)

    def starts(self, probe: Probe) -> list[tuple[float, ...]]:
        """A tenth of the balance in the middle of the longest run."""
        return [(probe.unit(np.ones(1)) / self.elapsed(0.5 * max(probe.duration, probe.dt)),)]


class PeriodicDisturbance(BalanceEffect):
    """An unmeasured oscillation: ``+ c sin(w t + phase)``."""

    name = "periodic_disturbance"
    rarity = 10.0
    drivers = ()
    at_port = ("time",)
    parameters = (
        Parameter("amplitude", unit="dx/dt"),
        Parameter("angular_frequency", null=1.0, low=0.0, unit="radian over time"),
        Parameter("phase", unit="radian"),
    )
    equation = "+ c sin(w t + phase)"
    signature = "a line in the spectrum of the residual that the input does not have"
    typical = "three quarters of a period fit into the runs"
    twins = ("drift", "hidden_mode")

    def term(self, t: Any, x: np.ndarray, v: Any, theta: Sequence[Any], width: float) -> Any:
        """``c sin(w t + phase)``."""
        return theta[0] * np.sin(theta[1] * t + theta[2]) + np.zeros_like(x)

    def plausible(self, theta: Sequence[float], probe: Probe) -> bool:
        """It comes back within the runs: a frequency at its lower bound is a slower curve of time."""
        return bool(theta[1] > 1.001 * self.lower_bounds(probe.duration)[1])

    def starts(self, probe: Probe) -> list[tuple[float, ...]]:
        """Sine and cosine at every frequency that the longest run resolves."""
        unit = probe.unit(np.ones(1))
        return [(unit, float(w), phase) for w in frequencies(probe.duration, probe.dt) for phase in (0.0, np.pi / 2)]

    def lower_bounds(self, duration: float) -> tuple[float, ...]:
        """Three quarters of a period: what is slower is an offset and a drift."""
        return (-np.inf, 1.5 * np.pi / duration if duration > 0 else 0.0, -np.inf)

    def canonical(self, theta: Sequence[float]) -> tuple[float, ...]:
        """Amplitude >= 0, phase in (-pi, pi]; while it is fitted both are free, or the fit would stick at a border."""
        amplitude, frequency, phase = theta
        turned = phase + (np.pi if amplitude < 0 else 0.0)
        return abs(amplitude), frequency, float(np.pi - np.mod(np.pi - turned, 2 * np.pi))


class StepDisturbance(BalanceEffect):
    """A load that sets in: ``+ c`` after ``t0``."""

    name = "step_disturbance"
    rarity = 10.0
    drivers = ()
    at_port = ("time",)
    parameters = (Parameter("size", unit="dx/dt"), Parameter("time", unit="time", jumps=True))
    equation = "+ c after t0"
    signature = "no residual before one moment, a transient and an offset after it"
    typical = "it sets in within the runs"
    twins = ("constant_bias", "parameter_step", "drift")
    nests = ("constant_bias",)

    def term(self, t: Any, x: np.ndarray, v: Any, theta: Sequence[Any], width: float) -> Any:
        """``c`` after ``t0``."""
        return theta[0] * after(t, theta[1], width) + np.zeros_like(x)

    def plausible(self, theta: Sequence[float], probe: Probe) -> bool:
        """It sets in within the runs."""
        return within_the_runs(theta[1], probe)

    def starts(self, probe: Probe) -> list[tuple[float, ...]]:
        """Forty times."""
        unit = probe.unit(np.ones(1))
        return [(unit, share * probe.duration) for share in JUMPS]
