"""What a model leaves: the latent force on top of it, whether that is a law, and the place of the gap."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sksurrogate.gap.fit._closeness import FAR
from sksurrogate.gap.fit._evidence import NEARLY_WHITE, NOTHING_LEFT, left
from sksurrogate.gap.fit._problem import Problem, Rival
from sksurrogate.gap.search._expander import Expander
from sksurrogate.gap.unnamed._disturbance_channel import places_by_law
from sksurrogate.gap.unnamed._latent_force import LatentForce, Place, latent_force, law_of, places

__all__ = ["CLOSED", "Remaining", "Remains", "law_left"]

#: Within so many times the noise nothing is left to place: a rough look at the places will do.
CLOSED = 1.2
#: Free runs of the simulator from which the places are told apart by the law that fits there.
LAWFUL = 2.0


@dataclass(frozen=True, eq=False)
class Remains:
    """What is left of the gap beside the names, and where it was.

    Attributes
    ----------
    latent : LatentForce
        On top of what is named.
    law : ndarray (n_balances,)
        R2 of its law on runs left out.
    places : list of Place
        The most accused first.
    gap : LatentForce
        On top of the simulator: the gap itself, in the balances.
    """

    latent: LatentForce
    law: np.ndarray
    places: list[Place]
    gap: LatentForce


class Remaining:
    """What remains, worked out while other questions are asked.

    Parameters
    ----------
    search : Expander
        Its numerics, and whether it wants a second process.
    null, first : Rival
        No effect, and the names that stand at the beginning.
    seed : int
    """

    def __init__(self, search: Expander, null: Rival, first: Rival, seed: int):
        self.search, self.first, self.seed = search, first, seed
        closed = left(first) < CLOSED
        # An open gap takes long to be placed, and without names there is nothing else to be asked meanwhile.
        self.both = both = closed and bool(first.effects)

        problem, at = search.problem, search.at(first)

        def question() -> tuple[tuple[LatentForce, list[Place]], tuple[LatentForce, np.ndarray] | None]:
            gap = gap_and_places(problem, null, closed)
            return gap, law_left(at, first, seed) if both else None

        self._aside = search.later.ask(question)

    def of(self, final: Rival) -> Remains:
        """Of the names that stand at the end."""
        here = final is not self.first or not self.both
        own = law_left(self.search.at(final), final, self.seed) if here else None
        (force, accusable), beside = self._aside.answer()
        told = own or beside
        assert told is not None
        latent, law = told
        return Remains(latent, law, accusable, force)


def gap_and_places(problem: Problem, null: Rival, closed: bool) -> tuple[LatentForce, list[Place]]:
    """The force on top of the simulator, and the places it may come from; a rough look where names have ``closed`` the gap."""
    found = places(problem, null, rough=closed)
    if not closed and left(null) > LAWFUL:
        found = places_by_law(problem, null, found)
    return latent_force(problem, null, quiet_sensors=True), found


def law_left(at: Problem, final: Rival, seed: int) -> tuple[LatentForce, np.ndarray]:
    """The force that is left, and its law."""
    latent = latent_force(at, final, quiet_sensors=left(final) > FAR)
    law = np.zeros(1)
    if not final.effects or left(final) > NOTHING_LEFT:
        law = law_of(at, final, latent, seed)
    if final.effects and NEARLY_WHITE < left(final) <= FAR:
        # Coloured sensor noise may have taken what is a law of the states.
        law = np.maximum(law, law_of(at, final, latent_force(at, final, quiet_sensors=True), seed))
    return latent, law
