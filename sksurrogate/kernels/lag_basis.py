"""Free runs, and fits on them, of models that are linear in fixed functions of past outputs and inputs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from sksurrogate.kernels.net import lag_rows
from sksurrogate.kernels.newton import TOO_FAR, fill_band, solve_band
from sksurrogate.kernels.rollout import march
from sksurrogate.kernels.shooting import FreeRunLoss

#: Rows whose features are made at once.
FEATURE_ROWS = 16384
#: Half width of the differences that give slopes of the features, in spreads.
SLOPE_HALF_WIDTH = 1e-5
#: A free run is given up this many spreads from the mean.
DIVERGED_SPREADS = 1e4


@dataclass(frozen=True)
class LagBasis:
    """``y[t] = basis(y[t-1], ..., u[t], ...) @ weights + bias``; past outputs lag by lag, then inputs."""

    basis: Callable[[np.ndarray], np.ndarray]  #: (n_rows, n_features) -> (n_rows, n_basis)
    weights: np.ndarray  #: (n_basis, n_outputs)
    bias: np.ndarray  #: (n_outputs,)
    output_lags: tuple[int, ...]
    input_terms: tuple[tuple[int, int], ...]  #: tuple of (int, int): column and lag of every input feature
    fixed_bias: bool = False  #: Whether the bias is given, not learned

    @cached_property
    def theta(self) -> np.ndarray:
        """Weights, then biases that are learned, flat."""
        return self.weights.ravel() if self.fixed_bias else np.concatenate([self.weights.ravel(), self.bias])

    @property
    def n_weights(self) -> int:
        """Entries of ``theta`` that are weights."""
        return self.weights.size

    @property
    def n_outputs(self) -> int:
        """Outputs of a step."""
        return len(self.bias)

    def at(self, theta: np.ndarray) -> LagBasis:
        """The same model with other weights."""
        n = self.weights.size
        bias = self.bias if self.fixed_bias else theta[n:]
        return replace(self, weights=theta[:n].reshape(self.weights.shape), bias=bias)

    def __call__(self, phi: np.ndarray) -> np.ndarray:
        """(n_rows, n_features) -> (n_rows, n_outputs)."""
        parts = [self.basis(phi[k : k + FEATURE_ROWS]) @ self.weights for k in range(0, len(phi), FEATURE_ROWS)]
        return np.concatenate(parts) + self.bias

    def rows(self, U: np.ndarray, y: np.ndarray, n_first: int) -> np.ndarray:
        """Features of steps n_first.., (n_runs * n, n_features)."""
        past = lag_rows(y, [(i, k) for k in self.output_lags for i in range(self.n_outputs)], n_first)
        return np.concatenate([past, lag_rows(U, self.input_terms, n_first)]).T

    def band(self, phi: np.ndarray, n_runs: int) -> np.ndarray:
        """Band of the recursion at these features, from central differences."""
        o, n_past = self.n_outputs, len(self.output_lags) * self.n_outputs
        slopes = np.empty((o, n_past, len(phi)))
        for k in range(n_past):
            ahead, behind = phi.copy(), phi.copy()
            ahead[:, k] += SLOPE_HALF_WIDTH
            behind[:, k] -= SLOPE_HALF_WIDTH
            slopes[:, k] = ((self(ahead) - self(behind)) / (2 * SLOPE_HALF_WIDTH)).T
        band = np.zeros((n_runs, len(phi) // n_runs, o, (max(self.output_lags) + 1) * o))
        for j in range(o):
            fill_band(band, self.output_lags, slopes[j], j)
        return band


@dataclass(frozen=True)
class BasisLoss(FreeRunLoss):
    """The loss of :class:`FreeRunLoss` for a :class:`LagBasis`, all numbers in standard deviations about the mean."""

    def run(self, model: Any, guess: np.ndarray | None = None, rtol: float = 1e-10) -> np.ndarray:
        """Free runs, by Newton over time from a guess, else step by step; nan after one has gone too far."""
        first = self.target[:, : self.n_first]
        if guess is not None:
            y = np.concatenate([first, guess[:, self.n_first :]], axis=1)
            if self._newton(model, y, rtol):
                return y
        far = np.full(model.n_outputs, DIVERGED_SPREADS)
        return march(model, self.U, first, model.output_lags, model.input_terms, (-far, far))

    def _newton(self, model: LagBasis, y: np.ndarray, rtol: float) -> bool:
        """Solve in place; False where it does not settle."""
        with np.errstate(all="ignore"):
            for _ in range(8):
                phi = model.rows(self.U, y, self.n_first)
                if not np.isfinite(phi).all() or np.abs(phi).max() > DIVERGED_SPREADS:
                    return False
                rest = model(phi).reshape(y[:, self.n_first :].shape) - y[:, self.n_first :]
                step, info = solve_band(model.band(phi, len(y)), rest.reshape(-1, 1))
                size, scale = float(np.abs(step).max()), float(np.abs(y).max())
                if info or not size <= TOO_FAR * (1.0 + scale):
                    return False
                y[:, self.n_first :] += step.reshape(rest.shape)
                if size <= np.sqrt(rtol) * (1e-3 + scale):  # Newton squares the error
                    return True
        return False

    def slopes(self, model: Any, y: np.ndarray) -> np.ndarray:
        """Slopes of free runs by the weights, (n_runs, n_steps - n_first, n_outputs, n_theta)."""
        phi = model.rows(self.U, y, self.n_first)
        o, n = model.n_outputs, len(phi)
        basis = np.concatenate([model.basis(phi[k : k + FEATURE_ROWS]) for k in range(0, n, FEATURE_ROWS)])
        right = np.zeros((basis.shape[1] + (not model.fixed_bias), o, n, o))
        for j in range(o):
            right[: basis.shape[1], j, :, j] = basis.T
            right[basis.shape[1] :, j, :, j] = 1.0
        found, _ = solve_band(model.band(phi, len(y)), right.reshape(-1, n * o).T, in_place=True)
        return found.reshape(len(y), n // len(y), o, -1)
