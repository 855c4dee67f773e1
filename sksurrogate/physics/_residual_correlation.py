"""Correlation of a residual in time: an autoregression by restricted likelihood, which allows for the fitted parameters."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.linalg import solve_toeplitz, toeplitz
from scipy.optimize import minimize, minimize_scalar

#: Longest autoregression.
_LONGEST = 20
#: Up to so many rows and so high an order the likelihood is restricted: beyond, the fitted
#: parameters hardly change it.
_MOST_ROWS, _MOST_ORDER = 20_000, 4
#: Partial autocorrelations come no nearer to 1, where the correlation would never end.
_NEAREST = 0.995
#: With so many rows for each column a white residual is believed to be one.
_PLENTY = 50


def residual_covariance(
    pieces: Sequence[np.ndarray], shared: Sequence[np.ndarray], own: Sequence[np.ndarray]
) -> np.ndarray | None:
    """Covariance of the noise in a residual at lags 0, 1, ...; None for white noise.

    The order is chosen by the criterion of Schwarz. Autocorrelations of the residual are too small where the fit is
    flexible or the record short, since the fit follows slow noise; the restricted likelihood, that of the residual's
    part which no parameter can move, is not misled (Harville, JASA 72 (1977) 320-338).

    ``pieces`` (n_samples,): residual of every run.
    ``shared`` (n_samples, k): slopes by the parameters.
    ``own`` (n_samples, m): slopes by what belongs to the run alone, its initial state.
    Returns (n_lags,).
    """
    n = sum(len(piece) for piece in pieces)
    most = min(_LONGEST, n // 20)
    power = sum(float(piece @ piece) for piece in pieces)
    if most < 1 or not power > 0:
        return None
    r = np.sum([np.correlate(np.r_[p, np.zeros(most)], p) for p in pieces], axis=0) / power  # at lags 0 .. most
    lags = min(20 * _LONGEST, n // 4)
    order = _order(r, n, most) if np.max(np.abs(r[1:])) >= 2.0 / np.sqrt(n) else 0
    if n > _MOST_ROWS or order > _MOST_ORDER:
        return None if order == 0 else power / n * _continued(solve_toeplitz(r[:order], r[1 : order + 1]), r, lags)
    if order == 0 and n > _PLENTY * (shared[0].shape[1] + sum(c.shape[1] for c in own)):
        return None
    shared, own = _independent(shared), [_independent([Z])[0] for Z in own]
    columns = sum(c.shape[1] for c in own) + shared[0].shape[1]
    if n < 3 * columns + 10 or (order == 0 and n > _PLENTY * columns):
        return None

    def cost(partial: np.ndarray) -> float:
        try:
            return _restricted(_coefficients(partial), pieces, shared, own)[0]
        except np.linalg.LinAlgError:  # a memory without end
            return np.inf

    if order < 2:
        found = minimize_scalar(lambda p: cost(np.array([p])), bounds=(-0.9, _NEAREST), method="bounded")
        if order == 0 and not cost(np.zeros(1)) - found.fun > 0.5 * np.log(n):
            return None
        a = np.array([found.x])
    else:
        start = np.arctanh(np.clip(_durbin(r, order)[0], -0.98, 0.98) / _NEAREST)
        best = minimize(
            lambda z: cost(_NEAREST * np.tanh(z)),
            start,
            method="Nelder-Mead",
            options={"maxfev": 60 * order, "xatol": 1e-3},
        )
        if not np.isfinite(best.fun):
            return power / n * _continued(solve_toeplitz(r[:order], r[1 : order + 1]), r, lags)
        a = _coefficients(_NEAREST * np.tanh(best.x))
    variance = _restricted(a, pieces, shared, own)[1]
    rho = _correlations(a)
    return variance / float(1.0 - a @ rho[1:]) * _continued(a, rho, lags)


def _durbin(r: np.ndarray, order: int) -> tuple[np.ndarray, np.ndarray]:
    """Partial autocorrelations (order,) and what every order leaves of the variance (order,), from autocorrelations ``r``.

    The recursion of Durbin and Levinson: each order's coefficients from those of the order before.
    """
    partial, left = np.zeros(order), np.zeros(order)
    a, rest, rho = np.zeros(0), 1.0, r[1 : order + 1]
    for p in range(order):
        value = (rho[p] - a @ rho[:p][::-1]) / rest
        a = _raised(a, value)
        rest = max(rest * (1.0 - value**2), 1e-12)
        partial[p], left[p] = value, rest
    return partial, left


def _order(r: np.ndarray, n: int, most: int) -> int:
    """Order of the autoregression with the best score, 0 for none."""
    left = _durbin(r, most)[1]
    scores = n * np.log(left) + np.arange(1, most + 1) * np.log(n)
    return int(np.argmin(scores)) + 1 if scores.min() < 0 else 0


def _raised(a: np.ndarray, value: float) -> np.ndarray:
    """Coefficients of the next order, whose last is ``value``."""
    out = np.empty(len(a) + 1)
    out[:-1] = a - value * a[::-1]
    out[-1] = value
    return out


def _coefficients(partial: np.ndarray) -> np.ndarray:
    """Coefficients of the stationary autoregression with these partial autocorrelations (Durbin and Levinson)."""
    a = np.zeros(0)
    for value in partial:
        a = _raised(a, value)
    return a


def _correlations(a: np.ndarray) -> np.ndarray:
    """Autocorrelation (p + 1,) of an autoregression, from the equations of Yule and Walker."""
    p = len(a)
    A, b = np.eye(p), np.zeros(p)
    for i in range(1, p + 1):
        for j in range(1, p + 1):
            lag = abs(i - j)
            if lag == 0:
                b[i - 1] += a[j - 1]
            else:
                A[i - 1, lag - 1] -= a[j - 1]
    return np.r_[1.0, np.linalg.solve(A, b)]


def _continued(a: np.ndarray, rho: np.ndarray, lags: int) -> np.ndarray:
    """Autocorrelation at lags 0 .. lags - 1."""
    p = len(a)
    out = np.zeros(max(lags, p + 1))
    out[: p + 1] = rho[: p + 1]
    for lag in range(p + 1, len(out)):
        out[lag] = a @ out[lag - p : lag][::-1]
    return out[:lags]


def _whitened(a: np.ndarray, rows: np.ndarray, first: np.ndarray) -> np.ndarray:
    """Rows of a run as those of white noise of the size of the innovations; ``first``: for its first p rows."""
    p = len(a)
    out = rows.copy()
    for j, value in enumerate(a, start=1):
        out[p:] -= value * rows[p - j : len(rows) - j]
    out[:p] = first @ rows[:p]
    return out


def _restricted(
    a: np.ndarray, pieces: Sequence[np.ndarray], shared: Sequence[np.ndarray], own: Sequence[np.ndarray]
) -> tuple[float, float]:
    """Minus the logarithm of the restricted likelihood, without constants, and the variance of the innovations."""
    rho, p = _correlations(a), len(a)
    size = max(float(1.0 - a @ rho[1:]), 1e-12)
    factor = np.linalg.cholesky(toeplitz(rho[:p]) / size + 1e-12 * np.eye(p))
    first = np.linalg.inv(factor)
    logs, freedom, rest = 0.0, 0, []
    for e, X, Z in zip(pieces, shared, own):
        if len(e) <= p:
            continue
        logs += float(np.sum(np.log(np.diag(factor))))
        both = _whitened(a, np.column_stack([Z, X, e]), first)
        m = Z.shape[1]
        Q, by_own = np.linalg.qr(both[:, :m])
        logs += float(np.sum(np.log(np.abs(np.diag(by_own)) + 1e-300)))
        rest.append(both[:, m:] - Q @ (Q.T @ both[:, m:]))
        freedom += len(e) - m
    R = np.asarray(np.linalg.qr(np.concatenate(rest), mode="r"))
    k = R.shape[1] - 1
    freedom = max(freedom - k, 1)
    variance = float(R[k, k] ** 2) / freedom if len(R) > k else 0.0
    logs += float(np.sum(np.log(np.abs(np.diag(R)[:k]) + 1e-300)))
    return logs + 0.5 * freedom * np.log(max(variance, 1e-300)), variance


def _independent(parts: Sequence[np.ndarray]) -> list[np.ndarray]:
    """The same directions without those that others already span: an output need not see every parameter."""
    _, s, Vt = np.linalg.svd(np.concatenate(parts), full_matrices=False)
    kept = s > 1e-8 * max(s.max(initial=0.0), 1e-300)
    return [part @ (Vt[kept].T / s[kept]) for part in parts]
