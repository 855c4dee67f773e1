"""The parameters that a calibration fits: where they start, their sizes, bounds and priors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sksurrogate.physics._asked import asked_bounds, asked_names, asked_priors, nominal_values
from sksurrogate.physics._prior import Prior
from sksurrogate.physics._simulator import Plant


@dataclass(frozen=True, eq=False)
class FreeParameters:
    """Parameters by name; arrays (n_parameters,)."""

    names: list[str]
    start: np.ndarray
    unit: np.ndarray  #: Size of each, 1 where it starts at 0
    low: np.ndarray
    high: np.ndarray
    prior: Prior

    @classmethod
    def of(
        cls,
        plant: Plant,
        params: Sequence[str] | None,
        bounds: Mapping[str, Any] | None,
        priors: Mapping[str, Any] | None,
    ) -> FreeParameters:
        """What a user asks for; raises SimulatorError and DataError."""
        names = asked_names(plant, params)
        nominal = nominal_values(plant, names)
        low, high = asked_bounds(bounds, names)
        prior = Prior.of(asked_priors(priors, dict(zip(names, nominal.tolist()))), names)
        start = np.clip(nominal, low, high)
        return cls(names, start, np.where(start != 0, np.abs(start), 1.0), low, high, prior)

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Low and high."""
        return self.low, self.high

    @property
    def started(self) -> dict[str, float]:
        """Where they start, by name."""
        return dict(zip(self.names, self.start.tolist()))

    def at_bound(self, theta: np.ndarray) -> np.ndarray:
        """Which values are at a bound (n_parameters,), where there is something between the bounds."""
        return ((theta <= self.low) | (theta >= self.high)) & (self.low < self.high)
