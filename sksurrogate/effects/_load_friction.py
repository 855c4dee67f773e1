"""Dry friction that grows with the force that a joint carries: in gears, bearings and brakes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from sksurrogate.effects._families import BalanceEffect
from sksurrogate.effects._parts import Parameter, Probe
from sksurrogate.effects._smooth import sign, stable


class LoadFriction(BalanceEffect):
    """Dry friction that grows with the load: ``- (c2 + c abs(F)) sign(v)``, F what enters at the port."""

    name = "load_friction"
    natural_drivers = ("own",)
    at_port = ("speed", "level")
    implausible = ("position",)
    of_load = True
    rarity = 10.0
    parameters = (Parameter("coefficient", low=0.0, unit="1"), Parameter("level", low=0.0, unit="dx/dt"))
    equation = "- (c2 + c abs(F)) sign(v), F what enters at the port"
    acts_at_null = True
    signature = "a square wave with the sign of v whose height follows what the drive gives"
    twins = ("coulomb_friction", "stribeck_friction", "input_gain")
    nests = ("coulomb_friction",)

    def term(self, t: Any, x: np.ndarray, v: Any, theta: Sequence[Any], width: Any) -> Any:
        """``width``: of the kinks, or that and the step that has to follow them (:meth:`smoothed`)."""
        height = self.jump(theta, x)
        if not isinstance(width, tuple):
            return -height * sign(v, width)
        width, h = width
        return -height * np.tanh(v / stable(width, height, h))

    def jump(self, theta: Sequence[Any], load: Any = 0.0) -> Any:
        """``c2 + c abs(F)``."""
        coefficient, level = theta
        return level + coefficient * np.abs(load)

    def smoothed(self, theta: Sequence[Any], width: float, h: float) -> Any:
        """The width and the step: how far a jump is smoothed follows the load."""
        return width, h

    def starts(self, probe: Probe) -> list[tuple[float, ...]]:
        """All of it with the load, and half of it; none where the variable keeps its sign or the load its size."""
        assert probe.v is not None
        load = np.abs(probe.x)
        if not (np.min(probe.v) < 0.0 < np.max(probe.v) and np.ptp(load) > 0.0):
            return []
        level = probe.unit(np.sign(probe.v))
        coefficient = level / float(np.sqrt(np.mean(load**2)))
        return [(coefficient, 0.0), (0.5 * coefficient, 0.5 * level)]
