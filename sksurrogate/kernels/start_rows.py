"""The first rows of a run as part of the model: their noise is taken off by what free runs look like."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

__all__ = ["StartRows", "found_start"]

#: Windows that the distribution is learned from.
ENOUGH = 5000
#: Ridge on the inputs, in units of their variance: rounding, for inputs that are still.
RIDGE = 1e-6
#: Gauss-Newton steps, and half width of differences, of a start from more rows; numbers are in spreads.
STEPS, WIDTH = 8, 1e-5


@dataclass(frozen=True, eq=False)
class StartRows:
    """Normal distribution of n consecutive outputs given the inputs of these rows, and how noisy ones are smoothed.

    Attributes
    ----------
    offset : ndarray (n_values,)
    by_inputs : ndarray (n_input_values, n_values)
    covariance : ndarray (n_values, n_values)
    noise : float
        Variance of the measurement noise.
    """

    offset: np.ndarray
    by_inputs: np.ndarray
    covariance: np.ndarray
    noise: float

    @classmethod
    def of(cls, U: np.ndarray, y: np.ndarray, n: int, noise: float) -> StartRows:
        """From free runs: U (n_runs, n_steps, n_inputs), y (n_runs, n_steps, n_outputs), n rows, all in spreads."""
        slide = np.lib.stride_tricks.sliding_window_view
        windows, inputs = (slide(v, n, axis=1).transpose(0, 1, 3, 2) for v in (y, U))
        some = np.linspace(0, windows.shape[0] * windows.shape[1] - 1, ENOUGH).astype(int)
        some = np.unique(some)
        W, V = (v.reshape(-1, *v.shape[2:])[some].reshape(len(some), -1) for v in (windows, inputs))
        middle, about = W.mean(axis=0), V.mean(axis=0)
        V = V - about
        gram = V.T @ V + RIDGE * len(V) * np.eye(V.shape[1])
        by_inputs = np.linalg.solve(gram, V.T @ (W - middle))
        rest = W - middle - V @ by_inputs
        return cls(middle - about @ by_inputs, by_inputs, rest.T @ rest / len(rest), noise)

    def expected(self, U: np.ndarray) -> np.ndarray:
        """Mean of the rows given their inputs, (n_runs, n_values)."""
        return self.offset + U.reshape(len(U), -1) @ self.by_inputs

    @property
    def posterior(self) -> np.ndarray:
        """Covariance of the rows once they were measured, (n_values, n_values)."""
        size = len(self.covariance)
        gain = np.linalg.solve(self.covariance + self.noise * np.eye(size), self.covariance)
        return self.covariance - self.covariance @ gain

    def smoothed(self, U: np.ndarray, first: np.ndarray) -> np.ndarray:
        """Most likely rows (n_runs, n, n_outputs) behind measured ones, U (n_runs, n, n_inputs)."""
        expected = self.expected(U)
        gain = np.linalg.solve(self.covariance + self.noise * np.eye(len(self.covariance)), self.covariance)
        return (expected + (first.reshape(len(first), -1) - expected) @ gain).reshape(first.shape)

    def precision(self) -> np.ndarray:
        """Inverse covariance before anything was measured, in units of the noise."""
        size = len(self.covariance)
        floor = RIDGE * max(float(np.trace(self.covariance)) / size, RIDGE)
        return self.noise * np.linalg.inv(self.covariance + floor * np.eye(size))


def found_start(
    run: Callable[[np.ndarray, np.ndarray], np.ndarray], start: StartRows, U: np.ndarray, y: np.ndarray, n: int
) -> np.ndarray:
    """First n rows from which the free runs come nearest to more measured rows: Gauss-Newton with the start's prior.

    Parameters
    ----------
    run : callable
        (inputs, first rows) -> free runs (n_runs, n_steps, n_outputs).
    start : StartRows
    U : ndarray (n_runs, n_rows, n_inputs)
    y : ndarray (n_runs, n_rows, n_outputs)
        Measured; nan where it was not.
    n : int

    Returns
    -------
    ndarray (n_runs, n, n_outputs)
    """
    n_runs, q = len(U), n * y.shape[2]
    known = np.isfinite(y)
    target, precision = np.where(known, y, 0.0), start.precision()
    expected = start.expected(U[:, :n])
    z = np.where(known[:, :n].reshape(n_runs, -1), target[:, :n].reshape(n_runs, -1), expected)

    def errors(z: np.ndarray) -> np.ndarray:
        with np.errstate(all="ignore"):
            return np.where(known, run(U, z.reshape(n_runs, n, -1)) - target, 0.0).reshape(n_runs, -1)

    def cost(e: np.ndarray, z: np.ndarray) -> np.ndarray:
        away = z - expected
        return np.nan_to_num(np.sum(e**2, axis=1), nan=np.inf) + np.einsum("ri,ij,rj->r", away, precision, away)

    e = errors(z)
    best, damping = cost(e, z), np.full(n_runs, 1e-6)
    for _ in range(STEPS):
        J = np.stack([(errors(z + WIDTH * row) - e) / WIDTH for row in np.eye(q)], axis=2)
        J[~np.isfinite(J).all(axis=(1, 2))] = 0.0
        normal = J.transpose(0, 2, 1) @ J + precision
        slope = np.einsum("rnq,rn->rq", J, np.nan_to_num(e)) + (z - expected) @ precision
        step = np.linalg.solve(normal + damping[:, None, None] * np.eye(q), slope[:, :, None])[:, :, 0]
        trial = z - step
        found = errors(trial)
        value = cost(found, trial)
        better = value <= best
        z, e = np.where(better[:, None], trial, z), np.where(better[:, None], found, e)
        best, damping = np.where(better, value, best), np.where(better, damping / 10, damping * 100)
        if np.abs(step).max(initial=0.0) < WIDTH:
            break
    return z.reshape(n_runs, n, -1)
