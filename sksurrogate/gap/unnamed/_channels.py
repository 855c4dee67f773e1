"""The channels of a simulator, each made once: signals, times and regions at each place, and the term that is missing there."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Generic

import numpy as np

from sksurrogate.gap.fit._evidence import C
from sksurrogate.gap.results._missing_term import MissingTerm
from sksurrogate.gap.results._table import Table
from sksurrogate.gap.unnamed._channel import Channel
from sksurrogate.gap.unnamed._drivers import Drivers
from sksurrogate.gap.unnamed._formula_regression import Draft
from sksurrogate.gap.unnamed._formula_search import drafts_at
from sksurrogate.gap.unnamed._missing_term import shape_of
from sksurrogate.gap.unnamed._regions import regions
from sksurrogate.gap.unnamed._when import times


class Channels(ABC, Generic[C]):
    """The channels of one null: the simulator, free parameters re-tuned."""

    def __init__(self, null: C):
        self.null = null
        #: By location and kind; None for a place where no signal can be followed
        self.known: dict[tuple[str, str], Channel | None] = {}
        self._drafts: dict[tuple[str, str], list[Draft]] = {}

    @abstractmethod
    def made(self, location: str, kind: str) -> Channel:
        """That of a place; LinAlgError or FloatingPointError where no signal there can be followed."""

    @abstractmethod
    def drivers(self, channel: Channel, changes: Sequence[float] = ()) -> Drivers:
        """Signals that may drive a law at the place of a channel, which may begin at some times."""

    def at(self, location: str, kind: str) -> Channel | None:
        """That of a place; None where no signal there can be followed."""
        if (location, kind) not in self.known:
            try:
                self.known[location, kind] = self.made(location, kind)
            except (np.linalg.LinAlgError, FloatingPointError):  # this place is lost, not the diagnosis
                self.known[location, kind] = None
        return self.known[location, kind]

    def drafts(self, location: str, kind: str) -> list[Draft]:
        """The formulae of most worth at a place, the best first."""
        channel = self.at(location, kind)
        if channel is not None and (location, kind) not in self._drafts:
            self._drafts[location, kind] = drafts_at(self.drivers(channel))
        return self._drafts.get((location, kind), [])

    @property
    def lost(self) -> list[str]:
        """Locations where no signal can be followed."""
        return [location for (location, _), channel in self.known.items() if channel is None]

    def regions_and_times(self, channel: Channel) -> tuple[Table, Table]:
        """Where and when the signal at a place is large."""
        w = channel.force()
        return regions(channel.record, channel.signals, w), times(self.null.problem.record, w)

    def missing_term(self, location: str, kind: str) -> MissingTerm:
        """The shape of what is missing at a place, on top of the null; no curves where no signal there can be followed."""
        channel = self.at(location, kind)
        if channel is None:
            return MissingTerm(location, kind, (), (), ())
        record = self.null.problem.record  # that of a channel may be cut into blocks
        first = record.t[record.starts]
        table = times(record, channel.force())
        changes = [row["start"] for row in table[1:] if row["kind"] == "change"] if np.ptp(first) == 0 else []
        moments = [float(first[0] + moment) for moment in changes]
        drivers = self.drivers(channel, moments)
        return shape_of(drivers, drafts_at(drivers) if moments else self.drafts(location, kind))
