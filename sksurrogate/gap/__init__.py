"""The diagnosis of the sim-to-real gap."""

from sksurrogate.gap._diagnose import GapDiagnoser
from sksurrogate.gap._display import GapDisplay
from sksurrogate.gap._report import EffectEstimate, GapReport

__all__ = ["EffectEstimate", "GapDiagnoser", "GapDisplay", "GapReport"]
