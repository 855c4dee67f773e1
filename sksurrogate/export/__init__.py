"""Export of fitted models and simulators: plain numpy with exact Jacobians, CasADi, C code, ONNX, FMU."""

from sksurrogate.export._casadi import to_c, to_casadi
from sksurrogate.export._describe import to_graph
from sksurrogate.export._fmu import to_fmu
from sksurrogate.export._graph import Graph
from sksurrogate.export._jacobian import input_jacobian
from sksurrogate.export._onnx import to_onnx
from sksurrogate.export._state_space import StateSpace, state_space

__all__ = ["Graph", "StateSpace", "input_jacobian", "state_space", "to_c", "to_casadi", "to_fmu", "to_graph", "to_onnx"]
