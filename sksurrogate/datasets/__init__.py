"""Data: the paper's plant, joint logs of robots, and real recordings fetched on demand."""

from sksurrogate.datasets._ball_drops import fetch_ball_drops
from sksurrogate.datasets._experiments import Experiments, simulate_experiments
from sksurrogate.datasets._generators import (
    linear_reactor,
    make_reactor,
    make_reactor_experiments,
    make_reactor_runs,
    reactor_rhs,
)
from sksurrogate.datasets._joint_log import JointLog, load_joint_log
from sksurrogate.datasets._recordings import (
    fetch_cascaded_tanks,
    fetch_heat_exchanger,
    fetch_silverbox,
)

__all__ = [
    "Experiments",
    "JointLog",
    "fetch_ball_drops",
    "fetch_cascaded_tanks",
    "fetch_heat_exchanger",
    "fetch_silverbox",
    "linear_reactor",
    "load_joint_log",
    "make_reactor",
    "make_reactor_experiments",
    "make_reactor_runs",
    "reactor_rhs",
    "simulate_experiments",
]
