"""Checks for extensions: does a simulator, does an effect keep its contract? Our own classes pass them too."""

from sksurrogate.effects._check import check_effect

__all__ = ["check_effect"]
