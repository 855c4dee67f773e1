"""Estimators around estimators and simulators."""

from sksurrogate.compose._hybrid import HybridRegressor

__all__ = ["HybridRegressor"]
