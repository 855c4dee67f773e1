"""Simulators: the protocol, wrappers, calibration."""

from sksurrogate.physics._calibrate import CalibratedSimulator
from sksurrogate.physics._casadi import CasadiSimulator
from sksurrogate.physics._closed_loop import ClosedLoopSimulator
from sksurrogate.physics._control import ControlSimulator
from sksurrogate.physics._fmu import FMUSimulator
from sksurrogate.physics._linearise import Linearisation, linearise, steady_state
from sksurrogate.physics._mujoco import MuJoCoSimulator
from sksurrogate.physics._ode import ODESimulator
from sksurrogate.physics._simulator import BaseSimulator
from sksurrogate.physics._surrogate import SurrogateSimulator
from sksurrogate.physics._wrappers import CallableSimulator, StepSimulator, TableSimulator

__all__ = [
    "BaseSimulator",
    "CalibratedSimulator",
    "CallableSimulator",
    "CasadiSimulator",
    "ClosedLoopSimulator",
    "ControlSimulator",
    "FMUSimulator",
    "Linearisation",
    "MuJoCoSimulator",
    "ODESimulator",
    "StepSimulator",
    "SurrogateSimulator",
    "TableSimulator",
    "linearise",
    "steady_state",
]
