"""Secondary losses of linear fits (paper, section 2.3): each is a few rows ``L theta ~ t``."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations
from math import prod
from typing import Any

import numpy as np

from sksurrogate.exceptions import DataError


@dataclass(frozen=True, eq=False)
class Situation:
    """What a penalty or constraint may know of the fit."""

    phi: Callable[[np.ndarray], np.ndarray]  #: Points (n_points, n_inputs) -> features (n_points, n_features)
    #: Points -> derivative of the features by the inputs (n_points, n_features, n_inputs)
    gradient: Callable[[np.ndarray], np.ndarray]
    n_inputs: int
    n_features: int
    n_outputs: int
    #: low, high: (n_inputs,): range of the training inputs
    low: np.ndarray
    high: np.ndarray
    #: Where neighbouring coefficients stand: n in a row, or the shape of a tensor
    blocks: Sequence[int | tuple[int, ...]]

    def points(self, points: Any, name: str) -> np.ndarray:
        """Points as a table with one column an input."""
        table = np.asarray(points, dtype=float)
        if table.ndim == 1 and self.n_inputs == 1:
            table = table[:, None]
        if table.ndim != 2 or table.shape[1] != self.n_inputs:
            raise DataError(
                f"{name}: points have shape {np.shape(points)}, expected (n_points, {self.n_inputs}), "
                "in the columns of the X given to fit."
            )
        if not np.all(np.isfinite(table)):
            raise DataError(f"{name}: points hold NaN or infinity; leave those rows out.")
        return table

    def outputs(self, values: Any, n: int, name: str) -> np.ndarray:
        """Values as (n, n_outputs); numbers and single columns are spread."""
        array = np.asarray(values, dtype=float)
        if array.ndim == 1 and (self.n_outputs == 1 or len(array) != self.n_outputs):
            array = array[:, None]
        try:
            return np.broadcast_to(array, (n, self.n_outputs))
        except ValueError:
            raise DataError(
                f"{name} has shape {np.shape(values)}, expected a number, ({n},) or ({n}, {self.n_outputs})."
            ) from None

    def parameters(self, values: Any, name: str) -> np.ndarray:
        """Values a parameter as (n_features, n_outputs), from a number, (n_features,) or (n_outputs, n_features)."""
        array = np.asarray(values, dtype=float)
        try:
            return np.broadcast_to(array, (self.n_outputs, self.n_features)).T
        except ValueError:
            raise DataError(
                f"{name} has shape {array.shape}, expected a number, ({self.n_features},) or "
                f"({self.n_outputs}, {self.n_features}) as coef_."
            ) from None

    def matrix(self, matrix: Any, name: str) -> np.ndarray:
        """Rows that act on the coefficients, with a zero for the intercept unless a column for it is there."""
        rows = np.atleast_2d(np.asarray(matrix, dtype=float))
        if rows.ndim == 2 and rows.shape[1] == self.n_features:
            return no_intercept(rows)
        if rows.ndim == 2 and rows.shape[1] == self.n_features + 1:
            return rows
        raise DataError(
            f"{name}: matrix has shape {np.shape(matrix)}, expected (n_rows, {self.n_features}), one column a "
            f"feature, or (n_rows, {self.n_features + 1}) with the intercept as the last column."
        )

    def predictor(self, points: np.ndarray) -> np.ndarray:
        """Rows that make y-hat at the points."""
        return np.hstack([self.phi(points), np.ones((len(points), 1))])


def no_intercept(rows: np.ndarray) -> np.ndarray:
    """Rows that do not touch the intercept."""
    return np.hstack([rows, np.zeros((len(rows), 1))])


class BasePenalty(ABC):
    """A secondary loss ``weight * |L theta - t|^2``, theta with the intercept as its last row.

    Examples
    --------
    >>> import numpy as np
    >>> from sksurrogate.linear import BasePenalty, PenalizedRegressor
    >>> class Sum(BasePenalty):   # the coefficients add up to one
    ...     weight = 1.0
    ...     def rows(self, at):
    ...         return np.r_[np.ones(at.n_features), 0.0][None, :], np.ones((1, at.n_outputs))
    >>> model = PenalizedRegressor([Sum()], alpha=1e8).fit([[1.0, 0.0], [0.0, 1.0], [1.0, 1.0]], [1.0, 3.0, 4.0])
    >>> round(float(model.coef_.sum()), 3)
    1.0
    """

    weight: float

    @abstractmethod
    def rows(self, at: Situation) -> tuple[np.ndarray, np.ndarray]:
        """L (n_rows, n_features + 1) and t (n_rows, n_outputs)."""


@dataclass(frozen=True, eq=False)
class Ridge(BasePenalty):
    """Sum of squared coefficients (Tikhonov, weight decay); the intercept is free. Paper 2.3 (i).

    Parameters
    ----------
    weight : float, default=1.0
        Beside the other penalties; alpha multiplies them all.

    Examples
    --------
    >>> import numpy as np
    >>> from sksurrogate.linear import PenalizedRegressor, Ridge
    >>> X = np.linspace(0, 1, 20)[:, None]
    >>> model = PenalizedRegressor([Ridge()], alpha=1.0).fit(X, 2 * X[:, 0])
    >>> bool(0 < model.coef_[0] < 2)   # drawn towards 0
    True
    """

    weight: float = 1.0

    def rows(self, at: Situation) -> tuple[np.ndarray, np.ndarray]:
        """The identity."""
        return no_intercept(np.eye(at.n_features)), np.zeros((at.n_features, at.n_outputs))


@dataclass(frozen=True, eq=False)
class RidgeTo(BasePenalty):
    """Squared distance of the coefficients from a prior ``theta0``. Paper 2.3 (ii).

    Parameters
    ----------
    theta0 : float or array-like (n_features,) or (n_outputs, n_features)
    weight : float, default=1.0

    Examples
    --------
    >>> import numpy as np
    >>> from sksurrogate.linear import PenalizedRegressor, RidgeTo
    >>> X = np.linspace(0, 1, 20)[:, None]
    >>> model = PenalizedRegressor([RidgeTo(1.0)], alpha=1e6).fit(X, 2 * X[:, 0])
    >>> round(float(model.coef_[0]), 3)   # the prior wins
    1.0
    """

    theta0: Any
    weight: float = 1.0

    def rows(self, at: Situation) -> tuple[np.ndarray, np.ndarray]:
        """The identity, with the prior as target."""
        return no_intercept(np.eye(at.n_features)), at.parameters(self.theta0, "RidgeTo(theta0=...)")


@dataclass(frozen=True, eq=False)
class CloseTo(BasePenalty):
    """Squared distance of y-hat from a solution given beforehand. Paper 2.3 (iii).

    Parameters
    ----------
    points : array-like (n_points, n_inputs)
        In the columns of the X given to fit.
    values : array-like (n_points,) or (n_points, n_outputs), callable, or fitted estimator
        The solution there: numbers, ``values(points)``, or ``values.predict(points)``.
    weight : float, default=1.0

    Examples
    --------
    >>> import numpy as np
    >>> from sksurrogate.linear import CloseTo, PenalizedRegressor
    >>> X = np.linspace(0, 1, 20)[:, None]
    >>> model = PenalizedRegressor([CloseTo(X, lambda p: 1 - p[:, 0])], alpha=1e6).fit(X, X[:, 0])
    >>> bool(abs(model.predict([[0.0]])[0] - 1) < 1e-3)
    True
    """

    points: Any
    values: Any
    weight: float = 1.0

    def rows(self, at: Situation) -> tuple[np.ndarray, np.ndarray]:
        """The predictor at the points, with the solution as target."""
        points = at.points(self.points, "CloseTo")
        values = self.values
        if hasattr(values, "predict"):
            values = values.predict(points)
        elif callable(values):
            values = values(points)
        return at.predictor(points), at.outputs(values, len(points), "CloseTo(values=...)")


@dataclass(frozen=True, eq=False)
class Slope(BasePenalty):
    """Squared slope: of y-hat at points, or differences of neighbouring coefficients. Paper 2.3 (iii).

    Parameters
    ----------
    points : array-like (n_points, n_inputs), optional
        Where ``dy/dx`` is held small (sum over points and inputs); None: differences of neighbouring coefficients.
    weight : float, default=1.0
    blocks : sequence of int or tuple of int, optional
        Coefficients a block, where differences must not reach from one block into the next (splines of several
        inputs); a tuple is the shape of a tensor, with neighbours along each axis. None: as the transformer
        ``features`` says (``SplineFeatures`` does), else all in a row. Without points only.

    Examples
    --------
    >>> import numpy as np
    >>> from sksurrogate.linear import PenalizedRegressor, Slope
    >>> X = np.linspace(0, 1, 20)[:, None]
    >>> model = PenalizedRegressor([Slope(X)], alpha=1e6).fit(X, X[:, 0])
    >>> bool(np.ptp(model.predict(X)) < 1e-3)   # flat
    True
    """

    points: Any = None
    weight: float = 1.0
    blocks: Sequence[int | tuple[int, ...]] | None = None

    def rows(self, at: Situation) -> tuple[np.ndarray, np.ndarray]:
        """First derivatives or first differences."""
        if self.points is None:
            return _with_zeros(_differences(at, self.blocks, 1, "Slope"), at)
        gradient = at.gradient(at.points(self.points, "Slope"))
        return _with_zeros(np.concatenate([gradient[:, :, j] for j in range(at.n_inputs)]), at)


@dataclass(frozen=True, eq=False)
class Curvature(BasePenalty):
    """Squared curvature: of y-hat at points, or second differences of the coefficients. Paper 2.3 (iii).

    Parameters
    ----------
    points : array-like (n_points, n_inputs), optional
        Where the matrix of second derivatives is held small (Frobenius norm); None: second differences of neighbouring
        coefficients (P-splines of Eilers and Marx).
    weight : float, default=1.0
    blocks : sequence of int, optional
        As in :class:`Slope`.

    Examples
    --------
    >>> import numpy as np
    >>> from sksurrogate.linear import Curvature, PenalizedRegressor
    >>> X = np.linspace(0, 1, 20)[:, None]
    >>> from sksurrogate.features import SplineFeatures
    >>> model = PenalizedRegressor([Curvature(X)], alpha=1e6, features=SplineFeatures(6)).fit(X, X[:, 0] ** 2)
    >>> bool(np.abs(np.diff(model.predict(X), 2)).max() < 1e-3)   # a straight line
    True
    """

    points: Any = None
    weight: float = 1.0
    blocks: Sequence[int | tuple[int, ...]] | None = None

    def rows(self, at: Situation) -> tuple[np.ndarray, np.ndarray]:
        """Second derivatives or second differences."""
        if self.points is None:
            return _with_zeros(_differences(at, self.blocks, 2, "Curvature"), at)
        points = at.points(self.points, "Curvature")
        step = 1e-3 * np.where(at.high > at.low, at.high - at.low, 1.0)
        centre = np.clip(points, at.low + step, np.maximum(at.high - step, at.low + step))
        middle, parts = at.phi(centre), []
        for j in range(at.n_inputs):
            h = np.zeros(at.n_inputs)
            h[j] = step[j]
            parts.append((at.phi(centre + h) - 2 * middle + at.phi(centre - h)) / step[j] ** 2)
        for i, j in combinations(range(at.n_inputs), 2):
            a, b = np.zeros(at.n_inputs), np.zeros(at.n_inputs)
            a[i], b[j] = step[i], step[j]
            mixed = at.phi(centre + a + b) - at.phi(centre + a - b) - at.phi(centre - a + b) + at.phi(centre - a - b)
            # it stands twice in the matrix of second derivatives
            parts.append(np.sqrt(2.0) * mixed / (4 * step[i] * step[j]))
        return _with_zeros(np.concatenate(parts), at)


@dataclass(frozen=True, eq=False)
class Rows(BasePenalty):
    """Any quadratic loss ``|matrix theta - target|^2``.

    Parameters
    ----------
    matrix : array-like (n_rows, n_features) or (n_rows, n_features + 1)
        The last column of the wider form acts on the intercept.
    target : float or array-like (n_rows,) or (n_rows, n_outputs), default=0.0
    weight : float, default=1.0

    Examples
    --------
    >>> import numpy as np
    >>> from sksurrogate.linear import PenalizedRegressor, Rows
    >>> X, y = [[1.0, 0.0], [0.0, 1.0], [1.0, 1.0]], [1.0, 3.0, 4.0]
    >>> equal = Rows([[1.0, -1.0]])   # both coefficients alike
    >>> bool(abs(np.diff(PenalizedRegressor([equal], alpha=1e8).fit(X, y).coef_)[0]) < 1e-6)
    True
    """

    matrix: Any
    target: Any = 0.0
    weight: float = 1.0

    def rows(self, at: Situation) -> tuple[np.ndarray, np.ndarray]:
        """As given."""
        rows = at.matrix(self.matrix, "Rows")
        return rows, at.outputs(self.target, len(rows), "Rows(target=...)")


def _with_zeros(rows: np.ndarray, at: Situation) -> tuple[np.ndarray, np.ndarray]:
    """Rows that leave the intercept free and aim at zero."""
    return no_intercept(rows), np.zeros((len(rows), at.n_outputs))


def _differences(at: Situation, blocks: Sequence[int | tuple[int, ...]] | None, order: int, name: str) -> np.ndarray:
    """Differences of neighbouring coefficients within each block."""
    shapes = [tuple(np.atleast_1d(block).tolist()) for block in (at.blocks if blocks is None else blocks)]
    if sum(map(prod, shapes)) != at.n_features or min(map(min, shapes)) < 1:
        raise DataError(f"{name}: blocks={blocks!r} must be positive and sum to the {at.n_features} features.")
    parts, start = [], 0
    for shape in shapes:
        size = prod(shape)
        unit = np.eye(size).reshape(*shape, size)
        for axis in range(len(shape)):
            steps = np.diff(unit, order, axis=axis).reshape(-1, size)
            parts.append(np.zeros((len(steps), at.n_features)))
            parts[-1][:, start : start + size] = steps
        start += size
    return np.concatenate(parts)
