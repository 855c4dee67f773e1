"""What a model leaves: the latent force on top of it, whether that is a law, and the place of the gap."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sksurrogate._parallel._worker_process import WorkerProcess
from sksurrogate.gap.fit._closeness import CLOSED, FAR, NEAR
from sksurrogate.gap.fit._evidence import Evidence
from sksurrogate.gap.unnamed._channel import Place
from sksurrogate.gap.unnamed._channels import Channels
from sksurrogate.gap.unnamed._latent_force import LatentForce, latent_force, law_of
from sksurrogate.gap.unnamed._likely_place import places, places_by_law


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
