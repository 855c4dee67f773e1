"""Derivatives without differentiation: test functions over windows carry the derivative over to themselves.

For a test function with ``phi = 0`` at both ends of a window, ``int phi dy/dt dt = -int phi' y dt``, so that

    int phi f(y, u) dt = -int phi' y dt

is an equation in f that holds without a derivative of the (noisy) y.
"""

from __future__ import annotations

import numpy as np

from sksurrogate.runs import Runs


class WeakForm:
    """The integrals over windows of ``width`` sample intervals, one window wherever it fits into the run.

    ``phi`` is a staircase over the intervals with the values of ``(1 - s^2)^2`` on s in [-1, 1], scaled to sum 1, so
    that the left-hand side is a sum of differences of y, without error. Integrals of f over an interval go by the
    trapezoidal rule with the input that acts there: held inputs jump at the samples, and f with them.

    ``runs``: with y.
    ``width``: intervals of a window; a shorter run has one window.
    ``held``: inputs are held from sample to sample; otherwise joined linearly.
    ``points`` (n_points, n_outputs + n_inputs): (y, u) at the left and the right end of every interval.
    ``centres`` (n_windows, n_outputs + n_inputs): means of (y, u) under phi.
    ``targets`` (n_windows, n_outputs): ``-int phi' y dt``: the mean of dy/dt under phi.
    ``weights`` (n_windows,): what a window says by itself: 1 over the sum of the correlations with all windows that it
        overlaps.
    """

    def __init__(self, runs: Runs, width: int, held: bool):
        self._runs, points, targets, weights = [], [], [], []
        for run in runs:
            assert run.y is not None
            intervals = len(run) - 1
            w = min(width, intervals)
            middle = (2 * np.arange(w) + 1) / w - 1
            share = (1 - middle**2) ** 2
            share /= share.sum()
            step = np.diff(run.t)[:, None]
            slopes = np.diff(run.y, axis=0) / step
            targets.append(_slide(slopes, share))
            after = run.X[:-1] if held else run.X[1:]
            points.append(np.concatenate([run.y[:-1], run.X[:-1]], axis=1))
            points.append(np.concatenate([run.y[1:], after], axis=1))
            self._runs.append((intervals, share))
            weights.append(np.full(len(targets[-1]), np.sum(share**2)))  # sum of phi's autocorrelation: (sum phi)^2
        self.weights = np.concatenate(weights)
        self.points, self.targets = np.concatenate(points), np.concatenate(targets)
        self.centres = self.mean(self.points)

    def mean(self, values: np.ndarray) -> np.ndarray:
        """Integrals with phi of something given at ``points``, (n_windows, n_columns)."""
        out, place = [], 0
        for intervals, share in self._runs:
            a, b = values[place : place + intervals], values[place + intervals : place + 2 * intervals]
            out.append(_slide(0.5 * (a + b), share))
            place += 2 * intervals
        return np.concatenate(out)


def _slide(values: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Weighted sums over every window of consecutive rows."""
    windows = np.lib.stride_tricks.sliding_window_view(values, len(weights), axis=0)
    return windows @ weights
