"""Fits of a correction through its own free run: pieces of runs at once, exact slopes, Levenberg-Marquardt."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from scipy.linalg.lapack import dtbtrs


@dataclass(frozen=True, eq=False)
class Pieces:
    """Stretches of runs, all of one length, that are run freely from their own first rows."""

    known: np.ndarray  #: (n_steps, n_pieces, n_known): features that do not depend on what is learned
    target: np.ndarray  #: (n_steps, n_pieces, n_outputs): nan behind the end of shorter runs
    n_lags: int  #: Rows that are given; also the number of past outputs among the features

    @property
    def first(self) -> np.ndarray:
        """Given rows."""
        return self.target[: self.n_lags]


def cut(known: Sequence[np.ndarray], target: Sequence[np.ndarray], n_lags: int, longest: int, most_rows: int) -> Pieces:
    """Cut runs into pieces of at most ``longest`` steps, evenly thinned to about ``most_rows`` rows in all."""
    length = min(max(len(k) for k in known), longest + n_lags)
    pieces = []
    for k, y in zip(known, target):
        # every piece begins with n_lags measured rows, shared with the end of the piece before it
        for start in range(0, max(len(k) - n_lags, 1), length - n_lags):
            if len(k) - start > n_lags or not start:
                pieces.append((k[start : start + length], y[start : start + length]))
    stride = max(1, int(np.ceil(len(pieces) * (length - n_lags) / most_rows)))
    pieces = pieces[::stride]
    known_out = np.zeros((length, len(pieces), known[0].shape[1]))
    target_out = np.full((length, len(pieces), target[0].shape[1]), np.nan)
    for p, (k, y) in enumerate(pieces):
        known_out[: len(k), p], known_out[len(k) :, p] = k, k[-1]
        target_out[: len(y), p] = y
    return Pieces(known_out, target_out, n_lags)


def features(y: np.ndarray, known: np.ndarray, n_lags: int) -> np.ndarray:
    """(n_steps - n_lags, n_pieces, n_features): past outputs, newest first, then the known."""
    n = len(y)
    return np.concatenate([*(y[n_lags - k : n - k] for k in range(1, n_lags + 1)), known[n_lags:]], axis=2)


def roll(net: Any, known: np.ndarray, first: np.ndarray) -> np.ndarray:
    """Free runs of a :class:`SkipNet`, all at once: (n_steps, n_pieces, n_outputs)."""
    raw, n_lags, o = net.raw(), len(first), first.shape[2]
    past, units = n_lags * o, raw.hidden.shape[1]
    by_past = np.concatenate([raw.hidden[:past], raw.skip[:past]], axis=1)
    sums = np.concatenate([known @ raw.hidden[past:] + raw.hidden_bias, known @ raw.skip[past:] + raw.bias], axis=2)
    y = np.empty((len(known), *first.shape[1:]))
    y[:n_lags] = first
    window = first[::-1].transpose(1, 0, 2).reshape(first.shape[1], past).copy()
    with np.errstate(all="ignore"):
        for t in range(n_lags, len(known)):
            z = window @ by_past
            z += sums[t]
            y[t] = np.tanh(z[:, :units]) @ raw.out + z[:, units:]
            window[:, o:] = window[:, :-o].copy()
            window[:, :o] = y[t]
    return y


def sensitivities(by_phi: np.ndarray, by_theta: np.ndarray, n_lags: int) -> np.ndarray:
    """Slopes of free runs by the parameters: one banded triangular solve a piece.

    ``by_phi`` (n_steps, n_pieces, n_outputs, n_features), ``by_theta`` (n_steps, n_pieces, n_outputs, n_theta).
    """
    m, pieces, o, _ = by_phi.shape
    out = np.empty_like(by_theta)
    for r in range(pieces):
        band = np.zeros(((n_lags + 1) * o, m * o))
        for k in range(1, n_lags + 1):
            for j in range(o):
                for i in range(o):
                    band[k * o + j - i, i : max(m - k, 0) * o : o] = -by_phi[k:, r, j, (k - 1) * o + i]
        out[:, r] = dtbtrs(band, by_theta[:, r].reshape(m * o, -1), uplo="L", diag="U")[0].reshape(by_theta[:, r].shape)
    return out


Residual = Callable[[Any, bool], tuple[np.ndarray, Any]]


def shooting(pieces: Pieces) -> Residual:
    """Errors of the free run and, where asked for, their slopes."""
    n, (steps, count, o) = pieces.n_lags, pieces.target.shape
    wanted = pieces.target[n:]
    there = np.isfinite(wanted)
    filled = np.where(there, wanted, 0.0)
    first = np.nan_to_num(pieces.first)

    @lru_cache(maxsize=1)  # the last map that was tried is the one whose slopes are asked for
    def run(net: Any) -> np.ndarray:
        return roll(net, pieces.known, first)

    def errors(net: Any, slopes: bool) -> tuple[np.ndarray, Any]:
        y = run(net)
        error = (y[n:] - filled)[there]
        if not slopes:
            return error, None
        phi = features(y, pieces.known, n)
        _, by_phi, by_theta = net.jacobians(phi.reshape(-1, phi.shape[2]))
        shape = (steps - n, count, o, -1)
        return error, sensitivities(by_phi.reshape(shape), by_theta.reshape(shape), n)[there]

    return errors


def without_bias(errors: Residual, n_outputs: int) -> Residual:
    """The same errors for maps whose last ``n_outputs`` parameters, the bias, stay where they are."""

    def held(net: Any, slopes: bool) -> tuple[np.ndarray, Any]:
        error, J = errors(net, slopes)
        if slopes:
            J[:, -n_outputs:] = 0.0
        return error, J

    return held


def one_step(pieces: Pieces) -> Residual:
    """Errors of one step from measured rows and, where asked for, their slopes."""
    n = pieces.n_lags
    phi = features(pieces.target, pieces.known, n).reshape(-1, pieces.known.shape[2] + n * pieces.target.shape[2])
    wanted = pieces.target[n:].reshape(len(phi), -1)
    rows = np.isfinite(wanted).all(axis=1) & np.isfinite(phi).all(axis=1)
    phi, wanted = phi[rows], wanted[rows]

    def errors(net: Any, slopes: bool) -> tuple[np.ndarray, Any]:
        if not slopes:
            return (net(phi) - wanted).ravel(), None
        value, _, by_theta = net.jacobians(phi)
        return (value - wanted).ravel(), by_theta.reshape(-1, by_theta.shape[2])

    return errors


def levenberg_marquardt(
    net: Any, errors: Residual, penalty: np.ndarray, prior: np.ndarray, max_iter: int, tol: float
) -> tuple[Any, float]:
    """Minimise ``sum errors^2 + sum penalty (theta - prior)^2``; the map and its cost."""

    def cost_of(candidate: Any) -> float:
        with np.errstate(all="ignore"):
            error, _ = errors(candidate, False)
            total = float(error @ error + penalty @ (candidate.theta - prior) ** 2)
        return total if np.isfinite(total) else np.inf

    cost, damping = cost_of(net), 1e-3
    for _ in range(max_iter if np.isfinite(cost) else 0):
        with np.errstate(all="ignore"):
            error, J = errors(net, True)
        if not np.all(np.isfinite(J)):
            break
        theta = net.theta
        gradient = J.T @ error + penalty * (theta - prior)
        normal = J.T @ J + np.diag(penalty)
        size = np.diag(normal)
        size = np.maximum(size, 1e-10 * size.max() + 1e-300)
        before = cost
        for _ in range(7):
            trial = net.at(theta - np.linalg.solve(normal + damping * np.diag(size), gradient))
            new = cost_of(trial)
            if new < cost:
                net, cost, damping = trial, new, max(damping / 5, 1e-12)
                break
            damping *= 4
        if before - cost <= tol * before:
            break
    return net, cost
