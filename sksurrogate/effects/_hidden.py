"""Effects with a state that the simulator does not have."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Any

import numpy as np

from sksurrogate.effects._families import HiddenEffect
from sksurrogate.effects._parts import Parameter, Probe
from sksurrogate.effects._smooth import TINY, WITHIN_SAMPLE, follow, magnitude
from sksurrogate.effects._stribeck_curve import larger_at_rest, stribeck_curve

#: A companion with a time constant of so many of the longest runs moves by a quarter of the way in them: its pull is that of
#: a loss. True ones follow within a run, those in the place of other laws were found at 5 runs to 1e20.
STILL = 4.0
#: One that did not begin at rest forgets where it began within the longest run: so many time constants leave a twentieth. Else its start
#: is a constant of the run.
FORGETS = 3.0
#: A mode rings where a sample is less than half a period. (One that follows within a sample only adds to the inertia.)
RINGS = np.pi
#: A spring with a limit of so many times the way that v goes from the start of a run yields by a tenth at most: it is a loss.
UNYIELDING = 5.0


class Hysteresis(HiddenEffect):
    """Bouc-Wen hysteresis: ``- c z``, ``dz/dt = v' (1 - (abs(z)/limit) (1 + sign(v' z))/2)``, ``z(0) = 0``."""

    name = "hysteresis"
    natural_drivers = ("own", "position")
    at_port = ("position",)
    parameters = (
        Parameter("stiffness", low=0.0, unit="dx/dt over v"),
        Parameter("limit", null=1.0, low=TINY, unit="v"),
    )
    equation = "- c z, dz/dt = v' (1 - (abs(z)/limit) (1 + sign(v' z))/2), z(0) = 0"
    signature = "a loop that is the same at any speed; a restoring force that yields"
    typical = "the spring yields within the runs, and not within a sample"
    twins = ("coulomb_friction", "lugre_friction", "linear_loss", "input_backlash")
    nests = ("coulomb_friction",)
    linear = True

    def rates(
        self, z: np.ndarray, t: Any, v: np.ndarray, dv: np.ndarray, theta: Sequence[Any], width: float
    ) -> Sequence[Any]:
        """``v' - (v' abs(z) + abs(v') z) / (2 limit)``: the same without ``sign(0)``."""
        limit = theta[1]
        return [dv - (dv * np.abs(z[0]) + np.abs(dv) * z[0]) / (2 * limit)]

    def rates_within(
        self, z: np.ndarray, t: Any, v: np.ndarray, dv: np.ndarray, theta: Sequence[Any], width: float, h: float
    ) -> Sequence[Any]:
        """A small limit is reached within a step."""
        return [follow(h * np.abs(dv) / theta[1]) * rate for rate in self.rates(z, t, v, dv, theta, width)]

    def force(self, z: np.ndarray, v: np.ndarray, theta: Sequence[Any]) -> Any:
        return -theta[0] * z[0]

    def plausible(self, theta: Sequence[float], probe: Probe) -> bool:
        """The spring yields within the runs, and not within a sample, as a dry friction does."""
        assert probe.v is not None
        limit, started = theta[1], np.repeat(probe.v[probe.starts], np.diff(np.r_[probe.starts, len(probe.v)]))
        travel = WITHIN_SAMPLE * float(np.sqrt(np.mean(np.delete(np.diff(probe.v), probe.starts[1:] - 1) ** 2)))
        return bool(travel < limit < UNYIELDING * np.max(np.abs(probe.v - started)))

    def starts(self, probe: Probe) -> list[tuple[float, ...]]:
        """Limits between a small part of the movement of v and more than all of it."""
        assert probe.v is not None
        size = float(np.std(probe.v))
        found: list[tuple[float, ...]] = []
        for share in (0.05, 0.15, 0.4, 1.0, 2.5):
            path = np.clip(probe.v - np.mean(probe.v), -share * size, share * size)
            found.append((probe.unit(path), share * size))
        return found if size > 0 else []


class LugreFriction(HiddenEffect):
    """Bristle friction (LuGre): ``- c z, dz/dt = v - c abs(v) z / g(v)``.

    ``g = level + (static_level - level) exp(-(v/velocity)^2)``; a ``static_level`` below ``level`` counts as ``level``.
    """

    name = "lugre_friction"
    natural_drivers = ("own",)
    at_port = ("speed",)
    implausible = ("position",)
    parameters = (
        Parameter("stiffness", low=0.0, unit="dx/dt over the integral of v"),
        Parameter("level", null=1.0, low=TINY, unit="dx/dt", grows=True),
        Parameter("static_level", null=1.0, low=TINY, unit="dx/dt", grows=True),
        Parameter("velocity", null=1.0, low=TINY, unit="v"),
    )
    equation = "- c z, dz/dt = v - c abs(v) z / g(v), g = level + (static_level - level) exp(-(v/velocity)^2), static_level >= level"
    signature = "springy before it slides, dry friction after"
    typical = "the bristles do not give way within a sample, as those of a dry friction do"
    twins = ("coulomb_friction", "stribeck_friction", "hysteresis")
    nests = ("coulomb_friction",)

    def rates(
        self, z: np.ndarray, t: Any, v: np.ndarray, dv: np.ndarray, theta: Sequence[Any], width: float
    ) -> Sequence[Any]:
        """``v - c abs(v) z / g(v)``."""
        return [v - self._decay(v, theta, width) * z[0]]

    def rates_within(
        self, z: np.ndarray, t: Any, v: np.ndarray, dv: np.ndarray, theta: Sequence[Any], width: float, h: float
    ) -> Sequence[Any]:
        """Stiff bristles give way within a step: what is left is dry friction."""
        decay = self._decay(v, theta, width)
        return [follow(h * decay) * (v - decay * z[0])]

    def _decay(self, v: np.ndarray, theta: Sequence[Any], width: float) -> Any:
        """``c abs(v) / g(v)``."""
        return theta[0] * magnitude(v, width) / np.maximum(stribeck_curve(v, *theta[1:]), TINY)

    def force(self, z: np.ndarray, v: np.ndarray, theta: Sequence[Any]) -> Any:
        return -theta[0] * z[0]

    def plausible(self, theta: Sequence[float], probe: Probe) -> bool:
        """Springy: bristles that give way within a sample are a dry friction."""
        assert probe.v is not None
        stiffness, level, *_ = theta
        travel = WITHIN_SAMPLE * probe.dt * float(np.sqrt(np.mean(probe.v**2)))
        return bool(level > stiffness * travel)

    def canonical(self, theta: Sequence[float]) -> tuple[float, ...]:
        """No less at rest than in motion."""
        stiffness, level, static, velocity = theta
        return stiffness, level, max(static, level), velocity

    def identifiable(self, theta: Sequence[float]) -> tuple[float, ...]:
        """Larger when slow."""
        stiffness, level, static, velocity = theta
        return stiffness, level, larger_at_rest(level, static), velocity

    def starts(self, probe: Probe) -> list[tuple[float, ...]]:
        """Bristles that give way after a part of a typical travel or more; friction at rest clearly and hardly above the other."""
        assert probe.v is not None
        speed = float(np.sqrt(np.mean(probe.v**2)))
        level = probe.unit(np.sign(probe.v))
        runs = np.split(probe.v, probe.starts[1:])
        travel = float(np.sqrt(np.mean([np.var(np.cumsum(run) * probe.dt) for run in runs])))
        if speed == 0 or travel == 0:
            return []
        found: list[tuple[float, ...]] = []
        for share in (0.02, 0.1, 0.5, 2.0):
            found.extend((level / (share * travel), level, ratio * level, 0.3 * speed) for ratio in (1.5, 1.1))
        return found


class HiddenRelaxation(HiddenEffect):
    """A slow companion, such as a wall or creep: ``- c (v - z), dz/dt = (v - z)/time_constant``.

    Driven by an input it is the slow part of what this input does (the diffusion of a battery's cell): c has the sign of its gain.
    """

    name = "hidden_relaxation"
    natural_drivers = ("own", "position")
    drivers = ("state", "input")
    at_port = ("position", "level")
    parameters = (
        Parameter("coefficient", low=0.0, unit="dx/dt over v"),
        Parameter("time_constant", null=1.0, low=TINY, unit="time"),
    )
    equation = "- c (v - z), dz/dt = (v - z)/time_constant"
    signature = "a slow tail after every step; fast changes meet more resistance than slow ones, or less where an input drives it"
    typical = "the companion is late, does not work against its driver, and follows within the runs"
    twins = ("exchange", "linear_loss", "hidden_mode", "sensor_lag", "input_lag")
    nests = ("linear_loss",)
    linear = True

    def either_sign(self, inputs: Collection[str]) -> bool:
        """Of an input, whose sign is a convention."""
        return self.variable in inputs

    def rest(self, v: np.ndarray, theta: Sequence[Any]) -> Sequence[Any]:
        """``z(0) = v(0)``."""
        return [v]

    def rates(
        self, z: np.ndarray, t: Any, v: np.ndarray, dv: np.ndarray, theta: Sequence[Any], width: float
    ) -> Sequence[Any]:
        """``(v - z) / time_constant``."""
        return [(v - z[0]) / theta[1]]

    def rates_within(
        self, z: np.ndarray, t: Any, v: np.ndarray, dv: np.ndarray, theta: Sequence[Any], width: float, h: float
    ) -> Sequence[Any]:
        """A companion that is much faster than a step keeps up."""
        return [follow(h / theta[1]) * (v - z[0]) / theta[1]]

    def force(self, z: np.ndarray, v: np.ndarray, theta: Sequence[Any]) -> Any:
        return -theta[0] * (v - z[0])

    def plausible(self, theta: Sequence[float], probe: Probe) -> bool:
        """The companion is late, and follows within the runs: one that stands still is a loss about where they began."""
        of_its_sign = probe.gain is None or theta[0] * probe.gain > 0.0
        slowest = (STILL if self.settled else 1.0 / FORGETS) * max(probe.duration, probe.dt)
        return of_its_sign and WITHIN_SAMPLE * probe.dt < theta[1] < slowest

    def starts(self, probe: Probe) -> list[tuple[float, ...]]:
        """Time constants over two decades, from two samples to the length of a run; none where an input does nothing in the balance."""
        assert probe.v is not None
        if probe.gain == 0.0:
            return []
        longest = max(probe.duration, 4 * probe.dt)
        times = [k * probe.dt for k in (2.0, 6.0, 20.0, 60.0, 200.0) if k * probe.dt < longest]
        unit = float(np.copysign(probe.unit(probe.v - np.mean(probe.v)), 1.0 if probe.gain is None else probe.gain))
        return [(unit, time) for time in times]


class HiddenMode(HiddenEffect):
    """A flexible part or slosh: ``+ c (z - v), z'' = w^2 (v - z) - 2 d w z'``."""

    name = "hidden_mode"
    natural_drivers = ("own", "position")
    n_hidden = 2
    at_port = ("position",)
    parameters = (
        Parameter("gain", low=0.0, unit="dx/dt over v"),
        Parameter("angular_frequency", null=1.0, low=TINY, unit="radian over time"),
        Parameter("damping", low=0.0),
    )
    equation = "+ c (z - v), z'' = w^2 (v - z) - 2 d w z'"
    signature = "ringing at one frequency after fast changes"
    typical = "it rings slower than the samples, or relaxes within the runs"
    twins = ("hidden_relaxation", "periodic_disturbance", "linear_loss", "parameter_error")
    linear = True

    def rest(self, v: np.ndarray, theta: Sequence[Any]) -> Sequence[Any]:
        """``z(0) = v(0), z'(0) = 0``."""
        return [v, np.zeros_like(v)]

    def rates(
        self, z: np.ndarray, t: Any, v: np.ndarray, dv: np.ndarray, theta: Sequence[Any], width: float
    ) -> Sequence[Any]:
        """``z'`` and ``w^2 (v - z) - 2 d w z'``."""
        _, w, damping = theta
        return [z[1], w * w * (v - z[0]) - 2 * damping * w * z[1]]

    def force(self, z: np.ndarray, v: np.ndarray, theta: Sequence[Any]) -> Any:
        """``c (z - v)``."""
        return theta[0] * (z[0] - v)

    def lower_bounds(self, duration: float) -> tuple[float, ...]:
        """Three quarters of a period: what is slower is not a ringing, and diverges beyond the record."""
        low = [parameter.low for parameter in self.parameters]
        return low[0], 1.5 * np.pi / duration if duration > 0 else low[1], low[2]

    def simpler(self, theta: Sequence[float]) -> dict[str, tuple[float, ...]]:
        """A mode that does not ring is a relaxation with ``2 d / w`` as time constant."""
        _, w, damping = theta
        return {"hidden_relaxation": (2.0 * damping / w,)} if damping > 1.0 else {}

    def plausible(self, theta: Sequence[float], probe: Probe) -> bool:
        """It rings, slower than the samples, or relaxes within the runs; from a start of its own it rings once at least."""
        _, w, damping = theta
        longest = max(probe.duration, probe.dt)
        if damping > 1.0:
            return WITHIN_SAMPLE * probe.dt < 2.0 * damping / w < longest * (STILL if self.settled else 1.0 / FORGETS)
        return w * probe.dt < RINGS and (self.settled or w * longest > 2.0 * np.pi)

    def starts(self, probe: Probe) -> list[tuple[float, ...]]:
        """Eight frequencies from two periods per run to six samples per period, lightly and well damped."""
        assert probe.v is not None
        unit = probe.unit(probe.v - np.mean(probe.v))
        highest = np.pi / (3 * probe.dt)
        lowest = min(4 * np.pi / max(probe.duration, probe.dt), highest / 2)
        return [(unit, float(w), damping) for w in np.geomspace(lowest, highest, 8) for damping in (0.05, 0.4)]
