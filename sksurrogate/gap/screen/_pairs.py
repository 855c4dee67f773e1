"""Pairs of effects that together leave least, by the Gram of one linearisation: two that hide each other are seen."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sksurrogate.gap.screen._screen import Screen, Start, grown, grows

__all__ = ["best_pairs"]

#: Pairs with one effect in common.
MOST_WITH_ONE = 3
#: Columns closer than this (cosine) are one column.
COLLINEAR = 0.9999


def best_pairs(screen: Screen, most: int) -> list[tuple[Start, Start]]:
    """The pairs of effects whose columns together remove most of the residual, each pair at its best starting values.

    Parameters
    ----------
    screen : Screen
    most : int
        Number of pairs.

    Returns
    -------
    list of (Start, Start)
        Best first; no effect stands in more than :data:`MOST_WITH_ONE` of them.
    """
    keys = list(dict.fromkeys(start.effect.key for start in screen.starts))
    if len(keys) < 2 or screen.columns is None:
        return []
    drop, a, b = _joint(screen)
    owner = np.array([keys.index(start.effect.key) for start in screen.starts])
    best = np.full((len(keys), len(keys)), -np.inf)
    np.maximum.at(best, (owner[:, None], owner[None, :]), drop)
    rows, columns = np.triu_indices(len(keys), 1)
    order = np.argsort(-best[rows, columns], kind="stable")
    used = np.zeros(len(keys), int)
    out: list[tuple[Start, Start]] = []
    for i, j in zip(rows[order], columns[order]):
        if len(out) == most or not np.isfinite(best[i, j]):
            break
        if max(used[i], used[j]) >= MOST_WITH_ONE:
            continue
        used[[i, j]] += 1
        mine, other = np.flatnonzero(owner == i), np.flatnonzero(owner == j)
        p, q = np.unravel_index(np.argmax(drop[np.ix_(mine, other)]), (len(mine), len(other)))
        k, m = mine[p], other[q]
        out.append((_at(screen, k, a[k, m]), _at(screen, m, b[k, m])))
    return out


def _joint(screen: Screen) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Drop of every pair of columns and their amplitudes, each (n_starts, n_starts)."""
    G = screen.gram()
    g, H = G[0, 1:], G[1:, 1:]
    h = np.maximum(np.diag(H), 1e-300)
    low, high = screen.low, screen.high
    with np.errstate(all="ignore"):
        cosine = H / np.sqrt(np.outer(h, h))
        det = np.outer(h, h) * np.maximum(1.0 - cosine**2, 1e-12)
        a = np.clip((g[:, None] * h[None, :] - H * g[None, :]) / det, low[:, None], high[:, None])
        b = np.clip((g[None, :] - H * a) / h[None, :], low[None, :], high[None, :])
        a = np.clip((g[:, None] - H * b) / h[:, None], low[:, None], high[:, None])
        drop = 2 * (a * g[:, None] + b * g[None, :]) - a**2 * h[:, None] - 2 * a * b * H - b**2 * h[None, :]
    drop = np.where((np.abs(cosine) < COLLINEAR) & np.isfinite(drop), drop, -np.inf)
    return drop, a, b


def _at(screen: Screen, k: int, amplitude: float) -> Start:
    """The start of one column with the amplitude that it has in the pair."""
    start, theta = screen.starts[k], screen.raw[k].copy()
    if len(theta) and (grows(start.effect) or amplitude < 0.5):
        theta = grown(start.effect, theta, amplitude)
    return replace(start, theta=theta)
