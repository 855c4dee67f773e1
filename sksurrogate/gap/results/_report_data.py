"""All that a diagnosis returns, without the ways to show it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from sksurrogate.effects._smooth import KINK_SHARPNESS
from sksurrogate.gap.results._data_faults import NO_FAULTS, DataFaults
from sksurrogate.gap.results._effect_estimate import EffectEstimate
from sksurrogate.gap.results._law import Law
from sksurrogate.gap.results._missing_term import MissingTerm
from sksurrogate.gap.results._next_experiment import NextExperiment
from sksurrogate.gap.results._provenance import UNKNOWN_PROVENANCE, Provenance
from sksurrogate.gap.results._reasons import UNDECIDED, Reasons
from sksurrogate.gap.results._remainder import NOTHING_KNOWN, Remainder
from sksurrogate.gap.results._shrink import Shrink
from sksurrogate.gap.results._table import EMPTY, Table
from sksurrogate.gap.results._trace import Trace
from sksurrogate.gap.results._where import Where


@dataclass(frozen=True, eq=False)
class ReportData:
    """Base of :class:`~sksurrogate.gap.GapReport`, which describes the attributes."""

    verdict: str
    sentence: str
    effects: list[EffectEstimate]
    ranking: Table
    retuned: Table
    where: Where
    shrink: Shrink
    missing_term: MissingTerm | None = None
    next_experiment: NextExperiment | None = None
    complete: bool = True
    notes: tuple[str, ...] = ()
    untestable: tuple[str, ...] = ()
    outputs: tuple[str, ...] = ()
    states: tuple[str, ...] = ()
    inputs: tuple[str, ...] = ()
    traces: tuple[Trace, ...] = ()
    seconds: float = float("nan")
    reasons: Reasons = UNDECIDED
    budget: Table = EMPTY
    remainder: Remainder = NOTHING_KNOWN
    units: Mapping[str, str] = field(default_factory=dict)
    nominal: Mapping[str, float] = field(default_factory=dict)
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    provenance: Provenance = UNKNOWN_PROVENANCE
    data: DataFaults = NO_FAULTS
    scale: tuple[float, ...] = ()
    sharpness: float = KINK_SHARPNESS
    mistakes: tuple[str, ...] = ()

    @property
    def law(self) -> Law | None:
        """The formula or curve of the missing term; None where none was found."""
        return None if self.missing_term is None else self.missing_term.law

    @property
    def certified_law(self) -> Law | None:
        """The law that closes a practical share of the gap on runs left out; None without one."""
        return self.law if self.law is not None and self.law.certified else None
