"""Effects on parameters: a number in the simulator is wrong, drifts or jumps."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from sksurrogate.effects._across_element import across_element
from sksurrogate.effects._base_effect import BaseEffect
from sksurrogate.effects._families import ParameterEffect
from sksurrogate.effects._levelling import Levelling
from sksurrogate.effects._onset import Starting
from sksurrogate.effects._parts import Parameter, Probe
from sksurrogate.effects._smooth import TINY, after
from sksurrogate.effects._variable import differences
from sksurrogate.physics._simulator import Plant

#: Times, as shares of the longest run, at which jumps are tried.
JUMPS = tuple(float(share) for share in (np.arange(40) + 0.5) / 40)


#: A jump in the first or last such share of the longest run is not a jump: the runs show nothing before it, or nothing after.
AT_AN_END = 0.02


def within_the_runs(time: float, probe: Probe) -> bool:
    """Whether the longest run shows both what was before a time and what came after: a size and a time follow any two readings."""
    shown = max(AT_AN_END * probe.duration, 2 * probe.dt)
    return shown < time < probe.duration - shown


def keeps_its_sign(factor: np.ndarray) -> bool:
    """Whether what a parameter is multiplied by is on one side of zero: no resistance drives, and no source drains, in a part of the data."""
    return not np.min(factor) < 0.0 < np.max(factor)


class ParameterError(ParameterEffect):
    """A parameter is off by a factor: ``p (1 + c)``; ``p + c`` where the nominal value is 0."""

    name = "parameter_error"
    parameters = (Parameter("relative_error", unit="1 (unit of p where p is 0)"),)
    equation = "p (1 + c); p + c where the nominal p is 0"
    signature = "whatever the parameter does, from the first row to the last, in every run alike"
    twins = ("input_gain", "sensor_gain", "linear_loss", "parameter_drift")

    def value(self, p: Any, t: Any, theta: Sequence[Any], width: float) -> Any:
        """``p (1 + c)``; what another effect has made of p, a symbol in a graph, is not 0."""
        if not isinstance(p, int | float | np.ndarray | np.generic):
            return p * (1 + theta[0])
        return np.where(np.equal(p, 0), p + theta[0], p * (1 + theta[0]))

    def starts(self, probe: Probe) -> list[tuple[float, ...]]:
        """A twentieth."""
        return [(0.05,)]


def constant_in_time(effect: BaseEffect) -> bool:
    """Whether an effect gives a parameter one value that it always has."""
    return effect.name == "parameter_error" and not isinstance(effect, Starting)


def _unless_nil(plant: Plant, location: str) -> Sequence[str | None]:
    """A parameter whose nominal value is 0 stays 0 by any factor."""
    return () if plant.params[location] == 0 else (None,)


class ParameterDrift(Levelling, ParameterEffect):
    """A parameter changes in proportion to time: ``p (1 + c t)``; it may level off."""

    name = "parameter_drift"
    rarity = 10.0
    parameters = (Parameter("rate", unit="1 over time"),)
    equation = "p (1 + c t)"
    signature = "a residual that is zero at the start of a run and grows with time where the parameter acts"
    typical = "the parameter keeps its sign to the end of the longest run"
    twins = ("drift", "sensor_drift", "parameter_error", "parameter_step")
    access = "step"

    @classmethod
    def variables(cls, plant: Plant, location: str) -> Sequence[str | None]:
        """Not on parameters whose nominal value is 0."""
        return _unless_nil(plant, location)

    def value(self, p: Any, t: Any, theta: Sequence[Any], width: float) -> Any:
        return p * (1 + theta[0] * self.elapsed(t))

    def plausible(self, theta: Sequence[float], probe: Probe) -> bool:
        """The parameter keeps its sign to the end of the longest run."""
        return keeps_its_sign(1 + theta[0] * self.elapsed(np.array([0.0, probe.duration])))

    def starts(self, probe: Probe) -> list[tuple[float, ...]]:
        """A tenth at the end of the longest run."""
        return [(0.1 / self.elapsed(max(probe.duration, probe.dt)),)]


class ParameterDependence(ParameterEffect):
    """A parameter depends on a signal: ``p (1 + c v + c2)``, as a heat transfer on a flow or an inductance on its current.

    It is tried where all other effects leave something without a name, and where it predicts the same as what is named.

    ``curvature``: of the dependence, with ``s = c v + c2``: 0, a straight line ``1 + s``; 1, ``exp(s)``, as a rate of reaction on the
        temperature; 2, ``1 / (1 - s)``, as the current through a resistance that grows; -1, ``sqrt(1 + 2 s)``. Between them
        ``(1 + (1 - curvature) s)^(1 / (1 - curvature))``.
    """

    name = "parameter_dependence"
    rarity = 10.0
    late = True
    linear = False
    parameters = (Parameter("slope", unit="1 over v"), Parameter("relative_error", grows=True))
    equation = "p (1 + s), s = c v + c2; curved: p exp(s), p / (1 - s), p sqrt(1 + 2 s), p (1 + (1 - k) s)^(1/(1 - k))"
    signature = "a residual as that of a wrong parameter, whose size goes with a signal"
    typical = "the parameter keeps its sign along the data"
    twins = ("parameter_error", "bilinear", "quadratic_loss", "input_curve", "sensor_nonlinearity")
    nests = ("parameter_error",)
    access = "step"

    def __init__(self, location: str | None = None, variable: str | None = None, curvature: float = 0.0):
        super().__init__(location, variable)
        self.curvature = curvature

    @classmethod
    def variables(cls, plant: Plant, location: str) -> Sequence[str | None]:
        """Every state and input, and the difference across an element, on parameters whose nominal value is not 0."""
        if plant.params[location] == 0:
            return ()
        found = across_element(plant, location)
        pair = found.signals if found is not None and len(found.signals) == 2 else None
        return (*plant.states, *plant.inputs, *(differences(*pair) if pair else ()))

    def value(self, p: Any, t: Any, theta: Sequence[Any], width: float, v: Any = 0.0) -> Any:
        s, power = theta[0] * v + theta[1], 1.0 - self.curvature
        if power == 1.0:
            return p * (1.0 + s)
        return p * np.exp(s) if power == 0.0 else p * np.maximum(1.0 + power * s, TINY) ** (1.0 / power)

    def as_curved(self, theta: Any, at: float, curvature: float) -> tuple[float, float] | None:
        """Slope and relative error of another curvature with the same value and slope at a value of the signal; None where it has none.

        >>> ParameterDependence("k", "T").as_curved((0.5, -2.0), 4.0, 2.0)
        (0.5, -2.0)
        """
        factor = float(self.value(1.0, 0.0, theta, 0.0, at))
        if factor <= 0.0:
            return None
        power = 1.0 - curvature
        s = np.log(factor) if power == 0.0 else (factor**power - 1.0) / power
        slope = theta[0] * factor ** (self.curvature - curvature)
        return float(slope), float(s - slope * at)

    def smaller(self, theta: np.ndarray, share: float) -> np.ndarray:
        """Nearer to the nominal value everywhere."""
        return share * theta

    def plausible(self, theta: Sequence[float], probe: Probe) -> bool:
        """The parameter keeps its sign along the data."""
        power = 1.0 - self.curvature
        return probe.v is None or keeps_its_sign(1 + power * (theta[0] * np.asarray(probe.v) + theta[1]))

    def starts(self, probe: Probe) -> list[tuple[float, ...]]:
        """A tenth more or less for a deviation of the signal, and right at its least, mean or largest value."""
        v = np.zeros(1) if probe.v is None else np.asarray(probe.v)
        slope = 0.1 / max(float(np.std(v)), 1e-12)
        right_at = float(np.min(v)), float(np.mean(v)), float(np.max(v))
        return [(sign * slope, -sign * slope * value) for value in right_at for sign in (1.0, -1.0)]


class ParameterStep(ParameterEffect):
    """A parameter jumps: ``p (1 + c)`` after ``t0``."""

    name = "parameter_step"
    rarity = 10.0
    parameters = (Parameter("relative_error"), Parameter("time", unit="time", jumps=True))
    equation = "p (1 + c) after t0"
    signature = "no residual before the jump; afterwards that of a wrong parameter"
    typical = "the jump lies within the runs"
    twins = ("step_disturbance", "parameter_error", "parameter_drift")
    nests = ("parameter_error",)
    access = "step"

    @classmethod
    def variables(cls, plant: Plant, location: str) -> Sequence[str | None]:
        """Not on parameters whose nominal value is 0."""
        return _unless_nil(plant, location)

    def value(self, p: Any, t: Any, theta: Sequence[Any], width: float) -> Any:
        """``p (1 + c)`` after ``t0``."""
        return p * (1 + theta[0] * after(t, theta[1], width))

    def plausible(self, theta: Sequence[float], probe: Probe) -> bool:
        """The jump lies within the runs."""
        return within_the_runs(theta[1], probe)

    def starts(self, probe: Probe) -> list[tuple[float, ...]]:
        """A tenth, at forty times."""
        return [(0.1, share * probe.duration) for share in JUMPS]
