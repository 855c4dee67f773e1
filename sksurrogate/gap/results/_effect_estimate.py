"""One named effect: its place, its parameters with intervals, its share of the gap, its probability."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

#: Half width of a 90 % interval in standard deviations.
BAND = 1.645
#: Numbers in the shape of an effect, 0 where it has the form of the catalogue.
SHAPE_NUMBERS = ("corner", "curvature", "falling", "levelling", "lower")
#: How a parameter depends on a signal, by the curvature of the dependence.
CURVES = {-1.0: "as a square root", 1.0: "exponentially", 2.0: "as one over a straight line"}


@dataclass(frozen=True)
class EffectEstimate:
    """One named effect.

    Attributes
    ----------
    name, location : str
    variable : str or None
    share : float
        Share of the gap's power on held-out runs that this effect removes.
    params : dict of float
        Magnitude first.
    intervals : dict of (float, float)
        90 % intervals, same keys as ``params``; inf where unbounded.
    probability : float
        That this effect, or one of ``equivalents``, acts in the plant, whatever else acts: evidence among the effects and laws that were
        compared, calibrated by how often such names act, given the lawful rest beside them and their share.
    equivalents : list of (name, location, variable)
        Other effects that explain these data as well.
    why : str
        When they part.
    richer : list of (name, location, variable)
        Those of ``equivalents`` that contain this effect and fit no better: richer, not needed.
    simpler : list of (name, location, variable)
        Those of ``equivalents`` that are special cases of this effect, and as good up to the tolerance.
    at_port : bool
        Whether it is a law at a port: its magnitude has the port's unit, not that of dx/dt.
    runs : tuple or None
        Labels of the runs in which it acts; None if it acts in all.
    before : float or None
        Of an actuator that remembers: the input before every run, as 0 where the runs begin with a step from rest; None: the value
        of their first rows.
    corner : float
        Of an actuator with a limit: how it bends there, from 0, a corner, to 1, ``tanh``.
    curvature : float
        Of a parameter that depends on a signal: 0, in a straight line; 1, exponentially; 2, as one over a straight line; -1, as a
        square root; others k as a straight line to the power 1 / (1 - k).
    falling : float
        Of an actuator that follows its input: natural logarithm of how many times as fast it falls as it rises, 0 where alike. Its
        parameter is that of the rise.
    levelling : float
        Of a drift: one over the time constant with which it levels off; 0: it goes on. Its magnitude is the rate at the start.
    lower : float
        Of an actuator that moves in steps: the share of a step by which it rounds lower; 0: to the nearest, 0.5: down.
    settled : bool
        Whether its memory began every run at rest. False for a relaxation, or the lag of an input, that the diagnosis found elsewhere;
        ``augmented_`` begins it at rest.

    Examples
    --------
    >>> from sksurrogate.gap import EffectEstimate
    >>> effect = EffectEstimate("sensor_bias", "y", None, 0.98, {"value": 0.5}, {"value": (0.4, 0.6)}, 0.99, [], "")
    >>> effect.location, effect.params["value"]
    ('y', 0.5)
    """

    name: str
    location: str
    variable: str | None
    share: float
    params: dict[str, float]
    intervals: dict[str, tuple[float, float]]
    probability: float
    equivalents: list[tuple[str, str, str | None]] = field(default_factory=list)
    why: str = ""
    richer: list[tuple[str, str, str | None]] = field(default_factory=list)
    at_port: bool = False
    runs: tuple[Any, ...] | None = None
    simpler: list[tuple[str, str, str | None]] = field(default_factory=list)
    before: float | None = None
    settled: bool = True
    corner: float = 0.0
    curvature: float = 0.0
    falling: float = 0.0
    levelling: float = 0.0
    lower: float = 0.0

    def __str__(self) -> str:
        driver = f", driven by {self.variable}" if self.variable and self.variable != self.location else ""
        return f"{self.name} at {self.location}{driver}{circumstances(self)}: {values_of(self)}; {weight_of(self)}"


def circumstances(effect: EffectEstimate) -> str:
    """The runs in which it acts, where these are not all; where its memory began, where that is not at rest; how its limit bends.

    >>> circumstances(EffectEstimate("input_lag", "u", None, 1.0, {}, {}, 1.0, runs=("a", "c"), before=0.0))
    ", in runs 'a', 'c', from 0 before every run"
    """
    runs = effect.runs
    where = "" if runs is None else f", in {'run' if len(runs) == 1 else 'runs'} {', '.join(map(repr, runs))}"
    where += f", soft at its limit ({effect.corner:.2g}; 0: a corner, 1: tanh)" if effect.corner else ""
    where += f", {curve_of(effect.curvature)}" if effect.curvature else ""
    where += f", falling {np.exp(effect.falling):.3g} times as fast as rising" if effect.falling else ""
    where += f", levelling off with a time constant of {1.0 / effect.levelling:.3g}" if effect.levelling else ""
    where += ", rounding down" if effect.lower else ""
    began = "" if effect.settled else ", not at rest where the runs begin"
    return where + (began if effect.before is None else f", from {effect.before:g} before every run")


def curve_of(curvature: float) -> str:
    """How a parameter depends on a signal.

    >>> curve_of(1.0), curve_of(-0.25)
    ('exponentially', 'as a straight line to the power 0.8')
    """
    return CURVES.get(curvature) or f"as a straight line to the power {1.0 / (1.0 - curvature):.3g}"


def values_of(effect: EffectEstimate) -> str:
    """Parameters with their 90 % intervals; after an early interrupt without."""
    parts = []
    for name, value in effect.params.items():
        low, high = effect.intervals[name]
        parts.append(f"{name} = {value:.4g}" + ("" if np.isnan(low) else f" [{low:.4g}, {high:.4g}]"))
    return ", ".join(parts)


def weight_of(effect: EffectEstimate) -> str:
    """Share and probability in words."""
    if np.isnan(effect.share):
        return "its share of the gap is not known yet"
    return f"{100 * effect.share:.1f} % of the gap, probability {effect.probability:.3f}"
