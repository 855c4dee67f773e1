"""What a model leaves: the latent force on top of it, whether that is a law, and the place of the gap."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sksurrogate.gap.fit._closeness import FAR, NEAR
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
