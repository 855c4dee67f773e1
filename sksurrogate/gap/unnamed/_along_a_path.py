"""A set of effects to first order about a path of the plant's states, and what its parameters explain beside other functions."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from sksurrogate.gap.fit._normal_equations import UNSEEN, project_starts, solve
from sksurrogate.gap.fit._ode import OdeBackend, OdeCandidate
from sksurrogate.gap.fit._pushes import STEP_OF_SLOPES
from sksurrogate.gap.unnamed._amplitude import RANK
from sksurrogate.kernels.disturbance import Disturbance, Noise
from sksurrogate.kernels.output_error import Fit, linearise, settle_hidden


@dataclass(frozen=True, eq=False)
class LinearSet:
    """Residual of a set of effects, explained to first order by its parameters.

    Other functions may explain it beside them: F is what these move the outputs by, (n_outputs, n_functions, n_samples).
    """

    base: OdeCandidate  #: Whose model carries everything to the outputs
    r: np.ndarray  #: (n_outputs, n_samples): residual
    J: np.ndarray  #: (n_outputs, n_theta, n_samples): sensitivities
    precision: np.ndarray  #: (n_theta,): what holds a step of the parameters
    pull: np.ndarray  #: (n_theta,): of their prior
    D: Disturbance

    @property
    def problem(self) -> OdeBackend:
        """Plant and record."""
        return self.base.problem

    @property
    def known(self) -> np.ndarray:
        """Residual and sensitivities, (n_outputs, 1 + n_theta, n_samples)."""
        return np.concatenate([self.r[:, None], self.J], axis=1)

    @property
    def finite(self) -> bool:
        """Whether the path can be followed."""
        return all(np.isfinite(part).all() for part in (self.r, self.J, self.D.A, self.D.C))

    # ---- likelihood -------------------------------------------------------------------------------------------------
    def log_likelihood(self, noise: Noise) -> float:
        """Under a noise, parameters at their best."""
        return self.best_of(*self.D.gram(self.known, noise))

    def best_of(self, G: np.ndarray, logdet: float) -> float:
        """The same from a Gram of residual, parameters and functions, and the log determinant of the noise."""
        k = 1 + self.J.shape[1]
        base = -0.5 * (G[0, 0] + logdet + self.base.prior_square)
        if k == 1:
            return base
        H, g = G[1:k, 1:k] + np.diag(self.precision), G[1:k, 0] + self.pull
        return base + 0.5 * float(g @ solve(H, g))

    def beside_parameters(self, G: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        """Of a Gram of residual, parameters and functions: that of the functions, their products with the residual and its power,
        the parameters at their best."""
        k = 1 + self.J.shape[1]
        H, g, power = G[k:, k:], G[k:, 0], float(G[0, 0]) + self.base.prior_square
        if k > 1:
            known = G[1:k, 1:k] + np.diag(self.precision)
            scale = 1.0 / np.sqrt(np.maximum(np.diag(known), 1e-150))
            cross = G[1:k, k:] * scale[:, None]
            pulled = scale * (G[1:k, 0] + self.pull)
            right = np.column_stack([cross, pulled])
            solved = np.linalg.lstsq(known * np.outer(scale, scale), right, rcond=UNSEEN)[0]
            H, g = H - cross.T @ solved[:, :-1], g - cross.T @ solved[:, -1]
            power -= float(pulled @ solved[:, -1])
        return 0.5 * (H + H.T), g, power

    # ---- movement that is left --------------------------------------------------------------------------------------
    @cached_property
    def _white(self) -> tuple[np.ndarray, np.ndarray]:
        """Sensitivities of the parameters over white noise, initial states projected out (n_theta, ...); those of the starts."""
        sd = self.problem.sd[:, None]
        J_x = self.base.linearised.J_x[:, self.base.model.free_states] / sd[:, None]
        record = self.problem.record
        J = project_starts(record.seen(self.J.transpose(1, 0, 2)) / sd, J_x, record.starts) if self.J.size else self.J
        return J.reshape(self.J.shape[1], self.r.size), J_x

    def projected(self, F: np.ndarray) -> np.ndarray:
        """What functions move the outputs by, over the noise, once initial states and parameters have followed, (n_functions, ...)."""
        J, J_x = self._white
        record = self.problem.record
        shown = record.seen(F.transpose(1, 0, 2)) / self.problem.sd[:, None]
        moved = project_starts(shown, J_x, record.starts).reshape(len(shown), -1)
        if len(J):
            q, _ = np.linalg.qr((J / np.maximum(np.linalg.norm(J, axis=1, keepdims=True), 1e-300)).T)
            moved = moved - (moved @ q) @ q.T
        unidentifiable = np.sum(moved**2, axis=1) <= RANK * np.sum(shown**2, axis=(1, 2))
        moved[unidentifiable] = 0.0  # initial states and parameters do all that the function does: rounding is left
        return moved

    def metric(self, F: np.ndarray) -> np.ndarray:
        """Mean square over the noise that weights of functions move the outputs by, as a quadratic form (n_functions, n_functions)."""
        moved = self.projected(F)
        return moved @ moved.T / self.problem.record.n_values


def linear_set(candidate: OdeCandidate, x: np.ndarray | None = None) -> LinearSet:
    """A set of effects about its own free run, or about a path of the plant's states (n_states, n_samples)."""
    base = candidate if x is None else linear_along(candidate, x)
    return LinearSet(base, *base.columns(), base.disturbance)


def as_regressors(candidate: OdeCandidate, x: np.ndarray) -> LinearSet:
    """A set of effects as the simulator without effects carries what they do along a path."""
    problem, n = candidate.problem, candidate.n_parameters
    theta = candidate.fit.theta
    none = problem.candidate((), replace(candidate.fit, theta=theta[n:], linearised=None), problem.augmented(()))
    none = linear_along(none, x)
    now, alone = x[:, None], none.model.bind(theta[n:, None])
    after, shown = alone(now), alone.outputs(now)

    def moved(values: np.ndarray) -> np.ndarray:
        """What the effects move the outputs by, for every column of parameters: (n_outputs, n_columns, n_samples)."""
        path = np.repeat(now, values.shape[1], axis=1)
        bound = candidate.model.bind(values)
        return none.disturbance.moved(bound(path) - after) + bound.outputs(path) - shown

    _, J, precision, pull = none.columns()
    steps = STEP_OF_SLOPES * problem.units(candidate.effects, theta)[:n]
    values = np.repeat(theta[:, None], 1 + n, axis=1)
    values[np.arange(n), 1 + np.arange(n)] += steps
    found = moved(values) if n else np.zeros((len(problem.record.y), 1, problem.record.n_samples))
    own = (found[:, 1:] - found[:, :1]) / steps[:, None] if n else found[:, :0]
    held = np.r_[np.where(theta[:n] != 0, np.abs(theta[:n]), np.inf) ** -2.0, precision]
    r = problem.record.seen(problem.record.y - none.fit.y - found[:, 0])
    J, pull = np.concatenate([own, J], axis=1), np.r_[np.zeros(n), pull]
    return LinearSet(none, r, J, held, pull, none.disturbance)


def linear_along(candidate: OdeCandidate, x: np.ndarray) -> OdeCandidate:
    """A candidate as its free run is to first order about a path of the plant's states."""
    model, theta = candidate.model, candidate.fit.theta
    x = settle_hidden(model, theta, x)
    lin = linearise(model, theta, x, candidate.problem.units(candidate.effects, theta))
    return replace(candidate, fit=Fit(theta, x, lin.y, np.inf, 0, True, lin))
