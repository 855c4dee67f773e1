"""Fit of the noise of a free-run residual: the likelihood of :class:`~sksurrogate.kernels.disturbance.Disturbance`, maximised.

The parameters of the model move along to first order, so that noise and model are fitted together.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from sksurrogate.kernels.clock import check_time
from sksurrogate.kernels.disturbance import Disturbance, Noise
from sksurrogate.kernels.linear_fit import linear_least_squares
from sksurrogate.kernels.noise_slopes import noise_slopes
from sksurrogate.kernels.run_columns import RunColumns, take_out

#: Correlation times of forces and of coloured sensor noise stay within these numbers of samples; one that ends at the largest may grow to
#: the longest run.
TAU_RANGE = (2.0, 60.0)
#: Least force over the RMS of dx/dt: a slow plant adds up a small force to more than its noise.
LEAST_FORCE = 1e-7
#: Mean square of the whitened residual beyond which, or below whose inverse, a noise fit starts from all noises resized.
NOISE_RESIZED = 4.0


def _log_prior(noise: Noise, sigma_unit: np.ndarray) -> float:
    """Weak log-normal priors on the correlation times; they keep flat directions in place."""
    prior = -0.5 * (np.log(noise.tau / 10.0)) ** 2 - 0.5 * (np.log(noise.tau_sensor / 10.0)) ** 2
    return float(prior - 0.005 * np.sum(np.log(noise.coloured / sigma_unit) ** 2))


def _prior_slopes(noise: Noise, sigma_unit: np.ndarray) -> np.ndarray:
    """Slopes of the prior in :meth:`Noise.pack`."""
    coloured = -0.01 * np.log(noise.coloured / sigma_unit)
    taus = -np.log(noise.tau / 10.0), -np.log(noise.tau_sensor / 10.0)
    return np.r_[np.zeros(len(noise.sigma) + len(noise.force)), taus[0], coloured, taus[1]]


def _noise_bounds(
    unit: np.ndarray, force_unit: np.ndarray, caps: tuple[np.ndarray, np.ndarray] | None
) -> tuple[np.ndarray, np.ndarray]:
    """Bounds of :meth:`Noise.pack`."""
    taus = np.log(TAU_RANGE)
    low = np.concatenate(
        [
            np.log(unit * 0.05),
            np.log(LEAST_FORCE * force_unit),
            [taus[0]],
            np.log(unit * 1e-2),
            [taus[0]],
        ]
    )
    force_high, coloured_high = (10 * force_unit, 100 * unit) if caps is None else caps
    coloured_high = np.maximum(coloured_high, 0.1 * unit)
    force_high = np.maximum(force_high, 1e-3 * force_unit)
    high = np.concatenate([np.log(unit * 20.0), np.log(force_high), [taus[1]], np.log(coloured_high), [taus[1]]])
    return low, high


def fit_noise(
    model: Disturbance,
    r: np.ndarray,
    start: Noise,
    force_unit: np.ndarray,
    J: np.ndarray | None = None,
    precision: np.ndarray | None = None,
    pull: np.ndarray | None = None,
    *,
    max_iterations: int = 15,
    curvature: np.ndarray | None = None,
    held: np.ndarray | None = None,
    caps: tuple[np.ndarray, np.ndarray] | None = None,
    sigma_unit: np.ndarray | None = None,
    own: RunColumns | None = None,
) -> tuple[Noise, float, np.ndarray]:
    """Maximise the likelihood over the noise parameters, with parameters of the model moved along.

    ``r`` (n_outputs, n_samples).
    ``force_unit`` (n_balances,): RMS of dx/dt of every balance; forces stay within :data:`LEAST_FORCE` and 10 of it.
    ``J`` (n_outputs, n_theta, n_samples): sensitivities: the likelihood is taken at the best parameters to first order.
    ``precision, pull`` (n_theta,): Gaussian prior on the parameters.
    ``curvature``: inverse Hessian of an earlier fit, to start from.
    ``held``: entries of ``start.pack()`` that stay where they are.
    ``caps``: largest force of every balance and coloured noise of every sensor that count as noise.
    ``sigma_unit`` (n_outputs,): sensor noise that counts as one, by which noises are bounded: that of ``start`` by
        default. Models that are compared need the same: a wider range alone would make one likelier than another.
    ``own``: further columns with free weights of their own in every run.
    Returns ``noise``, ``log_likelihood``.
    Returns ``curvature``: approximate inverse Hessian at the end.
    """
    columns = r[:, None] if J is None else np.concatenate([r[:, None], J], axis=1)
    none = np.zeros(columns.shape[1] - 1)
    unit = start.sigma if sigma_unit is None else sigma_unit
    low, high = _noise_bounds(unit, force_unit, caps)
    if held is not None:
        low, high = np.where(held, start.pack(), low), np.where(held, start.pack(), high)
    f = _Likelihood(
        model,
        columns,
        start,
        none if precision is None else precision,
        none if pull is None else pull,
        low,
        high,
        unit,
        own,
    )
    first = f.resized(np.clip(start.pack(), low, high))
    eta, value, inverse = _quasi_newton(f, *first, max_iterations, curvature)
    slow = _at_slowest(start, eta, low, high)
    if slow.any():
        slower = np.where(slow, np.log(max(TAU_RANGE[1], np.max(model.ends + 1 - model.starts))), high)
        wide = replace(f, high=slower)
        eta, value, inverse = _quasi_newton(wide, *wide.resized(eta), max_iterations, inverse)
    noise = start.unpack(eta)
    return noise, -value - _log_prior(noise, unit), inverse


def _at_slowest(start: Noise, eta: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Which entries of :meth:`Noise.pack` are correlation times that are fitted and end at their bound."""
    of_time = np.zeros(len(eta), bool)
    of_time[[len(start.sigma) + len(start.force), -1]] = True
    return np.asarray(of_time & (high > low) & (eta >= high - 1e-6))


class _Value(NamedTuple):
    """Negative log likelihood at the best parameters of the model, these, weights in every run, the mean square of the whitened
    residual, and the factor of the posterior precision."""

    best: float
    theta: np.ndarray
    weights: np.ndarray
    square: float
    factor: np.ndarray


LOST = _Value(np.inf, np.zeros(0), np.zeros(0), np.nan, np.zeros((0, 0)))


@dataclass(frozen=True, eq=False)
class _Likelihood:
    """Negative log likelihood of packed noise parameters, up to what does not depend on them; its columns are the residual
    and the sensitivities."""

    model: Disturbance
    columns: np.ndarray
    start: Noise
    precision: np.ndarray
    pull: np.ndarray
    low: np.ndarray
    high: np.ndarray
    unit: np.ndarray
    own: RunColumns | None

    def gram(self, noise: Noise, factor: np.ndarray) -> tuple[np.ndarray, float, np.ndarray]:
        """Of the columns, those with weights of their own in every run taken out; log determinant; these weights."""
        if self.own is None:
            return *self.model.gram(self.columns, noise, factor), np.zeros(0)
        whole = np.concatenate([self.columns, self.own.columns], axis=1)
        grams, logdets = self.model.gram_by_run(whole, noise, factor)
        if not np.all(np.isfinite(grams)):
            raise np.linalg.LinAlgError("the Gram is not finite")
        left, weights, _ = take_out(self.own.by_run(grams, self.model.starts), self.own.columns.shape[1])
        return left.sum(axis=0), float(np.sum(logdets)), weights

    def __call__(self, eta: np.ndarray) -> _Value:
        check_time()
        noise = self.start.unpack(eta)
        try:
            factor = self.model.factor(noise)
            G, logdet, weights = self.gram(noise, factor)
        except np.linalg.LinAlgError:
            return LOST
        if not np.all(np.isfinite(G)):
            return LOST
        H, g = G[1:, 1:] + np.diag(self.precision), G[1:, 0] + self.pull
        scale = np.sqrt(np.maximum(np.diag(H), 1e-150))
        normal, right = H / np.outer(scale, scale), g / scale
        if not (np.all(np.isfinite(normal)) and np.all(np.isfinite(right))):
            return LOST
        theta = linear_least_squares(normal, right, rcond=1e-10) if len(g) else g
        logdet -= 2.0 * _log_prior(noise, self.unit)
        value = 0.5 * (G[0, 0] - float(right @ theta) + logdet)
        if not np.isfinite(value):
            return LOST
        left = np.r_[1.0, -theta / scale]  # of the columns in the residual that is left
        square = float(left @ G @ left)
        if not square > 0:  # a sum of squares that its roundings have eaten up
            return LOST
        return _Value(
            float(value), theta / scale, weights @ left if self.own else weights, square / self.model.n_values, factor
        )

    def gradient(self, eta: np.ndarray, at: _Value) -> np.ndarray:
        """Slopes with the parameters of the model frozen at their best (envelope theorem); nan where they cannot be had."""
        noise = self.start.unpack(eta)
        residual = self.columns[:, 0] - np.einsum("okt,k->ot", self.columns[:, 1:], at.theta)
        if self.own is not None:
            residual -= self.own.sum(at.weights)
        try:
            with np.errstate(all="ignore"):
                slopes = noise_slopes(self.model, residual, noise, at.factor)
        except np.linalg.LinAlgError:  # from its end the precision rounds to one that is not positive definite
            return np.full(len(eta), np.nan)
        out = slopes - _prior_slopes(noise, self.unit)
        return np.where(self.low < self.high, out, 0.0)

    def resized(self, eta: np.ndarray) -> tuple[np.ndarray, _Value]:
        """All noises in their best common size where they are far from it: it has a closed form, but for bounds and prior."""
        at = self(eta)
        if not np.isfinite(at.best) or at.square <= 0 or 1.0 / NOISE_RESIZED < at.square < NOISE_RESIZED:
            return eta, at
        m, b = len(self.start.sigma), len(self.start.force)
        sizes = np.r_[np.ones(m + b), 0, np.ones(m), 0]
        other = np.clip(eta + 0.5 * np.log(at.square) * sizes, self.low, self.high)
        return min([(eta, at), (other, self(other))], key=lambda found: found[1].best)


def _quasi_newton(
    f: _Likelihood, eta: np.ndarray, at: _Value, max_iterations: int, inverse: np.ndarray | None
) -> tuple[np.ndarray, float, np.ndarray]:
    """BFGS within bounds, from a given inverse Hessian; stops when little is to be gained."""
    n, low, high = len(eta), f.low, f.high
    H = 0.02 * np.eye(n) if inverse is None else inverse.copy()
    if not np.isfinite(at.best):
        return eta, at.best, H
    g = f.gradient(eta, at)
    for _ in range(max_iterations):
        if not np.all(np.isfinite(g)):
            break
        stuck = ((eta <= low + 1e-9) & (g > 0)) | ((eta >= high - 1e-9) & (g < 0))
        free = ~stuck
        if not free.any():
            break
        d = np.zeros(n)
        d[free] = -H[np.ix_(free, free)] @ g[free]
        if g @ d > 0:
            d[free] = -g[free] / max(np.max(np.abs(g[free])), 1.0)
        d *= min(1.0, 2.0 / max(np.max(np.abs(d)), 1e-300))
        if -(g @ d) < 0.05:
            break
        t = 1.0
        for _ in range(8):
            new = np.clip(eta + t * d, low, high)
            there = f(new)
            if there.best < at.best + 1e-4 * (g @ (new - eta)):
                break
            t *= 0.3
        else:
            break
        gained = at.best - there.best
        if gained < 0.02:
            return new, there.best, H
        new_g = f.gradient(new, there)
        s, yv = new - eta, new_g - g
        if s @ yv > 1e-10:
            rho = 1.0 / (s @ yv)
            V = np.eye(n) - rho * np.outer(s, yv)
            H = V @ H @ V.T + rho * np.outer(s, s)
        eta, at, g = new, there, new_g
    return eta, at.best, H
