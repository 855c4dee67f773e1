"""What no name answers, as far as a simulator's access shows it: the law and the place of what is left."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection
from typing import Any, ClassVar, Generic

import numpy as np

from sksurrogate._parallel._worker_process import PendingAnswer
from sksurrogate.gap.decide._choice_by_fold import choices_by_fold
from sksurrogate.gap.decide._generic_correction import Correction
from sksurrogate.gap.decide._held_out import HeldOut, law_held_out
from sksurrogate.gap.decide._law_certificate import CertifiedLaw
from sksurrogate.gap.decide._posterior import Posterior
from sksurrogate.gap.decide._separations import Separations
from sksurrogate.gap.fit._evidence import C, Evidence
from sksurrogate.gap.fit._explained import NOTHING_HELPS, OtherWriting
from sksurrogate.gap.fit._rounding import Rounding
from sksurrogate.gap.results._table import EMPTY, Table
from sksurrogate.gap.search._set_search import SetSearch
from sksurrogate.gap.unnamed._channel import Place
from sksurrogate.gap.unnamed._channels import Channels
from sksurrogate.gap.unnamed._formula_fit import fitted_laws
from sksurrogate.gap.unnamed._law_left import LawLeft
from sksurrogate.gap.unnamed._likely_place import distinct

#: Formulae that are compared again in every fold.
MOST_FORMULAE = 3


class BaseAccess(ABC, Generic[C]):
    """Questions on top of what is named; those that only a right-hand side answers have no answer here.

    ``complete``: False after an interrupt: nothing that takes long is asked any more.
    ``excluded``: places where a user rules effects out: no law is looked for there.
    """

    #: Whether what needs no name is asked while names are looked for.
    asks_early = False
    #: Which effects were compared, in words.
    among: str
    channels_of: ClassVar[type[Channels]]
    #: How far experiments separate candidates.
    separations: ClassVar[Callable[..., Separations]]
    _channels: Channels[C] | None = None
    scale: np.ndarray | None = None  #: (n_states,): size of the states
    beside: LawLeft | None = None  #: The likeliest law without a name beside what stands, where one was looked for
    law_of_the_gap: LawLeft | None = None  #: The law that explains the gap alone, and better than any one effect
    places: list[Place] | None = None  #: Of the gap, the most likely first; None before what is left was looked at
    other_unit: OtherWriting = NOTHING_HELPS  #: Of the record, in which the simulator alone explains it

    def __init__(self, search: SetSearch[C], seed: int, excluded: Collection[str] = ()):
        self.search, self.seed, self.complete, self.excluded = search, seed, True, frozenset(excluded)

    def sensor_noise(self, final: Evidence[C]) -> np.ndarray:
        """Of every output (n_outputs,), as far as a wrong fit cannot make it larger."""
        return final.noise.sigma

    @abstractmethod
    def correction(self, correction: Any) -> Correction | None:
        """Free runs of the generic learner of the waterfall."""

    def ask_for_another_unit(self) -> None:
        """Whether the record is written in another unit than the simulator's, asked once."""

    def law_left(self, final: Evidence[C]) -> LawLeft | None:
        """The likeliest law beside what is named; None where none is compared with faults of the record."""
        return None

    def ask_for_places(self, final: Evidence[C]) -> PendingAnswer[list[Place]] | None:
        """The places of the gap, worked out while other questions are asked; None where they are not asked early."""
        return None

    def ask_for_the_law_of_the_gap(self) -> None:
        """Whether one law explains the gap, and better than any one effect: then names have its signals."""

    @abstractmethod
    def weigh(self, final: Evidence[C]) -> Posterior:
        """How probable each effect of what stands is."""

    def weigh_none(self) -> None:
        """The law beside no effect at all."""

    @abstractmethod
    def look_at_what_is_left(self, final: Evidence[C]) -> None:
        """What stands above the noise: the law in it, and the places of the gap."""

    @abstractmethod
    def withdraw(self, null: Evidence[C]) -> None:
        """The names are withdrawn: the null stands."""

    # ---- the verdict ------------------------------------------------------------------------------------------------
    def over_noise(self, final: Evidence[C], retuned: bool) -> float:
        """Free-run error that is left, in units of the noise."""
        return final.left

    def rounding(self, final: Evidence[C]) -> Rounding | None:
        """A grid of readings that nothing named explains, where it is coarse enough to matter."""
        return None

    # ---- where ------------------------------------------------------------------------------------------------------
    @abstractmethod
    def likely_place(self, final: Evidence[C]) -> tuple[str | None, str | None]:
        """Location and kind of what has no name."""

    @property
    def channels(self) -> Channels[C]:
        """Of the simulator alone."""
        null = self.search.fitted_null.candidate
        if self._channels is None or self._channels.null is not null:
            self._channels = self.channels_of(null)
        return self._channels

    def where_and_when(self, location: str | None, kind: str | None) -> tuple[Table, Table]:
        """By region and by time, of the signal at a place; at the likeliest place where no signal can be followed there."""
        tried = [(location, kind), *((place.location, place.kind) for place in (self.places or [])[:1])]
        channels = (self.channels.at(name, str(of)) for name, of in tried if name is not None)
        channel = next((one for one in channels if one is not None), None)
        return (EMPTY, EMPTY) if channel is None else self.channels.regions_and_times(channel)

    def law_beside(self, base: Evidence[C], final: Evidence[C], held: HeldOut) -> CertifiedLaw | None:
        """The best law on top of what is certain, at the places that are likeliest, simulated on runs left out."""
        search, same = self.search, base.candidate is self.channels.null
        channels = self.channels if same else self.channels_of(base.candidate)
        laws = fitted_laws(search, base, channels, self.places_of_law(final, bool(base.effects)))
        if not laws:
            return None
        best = laws[0].found
        evidence = search.score(best.candidate) - laws[0].price - search.score(base.candidate)
        choices = [(law.found.candidate, [law.found.noise], 2.0 * law.price) for law in laws[:MOST_FORMULAE]]
        finals = choices_by_fold(search, choices)
        return CertifiedLaw(laws[0], law_held_out(finals, held), self.fitted_on_more(best), evidence)

    @property
    def places_by_kind(self) -> dict[str, Collection[str]]:
        """Where this access lets a law act."""
        plant = self.search.problem.plant
        return {"input": plant.inputs, "output": plant.outputs}

    def places_of_law(self, final: Evidence[C], named: bool) -> list[tuple[str, str]]:
        """Where a law may stand: beside names where the evidence of a law puts it, else the likely place; then the next."""
        beside, by_kind = self.beside, self.places_by_kind
        first = (beside.location, beside.kind) if named and beside is not None else self.likely_place(final)

        def allowed(name: str | None, kind: str | None) -> bool:
            return name in by_kind.get(str(kind), ()) and name not in self.excluded

        found = [place for place in self.places or [] if allowed(place.location, place.kind)]
        others = distinct(sorted(found, key=lambda place: (place.location, place.kind) != first))
        names = [*([first] if allowed(*first) else []), *((place.location, place.kind) for place in others)]
        return list(dict.fromkeys((str(name), str(kind)) for name, kind in names))

    def imitated_by_retuning(self) -> list[tuple[str, str, str | None]]:
        """Effects that the re-tuning would hide."""
        return []

    # ---- long records -----------------------------------------------------------------------------------------------
    def fitted_on_more(self, final: Evidence[C]) -> Evidence[C]:
        """What stands, fitted on more of a long record."""
        return final

    @abstractmethod
    def notes(self, final: Evidence[C], verdict: str) -> list[str]:
        """What a careful reader should know of the simulator and of the data."""
