"""Shooting fit of a lag model: pieces of runs, scale-free loss, starts, penalty on what is not forgotten."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from sklearn.utils.parallel import _get_threadpool_controller

from sksurrogate.kernels.net import LagNet, Net
from sksurrogate.kernels.shooting import FreeRunLoss, fit_free_run, levenberg_marquardt
from sksurrogate.runs import Run


class Scaling:
    """Mean and standard deviation of inputs and outputs; the loss is made of scaled numbers."""

    def __init__(self, runs: Any):
        X, y = np.concatenate([run.X for run in runs]), np.concatenate([run.y for run in runs])
        self.u_mean, self.u_std = X.mean(axis=0), _spread(X)
        self.y_mean, self.y_std = y.mean(axis=0), _spread(y)

    def scaled(self, model: LagNet) -> LagNet:
        """The model in scaled numbers."""
        net, (mean, std) = model.net, self.of_features(model)
        weights, biases = list(net.weights), list(net.biases)
        weights[0] = weights[0] / net.scale[:, None]
        biases[0] = biases[0] + (mean - net.mean) @ weights[0]
        weights[0] = weights[0] * std[:, None]
        weights[-1], biases[-1] = weights[-1] / self.y_std, (biases[-1] - self.y_mean) / self.y_std
        n = len(mean)
        return _with(model, Net(tuple(weights), tuple(biases), net.activations, np.zeros(n), np.ones(n)))

    def raw(self, model: LagNet) -> LagNet:
        """The inverse of :meth:`scaled`."""
        net, (mean, std) = model.net, self.of_features(model)
        weights, biases = list(net.weights), list(net.biases)
        weights[-1], biases[-1] = weights[-1] * self.y_std, biases[-1] * self.y_std + self.y_mean
        return _with(model, Net(tuple(weights), tuple(biases), net.activations, mean, std))

    def of_features(self, model: LagNet) -> tuple[np.ndarray, np.ndarray]:
        """Mean and standard deviation of every feature."""
        return self.of_lags(len(model.output_lags), [j for j, _ in model.input_terms])

    def of_lags(self, n: int, columns: list[int]) -> tuple[np.ndarray, np.ndarray]:
        """Mean and standard deviation of n past outputs and of these columns of the inputs."""
        mean = np.concatenate([np.tile(self.y_mean, n), self.u_mean[columns]])
        return mean, np.concatenate([np.tile(self.y_std, n), self.u_std[columns]])


def shoot(
    model: LagNet,
    runs: Any,
    *,
    n_first: int,
    horizon: int | None,
    alpha: float,
    stability: float,
    n_starts: int,
    random_state: np.random.RandomState,
    max_iter: int = 200,
) -> tuple[LagNet, float]:
    """Fit on free runs; the model's own weights are the start where it is linear.

    Returns ``model``.
    Returns ``loss``: inf where no start gave finite free runs.
    """
    scaling = Scaling(runs)
    U, target = cut_pieces(runs, n_first, horizon)
    U, target = (U - scaling.u_mean) / scaling.u_std, (target - scaling.y_mean) / scaling.y_std
    loss = FreeRunLoss(U, target, n_first, alpha)
    demanding = displaced(loss, stability) if stability > 0 else None
    start = scaling.scaled(model)
    if model.net.activations:
        starts = [start.at(small_weights(start.net, random_state)) for _ in range(n_starts)]
    else:
        for _ in range(30):  # a linear model that diverges is pulled towards rest
            if np.isfinite(loss.value(start, loss.run(start))):
                break
            start = start.at(0.8 * start.theta)
        starts = [start]
    with _get_threadpool_controller().limit(
        limits=1, user_api="blas"
    ):  # small matrices: threads only wait on each other
        found, value = fit_free_run(loss, starts, max_iter=max_iter)
        if demanding is not None:  # started where the data alone are met: from afar it has more poor minima
            found, value = levenberg_marquardt(demanding, found, max_iter)
    return scaling.raw(found), value


def small_weights(net: Net, random_state: np.random.RandomState) -> np.ndarray:
    """Random weights so small that the recursion is stable, (n_theta,); measured: nine starts of ten reach one optimum."""
    parts = [random_state.normal(size=w.shape).ravel() / (3 * np.sqrt(len(w))) for w in net.weights]
    return np.concatenate([*parts, *(np.zeros(len(b)) for b in net.biases)])


def cut_pieces(runs: Any, n_first: int, horizon: int | None) -> tuple[np.ndarray, np.ndarray]:
    """Inputs and outputs of pieces of ``horizon`` steps after their first rows; nan where a piece is shorter.

    Returns (n_pieces, n_first + horizon, n_inputs), (n_pieces, n_first + horizon, n_outputs).
    """
    longest = max(len(run) for run in runs) - n_first
    steps = longest if horizon is None else min(horizon, longest)
    pieces = [(run, start) for run in runs for start in range(n_first, len(run), steps)]
    U = np.zeros((len(pieces), n_first + steps, runs[0].X.shape[1]))
    target = np.full((len(pieces), n_first + steps, runs[0].y.shape[1]), np.nan)
    for k, (run, start) in enumerate(pieces):
        _fill(U[k], target[k], run, start - n_first)
    return U, target


def _fill(U: np.ndarray, target: np.ndarray, run: Run, start: int) -> None:
    """Rows of a run from ``start``; the last input is held."""
    assert run.y is not None
    n = min(len(run) - start, len(U))
    U[:n], target[:n] = run.X[start : start + n], run.y[start : start + n]
    U[n:] = run.X[start + n - 1]


def displaced(loss: FreeRunLoss, stability: float) -> FreeRunLoss:
    """Every piece twice more, started one standard deviation above and below; in its second half it must be back on the data."""
    n, half = loss.n_first, loss.n_first + (loss.target.shape[1] - loss.n_first) // 2
    parts = [loss.target]
    for sign in (1.0, -1.0):
        other = loss.target.copy()
        other[:, :n] += sign
        other[:, n:half] = np.nan
        parts.append(other)
    weight = np.repeat([1.0, stability, stability], len(loss.U))
    return replace(loss, U=np.concatenate([loss.U] * 3), target=np.concatenate(parts), weight=weight)


def _spread(values: np.ndarray) -> np.ndarray:
    """Standard deviation of every column, 1 where it never moves."""
    std = values.std(axis=0)
    return np.where(std > 1e-12 * np.abs(values).max(axis=0), std, 1.0)


def _with(model: LagNet, net: Net) -> LagNet:
    return LagNet(net, model.output_lags, model.input_terms, model.n_outputs)
