"""Effects on the balance of a state that a neighbour draws towards itself."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from sksurrogate.effects._families import BalanceEffect
from sksurrogate.effects._parts import Parameter, Probe
from sksurrogate.physics._simulator import Plant

#: The neighbour's part of what is exchanged over the state's own (RMS), at least.
LEAST_NEIGHBOUR = 0.01


def others(names: Sequence[str], location: str) -> tuple[str, ...]:
    """Names without that of the location."""
    return tuple(name for name in names if name != location)


def neighbour_counts(own: np.ndarray, neighbour: np.ndarray) -> bool:
    """Whether what is exchanged depends on a neighbour; else it is a loss of the state's own.

    >>> temperature, flow = np.array([40.0, 70.0]), np.array([0.01, 0.02])
    >>> neighbour_counts(temperature, np.array([20.0, 20.0])), neighbour_counts(temperature, flow)
    (True, False)
    """
    return bool(np.mean(neighbour**2) >= LEAST_NEIGHBOUR**2 * np.mean(own**2))


class Exchange(BalanceEffect):
    """Heat or mass exchanged with a neighbour that counts: ``+ c (v - x)``."""

    name = "exchange"
    drivers = ("state", "input")
    at_port = ()
    parameters = (Parameter("coefficient", unit="1 over time"),)
    equation = "+ c (v - x)"
    signature = "the state is drawn towards its neighbour"
    twins = ("linear_loss", "radiation", "hidden_relaxation", "parameter_error")

    def starts(self, probe: Probe) -> list[tuple[float, ...]]:
        """None where the neighbour does not count."""
        assert probe.v is not None
        return super().starts(probe) if neighbour_counts(probe.x, probe.v) else []

    def term(self, t: Any, x: np.ndarray, v: Any, theta: Sequence[Any], width: float) -> Any:
        """``c (v - x)``."""
        return theta[0] * (v - x)

    @classmethod
    def variables(cls, plant: Plant, location: str) -> Sequence[str | None]:
        """The other states, and the inputs."""
        return others(plant.states, location) + plant.inputs


class Radiation(BalanceEffect):
    """Heat radiated by a neighbour that counts: ``+ c (v^4 - x^4)``."""

    name = "radiation"
    rarity = 10.0
    at_port = ()
    parameters = (Parameter("coefficient", low=0.0, unit="1 over time and x^3"),)
    equation = "+ c (v^4 - x^4)"
    signature = "an exchange that matters only when hot"
    twins = ("exchange", "linear_loss", "power_law")

    def starts(self, probe: Probe) -> list[tuple[float, ...]]:
        """None where the neighbour does not count."""
        assert probe.v is not None
        return super().starts(probe) if neighbour_counts(probe.x**4, probe.v**4) else []

    def term(self, t: Any, x: np.ndarray, v: Any, theta: Sequence[Any], width: float) -> Any:
        """``c (v^4 - x^4)``."""
        v2, x2 = v * v, x * x
        return theta[0] * (v2 * v2 - x2 * x2)

    @classmethod
    def variables(cls, plant: Plant, location: str) -> Sequence[str | None]:
        """The other states, and the inputs."""
        return others(plant.states, location) + plant.inputs
