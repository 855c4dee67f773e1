"""Time-series models around regressors (lags, derivatives, states), and hybrids of a simulator and a learned correction."""

from sksurrogate.compose._derivative import DerivativeRegressor
from sksurrogate.compose._hybrid import HybridRegressor
from sksurrogate.compose._recursive import RecursivePredictor
from sksurrogate.compose._state_space import StateSpaceRegressor
from sksurrogate.compose._validity import CoverageReport, coverage_report

__all__ = [
    "CoverageReport",
    "DerivativeRegressor",
    "HybridRegressor",
    "RecursivePredictor",
    "StateSpaceRegressor",
    "coverage_report",
]
