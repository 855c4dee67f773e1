"""A set of effects to first order about a path: the residual, and what its parameters and other columns explain of it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Generic

import numpy as np

from sksurrogate.gap.fit._backend import Backend, C
from sksurrogate.gap.fit._linear_model import LinearModel
from sksurrogate.gap.fit._normal_equations import eliminate, scaled
from sksurrogate.kernels.disturbance import Disturbance, Noise
from sksurrogate.kernels.linear_fit import linear_least_squares
from sksurrogate.kernels.noise_fit import fit_noise
from sksurrogate.kernels.run_columns import UNSEEN

#: Directions that move the outputs by less than this share of the most, or of what they moved before initial states and
#: parameters followed (power), count as none.
RANK = 1e-9


@dataclass(frozen=True, eq=False)
class LinearSet(LinearModel, Generic[C]):
    """Residual of a candidate, its sensitivities, and what holds a step of the parameters.

    Other columns may explain it beside them: F is what functions move the outputs by, (n_outputs, n_functions, n_samples); G the
    Gram of residual, parameters and functions under a noise.
    """

    base: C  #: Whose model carries everything to the outputs

    @property
    def problem(self) -> Backend:
        """Plant and record."""
        return self.base.problem

    @cached_property
    def D(self) -> Disturbance:
        """Noise model along the path."""
        return self.base.disturbance

    @property
    def finite(self) -> bool:
        """Whether the path can be followed."""
        return all(np.isfinite(part).all() for part in (self.r, self.J, self.D.A, self.D.C))

    # ---- likelihood -------------------------------------------------------------------------------------------------
    def gram(self, noise: Noise) -> tuple[np.ndarray, float]:
        """Of residual and sensitivities under a noise, and its log determinant."""
        return self.D.gram(self.known, noise)

    def noise_from(self, start: Noise, **options: Any) -> tuple[Noise, float, np.ndarray]:
        """The likeliest noise from a start, parameters at their best; as :func:`fit_noise` gives it."""
        problem = self.problem
        given = start, problem.force_unit(), self.J, self.precision, self.pull
        return fit_noise(self.D, self.r, *given, caps=problem.caps, **options)

    def log_likelihood(self, noise: Noise) -> float:
        """Under a noise, parameters at their best."""
        return self.at_best(*self.gram(noise))

    def at_best(self, G: np.ndarray, logdet: float) -> float:
        """The same from a Gram; its other functions do not act."""
        k = self.J.shape[1]
        left = eliminate(G[: 1 + k, : 1 + k], k, self.precision, self.pull)
        return -0.5 * (float(left[0, 0]) + logdet + self.base.prior_square)

    def likelihood_within_bounds(self, noise: Noise) -> float:
        """Under a noise, parameters at their best within their bounds; -inf where a trajectory left the finite numbers."""
        if not np.isfinite(self.J).all():
            return -np.inf
        try:
            G, logdet = self.gram(noise)
        except np.linalg.LinAlgError:
            return -np.inf
        return self.within_bounds(G, logdet) if np.isfinite(G).all() and np.isfinite(logdet) else -np.inf

    def within_bounds(self, G: np.ndarray, logdet: float) -> float:
        """The same from a Gram."""
        base = -0.5 * (G[0, 0] + logdet + self.base.prior_square)
        if len(G) == 1:
            return base
        normal, scale = scaled(G[1:, 1:] + np.diag(self.precision), 1e-150)
        right = (G[1:, 0] + self.pull) / scale
        if not (np.all(np.isfinite(normal)) and np.all(np.isfinite(right))):
            return -np.inf
        low, high = ((bound - self.base.fit.theta) * scale for bound in self.problem.bounds(self.base.effects))
        step = _bounded(normal, right, low, high)
        return base + float(right @ step) - 0.5 * float(step @ normal @ step)

    def beside_parameters(self, G: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        """Gram of the functions, their products with the residual and its power, the parameters at their best."""
        rest = eliminate(G, self.J.shape[1], self.precision, self.pull)
        H, g, power = rest[1:, 1:], rest[1:, 0], float(rest[0, 0]) + self.base.prior_square
        return 0.5 * (H + H.T), g, power

    # ---- movement that is left --------------------------------------------------------------------------------------
    @cached_property
    def _basis(self) -> np.ndarray:
        """Orthonormal directions in which the parameters move the outputs, initial states taken out, (n_values, n_theta)."""
        J = self.base.without_starts(self.J.transpose(1, 0, 2)).reshape(self.J.shape[1], self.r.size)
        return np.linalg.qr((J / np.maximum(np.linalg.norm(J, axis=1, keepdims=True), 1e-300)).T)[0]

    def projected(self, F: np.ndarray) -> np.ndarray:
        """What functions move the outputs by, over the noise, once initial states and parameters have followed, (n_functions, ...)."""
        columns = F.transpose(1, 0, 2)
        shown = self.problem.record.seen(columns) / self.problem.sd[:, None]
        moved = self.base.without_starts(columns).reshape(len(columns), -1)
        if self.J.shape[1]:
            moved = moved - (moved @ self._basis) @ self._basis.T
        unidentifiable = np.sum(moved**2, axis=1) <= RANK * np.sum(shown**2, axis=(1, 2))
        moved[unidentifiable] = 0.0  # initial states and parameters do all that the function does: rounding is left
        return moved

    def metric(self, F: np.ndarray) -> np.ndarray:
        """Mean square over the noise that weights of functions move the outputs by, as a quadratic form (n_functions, n_functions)."""
        moved = self.projected(F)
        return moved @ moved.T / self.problem.record.n_values


def linear_set(candidate: C) -> LinearSet[C]:
    """A candidate about its own free run."""
    return LinearSet(*candidate.columns(), candidate)


def _bounded(normal: np.ndarray, right: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Solve ``normal step = right``; components that leave their bounds are held there and the others solved again."""
    step, free = np.zeros(len(right)), np.ones(len(right), bool)
    for _ in range(len(right)):
        if not free.any():
            break
        pushed = right[free] - normal[np.ix_(free, ~free)] @ step[~free]
        step[free] = linear_least_squares(normal[np.ix_(free, free)], pushed, rcond=UNSEEN)
        outside = free & ((step < low) | (step > high))
        if not outside.any():
            break
        step[outside] = np.clip(step, low, high)[outside]
        free &= ~outside
    return step
