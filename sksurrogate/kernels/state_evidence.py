"""The penalty of a state-space fit by the evidence, and how sure its free runs are."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from sksurrogate.kernels.evidence import Evidence, by_run, correlation_length, weigh
from sksurrogate.kernels.shooting_evidence import LARGEST_LOG_CHANGE, PENALTY_ROUNDS, PENALTY_SETTLED
from sksurrogate.kernels.state_model import StateModel
from sksurrogate.kernels.state_space import OutputErrorLoss, StateFit, fit_output_error, state_slopes

#: Steps of Levenberg-Marquardt between which the penalty is weighed again.
STEPS_BETWEEN = 10
#: Prior standard deviation of the affine part, whose coefficients are of order one in standardised units: it holds what the
#: outputs do not see (other coordinates of the state), and nothing else.
AFFINE_PRIOR = 100.0


def weigh_states(
    model: StateModel, fit: StateFit, U: np.ndarray, Y: np.ndarray, starts: np.ndarray, alpha: float
) -> Evidence:
    """The evidence at a fit, initial states integrated out; the first group is the networks' weights, the second the affine part.

    ``model, fit, U, Y, starts, alpha``: as for :func:`fit_output_error`; ``alpha`` is the penalty beside the mean
        squared error.
    """
    loss = OutputErrorLoss(model, U, Y, starts, alpha)
    H, _, couple, own, _ = loss.normal(fit.theta, fit.x0, fit.x)
    reduced = H - np.einsum("rin,rnm,rjm->ij", couple, np.linalg.inv(own), couple) - np.diag(loss.penalty)
    error = np.where(loss.known, model.output(fit.theta, fit.x, U) - np.where(loss.known, Y, 0.0), 0.0)
    count, squares = int(loss.known.sum()), float(np.sum(error**2))
    alike = correlation_length(by_run(error, np.diff(np.r_[starts, len(U)])))
    groups = np.where(model.penalised > 0, 0, 1)
    penalty = np.array([alpha * count, squares / count / AFFINE_PRIOR**2])
    return weigh(count * reduced, fit.theta, groups, penalty, squares, count - fit.x0.size, alike)


def fit_state_evidence(
    model: StateModel,
    fit: StateFit,
    U: np.ndarray,
    Y: np.ndarray,
    starts: np.ndarray,
    alpha: float,
    accepts: Callable[[np.ndarray, np.ndarray], bool],
) -> tuple[StateFit, float]:
    """Follow the minimum from ``alpha`` to the penalty of the largest evidence; the fit and its penalty.

    It ends where neither the penalty moves nor a round gains half a nat. Steps to models that ``accepts`` refuses are not taken.
    """
    steps, before, count = fit.n_iter, np.inf, max(int(np.isfinite(Y).sum()), 1)
    for _ in range(PENALTY_ROUNDS):
        evidence = weigh_states(model, fit, U, Y, starts, alpha)
        change = float(np.log(evidence.penalty[0] / count / alpha))
        if abs(change) < PENALTY_SETTLED and (before - fit.cost) * count < evidence.half_nat:
            break
        before = fit.cost
        alpha *= float(np.exp(np.clip(change, -LARGEST_LOG_CHANGE, LARGEST_LOG_CHANGE)))
        fit = fit_output_error(
            model, fit.theta, fit.x0, U, Y, starts, alpha=alpha, max_iter=STEPS_BETWEEN, tol=1e-4, accepts=accepts
        )
        steps += fit.n_iter
    return StateFit(fit.theta, fit.x0, fit.x, fit.cost, steps), alpha


def run_variance(
    model: StateModel,
    theta: np.ndarray,
    x: np.ndarray,
    U: np.ndarray,
    evidence: Evidence,
    precision: np.ndarray,
    n_seen: int,
) -> np.ndarray:
    """Variance of new measurements along one free run, (n_samples, n_outputs): noise, parameters, and the initial state.

    ``x`` (n_samples, n_states): the run.
    ``precision`` (n_states, n_states): of the initial state before anything is measured, in units of the squared output
        error.
    ``n_seen``: rows from which the initial state was estimated.
    """
    _, J, Jx = state_slopes(model, theta, x, U, np.zeros(1, int))
    first = Jx[:n_seen].reshape(-1, Jx.shape[2])
    start = evidence.noise * np.linalg.inv(first.T @ first + precision)
    by_weights = np.einsum("top,pq,toq->to", J, evidence.covariance, J)
    return evidence.noise + by_weights + np.einsum("tox,xy,toy->to", Jx, start, Jx)
