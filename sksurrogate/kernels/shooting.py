"""Fit of a lag model on its free run: Adam finds the basin, Levenberg-Marquardt with exact slopes ends it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from sksurrogate.kernels.geodesic import PROBE, bent, second_order
from sksurrogate.kernels.net import LagNet
from sksurrogate.kernels.newton import adjoint_gradient, newton_runs, sensitivities
from sksurrogate.kernels.rollout import known_sums, runs_at_once

#: Steps of Adam.
ADAM_STEPS = 200
#: Steps of Levenberg-Marquardt after which starts are compared.
SHORT = 15
#: Rows on which the basin is looked for at most: it is wide, and the end is found on all.
BASIN_ROWS = 20_000


class Loss(Protocol):
    """``sum e^2`` and a penalty, of what a model gives: its free runs as a rule."""

    def run(self, model: Any, guess: np.ndarray | None = None, rtol: float = 1e-12) -> np.ndarray:
        """What the model gives; ``guess``: what one nearby gives, ``rtol``: error that does no harm."""

    def errors(self, y: np.ndarray) -> np.ndarray:
        """Errors of what a model gives."""

    def value(self, model: Any, y: np.ndarray) -> float:
        """The loss; inf where a run diverged."""

    def jacobian(self, model: Any, y: np.ndarray) -> np.ndarray:
        """Slopes of :meth:`errors` by theta, (..., n_theta)."""

    def penalty(self, model: Any) -> np.ndarray:
        """Half the curvature of the penalty, (n_theta,)."""

    def pull(self, model: Any) -> np.ndarray:
        """Half the slope of the penalty, (n_theta,)."""


@dataclass(frozen=True)
class FreeRunLoss:
    """``sum (y - y_hat)^2 + alpha * sum w^2`` over free runs."""

    U: np.ndarray  #: (n_runs, n_steps, n_inputs)
    #: (n_runs, n_steps, n_outputs): measured outputs, the first ``n_first`` of which start the runs; nan rows (ends of
    #: shorter runs) do not count
    target: np.ndarray
    n_first: int
    alpha: float = 0.0  #: Penalty on weights, not on biases
    weight: np.ndarray | None = None  #: (n_runs,): factor of every run's squares

    @property
    def root(self) -> float | np.ndarray:
        """Factor of every run's errors."""
        return 1.0 if self.weight is None else np.sqrt(self.weight)[:, None, None]

    def run(self, model: LagNet, guess: np.ndarray | None = None, rtol: float = 1e-12) -> np.ndarray:
        """Free runs, by Newton over time from the free runs of weights nearby, else step by step."""
        folded, first = model.folded(), self.target[:, : self.n_first]
        if guess is not None:
            y = np.concatenate([first, guess[:, self.n_first :]], axis=1)
            if newton_runs(folded, known_sums(folded, self.U, self.n_first), y, self.n_first, 8, rtol):
                return y
        return runs_at_once(folded, self.U, first)

    def some(self, most: int) -> FreeRunLoss:
        """The loss of runs spread evenly over all, with so many rows at most, or of one; the penalty is as much smaller."""
        n_runs, n_steps = self.target.shape[:2]
        n = max(most // n_steps, 1)
        if n >= n_runs:
            return self
        chosen = np.linspace(0, n_runs - 1, n).astype(int)
        weight = None if self.weight is None else self.weight[chosen]
        return replace(self, U=self.U[chosen], target=self.target[chosen], alpha=self.alpha * n / n_runs, weight=weight)

    def errors(self, y: np.ndarray) -> np.ndarray:
        """Weighted y_hat - y, 0 where nothing was measured, (n_runs, n_steps - n_first, n_outputs)."""
        with np.errstate(invalid="ignore"):
            error = self.root * (y[:, self.n_first :] - self.target[:, self.n_first :])
        return np.where(np.isnan(self.target[:, self.n_first :]), 0.0, error)

    def penalty(self, model: Any) -> np.ndarray:
        """Penalty of every entry of theta, (n_theta,)."""
        return self.alpha * (np.arange(model.theta.size) < model.n_weights)

    def pull(self, model: Any) -> np.ndarray:
        """Half the slope of the penalty, (n_theta,)."""
        return self.penalty(model) * model.theta

    def value(self, model: Any, y: np.ndarray) -> float:
        """The loss; inf where a run diverged."""
        with np.errstate(over="ignore", invalid="ignore"):
            total = float((self.errors(y) ** 2).sum() + self.penalty(model) @ model.theta**2)
        return total if np.isfinite(total) else np.inf

    def slopes(self, model: LagNet, y: np.ndarray) -> np.ndarray:
        """Slopes of the free runs by the weights, (n_runs, n_steps - n_first, n_outputs, n_theta)."""
        return sensitivities(model, self.U, y, self.n_first)

    def jacobian(self, model: Any, y: np.ndarray) -> np.ndarray:
        """Slopes of :meth:`errors` by the weights, (n_runs, n_steps - n_first, n_outputs, n_theta)."""
        J = self.slopes(model, y)
        if self.weight is not None:
            J *= np.sqrt(self.weight)[:, None, None, None]
        known = ~np.isnan(self.target[:, self.n_first :])
        if not known.all():
            J[~known] = 0.0
        return J

    @property
    def n_rows(self) -> float:
        """Measured numbers, each counted with its weight."""
        known = (~np.isnan(self.target[:, self.n_first :])).sum(axis=(1, 2))
        return float(known.sum() if self.weight is None else known @ self.weight)

    def gradient(self, model: LagNet, y: np.ndarray) -> np.ndarray:
        """Half the slope of the loss, (n_theta,)."""
        slope = adjoint_gradient(model, self.U, y, self.n_first, self.root * self.errors(y))
        return slope + self.pull(model)


def adam(loss: FreeRunLoss, model: LagNet, n_steps: int = 200, rate: float = 0.03) -> LagNet:
    """Adam with a rate that falls to nothing; returns the best weights seen."""
    y = loss.run(model)
    best, best_value = model, loss.value(model, y)
    first, second = np.zeros(model.theta.size), np.zeros(model.theta.size)
    for step in range(1, n_steps + 1):
        value = loss.value(model, y)
        if value < best_value:
            best, best_value = model, value
        gradient = loss.gradient(model, y) if np.isfinite(value) else np.array(np.nan)
        if not np.isfinite(gradient).all():  # back to the best, more slowly
            model, rate = best, rate / 3
            y = loss.run(model)
            first[:] = 0.0
            if not np.isfinite(loss.value(model, y)):
                return best
            continue
        first = 0.9 * first + 0.1 * gradient
        second = 0.999 * second + 0.001 * gradient**2
        move = first / (1 - 0.9**step) / (np.sqrt(second / (1 - 0.999**step)) + 1e-12)
        fall = 0.5 + 0.5 * np.cos(np.pi * step / (n_steps + 1))
        model = model.at(model.theta - rate * fall * move)
        y = loss.run(model, y, 1e-7)  # a gradient needs no more digits
    return model if loss.value(model, y) < best_value else best


def levenberg_marquardt(loss: Loss, model: Any, max_iter: int = 100, tol: float = 1e-6) -> tuple[Any, float]:
    """Levenberg-Marquardt with exact sensitivities; returns weights and loss."""
    return descend(loss, model, max_iter, tol)[:2]


def descend(
    loss: Loss, model: Any, max_iter: int, tol: float, guess: np.ndarray | None = None
) -> tuple[Any, float, np.ndarray]:
    """:func:`levenberg_marquardt` from free runs that are known nearly; returns weights, loss and free runs."""
    y = loss.run(model, guess)
    value = loss.value(model, y)
    damping, penalty, slow = 1e-3, loss.penalty(model), 0
    for _ in range(max_iter if np.isfinite(value) else 0):
        J, e = loss.jacobian(model, y).reshape(-1, model.theta.size), loss.errors(y).ravel()
        theta = model.theta
        normal = J.T @ J
        normal[np.diag_indices_from(normal)] += penalty
        gradient = J.T @ e + loss.pull(model)
        if not np.all(np.isfinite(normal)):
            break
        size = np.maximum(np.diag(normal), 1e-9 * np.diag(normal).max() + 1e-300)
        before = value
        for trial_number in range(14):
            try:
                factor = cho_factor(normal + damping * np.diag(size))
            except LinAlgError:
                damping *= 8
                continue
            step = -cho_solve(factor, gradient)
            probed = loss.errors(loss.run(model.at(theta + PROBE * step), y, 1e-9)).ravel()
            correction = -cho_solve(factor, J.T @ second_order(e, probed, J @ step), check_finite=False)
            trial = model.at(theta + bent(step, correction, size))
            y_trial = loss.run(trial, y)
            new = loss.value(trial, y_trial)
            if new < value:
                gain = (value - new) / max(step @ (damping * size * step - gradient), 1e-300)
                model, value, y = trial, new, y_trial
                # a damping that has just failed fails again as a rule
                lower = 0.2 if gain > 0.75 and not trial_number else 0.5 if gain > 0.25 else 2.0
                damping = max(damping * lower, 1e-12)
                break
            damping *= 3
        slow = slow + 1 if before - value <= tol * before else 0
        if slow >= 2 or value >= before:
            break
    return model, value, y


def fit_free_run(
    loss: FreeRunLoss, starts: Sequence[LagNet], max_iter: int = 200, tol: float = 1e-6
) -> tuple[LagNet, float]:
    """Adam, then Levenberg-Marquardt; a model without hidden layers needs no Adam.

    Of several starts each goes half of Adam's way and some steps further; the best goes to the end. Of many rows this
    far a part is enough.

    ``starts``: starting weights; their free runs must be finite.
    ``max_iter``: steps of Levenberg-Marquardt at most.
    ``tol``: relative decrease below which Levenberg-Marquardt stops.
    Returns ``model``, ``value``.
    """
    some = loss.some(BASIN_ROWS)
    if len(starts) == 1:
        best = adam(some, starts[0], ADAM_STEPS) if starts[0].net.activations else starts[0]
    else:
        tried = [levenberg_marquardt(some, adam(some, start, ADAM_STEPS // 2), SHORT, tol) for start in starts]
        tried.sort(key=lambda found: found[1])
        finite = (model for model, _ in tried if some is loss or np.isfinite(loss.value(model, loss.run(model))))
        best = next(finite, tried[0][0])
    return levenberg_marquardt(loss, best, max_iter, tol)
