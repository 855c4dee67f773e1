"""Second moments of lagged columns without the lag matrix."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sksurrogate.kernels.gram import Moments


def lag_moments(
    runs: Sequence[np.ndarray], max_lag: int, targets: Sequence[np.ndarray] | None = None, chunk: int = 8192
) -> Moments:
    """Moments of the lag matrix of several runs without the matrix, by shift recursion.

    Row t of the lag matrix is ``[z(t), z(t-1), ..., z(t-max_lag), y(t)]``. The products of two lags obey
    ``G[i+1, j+1] = G[i, j] + z(p-1-i) z(p-1-j)^T - z(n-1-i) z(n-1-j)^T`` within a run (p = max_lag): only the first row
    of blocks is summed over the data. Rows whose past would reach into another run are not counted.

    ``runs`` sequence of (n_steps, n_channels): runs with no more than ``max_lag`` rows contribute nothing.
    ``targets`` sequence of (n_steps, n_outputs): further columns that are not lagged.
    ``chunk``: rows at a time.
    Returns Moments: column ``i * n_channels + c`` is channel c at lag i; the targets stand to the right.
    """
    m, p = runs[0].shape[1], max_lag
    q = 0 if targets is None else targets[0].shape[1]
    moments = Moments.zeros((p + 1) * m + q)
    for r, run in enumerate(runs):
        n = len(run)
        if n <= p:
            continue
        parts = [run] if targets is None else [run, targets[r]]
        # about roughly the mean of the run: no digits lost on large offsets
        centre = np.concatenate([part[:: max(1, n // 4096)].mean(axis=0) for part in parts])
        sums, first = _first_lags(parts, centre, p, chunk)
        lagged, G = _shifted(run, centre[:m], sums[:m], first[:, :m])
        scatter = np.empty((len(moments.mean),) * 2)
        k = (p + 1) * m
        scatter[:k, :k] = G.transpose(0, 2, 1, 3).reshape(k, k)
        scatter[k:, :k] = first[:, m:, :m].transpose(1, 0, 2).reshape(q, k)
        scatter[:k, k:], scatter[k:, k:] = scatter[k:, :k].T, first[0, m:, m:]
        mean = np.concatenate([lagged.ravel(), sums[m:]]) / (n - p)
        offset = np.concatenate([np.tile(centre[:m], p + 1), centre[m:]])
        moments._merge(n - p, float(n - p), mean + offset, scatter - (n - p) * np.outer(mean, mean))
    return moments


def _first_lags(parts: list[np.ndarray], centre: np.ndarray, p: int, chunk: int) -> tuple[np.ndarray, np.ndarray]:
    """Sums of all channels at lag 0, and of channel c at lag 0 times channel e at lag k as (p+1, c, e)."""
    n, m, total = len(parts[0]), parts[0].shape[1], len(centre)
    first, sums = np.zeros((p + 1, total, total)), np.zeros(total)
    for a in range(p, n, chunk):
        b = min(a + chunk, n)
        piece = np.empty((total, b - a + p))
        piece[:m] = parts[0][a - p : b].T
        for part in parts[1:]:
            piece[m:] = part[a - p : b].T
        piece -= centre[:, None]
        now = piece[:, p:]
        sums += now.sum(axis=1)
        first[0, m:, m:] += now[m:] @ now[m:].T
        for e in range(m):
            for c in range(total):
                # np.correlate slides over the p + 1 shifts in C: shift p is lag 0
                first[:, c, e] += np.correlate(piece[e], now[c], mode="valid")[::-1]
    return sums, first


def _shifted(run: np.ndarray, centre: np.ndarray, sums: np.ndarray, first: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sums (p+1, m) of the lagged channels and of their products (p+1, p+1, m, m), from those of lag 0."""
    p, m, n = len(first) - 1, len(centre), len(run)
    head = run[:p][::-1] - centre
    tail = run[n - p :][::-1] - centre
    G = np.empty((p + 1, p + 1, m, m))
    for k in range(p + 1):
        steps = head[: p - k, :, None] * head[k:, None, :] - tail[: p - k, :, None] * tail[k:, None, :]
        along = first[k, :, :m] + np.concatenate([np.zeros((1, m, m)), np.cumsum(steps, axis=0)])
        index = np.arange(p + 1 - k)
        G[index, index + k] = along
        G[index + k, index] = along.transpose(0, 2, 1)
    return sums + np.concatenate([np.zeros((1, m)), np.cumsum(head - tail, axis=0)]), G
