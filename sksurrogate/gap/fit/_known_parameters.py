"""What a user knows of the simulator's parameters, in the coordinates of the fits.

A free parameter is fitted as the logarithm of its ratio to the nominal value, or as itself where that is 0; ``parameter_error``
as the ratio less one, likewise.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from sksurrogate.effects._base_effect import BaseEffect
from sksurrogate.effects._onset import Starting
from sksurrogate.effects._parameter import ParameterDependence, constant_in_time
from sksurrogate.exceptions import DataError

#: Standard deviation of the prior on the relative change of a free parameter; its tails are those of Student's t.
PRIOR = 0.10
#: A parameter further than this ratio (log) from nominal is out of the question unless the user says otherwise.
FARTHEST_RATIO = 4.0
#: Standard deviation that holds a free parameter still where an effect moves the same number.
HELD = 1e-3


@dataclass(frozen=True)
class KnownParameters:
    """Bounds and priors of parameters, in their own units.

    >>> known = KnownParameters({"k": (0.5, 2.0)}, {"k": (1.1, 0.11)})
    >>> [round(end, 3) for end in known.free_bounds("k", 1.0)]
    [-0.693, 0.693]
    >>> [round(float(v), 3) for v in known.free_prior("k", 1.0, 0.0)]
    [0.095, 0.1]
    """

    bounds: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    #: Normal where the nominal value is 0, else log-normal with this median and relative standard deviation: a
    #: parameter keeps its sign
    priors: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    def check(self, params: Mapping[str, float]) -> None:
        """DataError where bounds or a prior hold no value of the sign of the nominal one."""
        for what, given in (("bounds", self.bounds), ("priors", self.priors)):
            for name, (a, b) in given.items():
                nominal, held = params[name], (a, b) if what == "bounds" else (a,)  # a prior its mean
                if nominal != 0 and max(value / nominal for value in held) <= 0.0:
                    raise DataError(
                        f"{what}[{name!r}]=({a:g}, {b:g}) holds no value of the sign of the simulator's {name}={nominal:g}, and "
                        "re-tuning keeps the sign: give the simulator a value within them, "
                        f"set_params(params__{name}=...)."
                    )

    def free_bounds(self, name: str, nominal: float) -> tuple[float, float]:
        """Bounds of a free parameter."""
        low, high = self.bounds.get(name, (-np.inf, np.inf))
        if nominal == 0:
            return low, high
        least, most = sorted((low / nominal, high / nominal))
        first = float(np.log(least)) if least > 0 else -np.inf
        last = float(np.log(most)) if np.isfinite(most) else np.inf
        return (
            first if np.isfinite(first) else min(-FARTHEST_RATIO, last - FARTHEST_RATIO),
            last if np.isfinite(last) else max(FARTHEST_RATIO, first + FARTHEST_RATIO),
        )

    def free_prior(self, name: str, nominal: float, phi: float) -> tuple[float, float]:
        """Mean and standard deviation of a free parameter; Student's t by reweighting at ``phi`` where nothing is known."""
        if name in self.priors:
            mean, sd = self.priors[name]
            return (mean, sd) if nominal == 0 else (float(np.log(mean / nominal)), sd / abs(mean))
        return (0.0, np.inf) if nominal == 0 else (0.0, float(np.sqrt(PRIOR**2 + phi**2 / 2)))

    def bounds_of(
        self,
        params: Mapping[str, float],
        effects: Sequence[BaseEffect],
        free: Sequence[str],
        duration: float,
        inputs: Collection[str] = (),
    ) -> tuple[np.ndarray, np.ndarray]:
        """Bounds of the parameters of effects in turn, then of free parameters; ``duration`` of the longest run."""
        low: list[float] = []
        high: list[float] = []
        for effect in effects:
            least, most = list(effect.lower_bounds(duration)), [p.high for p in effect.parameters]
            if effect.either_sign(inputs):
                least[0] = -np.inf
            place = _place_of_error(effect)
            if place in self.bounds:
                a, b = sorted(map(_as_error(params[place]), self.bounds[place]))
                least, most = [max(a, least[0])], [min(b, most[0])]
            low += least
            high += most
        own = [self.free_bounds(name, params[name]) for name in free]
        return np.array([*low, *(a for a, _ in own)], float), np.array([*high, *(b for _, b in own)], float)

    def given_on(self, effects: Sequence[BaseEffect], free: Sequence[str]) -> np.ndarray:
        """Which of the parameters of effects in turn, then of free parameters, the user gives a prior of."""
        moved = {_place_of_error(effect) for effect in effects}
        own = [_place_of_error(effect) in self.priors for effect in effects for _ in effect.parameters]
        return np.array([*own, *(name in self.priors and name not in moved for name in free)], bool)

    def held(self, effects: Sequence[BaseEffect]) -> set[str]:
        """Parameters that depend on a signal, unless the user gives a prior: what they are at its mean is a number of the effect."""
        dependences = [e for e in effects if isinstance(e, ParameterDependence) and not isinstance(e, Starting)]
        return {str(effect.location) for effect in dependences} - set(self.priors)

    def prior_of(
        self, params: Mapping[str, float], effects: Sequence[BaseEffect], free: Sequence[str], theta: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Mean and standard deviation (inf: none) of the same numbers."""
        n = len(theta) - len(free)
        mean, sd = np.zeros(len(theta)), np.full(len(theta), np.inf)
        moved = {_place_of_error(effect) for effect in effects} | self.held(effects)
        position = 0
        for effect in effects:
            place = _place_of_error(effect)
            if place in self.priors:
                nominal, (centre, width) = params[place], self.priors[place]
                mean[position], sd[position] = _as_error(nominal)(centre), width / (abs(nominal) or 1.0)
            position += len(effect.parameters)
        for i, name in enumerate(free, start=n):
            mean[i], sd[i] = (0.0, HELD) if name in moved else self.free_prior(name, params[name], float(theta[i]))
        return mean, sd


def value_of(nominal: float, phi: float) -> float:
    """Value of a free parameter.

    >>> value_of(2.0, 0.0), value_of(0.0, 0.3)
    (2.0, 0.3)
    """
    return float(phi if nominal == 0 else nominal * np.exp(phi))


def _place_of_error(effect: BaseEffect) -> str:
    """The parameter whose relative error an effect is; no name where it is another effect."""
    return str(effect.location) if constant_in_time(effect) else ""


def _as_error(nominal: float) -> Callable[[float], float]:
    """A value of a parameter as a relative error; as itself where the nominal value is 0."""
    return lambda value: value if nominal == 0 else value / nominal - 1.0
