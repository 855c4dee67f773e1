"""Free runs whose samples have substeps of their own: many where a jump is crossed, few elsewhere."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from sksurrogate.kernels.integrate import DIFFERENCE, moved_one_by_one, rk4
from sksurrogate.kernels.windows import run_in_windows

#: Largest error of a sample, relative to the size of each state: a tenth of what a run in equal substeps may have, since jumps add up.
LARGEST_ERROR = 1e-9
#: Most substeps of a sample.
MOST_SUBSTEPS = 1024
#: Largest mean number of substeps of a sample: a plant that asks for more is stiff throughout.
MOST_ON_AVERAGE = 48.0
#: Choices of the substeps before the plant counts as stiff.
MOST_PASSES = 8

Derivative = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]


class _Samples:
    """The samples of runs of equal length one behind the other, and the Runge-Kutta map from each to the next.

    ``U`` (n_runs, n_samples, n_inputs), ``t`` (n_samples,), ``widths`` (n_samples,): s to the next sample, ``order`` {0, 1}: hold.
    """

    def __init__(self, derivative: Derivative, U: np.ndarray, t: np.ndarray, widths: np.ndarray, order: int) -> None:
        n_runs, _, n_inputs = U.shape
        self.derivative = derivative
        self.times, self.widths = np.tile(t, n_runs), np.tile(widths, n_runs)
        self.inputs = U.reshape(-1, n_inputs).T
        following = np.concatenate([U[:, 1:], U[:, -1:]], axis=1).reshape(-1, n_inputs).T
        self.rises = following - self.inputs if order == 1 else None

    def after(self, x: np.ndarray, rows: np.ndarray, counts: np.ndarray) -> np.ndarray:
        """The states one sample after these rows, ``x`` (n_states, n_columns, n_rows), in ``counts`` (n_rows,) substeps."""
        out = np.empty_like(x)
        for n_sub in np.unique(counts):
            at = np.flatnonzero(counts == n_sub)
            out[..., at] = self._alike(x[..., at], rows[at], int(n_sub))
        return out

    def _alike(self, x: np.ndarray, rows: np.ndarray, n_sub: int) -> np.ndarray:
        """The same for rows with one number of substeps."""
        shape = (n_sub, len(self.inputs), *x.shape[1:])
        mean, half = self.inputs[:, None, rows], None
        if self.rises is not None:
            rise = self.rises[:, None, rows] / n_sub
            mean = mean + (np.arange(n_sub) + 0.5)[:, None, None, None] * rise
            half = np.broadcast_to(rise / 2, shape)
        t = np.broadcast_to(self.times[rows], x.shape[1:])
        return rk4(self.derivative, t, x, np.broadcast_to(mean, shape), half, self.widths[rows] / n_sub)


def run_with_own_substeps(
    derivative: Derivative,
    U: np.ndarray,
    X0: np.ndarray,
    t: np.ndarray,
    widths: np.ndarray,
    *,
    order: int,
    near: np.ndarray,
) -> np.ndarray | None:
    """States (n_runs, n_samples, n_states) of runs of equal length; None where the plant is stiff nearly everywhere, or diverges.

    Every sample has 2, 4, 8, ... substeps: as many as keep its own error, against twice as many, below :data:`LARGEST_ERROR`.

    ``derivative`` (t, x, u) -> dx/dt on arrays (n, *s), ``U`` (n_runs, n_samples, n_inputs), ``X0`` (n_runs, n_states),
        ``t`` (n_samples,).
    ``widths`` (n_samples,): s from every sample to the next.
    ``order`` {0, 1}: hold.
    ``near`` (n_runs, n_samples, n_states): a run near this one, where the substeps are chosen first and Newton's method begins.
    """
    n_runs, n_samples, n_states = near.shape
    samples = _Samples(derivative, U, t, widths, order)
    every = np.arange(n_runs * n_samples)
    size = np.where(np.abs(X0) > 0, np.abs(X0), 1.0).max(axis=0)
    counts, x = np.full(len(every), 2), near.reshape(-1, n_states).T
    for _ in range(MOST_PASSES):
        more = _more_substeps(samples, x, every, counts)
        if more is None or more.mean() > MOST_ON_AVERAGE:
            return None
        if np.array_equal(more, counts):
            return x.T.reshape(near.shape)
        counts = more

        def step(z: np.ndarray, rows: np.ndarray, counts: np.ndarray = counts) -> np.ndarray:
            return samples.after(z, rows, counts[rows])

        x = run_in_windows(step, X0.T, n_samples * np.arange(n_runs), np.full(n_runs, n_samples), size, x)
    return None


def _more_substeps(samples: _Samples, x: np.ndarray, rows: np.ndarray, counts: np.ndarray) -> np.ndarray | None:
    """Substeps (n_rows,) of the samples along states ``x`` (n_states, n_rows): doubled until each keeps its error; None where x diverges.

    Points beside the states keep it too: where a plant rests, every step is exact, and long ones lead away from there.
    """
    if not np.all(np.isfinite(x)):
        return None
    counts, at = counts.copy(), rows
    scale = np.maximum(np.max(np.abs(x), axis=1), 1e-12)
    beside = moved_one_by_one(x, DIFFERENCE * scale)
    once = samples.after(beside, at, counts[at])
    while len(at):
        twice = samples.after(beside[..., at], at, 2 * counts[at])
        error = np.max(np.abs(once - twice) / scale[:, None, None], axis=(0, 1))
        wanting = ~(error <= LARGEST_ERROR) & (counts[at] < MOST_SUBSTEPS)
        at, once = at[wanting], twice[..., wanting]
        counts[at] *= 2
    return counts
