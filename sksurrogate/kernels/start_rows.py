"""The first rows of a run, found from more measured rows than a start needs."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

#: Gauss-Newton steps, and half width of differences, in standard deviations of the outputs.
START_STEPS, START_HALF_WIDTH = 8, 1e-5
#: Prior standard deviation of the first rows about the mean, in those of the outputs: it decides only what no measured row shows.
START_PRIOR_SD = 3.0


def found_start(run: Callable[[np.ndarray], np.ndarray], y: np.ndarray, n: int, noise: float) -> np.ndarray:
    """First n rows from which the free runs come nearest to more measured rows, by Gauss-Newton.

    ``run``: first rows (n_runs, n, n_outputs) -> free runs (n_runs, n_steps, n_outputs), in standard deviations about the mean.
    ``y`` (n_runs, n_rows, n_outputs): measured; nan where it was not.
    ``noise``: variance of the measurement noise.
    Returns (n_runs, n, n_outputs).
    """
    n_runs, q = len(y), n * y.shape[2]
    known, precision = np.isfinite(y), noise / START_PRIOR_SD**2
    target = np.where(known, y, 0.0)
    z = target[:, :n].reshape(n_runs, -1)

    def errors(z: np.ndarray) -> np.ndarray:
        with np.errstate(all="ignore"):
            return np.where(known, run(z.reshape(n_runs, n, -1)) - target, 0.0).reshape(n_runs, -1)

    def cost(e: np.ndarray, z: np.ndarray) -> np.ndarray:
        return np.nan_to_num(np.sum(e**2, axis=1), nan=np.inf) + precision * np.sum(z**2, axis=1)

    e = errors(z)
    best, damping = cost(e, z), np.full(n_runs, 1e-6)
    for _ in range(START_STEPS):
        J = np.stack([(errors(z + START_HALF_WIDTH * row) - e) / START_HALF_WIDTH for row in np.eye(q)], axis=2)
        J[~np.isfinite(J).all(axis=(1, 2))] = 0.0
        normal = J.transpose(0, 2, 1) @ J
        slope = np.einsum("rnq,rn->rq", J, np.nan_to_num(e)) + precision * z
        step = np.linalg.solve(normal + (precision + damping)[:, None, None] * np.eye(q), slope[:, :, None])[:, :, 0]
        trial = z - step
        found = errors(trial)
        value = cost(found, trial)
        better = value <= best
        z, e = np.where(better[:, None], trial, z), np.where(better[:, None], found, e)
        best, damping = np.where(better, value, best), np.where(better, damping / 10, damping * 100)
        if np.abs(step).max(initial=0.0) < START_HALF_WIDTH:
            break
    return z.reshape(n_runs, n, -1)
