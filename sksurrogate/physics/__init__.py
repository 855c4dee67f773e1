"""Simulators: the protocol, wrappers, calibration."""

from sksurrogate.physics._ode import ODESimulator
from sksurrogate.physics._simulator import BaseSimulator

__all__ = ["BaseSimulator", "ODESimulator"]
