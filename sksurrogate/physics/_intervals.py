"""What a fit knows of its parameters: covariance, intervals, combinations that the data do not fix."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_toeplitz
from scipy.stats import t as student

__all__ = ["Knowledge", "known"]

#: A direction of the parameters whose singular value is below this share of the largest is not fixed by the data.
_WEAK = 1e-6
#: Longest memory of what is left, in samples, that widens the intervals.
_MEMORY = 20


@dataclass(frozen=True, eq=False)
class Knowledge:
    """Uncertainty of k parameters.

    Attributes
    ----------
    covariance : ndarray (k, k)
        nan where the data do not fix all of them.
    width : ndarray (k,)
        Half width of the interval; inf where the data do not fix the parameter.
    loose : ndarray of bool (k,)
    null : ndarray (n, k)
        Directions, in units of ``unit``, that leave the outputs as they are.
    """

    covariance: np.ndarray
    width: np.ndarray
    loose: np.ndarray
    null: np.ndarray


def known(
    J_theta: np.ndarray, J_x: np.ndarray, residual: np.ndarray, sd: np.ndarray, starts: np.ndarray, unit: np.ndarray,
    confidence: float, fixed: np.ndarray,
) -> Knowledge:  # fmt: skip
    """Linearised, initial states projected out run by run, a memory of the residual taken into account.

    Parameters
    ----------
    J_theta : ndarray (n_outputs, k, n_samples)
    J_x : ndarray (n_outputs, n_free_states, n_samples)
        Of the initial states of the run.
    residual : ndarray (n_outputs, n_samples)
    sd : ndarray (n_outputs,)
        What the fit divided the residual of every output by.
    starts : ndarray of int (n_runs,)
    unit : ndarray (k,)
        Size of each parameter.
    confidence : float
    fixed : ndarray of bool (k,)
        Parameters at a bound: the others are judged as if these were known.
    """
    k, n_outputs = J_theta.shape[1], len(residual)
    size = np.maximum(sd, 1e-300)
    J_theta = np.where(fixed[:, None], 0.0, J_theta * unit[:, None])
    edges = np.r_[starts, residual.shape[1]]
    blocks, used = [], 0
    for a, b in zip(edges[:-1], edges[1:]):
        both = np.concatenate([J_theta[:, :, a:b], J_x[:, :, a:b]], axis=1) / size[:, None, None]
        rows = both.transpose(0, 2, 1).reshape(-1, both.shape[1])  # output by output, in time order
        shared, own = rows[:, :k], rows[:, k:]
        if own.shape[1]:
            U, s, _ = np.linalg.svd(own, full_matrices=False)
            U = U[:, s > 1e-10 * max(s[0], 1e-300)]
            shared = shared - U @ (U.T @ shared)
            used += U.shape[1]
        blocks.append(shared.reshape(n_outputs, b - a, k))
    if not k:
        return Knowledge(np.zeros((0, 0)), np.zeros(0), np.zeros(0, bool), np.zeros((0, 0)))
    R = np.linalg.qr(np.concatenate([block.reshape(-1, k) for block in blocks]), mode="r")
    _, s, Vt = np.linalg.svd(R)
    s = np.r_[s, np.zeros(k - len(s))]
    weak = s <= _WEAK * max(s[0], 1e-300)
    null = Vt[weak]
    null = null[~np.any(np.abs(null[:, fixed]) > 0.5, axis=1)] if len(null) else null
    loose = np.sqrt(np.sum(null**2, axis=0)) > 1e-3 if len(null) else np.zeros(k, bool)
    freedom = max(residual.size - used - int(np.sum(~weak)), 1)
    inverse = Vt.T / np.where(weak, np.inf, s)
    scatter = inverse @ (inverse.T @ _remembered(blocks, residual / size[:, None], edges) @ inverse) @ inverse.T
    covariance = scatter * np.outer(unit, unit) * (residual.size / freedom)
    width = float(student.ppf(0.5 + confidence / 2, freedom)) * np.sqrt(np.maximum(np.diag(covariance), 0.0))
    return Knowledge(
        np.full_like(covariance, np.nan) if len(null) else covariance, np.where(loose, np.inf, width), loose, null
    )


def _remembered(blocks: list[np.ndarray], residual: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """``J' R J`` with R the covariance of the residual: its size and its memory in time, output by output.

    The memory of every output is an autoregression whose order the information criterion of Schwarz chooses.
    """
    total = np.zeros((blocks[0].shape[2],) * 2)
    for j, left in enumerate(residual):
        rho = float(np.mean(left**2)) * _memory([left[a:b] for a, b in zip(edges[:-1], edges[1:])])
        for block in blocks:
            J = block[j]
            total += rho[0] * (J.T @ J)
            for lag in range(1, min(len(rho), len(J) - 1)):
                cross = J[lag:].T @ J[:-lag]
                total += rho[lag] * (cross + cross.T)
    return total


def _memory(pieces: list[np.ndarray]) -> np.ndarray:
    """Autocorrelation (n_lags,) of the fitted autoregression; [1] for white residuals."""
    n = sum(len(piece) for piece in pieces)
    most = min(_MEMORY, n // 20)
    power = sum(float(piece @ piece) for piece in pieces)
    if most < 1 or not power > 0:
        return np.ones(1)
    r = np.array([sum(float(p[lag:] @ p[: len(p) - lag]) for p in pieces if len(p) > lag) for lag in range(most + 1)])
    r = r / power
    if np.max(np.abs(r[1:])) < 2.0 / np.sqrt(n):
        return np.ones(1)
    best, chosen = 0.0, np.zeros(0)
    for order in range(1, most + 1):
        a = solve_toeplitz(r[:order], r[1 : order + 1])
        left = 1.0 - float(a @ r[1 : order + 1])
        score = n * np.log(max(left, 1e-12)) + order * np.log(n)
        if score < best:
            best, chosen = score, a
    if not len(chosen):
        return np.ones(1)
    p, lags = len(chosen), min(20 * _MEMORY, n // 4)
    rho = np.zeros(lags + p + 1)
    rho[: p + 1] = r[: p + 1]
    for lag in range(p + 1, len(rho)):
        rho[lag] = chosen @ rho[lag - p : lag][::-1]
    return rho[:lags]
