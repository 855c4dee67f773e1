"""What can be asked of a simulator that only gives trajectories: equivalent disturbances at its inputs and outputs."""

from __future__ import annotations

import warnings
from collections.abc import Collection
from typing import Any

import numpy as np
from scipy.special import expit

from sksurrogate.gap.decide._access import BaseAccess
from sksurrogate.gap.decide._generic_correction import Correction, generic_correction
from sksurrogate.gap.decide._needed import needed_only
from sksurrogate.gap.decide._posterior import Posterior
from sksurrogate.gap.decide._separations import of_trajectories
from sksurrogate.gap.fit._closeness import SETTLED
from sksurrogate.gap.fit._evidence import Evidence
from sksurrogate.gap.fit._trajectory import TrajectoryCandidate
from sksurrogate.gap.search._trajectory_search import TrajectorySearch
from sksurrogate.gap.unnamed._law_left import LawLeft
from sksurrogate.gap.unnamed._trajectory_channels import TrajectoryChannels, equivalent_places, law_left
from sksurrogate.kernels.record import Record

ACCESS = (
    "The simulator gives trajectories only: effects inside its balances, and parameters that drift or jump, cannot be tested; "
    "a missing one shows as an equivalent disturbance at an input or output. Give it rhs or step to test the whole "
    "catalogue."
)
ONE_ANSWER = "The simulator answers only the inputs in X, so no effect on an input could be tested."
TRANSIENTS = (
    "The runs do not start where the simulator does: their initial states were fitted as transients of a linear model of it. "
    "Give the simulator the initial states, or let it take x0, for a sharper answer."
)


class TrajectoryAccess(BaseAccess[TrajectoryCandidate]):
    """Seen through a linear surrogate, after the search: it moves the initial states.

    ``only_given``: whether the simulator answers no other inputs than those in X.
    """

    among, channels_of = "that can be tested here", TrajectoryChannels
    search: TrajectorySearch
    separations = staticmethod(of_trajectories)

    def __init__(self, search: TrajectorySearch, seed: int, only_given: bool, excluded: Collection[str] = ()):
        super().__init__(search, seed, excluded)
        self.only_given = only_given

    def correction(self, correction: Any) -> Correction | None:
        """None for a table of outputs, which has no answer to blocks of its runs."""
        return None if self.only_given else quietly(generic_correction(self.search.problem.plant.simulator, correction))

    def weigh(self, final: Evidence[TrajectoryCandidate]) -> Posterior:
        """How probable what stands is against none; no law inside can be put in the place of a name."""
        search, final = self.search, needed_only(self.search, final)
        chance = float(expit(search.score(final.candidate) - search.score(search.fitted_null.candidate)))
        return Posterior((chance,) * len(final.effects), None)

    def look_at_what_is_left(self, final: Evidence[TrajectoryCandidate]) -> None:
        """The places of the gap, and the likeliest formula where what stands leaves something."""
        self.places, search = equivalent_places(self.channels), self.search
        channels = self.channels if final.candidate is self.channels.null else TrajectoryChannels(final.candidate)
        found = self.places if channels is self.channels or final.left < SETTLED else equivalent_places(channels)
        self.beside = None
        if found and final.left < SETTLED:
            self.beside = LawLeft(found[0].location, found[0].kind, "")
        elif found:
            self.beside = law_left(channels, found[0], search.gap_over_noise, search.tolerance)

    def withdraw(self, null: Evidence[TrajectoryCandidate]) -> None:
        self.look_at_what_is_left(null)

    def likely_place(self, final: Evidence[TrajectoryCandidate]) -> tuple[str | None, str | None]:
        """That of the likeliest equivalent disturbance."""
        return (self.places[0].location, self.places[0].kind) if self.places else (None, None)

    def notes(self, final: Evidence[TrajectoryCandidate], verdict: str) -> list[str]:
        problem = self.search.problem
        notes = [ACCESS, *([ONE_ANSWER] if self.only_given else [])]
        return [*notes, TRANSIENTS] if problem.free_starts and problem.x0 is None else notes


def quietly(correction: Correction) -> Correction:
    """Without the warnings of runs on which it fails: the note on the simulator's access says enough."""

    def run(record: Record, fold: np.ndarray) -> np.ndarray:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return correction(record, fold)

    return run
