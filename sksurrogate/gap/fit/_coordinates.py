"""Coordinates in which a fit takes its steps: an effect by what it does where its signal has its size.

The coefficient of ``c |v|^m`` goes with ``s^-m`` where the signal has the size s. Where s is far from one, as a pressure in Pa, every step in
(c, m) that is not tiny leaves the valley of the fit; in (c s^m, m) it stays there, and both are known as well in any unit.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sksurrogate.effects._base_effect import BaseEffect
from sksurrogate.effects._model import AugmentedModel, BoundModel
from sksurrogate.kernels.output_error import Fit

#: Step of the differences of a gain, in its parameters.
GAIN_DIFFERENCE = 1e-6
#: Where the size of a signal is within this factor of one, steps in the parameters stay in the valley too.
FAR_FROM_ONE = 10.0


@dataclass(frozen=True)
class Coordinates:
    """Of the parameters of a set of effects; theta and coordinates are (n_theta,) or (n_theta, n_columns)."""

    #: Where the parameters of an effect stand, the effect, the size of its signal; effects whose coordinates are their parameters are left out
    effects: tuple[tuple[slice, BaseEffect, float], ...]

    def model(self, model: AugmentedModel) -> AugmentedModel:
        """A model as one of the coordinates."""
        return InCoordinates(model, self) if self.effects else model

    def of(self, theta: np.ndarray, at: np.ndarray | None = None) -> np.ndarray:
        """Coordinates of parameters, or of what belongs to them, as their bounds and units, about other parameters."""
        out, at = theta.copy(), theta if at is None else at
        for own, effect, size in self.effects:
            out[own.start] = theta[own.start] * effect.gain(at[own], size)
        return out

    def theta(self, z: np.ndarray) -> np.ndarray:
        """Parameters at coordinates."""
        out = z.copy()
        for own, effect, size in self.effects:
            out[own.start] = z[own.start] / effect.gain(z[own], size)
        return out

    def slopes(self, theta: np.ndarray) -> np.ndarray:
        """Of the coordinates in the parameters, (n_theta, n_theta)."""
        moved, out = theta[:, None] + GAIN_DIFFERENCE * np.eye(len(theta)), np.eye(len(theta))
        for own, effect, size in self.effects:
            gain = effect.gain(theta[own], size)
            out[own.start] = theta[own.start] * (effect.gain(moved[own], size) - gain) / GAIN_DIFFERENCE
            out[own.start, own.start] = gain
        return out

    def within(self, nearest: Callable[[np.ndarray], np.ndarray], z: np.ndarray) -> np.ndarray:
        """Coordinates of the nearest parameters that are allowed; those that are stay as they are, to the last digit."""
        theta = self.theta(z)
        allowed = nearest(theta)
        return np.where(allowed == theta, z, self.of(allowed))

    def in_parameters(self, fit: Fit) -> Fit:
        """A fit in coordinates with its parameters, and sensitivities to them."""
        if not self.effects:
            return fit
        theta, lin = self.theta(fit.theta), fit.linearised
        if lin is not None:
            lin = replace(lin.kept(), J_theta=np.einsum("okt,kj->ojt", lin.J_theta, self.slopes(theta)))
        return replace(fit, theta=theta, linearised=lin)


def coordinates_of(
    effects: Sequence[BaseEffect], slice_of: Callable[[int], slice], signals: Mapping[str, np.ndarray]
) -> Coordinates:
    """Coordinates of a set of effects along a path of the signals; ``slice_of``: where the parameters of each stand."""
    some = [(i, one) for i, one in enumerate(effects) if type(one).gain is not BaseEffect.gain]
    drivers = [(*one.signals, str(one.location))[0] for _, one in some]
    sized = [(slice_of(i), one, _size(signals[v])) for (i, one), v in zip(some, drivers)]
    return Coordinates(tuple(one for one in sized if abs(np.log(one[2])) > np.log(FAR_FROM_ONE)))


def _size(signal: np.ndarray) -> float:
    """Largest value of a signal, where a power shows most; 1 where there is none."""
    size = float(np.max(np.abs(signal)))
    return size if np.isfinite(size) and size > 0 else 1.0


class InCoordinates(AugmentedModel):
    """A model whose parameters are coordinates."""

    def __init__(self, model: AugmentedModel, coordinates: Coordinates):
        self.__dict__.update(model.__dict__)
        self.coordinates = coordinates

    def bind(self, theta: np.ndarray) -> BoundModel:
        """The model at coordinates (n_theta, n_columns)."""
        return super().bind(self.coordinates.theta(theta))
