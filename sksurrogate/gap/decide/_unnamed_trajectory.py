"""What can be asked of a simulator that only gives trajectories: equivalent disturbances at its inputs and outputs."""

from __future__ import annotations

import warnings
from dataclasses import replace
from typing import Any

import numpy as np

from sksurrogate.gap.decide._generic_correction import Correction, generic_correction
from sksurrogate.gap.decide._posterior import Posterior
from sksurrogate.gap.decide._rules import DecisionFeatures, share_left
from sksurrogate.gap.decide._separations import of_trajectories
from sksurrogate.gap.decide._unnamed import BaseUnnamed
from sksurrogate.gap.fit._evidence import Evidence
from sksurrogate.gap.fit._trajectory import TrajectoryCandidate
from sksurrogate.gap.results._shrink import Shrink
from sksurrogate.gap.results._table import EMPTY, Table
from sksurrogate.gap.search._trajectory_search import TrajectorySearch
from sksurrogate.gap.unnamed._channel import Place
from sksurrogate.gap.unnamed._latent_force import Remains
from sksurrogate.gap.unnamed._law_evidence import LawBeside
from sksurrogate.gap.unnamed._trajectory_channels import TrajectoryChannels, equivalent_places, force_left
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


class TrajectoryUnnamed(BaseUnnamed[TrajectoryCandidate]):
    """Seen through a linear surrogate, after the search: it moves the initial states.

    Parameters
    ----------
    only_given : bool
        Whether the simulator answers no other inputs than those in X.
    """

    among, channels_of = "that can be tested here", TrajectoryChannels
    search: TrajectorySearch
    separations = staticmethod(of_trajectories)

    def __init__(self, search: TrajectorySearch, seed: int, only_given: bool):
        super().__init__(search, seed)
        self.only_given = only_given

    @property
    def most_noise(self) -> np.ndarray:
        return np.full(len(self.search.problem.sd), np.inf)

    def correction(self, correction: Any) -> Correction | None:
        """None for a table of outputs, which has no answer to blocks of its runs."""
        return None if self.only_given else quietly(generic_correction(self.search.problem.plant.simulator, correction))

    def weigh(self, final: Evidence[TrajectoryCandidate]) -> Posterior:
        """How probable what stands is against none; no law inside can be put in the place of a name."""
        search = self.search
        less = search.score(search.fitted_null.candidate) - search.score(final.candidate)
        chance = float(1.0 / (1.0 + np.exp(np.clip(less, -700.0, 700.0))))
        return Posterior((chance,) * len(final.effects), None)

    def look_at_what_is_left(self, final: Evidence[TrajectoryCandidate]) -> None:
        """A force on the states of the surrogate, whether inputs and outputs repeat it, and the places it may come from."""
        latent, law = force_left(final, self.seed)
        self.remains = Remains(latent, law, equivalent_places(self.channels), latent)

    def withdraw(self, null: Evidence[TrajectoryCandidate]) -> None:
        self.look_at_what_is_left(null)

    def features(
        self, common: DecisionFeatures, final: Evidence[TrajectoryCandidate], shrink: Shrink
    ) -> DecisionFeatures:
        """What the verdict is decided on, with what inputs and outputs repeat of what is left."""
        return replace(common, lawful=self.lawful(shrink))

    def lawful(self, shrink: Shrink) -> float:
        """Share of the gap (amplitude) that inputs and outputs repeat of what is left."""
        law = 0.0 if self.remains is None else float(np.max(self.remains.law, initial=0.0))
        return share_left(shrink) * float(np.sqrt(max(law, 0.0)))

    def law_in_the_budget(self, shrink: Shrink) -> LawBeside | None:
        place, size = self.likeliest, self.lawful(shrink)
        nothing = (0, 0, self.search.problem.first_noise())
        return LawBeside(0.0, 0.0, place.location, place.kind, "", size, size, nothing) if place is not None else None

    def likely_place(self, final: Evidence[TrajectoryCandidate]) -> tuple[str | None, str | None]:
        return (place.location, place.kind) if (place := self.likeliest) else (None, None)

    @property
    def likeliest(self) -> Place | None:
        """The place of the likeliest equivalent disturbance."""
        return self.remains.places[0] if self.remains is not None and self.remains.places else None

    def anywhere(self) -> tuple[Table, Table]:
        """Of the signal at the likeliest place."""
        place = self.likeliest
        channel = self.channels.at(place.location, place.kind) if place is not None else None
        return (EMPTY, EMPTY) if channel is None else self.channels.regions_and_times(channel)

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
