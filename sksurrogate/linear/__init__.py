"""Fits that are linear in their parameters."""

from sksurrogate.linear._constraints import (
    BaseConstraint,
    Bounds,
    LinearEquality,
    LinearInequality,
    Monotone,
    OutputBounds,
)
from sksurrogate.linear._lagged import LaggedLinearRegressor
from sksurrogate.linear._nonlinear_basis import NonlinearBasisRegressor
from sksurrogate.linear._pcr import PCRRegressor
from sksurrogate.linear._penalties import BasePenalty, CloseTo, Curvature, Ridge, RidgeTo, Rows, Slope
from sksurrogate.linear._regressor import PenalizedRegressor
from sksurrogate.linear._sparse import SparseRegressor

__all__ = [
    "BaseConstraint",
    "BasePenalty",
    "Bounds",
    "CloseTo",
    "Curvature",
    "LaggedLinearRegressor",
    "LinearEquality",
    "LinearInequality",
    "Monotone",
    "NonlinearBasisRegressor",
    "OutputBounds",
    "PCRRegressor",
    "PenalizedRegressor",
    "Ridge",
    "RidgeTo",
    "Rows",
    "Slope",
    "SparseRegressor",
]
