"""What a diagnosis knows so far."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sksurrogate.gap.decide._equivalence import EquivalenceClass
from sksurrogate.gap.decide._held_out import HeldOut
from sksurrogate.gap.decide._law_certificate import CertifiedLaw
from sksurrogate.gap.fit._evidence import Evidence
from sksurrogate.gap.results._law import Law
from sksurrogate.gap.results._next_experiment import NextExperiment
from sksurrogate.gap.results._shrink import Shrink


@dataclass(frozen=True)
class Parts:
    """What of the gap each effect closes, and how probable it is."""

    shares: tuple[float, ...] = ()
    retuning: float = 0.0  #: Share of the re-tuned parameters
    probabilities: tuple[float, ...] = ()


@dataclass(frozen=True, eq=False)
class WithIntervals:
    """What stands, fitted on as much of a long record as is fitted, and the 90 % intervals of its parameters."""

    fitted: Evidence
    low: np.ndarray  #: (n_theta,)
    high: np.ndarray


@dataclass
class PartialResults:
    """Answers as they come in."""

    retuned: bool = False  #: Whether the free parameters are worth their number
    classes: list[EquivalenceClass] = field(default_factory=list)  #: Classes of the effects
    experiment: NextExperiment | None = None
    finals: list[Any] = field(default_factory=list)  #: What the runs outside each fold choose
    held: HeldOut | None = None
    shrink: Shrink | None = None
    uncertified: str = ""  #: Why names were withdrawn
    parts: Parts = Parts()
    values: WithIntervals | None = None
    beside: CertifiedLaw | None = None  #: The law on top of what stands
    law: Law | None = None  #: The same as a result
    #: A rejected effect that closes more of the gap (amplitude) on runs left out than the law, and how much
    nearer: tuple[Evidence, float] | None = None

    def class_of(self, i: int) -> EquivalenceClass:
        """The class of effect i; empty as long as it was not asked for."""
        return self.classes[i] if i < len(self.classes) else EquivalenceClass(i, [])
