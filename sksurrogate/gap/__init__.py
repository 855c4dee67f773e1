"""The diagnosis of the sim-to-real gap."""

from sksurrogate.gap._compare import ComparedRuns, compare_simulators
from sksurrogate.gap._diagnose import GapDiagnoser
from sksurrogate.gap.render._display import GapDisplay
from sksurrogate.gap.render._report import GapReport
from sksurrogate.gap.results._data_faults import DataFault, DataFaults
from sksurrogate.gap.results._effect_estimate import EffectEstimate

__all__ = [
    "ComparedRuns",
    "DataFault",
    "DataFaults",
    "EffectEstimate",
    "GapDiagnoser",
    "GapDisplay",
    "GapReport",
    "compare_simulators",
]
