"""A fitted residual as a plain function of features."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from sksurrogate.compose._network import agrees
from sksurrogate.compose._skip_net import as_skip_net
from sksurrogate.export._scalers import Scaling, scaling_of


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

    def __init__(self, first: Scaling, poly: Any, second: Scaling, ridge: Any):
        self.first = first
        index = [np.repeat(np.arange(len(row)), row) for row in poly.powers_]
        self.table = np.full((max([1, *map(len, index)]), len(index)), poly.n_features_in_)
        for column, factors in enumerate(index):
            self.table[: len(factors), column] = factors
        gain, offset = second.affine
        coef = np.atleast_2d(ridge.coef_)
        self.coef, self.intercept = (coef * gain).T, np.atleast_1d(ridge.intercept_) + coef @ offset

    def __call__(self, phi: np.ndarray) -> np.ndarray:
        z = np.concatenate([(phi - self.first.center) / self.first.scale, np.ones((len(phi), 1))], axis=1)
        product = z[:, self.table[0]]
        for row in self.table[1:]:
            product = product * z[:, row]
        return product @ self.coef + self.intercept


def compiled(residual: Any, phi: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """The prediction of a fitted residual on (n_rows, n_features) as (n_rows, n_outputs).

    Plain numpy where that gives what ``predict`` gives, at the training rows ``phi`` and beyond; else ``predict`` itself.
    """
    plain = as_skip_net(residual) or _as_polynomial(residual)
    return plain if plain is not None and agrees(plain, residual, phi) else _Predict(residual)


def _as_polynomial(residual: Any) -> _Polynomial | None:
    """A scaler, polynomials, a scaler, ridge, where no scaler clips; None for others."""
    steps = [step for _, step in getattr(residual, "steps", None) or []]
    if [type(step).__name__ for step in steps[1::2]] != ["PolynomialFeatures", "Ridge"] or len(steps) != 4:
        return None
    first, second = scaling_of(steps[0]), scaling_of(steps[2])
    if first is None or second is None or first.bounds is not None or second.bounds is not None:
        return None
    return _Polynomial(first, steps[1], second, steps[3])
