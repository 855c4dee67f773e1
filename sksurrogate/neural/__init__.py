"""Feedforward networks (paper, section 3) and recurrent ones (section 5)."""

from sksurrogate.neural._fnn import FNNRegressor
from sksurrogate.neural._recurrent import RecurrentRegressor

__all__ = ["FNNRegressor", "RecurrentRegressor"]
