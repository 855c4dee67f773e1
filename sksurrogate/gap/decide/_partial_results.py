"""What a diagnosis knows so far."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sksurrogate.gap.decide._equivalence import Slot
from sksurrogate.gap.decide._held_out import HeldOut
from sksurrogate.gap.fit._evidence import Evidence
from sksurrogate.gap.results._law import Law
from sksurrogate.gap.results._next_experiment import NextExperiment
from sksurrogate.gap.results._shrink import Shrink


@dataclass
class PartialResults:
    """Answers as they come in."""

    retuned: bool = False
    slots: list[Slot] = field(default_factory=list)
    experiment: NextExperiment | None = None
    finals: list[Any] = field(default_factory=list)
    held: HeldOut | None = None
    shrink: Shrink | None = None
    uncertified: str = ""
    shares: list[float] = field(default_factory=list)
    retuning: float = 0.0
    probabilities: list[float] = field(default_factory=list)
    fitted: Evidence | None = None
    bounds: tuple[np.ndarray, np.ndarray] | None = None
    law: Law | None = None
    lawful: Evidence | None = None
    lawful_fitted: Evidence | None = None
