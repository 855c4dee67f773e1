"""Uncertainty of fitted parameters: covariance, intervals, combinations that the data do not fix."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import stdtrit

from sksurrogate.physics._residual_correlation import residual_covariance

#: A direction of the parameters whose singular value is below this share of the largest is not fixed by the data.
_WEAK = 1e-6


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """Of k parameters."""

    covariance: np.ndarray  #: (k, k): nan where the data do not fix all of them
    width: np.ndarray  #: (k,): half width of the interval; inf where the data do not fix the parameter
    loose: np.ndarray  #: bool (k,)
    null: np.ndarray  #: (n, k): directions, in units of ``unit``, that leave the outputs as they are


def uncertainty_of(
    J_theta: np.ndarray, J_x: np.ndarray, residual: np.ndarray, sd: np.ndarray, starts: np.ndarray, unit: np.ndarray,
    confidence: float, fixed: np.ndarray, precision: np.ndarray | None = None, measured: np.ndarray | None = None,
) -> Uncertainty:  # fmt: skip
    """Of a fit, linearised: initial states are projected out run by run, and the correlation of the residual in time counts.

    ``J_theta`` (n_outputs, k, n_samples).
    ``J_x`` (n_outputs, n_free_states, n_samples): of the initial states of the run.
    ``residual`` (n_outputs, n_samples).
    ``sd`` (n_outputs,): what the fit divided the residual of every output by.
    ``starts`` (n_runs,).
    ``unit`` (k,): size of each parameter.
    ``fixed`` (k,): parameters at a bound: the others are judged as if these were known.
    ``precision`` (k,): of a prior, which counts like a measured value with the noise that is left.
    ``measured`` (n_outputs, n_samples): which values were measured; J_theta, J_x and residual are 0 elsewhere.
    """
    count = residual.size if measured is None else int(measured.sum())
    k, n_outputs = J_theta.shape[1], len(residual)
    size = np.maximum(sd, 1e-300)
    J_theta = np.where(fixed[:, None], 0.0, J_theta * unit[:, None])
    edges = np.r_[starts, residual.shape[1]]
    blocks, owns, used = [], [], 0
    for a, b in zip(edges[:-1], edges[1:]):
        both = np.concatenate([J_theta[:, :, a:b], J_x[:, :, a:b]], axis=1) / size[:, None, None]
        rows = both.transpose(0, 2, 1).reshape(-1, both.shape[1])  # output by output, in time order
        shared, own, U = rows[:, :k], rows[:, k:], np.zeros((len(rows), 0))
        if own.shape[1]:
            U, s, _ = np.linalg.svd(own, full_matrices=False)
            U = U[:, s > 1e-10 * max(s[0], 1e-300)]
            shared = shared - U @ (U.T @ shared)
            used += U.shape[1]
        owns.append(U)
        blocks.append(shared.reshape(n_outputs, b - a, k))
    if not k:
        return Uncertainty(np.zeros((0, 0)), np.zeros(0), np.zeros(0, bool), np.zeros((0, 0)))
    held = np.zeros(k) if precision is None else np.where(fixed, 0.0, precision * unit**2)
    rows = [*(block.reshape(-1, k) for block in blocks), np.diag(np.sqrt(held))[held > 0]]
    R = np.linalg.qr(np.concatenate(rows), mode="r")
    _, s, Vt = np.linalg.svd(R)
    s = np.r_[s, np.zeros(k - len(s))]
    weak = s <= _WEAK * max(s[0], 1e-300)
    null = Vt[weak]
    null = null[~np.any(np.abs(null[:, fixed]) > 0.5, axis=1)] if len(null) else null
    loose = np.sqrt(np.sum(null**2, axis=0)) > 1e-3 if len(null) else np.zeros(k, bool)
    freedom = max(count - used - int(np.sum(~weak)), 1)
    inverse = Vt.T / np.where(weak, np.inf, s)
    middle, slowest = _remembered(
        blocks, residual / size[:, None], edges, inverse[:, ~weak], owns, count / freedom, measured
    )
    middle = middle + np.diag(held) * residual.size / freedom * float(np.mean((residual / size[:, None]) ** 2))
    covariance = inverse @ (inverse.T @ middle @ inverse) @ inverse.T * np.outer(unit, unit)
    # correlated noise counts as fewer samples when its size is judged
    width = float(stdtrit(max(freedom / slowest, min(freedom, 3.0)), 0.5 + confidence / 2)) * np.sqrt(
        np.maximum(np.diag(covariance), 0.0)
    )
    return Uncertainty(
        np.full_like(covariance, np.nan) if len(null) else covariance, np.where(loose, np.inf, width), loose, null
    )


def _mean_square(pieces: list[np.ndarray]) -> float:
    """Of all values of a residual in pieces; 0 of none."""
    whole = np.concatenate(pieces)
    return float(np.mean(whole**2)) if len(whole) else 0.0


def _remembered(
    blocks: list[np.ndarray], residual: np.ndarray, edges: np.ndarray, fixed: np.ndarray, own: list[np.ndarray], spread: float,
    measured: np.ndarray | None = None,
) -> tuple[np.ndarray, float]:  # fmt: skip
    """``J' R J`` with R the covariance of the noise: its size and its correlation in time, output by output.

    Also by how many samples, at most, one independent sample is worth. ``fixed`` (k, n_known): the directions of the
    parameters that the data fix; ``own``: bases of what every run's initial state does to all outputs; ``spread``:
    residual size over degrees of freedom. Lags are counted from one measured value to the next.
    """
    total = np.zeros((blocks[0].shape[2],) * 2)
    slowest = 1.0
    for j, left in enumerate(residual):
        pieces = [left[a:b] for a, b in zip(edges[:-1], edges[1:])]
        starts = [U.reshape(len(residual), len(block[j]), U.shape[1])[j] for U, block in zip(own, blocks)]
        mine = [block[j] for block in blocks]
        if measured is not None:
            rows = [measured[j, a:b] for a, b in zip(edges[:-1], edges[1:])]
            pieces, starts, mine = ([part[row] for part, row in zip(parts, rows)] for parts in (pieces, starts, mine))
        cov = residual_covariance(pieces, [J @ fixed for J in mine], starts)
        cov = np.array([spread * _mean_square(pieces)]) if cov is None else cov
        slowest = max(slowest, 2.0 * float(np.sum(cov)) / max(float(cov[0]), 1e-300) - 1.0)
        for J in mine:
            total += cov[0] * (J.T @ J)
            for lag in range(1, min(len(cov), len(J) - 1)):
                cross = J[lag:].T @ J[:-lag]
                total += cov[lag] * (cross + cross.T)
    return total, slowest
