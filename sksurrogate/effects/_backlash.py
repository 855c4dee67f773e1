"""Play in an element between two parts: gears, couplings, ball joints."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from sksurrogate.effects._across_element import across_element
from sksurrogate.effects._families import ParameterEffect
from sksurrogate.effects._parts import Parameter, Probe
from sksurrogate.effects._smooth import TINY
from sksurrogate.effects._variable import differences
from sksurrogate.physics._simulator import Plant


class Backlash(ParameterEffect):
    """A spring between two parts, or another element, does nothing until the play is taken up.

    What passes through it is ``p sign(v) max(abs(v) - c, 0)`` in place of ``p v``, v being the difference across it.
    It is tried where all other effects leave something without a name, and where it predicts the same as what is named.
    """

    name = "backlash"
    rarity = 10.0
    late = True
    linear = False
    parameters = (Parameter("half_width", low=0.0, unit="v"),)
    equation = "p max(1 - c/abs(v), 0), v the difference across an element"
    signature = "no force while the play is crossed, a constant lack beyond it; knocks at reversals"
    typical = "the parts move within the play and beyond it"
    twins = ("parameter_dependence", "parameter_error", "input_backlash", "input_dead_zone")
    access = "step"

    @classmethod
    def variables(cls, plant: Plant, location: str) -> Sequence[str | None]:
        """The difference across an element that the parameter scales; none where its nominal value is 0."""
        found = across_element(plant, location) if plant.params[location] != 0 else None
        if found is None or not found.proportional or set(found.signals) <= set(plant.inputs):
            return ()
        return (found.signals[0] if len(found.signals) == 1 else differences(*found.signals)[0],)

    def value(self, p: Any, t: Any, theta: Sequence[Any], width: float, v: Any = 0.0) -> Any:
        """``p max(1 - c/abs(v), 0)``."""
        return p * np.maximum(1.0 - theta[0] / np.maximum(abs(v), TINY), 0.0)

    def plausible(self, theta: Sequence[float], probe: Probe) -> bool:
        """The parts move within the play and beyond it."""
        size = np.abs(np.zeros(1) if probe.v is None else probe.v)
        return float(np.min(size)) < theta[0] < float(np.max(size))

    def starts(self, probe: Probe) -> list[tuple[float, ...]]:
        """From narrow to nearly as wide as the parts move."""
        size = np.abs(np.ones(1) if probe.v is None else probe.v)
        return [(width,) for width in probe.quantiles(size, 0.1, 0.3, 0.5, 0.7, 0.9)]
