"""Constraints of linear fits (paper, section 2.3): rows ``lower <= C theta <= upper``."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any

import numpy as np

from sksurrogate.exceptions import DataError
from sksurrogate.linear._penalties import Situation, no_intercept


class BaseConstraint(ABC):
    """A constraint ``lower <= C theta <= upper``, theta with the intercept as its last row.

    Examples
    --------
    >>> import numpy as np
    >>> from sksurrogate.linear import BaseConstraint, PenalizedRegressor
    >>> class Through(BaseConstraint):   # y-hat is 1 at the origin: the intercept is 1
    ...     def rows(self, at):
    ...         one = np.ones((1, at.n_outputs))
    ...         return np.r_[np.zeros(at.n_features), 1.0][None, :], one, one
    >>> round(float(PenalizedRegressor(constraints=[Through()]).fit([[0.0], [1.0], [2.0]], [0.0, 1.0, 2.0]).intercept_), 6)
    1.0
    """

    @abstractmethod
    def rows(self, at: Situation) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """C (n_rows, n_features + 1), lower and upper (n_rows, n_outputs)."""


@dataclass(frozen=True, eq=False)
class Bounds(BaseConstraint):
    """Bounds on the coefficients, not on the intercept.

    Parameters
    ----------
    lower, upper : float or array-like (n_features,) or (n_outputs, n_features), default=-inf, inf

    Examples
    --------
    >>> from sksurrogate.linear import Bounds, PenalizedRegressor
    >>> model = PenalizedRegressor(constraints=[Bounds(upper=0.5)]).fit([[0.0], [1.0], [2.0]], [0.0, 1.0, 2.0])
    >>> round(float(model.coef_[0]), 6)
    0.5
    """

    lower: Any = -np.inf
    upper: Any = np.inf

    def rows(self, at: Situation) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The identity."""
        lower, upper = (at.parameters(v, f"Bounds({n}=...)") for v, n in ((self.lower, "lower"), (self.upper, "upper")))
        return no_intercept(np.eye(at.n_features)), lower, upper


@dataclass(frozen=True, eq=False)
class LinearEquality(BaseConstraint):
    """``matrix theta = value``.

    Parameters
    ----------
    matrix : array-like (n_rows, n_features) or (n_rows, n_features + 1)
        The last column of the wider form acts on the intercept.
    value : float or array-like (n_rows,) or (n_rows, n_outputs), default=0.0

    Examples
    --------
    >>> from sksurrogate.linear import LinearEquality, PenalizedRegressor
    >>> alike = LinearEquality([[1.0, -1.0]])
    >>> X, y = [[1.0, 0.0], [0.0, 1.0], [1.0, 1.0], [0.0, 0.0]], [1.0, 3.0, 4.0, 0.0]
    >>> PenalizedRegressor(constraints=[alike]).fit(X, y).coef_.round(6).tolist()
    [2.0, 2.0]
    """

    matrix: Any
    value: Any = 0.0

    def rows(self, at: Situation) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """As given."""
        rows = at.matrix(self.matrix, "LinearEquality")
        value = at.outputs(self.value, len(rows), "LinearEquality(value=...)")
        return rows, value, value


@dataclass(frozen=True, eq=False)
class LinearInequality(BaseConstraint):
    """``lower <= matrix theta <= upper``.

    Parameters
    ----------
    matrix : array-like (n_rows, n_features) or (n_rows, n_features + 1)
        The last column of the wider form acts on the intercept.
    upper : float or array-like (n_rows,) or (n_rows, n_outputs), default=0.0
    lower : as upper, default=-inf

    Examples
    --------
    >>> from sksurrogate.linear import LinearInequality, PenalizedRegressor
    >>> no_larger = LinearInequality([[-1.0, 1.0]])   # the second coefficient is not larger than the first
    >>> X, y = [[1.0, 0.0], [0.0, 1.0], [1.0, 1.0], [0.0, 0.0]], [1.0, 3.0, 4.0, 0.0]
    >>> PenalizedRegressor(constraints=[no_larger]).fit(X, y).coef_.round(6).tolist()
    [2.0, 2.0]
    """

    matrix: Any
    upper: Any = 0.0
    lower: Any = -np.inf

    def rows(self, at: Situation) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """As given."""
        rows = at.matrix(self.matrix, "LinearInequality")
        upper, lower = (
            at.outputs(v, len(rows), f"LinearInequality({n}=...)")
            for v, n in ((self.upper, "upper"), (self.lower, "lower"))
        )
        return rows, lower, upper


@dataclass(frozen=True, eq=False)
class OutputBounds(BaseConstraint):
    """Bounds on y-hat over a region, given by points in it.

    Parameters
    ----------
    points : array-like (n_points, n_inputs)
        In the columns of the X given to fit.
    lower, upper : float or array-like (n_points,) or (n_points, n_outputs), default=-inf, inf

    Examples
    --------
    >>> from sksurrogate.linear import OutputBounds, PenalizedRegressor
    >>> capped = OutputBounds([[3.0]], upper=2.0)   # also where there are no data
    >>> model = PenalizedRegressor(constraints=[capped]).fit([[0.0], [1.0], [2.0]], [0.0, 1.0, 2.0])
    >>> round(float(model.predict([[3.0]])[0]), 6)
    2.0
    """

    points: Any
    lower: Any = -np.inf
    upper: Any = np.inf

    def rows(self, at: Situation) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The predictor at the points."""
        points = at.points(self.points, "OutputBounds")
        lower, upper = (
            at.outputs(v, len(points), f"OutputBounds({n}=...)")
            for v, n in ((self.lower, "lower"), (self.upper, "upper"))
        )
        return at.predictor(points), lower, upper


@dataclass(frozen=True, eq=False)
class Monotone(BaseConstraint):
    """y-hat rises (or falls) along one input over a region, given by points in it.

    Parameters
    ----------
    points : array-like (n_points, n_inputs)
        In the columns of the X given to fit; the slope has its sign at each of them.
    input : int, default=0
        Column of the input.
    increasing : bool, default=True

    Examples
    --------
    >>> from sksurrogate.linear import Monotone, PenalizedRegressor
    >>> model = PenalizedRegressor(constraints=[Monotone([[0.0]])]).fit([[0.0], [1.0], [2.0]], [2.0, 1.0, 0.0])
    >>> abs(round(float(model.coef_[0]), 6))   # data that fall, under a model that may not
    0.0
    """

    points: Any
    input: int = 0
    increasing: bool = True

    def rows(self, at: Situation) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The slope at the points."""
        if not -at.n_inputs <= self.input < at.n_inputs:
            raise DataError(f"Monotone(input={self.input}) is out of range: X has {at.n_inputs} columns.")
        slope = at.gradient(at.points(self.points, "Monotone"))[:, :, self.input]
        zero, infinite = np.zeros((len(slope), at.n_outputs)), np.full((len(slope), at.n_outputs), np.inf)
        return no_intercept(slope), *((zero, infinite) if self.increasing else (-infinite, zero))
