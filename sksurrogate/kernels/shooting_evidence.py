"""Shooting fits whose penalty follows the evidence from round to round."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sksurrogate.kernels.evidence import Evidence, correlation_length, left_out, weigh
from sksurrogate.kernels.shooting import FreeRunLoss, descend

#: Rounds of Levenberg-Marquardt between which the penalty is weighed again, at most, and steps in a round: as many steps as
#: a fit with a fixed penalty takes.
PENALTY_ROUNDS, STEPS_IN_ROUND = 50, 4
#: Largest change of the logarithm of the penalty in a round: the path stays near minima that the data have led to.
LARGEST_LOG_CHANGE = 1.2
#: Parts that are left out at least and at most.
FEWEST_PARTS, MOST_PARTS = 4, 16
#: The penalty has settled at such a change of its logarithm; the way down at less than half a nat a round, which no choice
#: hangs on: in squares as much as the variance of the noise, of residuals that stay alike as many times as much.
PENALTY_SETTLED = 0.05


@dataclass(frozen=True, eq=False)
class EvidenceFit:
    """A shooting fit, its penalty and noise."""

    model: Any
    loss: FreeRunLoss  #: With the last penalty
    y: np.ndarray  #: (n_runs, n_steps, n_outputs): free runs
    evidence: Evidence  #: Its ``penalty`` is where a further round would move it

    def left_out(self) -> np.ndarray:
        """Mean squared error of runs by fits without them, linearised; of parts of runs where there are few, (n_parts,)."""
        J, e = self.loss.jacobian(self.model, self.y), self.loss.errors(self.y)
        penalty = self.loss.penalty(self.model)
        J, e, parts = J.reshape(-1, J.shape[-1]), e.ravel(), _parts(e)
        return left_out(J, e, parts, penalty * self.model.theta, penalty)


def _parts(e: np.ndarray) -> list[np.ndarray]:
    """Rows of the residuals (n_runs, n_steps, n_outputs) that are left out together."""
    n_runs = len(e)
    n_parts = min(n_runs, MOST_PARTS) if n_runs >= FEWEST_PARTS else n_runs * -(-FEWEST_PARTS // n_runs)
    return np.array_split(np.arange(e.size), n_parts)


def _weighed(loss: FreeRunLoss, model: Any, gram: np.ndarray, e: np.ndarray, correlation: float) -> Evidence:
    """The evidence at a model; one group of all weights."""
    groups = np.where(np.arange(model.theta.size) < model.n_weights, 0, -1)
    return weigh(gram, model.theta, groups, np.array([loss.alpha]), float(np.sum(e**2)), loss.n_rows, correlation)


def _gram(loss: FreeRunLoss, model: Any, y: np.ndarray) -> np.ndarray:
    J = loss.jacobian(model, y).reshape(-1, model.theta.size)
    return J.T @ J


def first_penalty(loss: FreeRunLoss, model: Any, guess: float = 1e-2, n_rounds: int = 5) -> float:
    """The penalty of the evidence with the model held, for a fit that begins there; ``guess`` where it diverges."""
    y = loss.run(model)
    gram, e = _gram(loss, model, y), loss.errors(y)
    if not (np.isfinite(gram).all() and np.isfinite(e).all()):
        return guess
    loss = replace(loss, alpha=guess)
    for _ in range(n_rounds):
        loss = replace(loss, alpha=float(_weighed(loss, model, gram, e, correlation_length(e)).penalty[0]))
    return loss.alpha


def fit_by_evidence(
    loss: FreeRunLoss,
    model: Any,
    *,
    accepts: Callable[[Any], bool] | None = None,
    n_rounds: int = PENALTY_ROUNDS,
    n_steps: int = STEPS_IN_ROUND,
) -> EvidenceFit | None:
    """Follow the minimum from ``loss.alpha`` to the penalty of the largest evidence.

    ``loss``: its ``alpha`` is where the path begins.
    ``model``: start; its free runs must be finite.
    ``accepts`` (model) -> bool: the path ends before the first model that it refuses.
    Returns None where the start is refused, or its free runs are not finite.
    """
    found: EvidenceFit | None = None
    y: np.ndarray | None = None
    before = np.inf
    for _ in range(n_rounds):
        model, value, y = descend(loss, model, n_steps, 1e-6, y)
        if not np.isfinite(value) or (accepts is not None and not accepts(model)):
            return found
        e = loss.errors(y)
        evidence = _weighed(loss, model, _gram(loss, model, y), e, correlation_length(e))
        found = EvidenceFit(model, loss, y, evidence)
        change = float(np.log((evidence.penalty[0] + 1e-300) / (loss.alpha + 1e-300)))
        if abs(change) < PENALTY_SETTLED and before - value < evidence.half_nat:
            break
        before = value
        loss = replace(loss, alpha=float(loss.alpha * np.exp(np.clip(change, -LARGEST_LOG_CHANGE, LARGEST_LOG_CHANGE))))
    return found
