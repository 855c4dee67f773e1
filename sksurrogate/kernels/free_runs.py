"""Free runs of a model, and the paths of hidden states along a trajectory."""

from __future__ import annotations

import numpy as np

from sksurrogate.kernels.banded import recursion_band, solve_recursion
from sksurrogate.kernels.free_run_model import FreeRunModel
from sksurrogate.kernels.integrate import DIFFERENCE, close
from sksurrogate.kernels.windows import run_in_windows

#: Correction, over the size of each state, at which a run by Newton in time counts as closed.
NEWTON_CLOSED = 1e-9
#: Newton steps in which hidden states settle along a trajectory.
SETTLING_STEPS = 8


def free_run(model: FreeRunModel, theta: np.ndarray, x0: np.ndarray) -> np.ndarray:
    """Free run from initial states (n_states, n_runs), by the simulator itself or window by window: (n_states, n_samples)."""
    bound, record = model.bind(theta[:, None]), model.record
    own = bound.run(x0)
    return own if own is not None else run_in_windows(bound, x0, record.starts, record.lengths, model.scale)


def run_near(model: FreeRunModel, theta: np.ndarray, near: np.ndarray) -> np.ndarray:
    """Free run from the first rows of a trajectory (n_states, n_samples): by Newton in time from there, else window by window."""
    starts = model.record.starts
    x, closed, _ = close(model.bind(theta[:, None]), near, starts, model.scale, NEWTON_CLOSED)
    return x if closed else free_run(model, theta, near[:, starts])


def settle_hidden(model: FreeRunModel, theta: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Fill in hidden states along a given nominal trajectory: Newton in time on their rows alone."""
    n, m, starts = model.n_states, model.n_nominal, model.record.starts
    if n == m:
        return x
    bound = model.bind(theta[:, None])
    out = np.zeros((n, x.shape[1]))
    out[:m] = x[:m]
    first = bound.start(x[:m, None, starts])
    out[m:] = np.repeat(first[m:, 0], model.record.lengths, axis=1)
    dx = DIFFERENCE * model.scale[m:]
    for _ in range(SETTLING_STEPS):
        columns = np.repeat(out[:, None, :], 1 + n - m, axis=1)
        for j in range(n - m):
            columns[m + j, 1 + j] += dx[j]
        after = bound(columns)[m:]
        A = (after[:, 1:] - after[:, :1]) / dx[:, None]
        defect = np.zeros_like(out[m:])
        defect[:, 1:] = after[:, 0, :-1] - out[m:, 1:]
        defect[:, starts] = 0.0
        if not (np.all(np.isfinite(A)) and np.all(np.isfinite(defect))):
            break
        step = solve_recursion(recursion_band(A, starts), defect[:, None])[:, 0]
        out[m:] += np.clip(step, -10 * model.scale[m:, None], 10 * model.scale[m:, None])
        if np.max(np.abs(step) / model.scale[m:, None]) < 1e-6:
            break
    return out
