"""A signal without its white noise: one that is held at levels, one that moves smoothly."""

from __future__ import annotations

import numpy as np
from scipy.fft import dct, idct

#: Strengths that a smooth path chooses from: from no smoothing to one line over 10^4 samples, half a decade apart.
STRENGTHS = np.logspace(-2, 16, 37)


def held_levels(u: np.ndarray) -> np.ndarray:
    """The piecewise constant signal that a noisy one is likeliest to be: least squares with a price of ``2 ln n`` a level.

    Optimal partitioning by dynamic programming, pruned (Killick, Fearnhead and Eckley 2012). The price is Schwarz's for
    a level and its place. The noise comes from the median of the differences, which levels that change at fewer than half of
    the samples do not reach. Levels that change with one period have no places of their own: where that is likelier, also
    those that differ by less than the price of a place are kept apart.

    ``u`` (n_samples,).
    Returns (n_samples,): ``u`` itself where its differences show no noise.

    >>> u = np.repeat([0.0, 1.0], 50) + 0.1 * np.random.default_rng(1).normal(size=100)
    >>> levels = held_levels(u)
    >>> len(np.unique(levels)), bool(levels[49] < 0.1 < 0.9 < levels[50])
    (2, True)
    """
    sd = 1.4826 * float(np.median(np.abs(np.diff(u)))) / np.sqrt(2) if len(u) > 1 else 0.0
    if sd == 0.0:
        return u.copy()
    first = _levels(u, sd)
    # The median is off by a tenth for a hundred samples; what the levels leave is not.
    sd = float(np.sqrt(np.sum((u - first) ** 2) / max(len(u) - 2 * len(np.unique(first)), 1)))
    if sd == 0.0:
        return first
    free = _levels(u, sd)
    sizes = np.diff(np.r_[0, np.flatnonzero(np.diff(free)) + 1, len(u)])
    price = float(np.sum(((u - free) / sd) ** 2)) + 2.0 * len(sizes) * np.log(len(u))
    found = [(price, free), *(_periodic_levels(u, sd, period) for period in np.unique(sizes[sizes > 1]))]
    return min(found, key=lambda one: one[0])[1]


def _periodic_levels(u: np.ndarray, sd: float, period: int) -> tuple[float, np.ndarray]:
    """Levels that change every so many rows, first where that is likeliest, and their misfit with its price.

    The price is ``ln n`` a level, and as much for the period and for its place.

    >>> price, levels = _periodic_levels(np.array([5.0, 1.0, 3.0, 0.0, 0.0, 7.0]), 1.0, 2)
    >>> levels.round(9) + 0.0
    array([5., 2., 2., 0., 0., 7.])
    """
    n, z, begin = len(u), (u - u.mean()) / sd, np.arange(period)
    total = np.r_[0.0, np.cumsum(z)]
    whole = (n - begin) // period  # levels that are not cut off by an end of the signal
    end = begin + period * whole
    explained = (
        np.bincount(np.arange(n - period + 1) % period, (total[period:] - total[:-period]) ** 2, period) / period
    )
    explained += total[begin] ** 2 / np.maximum(begin, 1) + (total[n] - total[end]) ** 2 / np.maximum(n - end, 1)
    price = (2 + whole + (begin > 0) + (end < n)) * np.log(n) - explained
    edges = np.unique(np.r_[0, np.arange(np.argmin(price), n, period), n])
    levels = u.mean() + sd * np.diff(total[edges]) / np.diff(edges)
    return float(np.min(price) + np.sum(z**2)), np.repeat(levels, np.diff(edges))


def _levels(u: np.ndarray, sd: float) -> np.ndarray:
    """The same for a known deviation of the noise."""
    n, z = len(u), (u - u.mean()) / sd
    total, square = np.r_[0.0, np.cumsum(z)], np.r_[0.0, np.cumsum(z**2)]
    price = 2.0 * np.log(n)
    best, begins, firsts = np.full(n + 1, -price), np.zeros(n + 1, dtype=int), np.array([0])
    for stop in range(1, n + 1):
        misfit = square[stop] - square[firsts] - (total[stop] - total[firsts]) ** 2 / (stop - firsts)
        cost = best[firsts] + misfit
        k = int(np.argmin(cost))
        best[stop], begins[stop] = cost[k] + price, firsts[k]
        firsts = np.r_[firsts[cost <= best[stop]], stop]
    out, stop = np.empty(n), n
    while stop:
        out[begins[stop] : stop] = u[begins[stop] : stop].mean()
        stop = int(begins[stop])
    return out


def smooth_path(u: np.ndarray) -> np.ndarray:
    """The smooth signal behind a noisy one: squares of second differences are penalised, as much as cross-validation says.

    Generalised cross-validation through the cosine transform (Garcia 2010).

    ``u`` (n_samples,).
    Returns (n_samples,).

    >>> t = np.linspace(0, 6, 400)
    >>> noisy = np.sin(t) + 0.3 * np.random.default_rng(0).normal(size=400)
    >>> bool(np.std(smooth_path(noisy) - np.sin(t)) < 0.06)
    True
    """
    n, waves = len(u), dct(u, norm="ortho")
    passed = 1.0 / (1.0 + np.outer(STRENGTHS, (2.0 - 2.0 * np.cos(np.pi * np.arange(n) / n)) ** 2))
    missed = np.sum(((1.0 - passed) * waves) ** 2, axis=1)
    free = n - passed.sum(axis=1)
    scores = np.divide(missed, free**2, out=np.full(len(free), np.inf), where=free > 1e-3)
    return np.asarray(idct(passed[int(np.argmin(scores))] * waves, norm="ortho"))
