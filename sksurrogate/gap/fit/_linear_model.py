"""A residual that columns explain: their weights under a Gaussian prior, from one Gram."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from sksurrogate.gap.fit._normal_equations import solve

L = TypeVar("L", bound="LinearModel")


@dataclass(frozen=True, eq=False)
class LinearModel:
    """A residual, the columns that explain it, and what holds their weights.

    >>> model = LinearModel.of(np.array([[2.0, 4.0]])).beside(np.array([[[1.0, 2.0]]]))
    >>> flat = model.known.reshape(2, -1)
    >>> model.weights(flat @ flat.T).round(12).tolist()
    [2.0]
    """

    r: np.ndarray  #: (n_outputs, n_samples)
    J: np.ndarray  #: (n_outputs, n_theta, n_samples)
    #: precision, pull: (n_theta,): Gaussian prior of a step
    precision: np.ndarray
    pull: np.ndarray

    @classmethod
    def of(cls, r: np.ndarray) -> LinearModel:
        """A residual that nothing explains."""
        return LinearModel(r, np.zeros((len(r), 0, r.shape[1])), np.zeros(0), np.zeros(0))

    @property
    def known(self) -> np.ndarray:
        """Residual and columns, (n_outputs, 1 + n_theta, n_samples)."""
        return np.concatenate([self.r[:, None], self.J], axis=1)

    def beside(self: L, F: np.ndarray) -> L:
        """The same with further columns, whose weights nothing holds."""
        free = np.zeros(F.shape[1])
        J = np.concatenate([self.J, F], axis=1)
        return replace(self, J=J, precision=np.r_[self.precision, free], pull=np.r_[self.pull, free])

    def weights(self, G: np.ndarray) -> np.ndarray:
        """Of the columns, from the Gram of the residual (first) and of them."""
        if len(G) == 1:
            return np.zeros(0)
        return solve(G[1:, 1:] + np.diag(self.precision), G[1:, 0] + self.pull)
