"""How a free run forgets: local spectral radius and contraction along it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

#: Half width of differences in standard deviations of the outputs; the second for piecewise constant models (forests).
SMOOTH_HALF_WIDTH, STEPPED_HALF_WIDTH = 1e-5, 0.5


@dataclass(frozen=True, eq=False)
class StabilityReport:
    """Growth of small disturbances of the past outputs along free runs.

    For piecewise constant models (forests) the disturbances are half a standard deviation of the outputs.

    Attributes
    ----------
    labels : tuple
        One per run.
    radius : tuple of ndarray (n_steps,)
        Spectral radius of the linearisation at every step after the first rows. A run may be stable although it is above 1 at some steps.
    rate : tuple of float
        Mean factor of a disturbance a step over the whole run: below 1 the run forgets where it began.
    peak : tuple of float
        Largest factor that a disturbance of the first rows reaches along the run.
    memory : tuple of float
        Steps after which a disturbance is a hundredth; inf where the rate is not below 1.
    """

    labels: tuple[Any, ...]
    radius: tuple[np.ndarray, ...]
    rate: tuple[float, ...]
    peak: tuple[float, ...]
    memory: tuple[float, ...]

    @property
    def contracts(self) -> bool:
        """Whether every run forgets where it began."""
        return all(rate < 1.0 for rate in self.rate)

    def __str__(self) -> str:
        worst = int(np.argmax(self.rate))
        name = "the run" if self.labels[worst] is None else f"run {self.labels[worst]!r}"
        share = float(np.mean(np.concatenate(self.radius) > 1.0))
        head = f"{len(self.rate)} free run{'s' if len(self.rate) > 1 else ''}: worst in {name}, disturbances "
        body = f"change by a factor {self.rate[worst]:.4g} a step (peak {self.peak[worst]:.3g})"
        tail = f"; spectral radius above 1 in {100 * share:.1f} % of the steps, at most {self._largest:.4g}."
        if self.contracts:
            return f"{head}{body}, to a hundredth in {self.memory[worst]:.0f} steps{tail} The free runs forget."
        return (
            f'{head}{body}{tail} The free runs do not forget: fit with loss="shooting", stability above 0, longer runs or '
            "fewer lags."
        )

    @property
    def _largest(self) -> float:
        return float(max(radius.max(initial=0.0) for radius in self.radius))


def growth_along(
    step: Callable[[np.ndarray], np.ndarray],
    features: Sequence[np.ndarray],
    labels: Sequence[Any],
    lags: Sequence[int],
    n_outputs: int,
) -> StabilityReport:
    """Linearise a one-step model along free runs.

    ``step``: (n_rows, n_features) -> (n_rows, n_outputs); the first features are past outputs lag by lag.
    ``features`` (n_steps, n_features): features along every free run.
    """
    n_past = len(lags) * n_outputs
    every = [_slopes(step, phi, n_past, SMOOTH_HALF_WIDTH) for phi in features]
    if not any(np.any(slopes) for slopes in every):
        every = [_slopes(step, phi, n_past, STEPPED_HALF_WIDTH) for phi in features]
    found = [_of_run(slopes, lags, n_outputs) for slopes in every]
    radius, rate, peak = zip(*found)
    memory = tuple(float(np.log(0.01) / np.log(r)) if 0 < r < 1 else (0.0 if r == 0 else np.inf) for r in rate)
    return StabilityReport(tuple(labels), radius, rate, peak, memory)


def _slopes(step: Callable[[np.ndarray], np.ndarray], phi: np.ndarray, n_past: int, share: float) -> np.ndarray:
    """Slopes by the past outputs, by central differences in one call, (n_steps, n_outputs, n_past)."""
    width = share * (phi[:, :n_past].std(axis=0) + 1e-6 * np.abs(phi[:, :n_past]).max(axis=0) + 1e-12)
    rows = np.repeat(phi[None], 2 * n_past, axis=0)
    for k in range(n_past):
        rows[2 * k, :, k] += width[k]
        rows[2 * k + 1, :, k] -= width[k]
    y = step(rows.reshape(-1, phi.shape[1])).reshape(n_past, 2, len(phi), -1)
    return np.moveaxis((y[:, 0] - y[:, 1]) / (2 * width[:, None, None]), 0, 2)


def _of_run(slopes: np.ndarray, lags: Sequence[int], o: int) -> tuple[np.ndarray, float, float]:
    """Spectral radius of every step's companion matrix, mean and largest growth of their product."""
    n, size = len(slopes), max(lags) * o
    matrices = np.zeros((n, size, size))
    for k, lag in enumerate(lags):
        matrices[:, :o, (lag - 1) * o : lag * o] = slopes[:, :, k * o : (k + 1) * o]
    matrices[:, np.arange(o, size), np.arange(size - o)] = 1.0
    radius = np.abs(np.linalg.eigvals(matrices)).max(axis=1)
    product, log_size = np.eye(size), 0.0
    logs: list[float] = []
    for matrix in matrices:
        product = matrix @ product
        norm = float(np.linalg.norm(product, 2))
        if norm == 0.0:
            return radius, 0.0, float(np.exp(max(logs, default=0.0)))
        log_size += np.log(norm)
        logs.append(log_size)
        product /= norm
    return radius, float(np.exp(logs[-1] / n)), float(np.exp(min(max(*logs, 0.0), 700.0)))
