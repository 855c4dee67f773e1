"""The default residual's map: a linear part plus one layer of tanh units, with exact slopes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sksurrogate.export._scalers import scaling_of


@dataclass(frozen=True, eq=False)
class SkipNet:
    """``f = S'z + W2' tanh(W1'z + b1) + b2`` with ``z = (phi - mean) / scale``."""

    #: mean, scale: (n_features,)
    mean: np.ndarray
    scale: np.ndarray
    skip: np.ndarray  #: (n_features, n_outputs)
    hidden: np.ndarray  #: (n_features, n_units)
    hidden_bias: np.ndarray  #: (n_units,)
    out: np.ndarray  #: (n_units, n_outputs)
    bias: np.ndarray  #: (n_outputs,)

    @property
    def parts(self) -> tuple[np.ndarray, ...]:
        """What is fitted."""
        return self.skip, self.hidden, self.hidden_bias, self.out, self.bias

    @property
    def theta(self) -> np.ndarray:
        """The fitted numbers, flat."""
        return np.concatenate([part.ravel() for part in self.parts])

    @property
    def groups(self) -> np.ndarray:
        """Group of every fitted number, (n_theta,): linear part, hidden weights, output weights; -1: a bias."""
        return np.repeat([0, 1, -1, 2, -1], [part.size for part in self.parts])

    def at(self, theta: np.ndarray) -> SkipNet:
        """The same map with other numbers."""
        found, place = [], 0
        for part in self.parts:
            found.append(theta[place : place + part.size].reshape(part.shape))
            place += part.size
        return replace(self, skip=found[0], hidden=found[1], hidden_bias=found[2], out=found[3], bias=found[4])

    def __call__(self, phi: np.ndarray) -> np.ndarray:
        """(n_rows, n_features) -> (n_rows, n_outputs)."""
        z = (phi - self.mean) / self.scale
        return z @ self.skip + np.tanh(z @ self.hidden + self.hidden_bias) @ self.out + self.bias

    def jacobians(self, phi: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Value, slopes (n_rows, n_outputs, n_features) and (n_rows, n_outputs, n_theta)."""
        z = (phi - self.mean) / self.scale
        h = np.tanh(z @ self.hidden + self.hidden_bias)
        n, o = len(z), self.skip.shape[1]
        gate = (1.0 - h * h)[:, None, :] * self.out.T  # (n_rows, n_outputs, n_units)
        by_phi = (self.skip.T + gate @ self.hidden.T) / self.scale
        one = np.eye(o)
        by_theta = [
            (z[:, None, :, None] * one[:, None, :]).reshape(n, o, -1),
            (z[:, None, :, None] * gate[:, :, None, :]).reshape(n, o, -1),
            gate,
            (h[:, None, :, None] * one[:, None, :]).reshape(n, o, -1),
            np.broadcast_to(one, (n, o, o)),
        ]
        return z @ self.skip + h @ self.out + self.bias, by_phi, np.concatenate(by_theta, axis=2)

    def in_units(self, features: np.ndarray, outputs: np.ndarray) -> SkipNet:
        """The same map in other units: features and outputs are multiplied by these factors."""
        return replace(
            self,
            mean=self.mean * features,
            scale=self.scale * features,
            skip=self.skip * outputs,
            out=self.out * outputs,
            bias=self.bias * outputs,
        )

    def raw(self) -> SkipNet:
        """The same function of unscaled features (mean 0, scale 1)."""
        skip, hidden = self.skip / self.scale[:, None], self.hidden / self.scale[:, None]
        return SkipNet(
            np.zeros_like(self.mean),
            np.ones_like(self.scale),
            skip,
            hidden,
            self.hidden_bias - self.mean @ hidden,
            self.out,
            self.bias - self.mean @ skip,
        )


def merged(nets: Sequence[SkipNet]) -> SkipNet:
    """The mean of several maps, as one map."""
    parts, n = [net.raw() for net in nets], len(nets)
    return SkipNet(
        parts[0].mean,
        parts[0].scale,
        np.mean([p.skip for p in parts], axis=0),
        np.concatenate([p.hidden for p in parts], axis=1),
        np.concatenate([p.hidden_bias for p in parts]),
        np.concatenate([p.out / n for p in parts]),
        np.mean([p.bias for p in parts], axis=0),
    )


#: Linear models whose ``coef_`` and ``intercept_`` are the whole prediction.
_LINEAR_MODELS = ("LinearRegression", "Ridge", "RidgeCV", "Lasso", "LassoCV", "ElasticNet", "ElasticNetCV")


def as_skip_net(estimator: Any) -> SkipNet | None:
    """A fitted linear model or one-layer tanh or logistic network, also behind a scaler that does not clip; None for others."""
    steps = [step for _, step in getattr(estimator, "steps", None) or [("model", estimator)]]
    scalings, model = [scaling_of(step) for step in steps[:-1]], steps[-1]
    if len(scalings) > 1 or any(scaling is None or scaling.bounds is not None for scaling in scalings):
        return None
    kind = type(model).__name__
    if not type(model).__module__.startswith("sklearn."):
        return None
    if kind in _LINEAR_MODELS:
        skip = np.ascontiguousarray(np.atleast_2d(model.coef_).T)
        m, o = skip.shape
        bias = np.broadcast_to(np.atleast_1d(model.intercept_), (o,)).astype(float)
        hidden, hidden_bias, out = np.zeros((m, 0)), np.zeros(0), np.zeros((0, o))
    elif kind == "MLPRegressor" and _one_layer(model):
        (hidden, out), (hidden_bias, bias) = model.coefs_, model.intercepts_
        if model.activation == "logistic":  # 1 / (1 + exp(-z)) = 1/2 + tanh(z / 2) / 2
            hidden, hidden_bias, bias, out = hidden / 2, hidden_bias / 2, bias + out.sum(axis=0) / 2, out / 2
        skip = np.zeros((len(hidden), out.shape[1]))
    else:
        return None
    mean, scale = np.zeros(len(skip)), np.ones(len(skip))
    for scaling in scalings:
        mean, scale = scaling.center, scaling.scale  # type: ignore[union-attr]
    return SkipNet(mean, scale, skip, hidden, hidden_bias, out, bias)


def _one_layer(model: Any) -> bool:
    """Whether an ``MLPRegressor`` has one hidden layer of tanh or logistic units and a linear output."""
    return len(model.coefs_) == 2 and model.activation in ("tanh", "logistic") and model.out_activation_ == "identity"


def write_back(estimator: Any, net: SkipNet) -> None:
    """Put the numbers of a map back into the regressor that :func:`as_skip_net` read."""
    model = getattr(estimator, "steps", [(0, estimator)])[-1][1]
    if hasattr(model, "coefs_"):
        hidden, hidden_bias, out, bias = net.hidden, net.hidden_bias, net.out, net.bias
        if model.activation == "logistic":
            hidden, hidden_bias, out, bias = 2 * hidden, 2 * hidden_bias, 2 * out, bias - out.sum(axis=0)
        model.coefs_, model.intercepts_ = [hidden.copy(), out.copy()], [hidden_bias.copy(), bias.copy()]
        return
    flat = np.ndim(model.coef_) == 1
    model.coef_ = net.skip[:, 0].copy() if flat else net.skip.T.copy()
    model.intercept_ = float(net.bias[0]) if flat else net.bias.copy()
