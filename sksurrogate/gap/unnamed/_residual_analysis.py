"""What a model leaves: the latent force on top of it, whether that is a law, and the place of the gap."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sksurrogate._parallel._worker_process import WorkerProcess
from sksurrogate.gap.fit._closeness import CLOSED, FAR, NEAR
from sksurrogate.gap.fit._evidence import Evidence
from sksurrogate.gap.unnamed._channels import Channels
from sksurrogate.gap.unnamed._latent_force import LatentForce, Place, latent_force, law_of, places

#: Places that are compared by the law that fits there.
COMPARED = 3


@dataclass(frozen=True, eq=False)
class Remains:
    """What is left of the gap beside the names, and where it was."""

    latent: LatentForce  #: On top of what is named
    law: np.ndarray  #: (n_balances,): R2 of its law on runs left out
    places: list[Place]  #: The most likely first
    gap: LatentForce  #: On top of the simulator: the gap itself, in the balances


class Remaining:
    """What remains, worked out while other questions are asked.

    Parameters
    ----------
    later : Second
        Process for what is wanted later.
    null, first : Evidence
        No effect, and the names that stand at the beginning.
    channels : Channels
        Of the null.
    """

    def __init__(self, later: WorkerProcess, null: Evidence, channels: Channels, first: Evidence, seed: int):
        self.first, self.seed = first, seed
        closed = first.left < CLOSED
        # An open gap takes long to be placed, and without names there is nothing else to be asked meanwhile.
        self.both = both = closed and bool(first.effects)

        def question() -> tuple[tuple[LatentForce, list[Place]], tuple[LatentForce, np.ndarray] | None]:
            return gap_and_places(null, channels, closed), law_left(first, seed) if both else None

        self._pending = later.ask(question)

    def of(self, final: Evidence) -> Remains:
        """Of the names that stand at the end."""
        here = final.candidate is not self.first.candidate or not self.both
        own = law_left(final, self.seed) if here else None
        (force, likely), beside = self._pending.answer()
        found = own or beside
        assert found is not None
        latent, law = found
        return Remains(latent, law, likely, force)


def gap_and_places(null: Evidence, channels: Channels, closed: bool) -> tuple[LatentForce, list[Place]]:
    """The force on top of the simulator, and the places it may come from; a rough look where names have ``closed`` the gap."""
    found = places(null.candidate, rough=closed)
    if not closed and null.left > NEAR:
        found = places_by_law(channels, found)
    return latent_force(null, quiet_sensors=True), found


def law_left(final: Evidence, seed: int) -> tuple[LatentForce, np.ndarray]:
    """The force that is left, and its law where nothing is named: beside names the evidence of a law answers."""
    latent = latent_force(final, quiet_sensors=final.left > FAR)
    return latent, np.zeros(1) if final.effects else law_of(final.candidate, latent, seed)


def places_by_law(channels: Channels, found: Sequence[Place]) -> list[Place]:
    """The most likely places again, each with the law of states and inputs that fits there and a force for the rest.

    A free force follows the gap from many places; a law of states and inputs follows it from the right one.
    """
    if not found:
        return []
    distinct: list[Place] = []
    for place in found:
        if not any(abs(place.log_likelihood - other.log_likelihood) < 1e-9 for other in distinct):
            distinct.append(place)
    again = {}
    for place in distinct[:COMPARED]:
        drafts = channels.drafts(place.location, place.kind)
        if drafts and np.isfinite(drafts[0].level):
            again[place.log_likelihood] = drafts[0].level
    if len(again) < 2:
        return list(found)
    # The others stay as far below as they were.
    drop = max(again) - max(again.values())
    lowest = min(again.values())
    out = [
        replace(p, log_likelihood=again[p.log_likelihood])
        if p.log_likelihood in again
        else replace(p, log_likelihood=min(p.log_likelihood - drop, lowest))
        for p in found
    ]
    return sorted(out, key=lambda place: -place.log_likelihood)
