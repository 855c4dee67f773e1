"""What the feature maps share: one basis for each input, side by side or multiplied."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from itertools import product
from math import prod
from typing import Any

import numpy as np
from sklearn.base import BaseEstimator, TransformerMixin, _fit_context
from sklearn.utils._param_validation import StrOptions
from sklearn.utils.validation import _check_feature_names_in, check_is_fitted

from sksurrogate._checks import checked
from sksurrogate.exceptions import DataError
from sksurrogate.kernels.bases import tensor

#: Rows that are worked on at a time.
TRANSFORM_ROWS = 4096
#: More columns than this are taken for a mistake.
MOST_COLUMNS = 10_000_000
INTERACTION = ["boolean", StrOptions({"additive", "tensor"})]


def column_of(values: Any, j: int, n_inputs: int, name: str) -> np.ndarray:
    """Column j of a parameter that is given once for all inputs (1-D) or with one column for each (2-D)."""
    table = np.asarray(values, dtype=float)
    if not np.isfinite(table).all():
        raise DataError(f"{name} holds NaN or infinity: every entry must be a finite number.")
    if table.ndim == 1 and len(table):
        return table
    if table.ndim != 2 or table.shape[1] != n_inputs or not len(table):
        raise DataError(
            f"{name} has shape {table.shape}, but X has {n_inputs} inputs: give a list of numbers for all inputs, "
            f"or an array (n, {n_inputs}) with one column for each."
        )
    return table[:, j]


def rising(points: np.ndarray) -> np.ndarray:
    """Distinct points in rising order; a column that does not move gets a range of its own around its value."""
    distinct = np.unique(points)
    if len(distinct) > 1:
        return distinct
    half = max(0.5, 1e-3 * abs(float(distinct[0])))
    return np.linspace(distinct[0] - half, distinct[0] + half, max(2, len(points)))


class BaseFeatures(TransformerMixin, BaseEstimator, ABC):
    """Base of the feature maps phi(x) of section 2.1; a subclass gives the basis of one input."""

    interaction: Any

    @abstractmethod
    def _learn(self, x: np.ndarray, j: int) -> Any:
        """The basis of input j from its column."""

    @abstractmethod
    def _values(self, basis: Any, x: np.ndarray, derivative: int) -> np.ndarray:
        """The basis at x, or its derivative: (n_samples, n)."""

    @abstractmethod
    def _labels(self, basis: Any, name: str) -> list[str]:
        """Names of the columns of one input."""

    @_fit_context(prefer_skip_nested_validation=True)
    def fit(self, X: Any, y: Any = None) -> BaseFeatures:
        """Learn where the basis functions lie.

        Parameters
        ----------
        X : array-like (n_samples, n_inputs)
        y : ignored

        Returns
        -------
        self
        """
        X = checked(self, X, dtype=np.float64)
        self._learn_all(X)
        if self.n_features_out_ > MOST_COLUMNS:
            raise DataError(
                f"interaction={self.interaction!r} gives {self.n_features_out_} features for {X.shape[1]} inputs, more than "
                f'{MOST_COLUMNS}: use interaction="additive", fewer basis functions, or fewer inputs.'
            )
        return self

    def transform(self, X: Any) -> Any:
        """Features phi(x) of every row.

        Parameters
        ----------
        X : array-like (n_samples, n_inputs)

        Returns
        -------
        ndarray (n_samples, n_features_out)
        """
        return self._evaluate(self._checked(X))

    def jacobian(self, X: Any) -> np.ndarray:
        """Exact slope of every feature with respect to every input.

        Parameters
        ----------
        X : array-like (n_samples, n_inputs)

        Returns
        -------
        ndarray (n_samples, n_features_out, n_inputs)
            At a kink or jump the slope of the piece on which ``transform`` counts the row.
        """
        X = self._checked(X)
        out = np.zeros((len(X), self.n_features_out_, X.shape[1]))
        for j in range(X.shape[1]):
            self._slope(X, j, out[:, :, j])
        return out

    def get_feature_names_out(self, input_features: Any = None) -> np.ndarray:
        """Names of the features.

        Parameters
        ----------
        input_features : array-like of str, optional
            Names of the inputs; by default those seen in ``fit``, else ``x0``, ``x1``, ...

        Returns
        -------
        ndarray of str (n_features_out,)
        """
        check_is_fitted(self, "n_features_out_")
        return np.asarray(self._names(_check_feature_names_in(self, input_features)), dtype=object)

    @property
    def _n_features_out(self) -> int:
        """What scikit-learn asks for."""
        return self.n_features_out_

    @property
    def blocks_(self) -> tuple[tuple[int, ...], ...]:
        """Where neighbours stand: (n_j,) for each input side by side, or one (n_1, n_2, ...) for all products."""
        return (tuple(self._sizes),) if self._multiplied else tuple((size,) for size in self._sizes)

    @property
    def _multiplied(self) -> bool:
        """Whether the bases of the inputs are multiplied."""
        return self.interaction is True or self.interaction == "tensor"

    def _learn_all(self, X: np.ndarray) -> None:
        """Bases of all inputs and the number of features."""
        self.bases_ = [self._learn(x, j) for j, x in enumerate(X.T)]
        sizes = [self._values(basis, x[:1], 0).shape[1] for basis, x in zip(self.bases_, X.T)]
        self._sizes = sizes
        self.n_features_out_ = prod(sizes) if self._multiplied else sum(sizes)

    def _checked(self, X: Any) -> np.ndarray:
        """X as scikit-learn wants it checked."""
        check_is_fitted(self, "n_features_out_")
        return checked(self, X, reset=False, dtype=np.float64)

    def _blocks(self, X: np.ndarray, orders: Sequence[int]) -> list[np.ndarray]:
        """The basis of each input at the rows of X."""
        return [self._values(basis, x, order) for basis, x, order in zip(self.bases_, X.T, orders)]

    def _evaluate(self, X: np.ndarray) -> Any:
        """Features, a block of rows at a time."""
        out = np.empty((len(X), self.n_features_out_))
        none = [0] * X.shape[1]
        for a in range(0, len(X), TRANSFORM_ROWS):
            rows = slice(a, a + TRANSFORM_ROWS)
            blocks = self._blocks(X[rows], none)
            out[rows] = tensor(blocks) if self._multiplied else np.hstack(blocks)
        return out

    def _slope(self, X: np.ndarray, j: int, out: np.ndarray) -> None:
        """Write d phi / d x_j into ``out`` (n_samples, n_features_out), which holds zeros."""
        if self._multiplied:
            out[:] = tensor(self._blocks(X, [int(i == j) for i in range(X.shape[1])]))
        else:
            start = sum(self._sizes[:j])
            out[:, start : start + self._sizes[j]] = self._values(self.bases_[j], X[:, j], 1)

    def _names(self, inputs: Sequence[str]) -> list[str]:
        """Names of all columns; a constant factor is left out of a product's name."""
        labels = [self._labels(basis, str(name)) for basis, name in zip(self.bases_, inputs)]
        if not self._multiplied:
            return [label for group in labels for label in group]
        return ["*".join([label for label in factors if label != "1"]) or "1" for factors in product(*labels)]
