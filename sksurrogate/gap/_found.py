"""What a diagnosis knows so far."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from sksurrogate.gap._free_curve import FreeCurve
from sksurrogate.gap._law_rival import LawRival
from sksurrogate.gap._problem import Rival
from sksurrogate.gap._remains import Remains
from sksurrogate.gap._report import NextExperiment, Shrink
from sksurrogate.gap._separate import Slot
from sksurrogate.gap._shrink import HeldOut

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
    finals: list[Rival] = field(default_factory=list)
    experiment: NextExperiment | None = None
    fitted: Rival | None = None
    bounds: tuple[np.ndarray, np.ndarray] | None = None
    shares: list[float] | None = None
    retuned: bool = False
