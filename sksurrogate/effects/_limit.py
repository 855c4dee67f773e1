"""Effects on a state that cannot pass a limit."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from sksurrogate.effects._base_effect import BaseEffect
from sksurrogate.effects._families import LimitEffect
from sksurrogate.effects._onset import Starting
from sksurrogate.effects._parts import Parameter, Probe
from sksurrogate.physics._simulator import Plant

#: Quantiles of the reached range at which limits are tried: a run may begin above a limit.
LIMIT_QUANTILES = (0.998, 0.97, 0.9, 0.75, 0.5, 0.25)
#: Depths below the top of the range, over the range: a limit may have cut off a few peaks only.
DEPTHS = (0.001, 0.004, 0.016)


def in_force(effect: BaseEffect, t: Any, theta: Sequence[Any], width: float, free: Any, limited: Any) -> Any:
    """What a limit makes of states or rates, for the share of its window at a time; as they are for the rest.

    A state that is beyond the limit where that sets in is brought back in the substep after it, so that a run is smooth in the onset.
    """
    if not isinstance(effect, Starting):
        return limited
    return free + effect.within(t, theta, width) * (limited - free)


def limits_inside(probe: Probe) -> list[float]:
    """Limits to try within the reached range."""
    top, spread = float(np.max(probe.x)), float(np.ptp(probe.x))
    below = [top - depth * spread for depth in DEPTHS]
    return [limit for limit in [*probe.quantiles(probe.x, *LIMIT_QUANTILES), *below] if limit < top]


class StateSaturation(LimitEffect):
    """A hard limit: ``x <= c``."""

    name = "state_saturation"
    parameters = (Parameter("limit", null=np.inf, unit="x"),)
    equation = "x <= c"
    signature = "flat tops of the state at one level"
    twins = ("overflow", "end_stop", "sensor_saturation", "input_saturation")

    def clip(
        self, x: np.ndarray, v: np.ndarray | None, theta: Sequence[Any], final: bool
    ) -> tuple[np.ndarray, np.ndarray | None]:
        """``min(x, c)``."""
        return np.minimum(x, theta[0]), None

    @classmethod
    def instances(cls, plant: Plant, balances: Sequence[str]) -> Iterator[BaseEffect]:
        """Every state: a simulator that cuts off a position changes no balance."""
        return super().instances(plant, plant.states)

    def starts(self, probe: Probe) -> list[tuple[float, ...]]:
        """Limits at quantiles of the reached range and just below its top."""
        return [(limit,) for limit in limits_inside(probe)]


class Overflow(LimitEffect):
    """A vessel that spills: ``x <= c``; a share of what is cut off is added to dv/dt."""

    name = "overflow"
    parameters = (Parameter("limit", null=np.inf, unit="x"), Parameter("share", low=0.0, unit="v over x"))
    equation = "x <= c; a share of what is cut off is added to dv/dt"
    signature = "flat tops of one state while another rises faster"
    twins = ("state_saturation", "end_stop", "exchange")
    nests = ("state_saturation",)

    @classmethod
    def variables(cls, plant: Plant, location: str) -> Sequence[str | None]:
        """The other states."""
        return tuple(name for name in plant.states if name != location)

    def clip(
        self, x: np.ndarray, v: np.ndarray | None, theta: Sequence[Any], final: bool
    ) -> tuple[np.ndarray, np.ndarray | None]:
        """``min(x, c)``; at the end of a substep ``v + share (x - min(x, c))``."""
        limited = np.minimum(x, theta[0])
        return limited, v + theta[1] * (x - limited) if final and v is not None else None

    def flow(
        self, x: np.ndarray, dx: np.ndarray, dv: np.ndarray, theta: Sequence[Any]
    ) -> tuple[np.ndarray, np.ndarray]:
        """What would fill the full vessel further goes over."""
        cut = np.where(x >= theta[0], np.maximum(dx, 0.0), 0.0)
        return dx - cut, dv + theta[1] * cut

    def starts(self, probe: Probe) -> list[tuple[float, ...]]:
        """Limits at quantiles of the reached range and just below its top; half of it spills over."""
        return [(limit, 0.5) for limit in limits_inside(probe)]
