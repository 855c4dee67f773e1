"""A fitted residual as a plain function of features."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from sksurrogate.compose._skip_net import as_skip_net


class Deviation:
    """A predictor of the output as one of the deviation: what it adds to the simulator's output, the last features."""

    def __init__(self, step: Any, n_outputs: int):
        self.step, self.n_outputs = step, n_outputs

    def __call__(self, phi: np.ndarray) -> np.ndarray:
        return self.step(phi) - phi[:, -self.n_outputs :]


class _Predict:
    """A fitted regressor as a function of features, always with two dimensions."""

    def __init__(self, residual: Any):
        self.residual = residual

    def __call__(self, phi: np.ndarray) -> np.ndarray:
        return np.asarray(self.residual.predict(phi)).reshape(len(phi), -1)


class _Polynomial:
    """The default of the static forms (scaler, polynomials, scaler, ridge) in plain numpy."""

    def __init__(self, steps: Sequence[Any]):
        self.scale, poly, second, ridge = steps
        index = [np.repeat(np.arange(len(row)), row) for row in poly.powers_]
        self.table = np.full((max(len(i) for i in index), len(index)), poly.n_features_in_)
        for column, factors in enumerate(index):
            self.table[: len(factors), column] = factors
        coef = np.atleast_2d(ridge.coef_) / second.scale_
        self.coef, self.intercept = coef.T, np.atleast_1d(ridge.intercept_) - coef @ second.mean_

    def __call__(self, phi: np.ndarray) -> np.ndarray:
        z = np.concatenate([(phi - self.scale.mean_) / self.scale.scale_, np.ones((len(phi), 1))], axis=1)
        product = z[:, self.table[0]]
        for row in self.table[1:]:
            product = product * z[:, row]
        return product @ self.coef + self.intercept


def compiled(residual: Any) -> Callable[[np.ndarray], np.ndarray]:
    """The prediction of a fitted residual on (n_rows, n_features) as (n_rows, n_outputs); plain numpy where possible."""
    net = as_skip_net(residual)
    if net is not None:
        return net
    steps = [step for _, step in getattr(residual, "steps", None) or []]
    kinds = [type(step).__name__ for step in steps]
    if kinds == ["StandardScaler", "PolynomialFeatures", "StandardScaler", "Ridge"]:
        return _Polynomial(steps)
    return _Predict(residual)
