"""Estimators around estimators and simulators."""

from sksurrogate.compose._derivative import DerivativeRegressor
from sksurrogate.compose._hybrid import HybridRegressor
from sksurrogate.compose._recursive import RecursivePredictor

__all__ = ["DerivativeRegressor", "HybridRegressor", "RecursivePredictor"]
