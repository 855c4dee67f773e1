"""Long free runs of fitted derivatives by Newton's method over many samples at a time, and the part of long records that is run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sksurrogate.kernels.integrate import Derivative, rk4
from sksurrogate.kernels.signals import hold
from sksurrogate.kernels.windows import run_in_windows
from sksurrogate.runs import Runs


def long_runs(
    slopes: Derivative,
    inputs: Sequence[np.ndarray],
    times: Sequence[np.ndarray],
    first: np.ndarray,
    order: int,
    n_sub: int,
    size: np.ndarray,
) -> list[np.ndarray]:
    """Free runs of any lengths, window by window.

    ``slopes`` (t, x, u) -> dx/dt on arrays (n, *s), ``inputs, times`` sequence of (n_samples, n_inputs) and
        (n_samples,), ``first`` (n_runs, n_states).
    ``order`` {0, 1}: hold.
    ``n_sub``: substeps per sample.
    ``size`` (n_states,): size of every state.
    Returns list of (n_samples, n_states): nan from where a run has diverged.
    """
    lengths = np.array([len(U) for U in inputs])
    starts = np.r_[0, np.cumsum(lengths[:-1])]
    mean, half = np.zeros((n_sub, 0, 1, int(lengths.sum()))), None
    signals = [hold(column, n_sub, order, starts) for column in np.concatenate(inputs).T]
    if signals:
        mean = np.stack([signal.mean for signal in signals], axis=1)
        half = np.stack([signal.half for signal in signals if signal.half is not None], axis=1) if order else None
    widths = np.concatenate([np.diff(t, append=t[-1] + 1.0) for t in times]) / n_sub

    def step(x: np.ndarray, rows: np.ndarray) -> np.ndarray:
        ends = None if half is None else half[..., rows]
        return rk4(slopes, np.zeros(len(rows)), x, mean[..., rows], ends, widths[rows])

    with np.errstate(all="ignore"):
        x = run_in_windows(step, np.asarray(first, dtype=float).T, starts, lengths, size)
    return [x[:, a : a + n].T for a, n in zip(starts, lengths)]


def watched(runs: Runs, most: int) -> Runs:
    """Runs spread evenly over all with at most ``most`` rows together, or the first rows of a long one."""
    total = sum(len(run) for run in runs)
    if total <= most:
        return runs
    n = max(len(runs) * most // total, 1)
    length, chosen = most // n, [runs[k] for k in np.linspace(0, len(runs) - 1, n).astype(int)]
    cut = (
        replace(run, stop=min(run.stop, run.start + length), X=run.X[:length], y=run.y[:length], t=run.t[:length])
        for run in chosen
    )
    return replace(runs, runs=tuple(cut))
