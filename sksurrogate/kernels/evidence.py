"""Penalty and noise of a least-squares fit by MacKay's evidence, and what a fit would be without one of its runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

#: Autocorrelation at which the sum over lags stops: beyond, it is mostly its own error.
AUTOCORRELATION_SETTLED = 0.05
#: Least variance of the noise, in units of the outputs' variance: rounding.
LEAST_NOISE = 1e-24
#: Rounding, relative to the largest eigenvalue of the Hessian with unit diagonal.
SINGULAR = 1e-14


@dataclass(frozen=True, eq=False)
class Evidence:
    """The quadratic approximation about a minimum of ``|r|^2 + sum_g penalty_g |w_g|^2``."""

    penalty: np.ndarray  #: (n_groups,): where the evidence moves it; in units of the squares
    noise: float  #: Variance of a residual
    effective: np.ndarray  #: (n_groups,): parameters of each group that the data determine, between 0 and its size
    covariance: np.ndarray  #: (n_theta, n_theta): of the parameters
    log_evidence: float  #: Up to a constant that depends on the sizes of the groups alone
    half_nat: float  #: What half a nat is in squares: the noise, times the rows over which residuals stay alike


def weigh(
    gram: np.ndarray,
    theta: np.ndarray,
    groups: np.ndarray,
    penalty: np.ndarray,
    squares: float,
    n_rows: float,
    correlation: float = 1.0,
) -> Evidence:
    r"""One step of MacKay's fixed point, ``penalty = noise * effective / |w|^2``.

    With ``H = J'J + penalty`` and :math:`\gamma_g = n_g - \lambda_g \mathrm{tr}_g H^{-1}` effective parameters, the noise
    is ``squares / (n_rows - effective - free)``. Residuals that stay alike for ``correlation`` rows count as
    ``n_rows / correlation`` rows.

    ``gram`` (n_theta, n_theta): J'J at the minimum, without the penalty.
    ``theta`` (n_theta,).
    ``groups`` int (n_theta,): group of every parameter; -1 where it is not penalised.
    ``penalty`` (n_groups,).
    ``squares``: r'r without the penalty.
    ``n_rows``: residuals.

    See MacKay, *Bayesian interpolation* and *A practical Bayesian framework for backpropagation networks*, Neural
    Computation 4 (1992).

    >>> import numpy as np
    >>> found = weigh(np.diag([3.0]), np.array([2.0]), np.array([0]), np.array([1.0]), 4.0, 10.0)
    >>> found.effective.round(2), round(found.noise, 4), found.penalty.round(4)
    (array([0.75]), 0.4324, array([0.0811]))
    """
    weight = np.where(groups >= 0, penalty[np.maximum(groups, 0)], 0.0)
    inverse, log_det = _inverse(gram + np.diag(weight))
    own = np.diag(inverse)
    sizes = np.array([np.sum(groups == g) for g in range(len(penalty))])
    traces = np.array([own[groups == g].sum() for g in range(len(penalty))])
    effective = np.clip(sizes - penalty * traces, 0.0, sizes)
    free = float(np.sum(groups < 0))
    noise = max(squares / max(n_rows - free - float(effective.sum()), 1.0), LEAST_NOISE)
    lengths = np.array([np.sum(theta[groups == g] ** 2) for g in range(len(penalty))])
    # a penalty beyond the largest curvature leaves nothing of a group: more is the same
    most = float(np.diag(gram).max(initial=0.0)) + LEAST_NOISE
    moved = correlation * noise * np.maximum(effective, 1e-3) / np.maximum(lengths, LEAST_NOISE)
    spread = correlation * noise
    held = groups >= 0
    log_evidence = -0.5 * (squares + float(weight @ theta**2)) / spread - 0.5 * n_rows / correlation * np.log(noise)
    with np.errstate(divide="ignore"):
        log_evidence += 0.5 * float(np.sum(np.log(weight[held]))) - 0.5 * log_det
    log_evidence += 0.5 * free * np.log(spread)
    return Evidence(np.minimum(moved, most), noise, effective, spread * inverse, float(log_evidence), spread)


def _inverse(H: np.ndarray) -> tuple[np.ndarray, float]:
    """Inverse and log determinant of a symmetric matrix, directions of no curvature held at the rounding."""
    own = np.diag(H)
    scale = np.sqrt(np.where(own > SINGULAR * own.max(initial=0.0), own, max(float(own.max(initial=0.0)), LEAST_NOISE)))
    values, vectors = np.linalg.eigh(H / np.outer(scale, scale))
    values = np.maximum(values, SINGULAR * max(float(values[-1]), 1.0))
    root = vectors / np.sqrt(values) / scale[:, None]
    return root @ root.T, float(np.sum(np.log(values)) + 2 * np.sum(np.log(scale)))


def by_run(errors: np.ndarray, lengths: np.ndarray) -> np.ndarray:
    """Errors (n_samples, n_outputs) of runs one after the other as (n_runs, longest, n_outputs), 0 behind the end of a run."""
    padded = np.zeros((len(lengths), int(np.max(lengths)), errors.shape[1]))
    for part, own in zip(padded, np.split(errors, np.cumsum(lengths)[:-1])):
        part[: len(own)] = own
    return padded


def correlation_length(errors: np.ndarray) -> float:
    """Rows over which residuals stay alike: ``1 + 2 sum rho_k`` up to the first lag of almost none, at least 1.

    ``errors`` (n_runs, n_steps, n_outputs): 0 where nothing was measured.

    >>> import numpy as np
    >>> white = np.random.default_rng(0).normal(size=(4, 500, 1))
    >>> correlation_length(white) < 1.2, correlation_length(np.repeat(white, 10, axis=1)) > 8
    (True, True)
    """
    power, found = float(np.sum(errors**2)), 1.0
    if not power > 0:
        return 1.0
    for lag in range(1, errors.shape[1] // 2):
        rho = float(np.sum(errors[:, lag:] * errors[:, :-lag])) / power
        found += 2 * rho
        if rho < AUTOCORRELATION_SETTLED:
            break
    return max(found, 1.0)


def left_out(
    J: np.ndarray, e: np.ndarray, parts: Sequence[np.ndarray], pull: np.ndarray, penalty: np.ndarray
) -> np.ndarray:
    """Mean squared error of every part by a fit without it: one Gauss-Newton step from the fit to all.

    ``J`` (n_rows, n_theta): slopes of the residuals.
    ``e`` (n_rows,): residuals.
    ``parts``: rows that are left out together.
    ``pull`` (n_theta,): half the slope of the penalty term.
    ``penalty`` (n_theta,).
    Returns (n_parts,).

    >>> import numpy as np
    >>> rng = np.random.default_rng(0)
    >>> J, y = rng.normal(size=(15, 2)), rng.normal(size=15)
    >>> theta, other = (np.linalg.lstsq(J[k:], y[k:], rcond=None)[0] for k in (0, 5))
    >>> found = left_out(J, J @ theta - y, [np.arange(5)], np.zeros(2), np.zeros(2))
    >>> bool(np.isclose(found[0], np.mean((J[:5] @ other - y[:5]) ** 2)))
    True
    """
    whole, slope = J.T @ J + np.diag(penalty), J.T @ e + pull
    found = np.empty(len(parts))
    for k, rows in enumerate(parts):
        own, error = J[rows], e[rows]
        inverse, _ = _inverse(whole - own.T @ own)
        found[k] = np.mean((error - own @ (inverse @ (slope - own.T @ error))) ** 2)
    return found
