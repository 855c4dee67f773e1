"""Feedforward networks (paper, section 3)."""

from sksurrogate.neural._fnn import FNNRegressor

__all__ = ["FNNRegressor"]
