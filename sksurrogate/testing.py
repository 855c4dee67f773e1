"""Checks for extensions: does a simulator, does an effect keep its contract? Our own classes pass them too."""

from sksurrogate._expected_checks import expected_failed_checks
from sksurrogate.effects._check import check_effect
from sksurrogate.physics._check import check_simulator

__all__ = ["check_effect", "check_simulator", "expected_failed_checks"]
