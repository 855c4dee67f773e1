"""Inputs that excite a simulator within given limits."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

__all__ = ["SHORTEST_HOLD", "excitation"]

#: Samples that a step is held at least; a line of a multisine has at least twice as many a period.
SHORTEST_HOLD = 4
#: Lines of a multisine, spread evenly over the logarithm of the frequency.
LINES = 12
#: Amplitudes of the runs in turn, over the range: large ones show limits, small ones dry friction and dead zones.
AMPLITUDES = (1.0, 0.5, 0.2)


def steps(rng: np.random.Generator, n: int) -> np.ndarray:
    """Levels between 0 and 1, held for times that are spread evenly over their logarithm."""
    longest = max(n // 4, SHORTEST_HOLD + 1)
    out: list[np.ndarray] = []
    while sum(map(len, out)) < n:
        held = int(np.exp(rng.uniform(np.log(SHORTEST_HOLD), np.log(longest))))
        out.append(np.full(held, rng.uniform()))
    return np.concatenate(out)[:n]


def multisine(rng: np.random.Generator, n: int) -> np.ndarray:
    """Sines of random phases between 0 and 1, from one period in a run to :data:`SHORTEST_HOLD` samples a half."""
    fastest = max(n / (2 * SHORTEST_HOLD), 2.0)
    periods = np.geomspace(1.0, fastest, LINES)
    t = np.arange(n) / n
    wave = np.sin(2 * np.pi * np.outer(periods, t) + rng.uniform(0, 2 * np.pi, (LINES, 1))).sum(axis=0)
    return (wave - wave.min()) / max(float(np.ptp(wave)), 1e-300)


def excitation(
    limits: Sequence[tuple[float, float]], n_runs: int, n_samples: int, rng: np.random.Generator
) -> np.ndarray:
    """Runs of steps and of multisines in turn, at three amplitudes, within limits.

    Parameters
    ----------
    limits : sequence of (low, high)
        Of every input.
    n_runs, n_samples : int
    rng : Generator

    Returns
    -------
    ndarray (n_runs, n_samples, n_inputs)

    Examples
    --------
    >>> U = excitation([(-1.0, 2.0)], 4, 50, np.random.default_rng(0))
    >>> U.shape, bool(U.min() >= -1.0 and U.max() <= 2.0)
    ((4, 50, 1), True)
    """
    out = np.empty((n_runs, n_samples, len(limits)))
    for run in range(n_runs):
        shape, size = (steps, multisine)[run % 2], AMPLITUDES[(run // 2) % len(AMPLITUDES)]
        for i, (low, high) in enumerate(limits):
            middle = rng.uniform(size / 2, 1 - size / 2)
            out[run, :, i] = low + (high - low) * (middle + size * (shape(rng, n_samples) - 0.5))
    return out
