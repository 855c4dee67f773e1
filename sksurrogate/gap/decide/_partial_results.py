"""What a diagnosis knows so far."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from sksurrogate.gap.decide._equivalence import Slot
from sksurrogate.gap.decide._held_out import HeldOut
from sksurrogate.gap.decide._posterior import Posterior
from sksurrogate.gap.fit._evidence import Evidence
from sksurrogate.gap.fit._problem import Candidate
from sksurrogate.gap.results._next_experiment import NextExperiment
from sksurrogate.gap.results._shrink import Shrink
from sksurrogate.gap.unnamed._free_curve import FreeCurve
from sksurrogate.gap.unnamed._law_rival import LawRival
from sksurrogate.gap.unnamed._residual_analysis import Remains

__all__ = ["Found"]


@dataclass
class Found:
    """Answers as they come in."""

    slots: list[Slot]
    curve: FreeCurve | None = None
    rivals: dict[bool, LawRival | None] = field(default_factory=dict)
    remains: Remains | None = None
    shrink: Shrink | None = None
    held: HeldOut | None = None
    finals: list[Candidate] = field(default_factory=list)
    experiment: NextExperiment | None = None
    fitted: Evidence | None = None
    bounds: tuple[np.ndarray, np.ndarray] | None = None
    shares: list[float] | None = None
    retuning: float = 0.0
    posterior: Posterior | None = None
    probabilities: list[float] = field(default_factory=list)
    retuned: bool = False
