"""Unit steps as features."""

from __future__ import annotations

from numbers import Integral
from typing import Any

import numpy as np
from sklearn.utils._param_validation import Interval, StrOptions

from sksurrogate.features._base import INTERACTION, BaseFeatures, column_of, rising
from sksurrogate.kernels.bases import spline_at_data, steps


class HeavisideFeatures(BaseFeatures):
    """Unit steps H(x - threshold): 0 below the threshold, 1 from it on.

    Splines of order 0 are differences of neighbouring steps (Remark 1), so that both span the same functions; a hidden
    layer of binary steps in a network is the same family again.

    Parameters
    ----------
    thresholds : int, "data" or array-like (n,) or (n, n_inputs), default=10
        An int: that many equidistant thresholds, the first at the least value of the input (its step is the constant).
        "data": half-way between neighbouring values and half a distance outside both ends, one more than distinct values.
    interaction : bool or {"additive", "tensor"}, default=False
        With several inputs: side by side, or all products.

    Attributes
    ----------
    bases_ : list of ndarray
        Thresholds of each input.
    n_features_out_ : int
    n_features_in_ : int
    feature_names_in_ : ndarray of str
        Where X is a frame.

    References
    ----------
    Lie, *Surrogate and Hybrid Models for Control*, SIMS 60 (2019), section 2.2, Remark 1.

    Examples
    --------
    >>> from sksurrogate.features import HeavisideFeatures
    >>> HeavisideFeatures(thresholds=[0.5, 1.0]).fit_transform([[0.0], [0.7], [1.0]])
    array([[0., 0.],
           [1., 0.],
           [1., 1.]])
    """

    _parameter_constraints: dict = {
        "thresholds": [Interval(Integral, 1, None, closed="left"), StrOptions({"data"}), "array-like"],
        "interaction": INTERACTION,
    }

    def __init__(self, thresholds: Any = 10, *, interaction: bool | str = False):
        self.thresholds = thresholds
        self.interaction = interaction

    def _learn(self, x: np.ndarray, j: int) -> np.ndarray:
        if isinstance(self.thresholds, str):
            return spline_at_data(x, 0).knots
        if isinstance(self.thresholds, Integral):
            low, high = rising(np.array([x.min(), x.max()]))[[0, -1]]
            return np.linspace(low, high, int(self.thresholds), endpoint=False)
        return column_of(self.thresholds, j, self.n_features_in_, "thresholds")

    def _values(self, basis: np.ndarray, x: np.ndarray, derivative: int) -> np.ndarray:
        # the slope is zero everywhere but at the jumps
        return np.zeros((len(x), len(basis))) if derivative else steps(x, basis)

    def _labels(self, basis: np.ndarray, name: str) -> list[str]:
        return [f"step{i}({name})" for i in range(len(basis))]
