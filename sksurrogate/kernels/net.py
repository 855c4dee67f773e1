"""A feedforward network as plain arrays, and the lag model y[t] = net(past outputs, inputs) around it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np


@dataclass(frozen=True)
class Net:
    """A feedforward network on ``(phi - mean) / scale``; without hidden layers a linear model."""

    weights: tuple[np.ndarray, ...]  #: tuple of (n_in, n_out)
    biases: tuple[np.ndarray, ...]  #: tuple of (n_out,)
    activations: tuple[str, ...]  #: One a hidden layer; the last layer is linear
    #: mean, scale: (n_features,)
    mean: np.ndarray
    scale: np.ndarray

    @cached_property
    def theta(self) -> np.ndarray:
        """All weights, then all biases, flat."""
        return np.concatenate([w.ravel() for w in (*self.weights, *self.biases)])

    @property
    def n_weights(self) -> int:
        """Entries of ``theta`` that are weights."""
        return sum(w.size for w in self.weights)

    def at(self, theta: np.ndarray) -> Net:
        """The same network with other weights."""
        parts, place = [], 0
        for w in (*self.weights, *self.biases):
            parts.append(theta[place : place + w.size].reshape(w.shape))
            place += w.size
        n = len(self.weights)
        return replace(self, weights=tuple(parts[:n]), biases=tuple(parts[n:]))

    def folded(self) -> Net:
        """The same function without scaling and without logistic layers (they are tanh layers of other weights)."""
        weights, biases = list(self.weights), list(self.biases)
        weights[0] = weights[0] / self.scale[:, None]
        biases[0] = biases[0] - self.mean @ weights[0]
        for k, kind in enumerate(self.activations):
            if kind == "logistic":  # 1 / (1 + exp(-z)) = 1/2 + tanh(z / 2) / 2
                weights[k], biases[k] = weights[k] / 2, biases[k] / 2
                biases[k + 1] = biases[k + 1] + weights[k + 1].sum(axis=0) / 2
                weights[k + 1] = weights[k + 1] / 2
        kinds = tuple("tanh" if kind == "logistic" else kind for kind in self.activations)
        n = len(self.mean)
        return Net(tuple(weights), tuple(biases), kinds, np.zeros(n), np.ones(n))

    def __call__(self, phi: np.ndarray) -> np.ndarray:
        """(n_rows, n_features) -> (n_rows, n_outputs)."""
        x = (phi - self.mean) / self.scale
        return self.layers((x @ self.weights[0] + self.biases[0]).T)[-1].T

    def layers(self, z: np.ndarray) -> list[np.ndarray]:
        """Values of every layer from the first layer's sums (n_units, n_rows), units first; the last is the output."""
        values = []
        for w, b, kind in zip(self.weights[1:], self.biases[1:], self.activations):
            values.append(activate(kind, z))
            z = w.T @ values[-1]
            z += b[:, None]
        return [*values, z]

    def back(self, values: list[np.ndarray], output: int) -> list[np.ndarray]:
        """Slopes of one output by every layer's sums, (n_units, n_rows) each, the first layer first."""
        found = [np.ones((1, values[0].shape[1]))] if len(self.weights) == 1 else []
        if found:
            return [np.repeat(np.eye(len(values[0]))[:, output : output + 1], values[0].shape[1], axis=1)]
        found = [np.eye(len(values[-1]))[:, output : output + 1]]
        for w, kind, value in zip(reversed(self.weights[1:]), reversed(self.activations), reversed(values[:-1])):
            found.append((w @ found[-1]) * slope(kind, value))
        return found[::-1]

    def by_theta(self, x: np.ndarray, values: list[np.ndarray], backs: list[np.ndarray], out: np.ndarray) -> None:
        """Slopes of one output by the weights into ``out`` (n_theta, n_rows); x is scaled, (n_features, n_rows)."""
        place = 0
        for below, back in zip([x, *values[:-1]], backs):
            for row in below:
                np.multiply(row, back, out=out[place : place + len(back)])
                place += len(back)
        for back in backs:
            out[place : place + len(back)] = back
            place += len(back)


def activate(kind: str, z: np.ndarray) -> np.ndarray:
    """Value of an activation."""
    if kind == "tanh":
        return np.tanh(z)
    if kind == "logistic":
        return 0.5 + 0.5 * np.tanh(0.5 * z)
    return np.maximum(z, 0.0) if kind == "relu" else z


def slope(kind: str, value: np.ndarray) -> np.ndarray:
    """Slope of an activation from its value."""
    if kind == "tanh":
        return 1.0 - value * value
    if kind == "logistic":
        return value * (1.0 - value)
    return (value > 0).astype(float) if kind == "relu" else np.ones_like(value)


@dataclass(frozen=True)
class LagNet:
    """``y[t] = net(y[t-1], ..., u[t], ...)``: past outputs lag by lag, then inputs."""

    net: Net
    output_lags: tuple[int, ...]
    input_terms: tuple[tuple[int, int], ...]  #: tuple of (int, int): column and lag of every input feature
    n_outputs: int

    @property
    def longest(self) -> int:
        """Rows of history that one step needs."""
        return max([*self.output_lags, *(lag for _, lag in self.input_terms)])

    @property
    def n_past(self) -> int:
        """Features that are past outputs."""
        return len(self.output_lags) * self.n_outputs

    @property
    def theta(self) -> np.ndarray:
        """All weights, then all biases, flat."""
        return self.net.theta

    @property
    def n_weights(self) -> int:
        """Entries of ``theta`` that are weights."""
        return self.net.n_weights

    def at(self, theta: np.ndarray) -> LagNet:
        """The same model with other weights."""
        return replace(self, net=self.net.at(theta))

    def folded(self) -> LagNet:
        """The same model without scaling inside."""
        return replace(self, net=self.net.folded())

    def past_rows(self, y: np.ndarray, n_first: int) -> np.ndarray:
        """Past outputs of steps n_first.. of y (n_runs, n_steps, n_outputs), (n_past, n_runs * n)."""
        return lag_rows(y, [(i, k) for k in self.output_lags for i in range(self.n_outputs)], n_first)

    def input_rows(self, U: np.ndarray, n_first: int) -> np.ndarray:
        """Input features of steps n_first.. of U (n_runs, n_steps, n_inputs), (n_known, n_runs * n)."""
        return lag_rows(U, self.input_terms, n_first)


def lag_rows(values: np.ndarray, columns: Sequence[tuple[int, int]], n_first: int) -> np.ndarray:
    """``out[i, r, t] = values[r, n_first + t - lag_i, column_i]``, flattened over runs and steps."""
    n_runs, n_steps, _ = values.shape
    out = np.empty((len(columns), n_runs, n_steps - n_first))
    for i, (column, lag) in enumerate(columns):
        out[i] = values[:, n_first - lag : n_steps - lag, column]
    return out.reshape(len(columns), -1)
