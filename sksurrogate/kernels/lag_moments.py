"""Linear models of lagged columns without their lag matrix: the Gram of lags by shift recursion."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve

__all__ = ["lag_gram", "solve_lags"]

#: Samples that are worked on at once, so that they stay in the cache.
BLOCK = 8192

#: Above this condition number of the scaled Gram its solution has lost half of the digits.
WORST = 1e13


def lag_gram(
    runs: Sequence[np.ndarray], terms: Sequence[tuple[int, int]], n_first: int, mean: np.ndarray
) -> tuple[int, np.ndarray, np.ndarray]:
    """Sums and inner products of lagged columns, rows ``n_first`` and later of every run.

    With ``G[(c, i), (d, j)] = sum_t z_c[t - i] z_d[t - j]`` only ``i = 0`` or ``j = 0`` are summed over the data; the
    others follow by ``G[(c, i + 1), (d, j + 1)] = G[(c, i), (d, j)]`` plus the product that comes in at the start of the
    run, minus the one that goes out at its end.

    Parameters
    ----------
    runs : sequence of ndarray (n_samples, n_channels)
    terms : sequence of (int, int)
        Channel and lag of every column.
    n_first : int
        At least the longest lag.
    mean : ndarray (n_channels,)
        Taken off every channel.

    Returns
    -------
    n_rows : int
    sums : ndarray (n_terms,)
    gram : ndarray (n_terms, n_terms)
    """
    longest, c = max(lag for _, lag in terms), len(mean)
    n_rows, sums, gram = 0, np.zeros((longest + 1, c)), np.zeros((longest + 1, c, longest + 1, c))
    for values in runs:
        n_rows += len(values) - n_first
        head = values[n_first - longest : n_first] - mean  # what the lags of the first rows see
        last = values[len(values) - longest :] - mean
        ahead, total = _first_row(values, longest, n_first, mean)
        G = np.empty_like(gram)
        G[0] = ahead.transpose(1, 0, 2)
        G[:, :, 0] = ahead.transpose(0, 2, 1)
        for i in range(longest):
            come, go = head[longest - 1 - i], last[longest - 1 - i]
            others_in, others_out = head[::-1], last[::-1]
            step = come[:, None, None] * others_in[None] - go[:, None, None] * others_out[None]
            G[i + 1, :, 1:] = G[i, :, :-1] + step
            sums[i] += total
            total = total + come - go
        sums[longest] += total
        gram += G
    channels, lags = np.array([k for k, _ in terms]), np.array([k for _, k in terms])
    picked = gram[lags[:, None], channels[:, None], lags[None], channels[None]]
    return n_rows, sums[lags, channels], picked


def _first_row(values: np.ndarray, longest: int, n_first: int, mean: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """``sum_t z_c[t] z_d[t - j]`` as (longest + 1, n_channels, n_channels), and the sums of z."""
    c = values.shape[1]
    found, total = np.zeros((longest + 1, c, c)), np.zeros(c)
    for start in range(n_first, len(values), BLOCK):
        block = np.ascontiguousarray((values[start - longest : start + BLOCK] - mean).T)
        now = block[:, longest:]
        total += now.sum(axis=1)
        for a in range(c):
            for b in range(c):
                found[:, a, b] += np.correlate(block[b], now[a], "valid")[::-1]
    return found, total


def solve_lags(
    n_rows: int, sums: np.ndarray, gram: np.ndarray, n_targets: int, alpha: float, intercept: bool
) -> tuple[np.ndarray, np.ndarray, float] | None:
    """Least squares or ridge from :func:`lag_gram`, whose last columns are the targets.

    Returns
    -------
    coef : ndarray (n_features, n_targets)
    offset : ndarray (n_targets,)
        Intercept in numbers without their mean.
    squares : float
        Sum of squared errors.
    None where the columns are too nearly dependent for a Gram.
    """
    if intercept:
        gram = gram - np.outer(sums, sums) / n_rows
    size = np.sqrt(np.diag(gram))
    if not np.all(size > 0):
        return None
    p = len(sums) - n_targets
    S = gram / np.outer(size, size)
    H = S[:p, :p] + np.diag(alpha / size[:p] ** 2)
    if np.linalg.cond(H) > WORST:
        return None
    try:
        scaled = cho_solve(cho_factor(H), S[:p, p:])
    except LinAlgError:
        return None
    coef = scaled * size[p:] / size[:p, None]
    offset = (sums[p:] - sums[:p] @ coef) / n_rows if intercept else np.zeros(n_targets)
    both = np.concatenate([-coef, np.eye(n_targets)])
    return coef, offset, float(max(np.trace(both.T @ gram @ both), 0.0))
