"""A slow actuator in motion where a run begins, as in a record that begins amid an operation."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from sksurrogate.effects._base_effect import BaseEffect
from sksurrogate.effects._families import HiddenEffect
from sksurrogate.effects._hidden import FORGETS
from sksurrogate.effects._input import InputLag
from sksurrogate.effects._parts import Probe
from sksurrogate.effects._smooth import TINY, WITHIN_SAMPLE, follow


class UnsettledLag(HiddenEffect):
    """The lag of an input, from where its actuator stood when a run began: ``c dw/dt + w = u``, ``w(0)`` any.

    It is :class:`~sksurrogate.effects._input.InputLag` with a hidden state in place of a known start: at the port of the input it adds
    ``w - u``.

    Examples
    --------
    >>> UnsettledLag("u").key
    ('input_lag', 'u', None)
    """

    name = InputLag.name
    parameters = InputLag.parameters
    equation = InputLag.equation
    signature = InputLag.signature
    typical = "the actuator follows within the runs, and not within a sample"
    twins = InputLag.twins
    rarity = InputLag.rarity
    settled = False

    def __init__(self, location: str | None = None):
        super().__init__(location, location)

    @property
    def key(self) -> tuple[str, str | None, str | None]:
        """That of the lag: no other signal drives it."""
        return self.name, self.location, None

    @property
    def at_rest(self) -> bool:
        """It need not be."""
        return False

    @property
    def settled_form(self) -> BaseEffect:
        """The lag from the first value of the input."""
        return InputLag(self.location)

    def rest(self, v: np.ndarray, theta: Sequence[Any]) -> Sequence[Any]:
        """``w(0) = u(0)``."""
        return [v]

    def rates(
        self, z: np.ndarray, t: Any, v: np.ndarray, dv: np.ndarray, theta: Sequence[Any], width: float
    ) -> Sequence[Any]:
        """``(u - w) / c``."""
        return [(v - z[0]) / np.maximum(theta[0], TINY)]

    def rates_within(
        self, z: np.ndarray, t: Any, v: np.ndarray, dv: np.ndarray, theta: Sequence[Any], width: float, h: float
    ) -> Sequence[Any]:
        """An actuator that is much faster than a step keeps up."""
        return [follow(h / np.maximum(theta[0], TINY)) * rate for rate in self.rates(z, t, v, dv, theta, width)]

    def force(self, z: np.ndarray, v: np.ndarray, theta: Sequence[Any]) -> Any:
        """``w - u``."""
        return z[0] - v

    def plausible(self, theta: Sequence[float], probe: Probe) -> bool:
        """What is slower than a third of a run is a constant of the run, what is faster than a sample shows no start."""
        return WITHIN_SAMPLE * probe.dt < theta[0] < max(probe.duration, probe.dt) / FORGETS

    def starts(self, probe: Probe) -> list[tuple[float, ...]]:
        """As of the lag."""
        return InputLag(self.location).starts(probe)
