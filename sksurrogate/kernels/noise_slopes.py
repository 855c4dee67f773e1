"""Slopes of the likelihood of a residual in its noise parameters, from the moments of the states given the residual.

By Fisher's identity the slope is the mean, over the states given the residual, of the slope of their joint density: it needs
how they vary at one sample, and every coloured noise from one sample to the next. The posterior precision is block
tridiagonal: its Cholesky factor holds what a sample learns from those before, one started at the other end what it learns from
those after, and both together are the precision of its states (a twisted factorisation). The time of two factors gives
all slopes.

References
----------
Meurant, *A review on the inverse of symmetric tridiagonal and block tridiagonal matrices*, SIAM J. Matrix Anal. Appl. 13
(1992).
"""

from __future__ import annotations

import numpy as np
from scipy.linalg.lapack import dpbtrf

from sksurrogate.kernels.disturbance import Disturbance, Noise

#: Share of its own row of the precision that is known of a state at least: differences of rows round to that.
KNOWN = 1e-13


def noise_slopes(model: Disturbance, r: np.ndarray, noise: Noise, factor: np.ndarray) -> np.ndarray:
    """Slopes of the negative log likelihood in the logarithms of the noise parameters.

    ``r`` (n_outputs, n_samples): residual.
    ``factor``: :meth:`Disturbance.factor` of this noise.
    Returns ndarray: in the order of :meth:`Noise.pack`.
    """
    n, b = model.n, model.b
    mean = model.mean(r, noise, factor)
    now, ahead = _covariances(model, noise, factor)
    spread, a, _ = model.chains(noise)
    chains, pairs = mean[n:], np.sum(model.inner)
    square = np.einsum("iit->it", now[n:, n:]) + chains**2
    product = ahead + chains[:, :-1] * chains[:, 1:]
    first, before, after = np.sum(square[:, model.starts], axis=1), square @ model.inner, square @ model.later
    between = product @ model.inner[:-1]
    # A chain's own density: w0^2 / s^2 + sum (w' - a w)^2 / (s^2 (1 - a^2)), with the determinant.
    steps, rest = after - 2.0 * a * between + a**2 * before, 1.0 - a**2
    sizes = model.n_samples - (first + steps / rest) / spread**2
    by_a = (a * steps / rest**2 - (between - a * before) / rest) / spread**2 - pairs * a / rest
    tau = np.repeat([noise.tau, noise.tau_sensor], [b, model.m])
    taus = by_a * a / tau
    white = model.counts.sum(axis=0) - _misses(model, model.at_measured(r), mean, now) / noise.sigma**2
    return np.r_[white, sizes[:b], np.sum(taus[:b]), sizes[b:], np.sum(taus[b:])]


def _misses(model: Disturbance, r: np.ndarray, mean: np.ndarray, now: np.ndarray) -> np.ndarray:
    """Mean square of the white noise of every output given the residual, summed over the samples, (n_outputs,)."""
    out = np.empty(model.m)
    for j, seen in enumerate(model.seen):
        rows = np.r_[seen, model.n + model.b + j]
        weights = np.concatenate([model.C[:, j, seen].T, model.weight_of(j)[None]])
        e = r[j] - np.einsum("it,it->t", weights, mean[rows])
        out[j] = e @ e + np.einsum("it,ikt,kt->", weights, now[np.ix_(rows, rows)], weights)
    return out


def _covariances(model: Disturbance, noise: Noise, factor: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Of all components at one sample (size, size, n_samples), of every chain with its next value (n_chains, n_samples - 1)."""
    n, size = model.n, model.size
    band = model.precision(noise).reshape(-1, size + n)
    before = _by_sample(factor, size)
    after = _by_sample(_factor_from_the_end(band), size)[:, :, ::-1]
    # What is known from before, its own readings included, less what passes through the coupling to the next sample.
    P = np.zeros((size, size, model.n_samples))
    for j in range(size):
        column = before[j, : size - j]
        _add_product(P[j:, j:], column, column)
    for j in range(size):  # rows of the factor from the end count from the last component
        k = min(size, n + j)
        column = after[j, size - j : size - j + k, 1:][::-1]
        _add_product(P[size - k :, size - k :, :-1], -column, column)
    P[np.arange(size), np.arange(size)] += KNOWN * band[:, 0].reshape(-1, size).T
    now = _inverses(P)
    return now, np.array([-_with_next(before, now, c, n) for c in range(n, size)])


def _factor_from_the_end(band: np.ndarray) -> np.ndarray:
    """Banded Cholesky factor of a band (n_rows, width) taken from the last row to the first."""
    turned = np.zeros_like(band)
    for d in range(band.shape[1]):
        turned[: len(band) - d, d] = band[: len(band) - d, d][::-1]
    factor, info = dpbtrf(turned.T, lower=1, overwrite_ab=1)
    if info != 0:
        raise np.linalg.LinAlgError("the posterior precision is not positive definite")
    return factor


def _by_sample(factor: np.ndarray, size: int) -> np.ndarray:
    """A banded factor with the samples last: entry ``[j, d]`` of component j and what stands d behind it."""
    return np.ascontiguousarray(factor.T.reshape(-1, size, len(factor)).transpose(1, 2, 0))


def _add_product(P: np.ndarray, a: np.ndarray, c: np.ndarray) -> None:
    """``P += a c'`` on and below the diagonal, all samples at once; row by row it stays in the processor's cache."""
    for i in range(len(a)):
        P[i, : i + 1] += a[i] * c[: i + 1]


def _inverses(P: np.ndarray) -> np.ndarray:
    """Inverses of positive definite matrices (size, size, n), given on and below the diagonal; in place, by sweeps."""
    size = len(P)
    for k in range(size):
        column = np.concatenate([P[k, : k + 1], P[k + 1 :, k]])
        pivot = 1.0 / P[k, k]
        scaled = column * pivot
        _add_product(P, -scaled, column)
        P[k, :k], P[k:, k] = scaled[:k], scaled[k:]
        P[k, k] = -pivot
    for i in range(size):
        P[i, : i + 1] *= -1.0
        P[:i, i] = P[i, :i]
    return P


def _with_next(before: np.ndarray, now: np.ndarray, c: int, n: int) -> np.ndarray:
    """Minus the covariance of component c with itself at the next sample (n_samples - 1,): ``L^-T L_next' now_next``."""
    size = len(now)
    solved: dict[int, np.ndarray] = {}
    for i in reversed(range(c, size)):
        k = min(size, n + i)
        x = np.einsum("kt,kt->t", before[i, size - i : size - i + k, :-1], now[:k, c, 1:])
        for j, other in solved.items():
            x -= before[i, j - i, :-1] * other
        solved[i] = x / before[i, 0, :-1]
    return solved[c]
