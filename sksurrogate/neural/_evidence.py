"""The penalty of a network by the evidence: weight decay and noise are found together, without a grid."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from sksurrogate.exceptions import DataError
from sksurrogate.kernels.evidence import Evidence, weigh
from sksurrogate.neural._network import Layers
from sksurrogate.neural._problems import JACOBIAN_ROWS, Rows, normal_equations
from sksurrogate.neural._solvers import Plan, train_least_squares
from sksurrogate.neural._training import Torch, Trained, train

#: Where the penalty begins, beside the mean squared error. A free fit is a fixed point of its own (large weights ask for
#: a small penalty), a much larger one too (no weights ask for a large one): from between, the path finds the data's.
FIRST = 1e-3
#: Rounds at most, largest change of the penalty's logarithm in a round, and the change at which it has settled.
EVIDENCE_ROUNDS, LARGEST_PENALTY_CHANGE, EVIDENCE_SETTLED = 12, 2.3, 0.05


@dataclass(frozen=True, eq=False)
class Posterior:
    """Gaussian posterior of a network's weights, and the noise, for standardised data."""

    layers: Layers
    evidence: Evidence
    noise: np.ndarray  #: (n_outputs,): variance of every output's noise
    rows: Rows  #: The scaling

    def deviation(self, X: np.ndarray) -> np.ndarray:
        """Standard deviation of a new measurement, (n_rows, n_outputs), in units of y."""
        x = ((X - self.rows.mean) / self.rows.scale).T
        runs, n_outputs = self.layers.run(x), len(self.rows.gain)
        variance = np.empty((n_outputs, x.shape[1]))
        J = np.empty((len(self.layers.theta), x.shape[1]))
        for k in range(n_outputs):
            delta = np.zeros((n_outputs, x.shape[1]))
            delta[k] = 1.0
            self.layers.back(x, runs, delta, J)
            variance[k] = self.noise[k] + np.einsum("pn,pq,qn->n", J, self.evidence.covariance, J)
        return np.sqrt(variance).T * self.rows.gain


def train_by_evidence(solver: str, plan: Plan, rows: Rows, torch: Torch) -> tuple[Trained, Plan, Posterior]:
    """Levenberg-Marquardt from random starts, then from its end with the penalty weighed again until it settles.

    Returns ``trained``.
    Returns ``plan``: with the penalty.
    Returns ``posterior``.
    """
    if solver != "lm" or "binary_step" in plan.activations or rows.smooth is not None:
        raise DataError(
            'alpha="evidence" needs the Hessian of plain squares: take solver="lm" ("auto" does up to 300 weights), no '
            '"binary_step", slope=0 and curvature=0; or give alpha a number.'
        )
    plan = replace(plan, alpha=FIRST)
    trained = train(solver, plan, rows, None, torch)
    outcome = trained.outcome
    for _ in range(EVIDENCE_ROUNDS):
        evidence = _weighed(plan, rows, outcome.layers)
        change = float(
            np.clip(
                np.log(evidence.penalty[0] / rows.total / plan.alpha), -LARGEST_PENALTY_CHANGE, LARGEST_PENALTY_CHANGE
            )
        )
        if abs(change) < EVIDENCE_SETTLED:
            break
        plan = replace(plan, alpha=plan.alpha * float(np.exp(change)))
        found = train_least_squares(plan, rows, start=outcome.layers)
        outcome = replace(found, curve=outcome.curve + found.curve, n_iter=outcome.n_iter + found.n_iter)
    evidence = _weighed(plan, rows, outcome.layers)
    kept = replace(rows, X=rows.X[:0].copy(), Y=rows.Y[:0].copy(), weights=None)
    noise = evidence.noise * _shares(outcome.layers, rows)
    return replace(trained, outcome=outcome), plan, Posterior(outcome.layers, evidence, noise, kept)


def _shares(layers: Layers, rows: Rows) -> np.ndarray:
    """Squares of every output's residuals over their mean, (n_outputs,)."""
    squares = np.zeros(rows.Y.shape[1])
    for first in range(0, len(rows), JACOBIAN_ROWS):
        x, y, weights = rows.part(slice(first, first + JACOBIAN_ROWS))
        away = (layers(x) - y) ** 2
        squares += away.sum(axis=0) if weights is None else weights @ away
    return squares / max(float(squares.mean()), np.finfo(float).tiny)


def _weighed(plan: Plan, rows: Rows, layers: Layers) -> Evidence:
    """The evidence at a network; one group of all weights, or of weights and biases about a prior."""
    theta = layers.theta
    squares, _, gram = normal_equations(layers, rows)(theta)
    groups = np.where(layers.is_weight > 0, 0, -1) if plan.prior is None else np.zeros(len(theta), int)
    away = theta if plan.prior is None else theta - plan.prior
    penalty = np.array([plan.alpha * rows.total])
    return weigh(gram, away, groups, penalty, squares, rows.total * plan.sizes[-1])
