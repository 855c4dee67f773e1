"""What can be asked where the right-hand side is known: curves, laws and forces in every balance."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from sksurrogate._parallel._worker_process import PendingAnswer
from sksurrogate.effects._base_effect import BaseEffect
from sksurrogate.effects._catalogue import name_of
from sksurrogate.effects._families import BalanceEffect, HiddenEffect
from sksurrogate.gap.decide._access import BaseAccess
from sksurrogate.gap.decide._contenders import in_more_names, in_other_names
from sksurrogate.gap.decide._gap_of_one_law import law_of_the_gap
from sksurrogate.gap.decide._generic_correction import Correction, generic_correction, known_runs
from sksurrogate.gap.decide._posterior import Posterior, law_left_beside, let_stand
from sksurrogate.gap.decide._retuning import imitated_by_retuning
from sksurrogate.gap.decide._separations import of_ode
from sksurrogate.gap.fit._build import build_problem
from sksurrogate.gap.fit._closeness import NEARLY_WHITE, SETTLED
from sksurrogate.gap.fit._evidence import Evidence, estimate_noise
from sksurrogate.gap.fit._ode import OdeCandidate
from sksurrogate.gap.fit._other_unit import other_unit
from sksurrogate.gap.fit._record_parts import FITTED_SAMPLES, excerpt
from sksurrogate.gap.fit._rounding import GRID_NOTE, GRID_SHARE, Rounding, unnamed_rounding
from sksurrogate.gap.search._ode_search import OdeSearch
from sksurrogate.gap.unnamed._channel import Place
from sksurrogate.gap.unnamed._law_left import LawLeft
from sksurrogate.gap.unnamed._likely_place import likely_place, place_of_law, places_of_gap
from sksurrogate.gap.unnamed._ode_channels import OdeChannels
from sksurrogate.gap.unnamed._smoothed_path import sensor_noise
from sksurrogate.kernels.record import Record

#: White noise is at most so many times what differences of the outputs show.
MOST_NOISE = 1.1
PIECES_NOTE = (
    "The candidates were compared on {some} of {whole} samples, in pieces spread over the record; what is named was fitted on more "
    "of them."
)
KINK_NOTE = "The kink of {name} is fitted as a smooth turn, about {width:.3g} wide in {variable} on each side."
IN_MORE_NAMES = "These data cannot tell {others} together from {names}; the fewest names stand."
#: The same of as many names, which one by one predict what those named do.
IN_OTHER_NAMES = "These data cannot tell {others} from {names}; the more usual names are given."


def lost_places(names: Sequence[str]) -> list[str]:
    """Places where no signal can be followed.

    >>> lost_places(["level"])[0][:47]
    'No missing term could be looked for at level: t'
    """
    text = (
        f"No missing term could be looked for at {', '.join(names)}: the simulator's response to a signal there is not finite along "
        "the measured runs."
    )
    return [text] if names else []


def notes_on_kinks(candidate: OdeCandidate) -> list[str]:
    """Over how much of their variables the named laws turn, where that was fitted."""
    if not candidate.problem.numerics.rounded:
        return []
    widths = candidate.model.bind(candidate.fit.theta[:, None]).widths
    return [
        KINK_NOTE.format(name=name_of(effect), width=width, variable=effect.variable)
        for i, (effect, width) in enumerate(zip(candidate.effects, widths))
        if has_kink(effect, candidate.theta_of(i), width)
    ]


def notes_in_other_words(named: OdeCandidate, others: Sequence[OdeCandidate]) -> list[str]:
    """Several names that do together what one or more of those named do; the first of the sets with the fewest."""
    fewest = sorted(others, key=lambda one: len(one.effects))[:1]
    return [
        (IN_MORE_NAMES if len(one.effects) > len(named.effects) else IN_OTHER_NAMES).format(
            names=" and ".join(name_of(e) for e in named.effects if e.key not in one.keys),
            others=" and ".join(name_of(e) for e in one.effects if e.key not in named.keys),
        )
        for one in fewest
    ]


def has_kink(effect: BaseEffect, theta: np.ndarray, width: float) -> bool:
    """Whether a law without states of its own changes within a width of a signal with that width.

    >>> from sksurrogate.effects import CATALOGUE
    >>> has_kink(CATALOGUE["coulomb_friction"]("v", "v"), np.array([1.0]), 0.1)
    True
    >>> has_kink(CATALOGUE["linear_loss"]("v", "v"), np.array([1.0]), 0.1)
    False
    """
    if not isinstance(effect, BalanceEffect) or isinstance(effect, HiddenEffect) or "*" in str(effect.variable):
        return False
    v = width * np.linspace(-1.0, 1.0, 9)
    wide, narrow = (effect.term(np.zeros(9), v, v, list(theta), one) for one in (width, 0.5 * width))
    return not np.allclose(wide, narrow, rtol=1e-5, atol=1e-8 * float(np.max(np.abs(wide))))


class OdeAccess(BaseAccess[OdeCandidate]):
    """Along the free run, and along the smoothed path.

    ``whole``: all of a long record.
    ``pieces``: notes on runs that were cut.
    ``instead``: the likeliest law in the place of all names, once it was asked for.
    """

    asks_early, among, channels_of = True, "of the catalogue", OdeChannels
    search: OdeSearch
    separations = staticmethod(of_ode)

    def __init__(
        self, search: OdeSearch, seed: int, whole: Record, excluded: Collection[str] = (), pieces: Sequence[str] = ()
    ):
        super().__init__(search, seed, excluded)
        self.whole, self.pieces = whole, tuple(pieces)
        self.scale = search.problem.scale
        self.places_asked: PendingAnswer[list[Place]] | None = None
        self.instead: LawLeft | None = None
        self.beside_forces: np.ndarray | None = None  # sensor noise where every balance may have a force

    @property
    def most_noise(self) -> np.ndarray:
        """Largest white noise of the sensors."""
        return MOST_NOISE * self.search.problem.sd

    def sensor_noise(self, final: Evidence[OdeCandidate]) -> np.ndarray:
        """Of the fit and of the force that it leaves the larger: a wrong fit leaves its coloured noise to take the white one's part."""
        noises = [final.noise.sigma, *([] if self.beside_forces is None else [self.beside_forces])]
        return np.max(np.minimum(noises, self.most_noise), axis=0)

    def law_left(self, final: Evidence[OdeCandidate]) -> LawLeft | None:
        return law_left_beside(self.search, final)

    def ask_for_another_unit(self) -> None:
        """Whether the record fits in another unit."""
        problem = self.search.problem
        self.other_unit = other_unit(problem.model, problem.record)

    def correction(self, correction: Any) -> Correction | None:
        """Beside the runs of the simulator that are known."""
        problem = self.search.problem
        return generic_correction(problem.plant.simulator, correction, known_runs(problem))

    def ask_for_the_law_of_the_gap(self) -> None:
        self.law_of_the_gap = law_of_the_gap(self.search)

    def weigh(self, final: Evidence[OdeCandidate]) -> Posterior:
        """What stands beside a law without a name, and how probable each of its effects is against one in its place."""
        if not final.effects:
            return Posterior((), None)
        self.search.report("whether a law without a name does as well")
        _, posterior = let_stand(self.search, final)
        self.beside = posterior.law.left if posterior.law is not None else None
        return posterior

    def weigh_none(self) -> None:
        self.beside = self.instead = self.law_left(self.search.fitted_null)

    def look_at_what_is_left(self, final: Evidence[OdeCandidate]) -> None:
        asked = self.places_asked or self.ask_for_places(final)
        self.beside_forces = sensor_noise(final)
        self.places = asked.answer()

    def ask_for_places(self, final: Evidence[OdeCandidate]) -> PendingAnswer[list[Place]]:
        search = self.search
        question = partial(places_of_gap, search.fitted_null, self.channels, final.left < SETTLED)
        self.places_asked = search.later.ask(question)
        return self.places_asked

    def withdraw(self, null: Evidence[OdeCandidate]) -> None:
        self.beside_forces, self.beside = sensor_noise(null), None

    # ---- the verdict ------------------------------------------------------------------------------------------------
    def over_noise(self, final: Evidence[OdeCandidate], retuned: bool) -> float:
        """In the worst output. Sensors are at least as noisy as they are beside a force in every balance: a noise fit may call white noise
        coloured. Where nothing is named, noise beyond the largest is a gap that the noise fit has swallowed.
        """
        assert self.beside_forces is not None
        most = np.inf if final.effects or retuned else self.most_noise
        return final.left_within(most, np.minimum(self.beside_forces, self.most_noise))

    def rounding(self, final: Evidence[OdeCandidate]) -> Rounding | None:
        found = unnamed_rounding(final.candidate)
        return found if found is not None and found.share > GRID_SHARE else None

    # ---- where ------------------------------------------------------------------------------------------------------
    def likely_place(self, final: Evidence[OdeCandidate]) -> tuple[str | None, str | None]:
        """A sensor that rounds, the place of a certain law, the place of a free force."""
        problem, rounding, places = self.search.problem, self.rounding(final), self.places or []
        if rounding is not None and final.left < NEARLY_WHITE:
            return rounding.sensor, "output"
        if self.instead is None and self.complete:
            self.instead = self.law_left(self.search.fitted_null)
        place = place_of_law(self.instead, places, problem.plant.inputs)
        if place:
            return place
        return likely_place(places) if places else (None, None)

    @property
    def places_by_kind(self) -> dict[str, Collection[str]]:
        problem, plant = self.search.problem, self.search.problem.plant
        return {"state": problem.balances, "input": plant.ports, "output": plant.outputs, "parameter": plant.params}

    def imitated_by_retuning(self) -> list[tuple[str, str, str | None]]:
        screen = self.search.first_screen
        found = imitated_by_retuning(screen, self.search.fitted_null.fit.theta) if screen is not None else []
        return [(effect.name, str(effect.location), effect.variable) for effect in found]

    # ---- long records -----------------------------------------------------------------------------------------------
    def fitted_on_more(self, final: Evidence[OdeCandidate]) -> Evidence[OdeCandidate]:
        at = final.candidate.problem
        if self.whole.n_samples == at.record.n_samples:
            return final
        self.search.report("fitting what was named on more of the record")
        record, _ = excerpt(self.whole, FITTED_SAMPLES)
        larger, smoothed = build_problem(at.model, record, at.free, at.balances, at.known)
        larger = replace(larger, numerics=at.numerics, scale=at.scale, caps=at.caps)
        candidate = larger.fit(final.effects, final.fit.theta, smoothed.x)
        return final if candidate is None else estimate_noise(candidate, final.noise, final.curvature, max_iterations=5)

    def notes(self, final: Evidence[OdeCandidate], verdict: str) -> list[str]:
        notes, rounding = lost_places(self.channels.lost), self.rounding(final)
        if verdict in ("unknown", "partial") and rounding is not None:
            notes.append(GRID_NOTE.format(name=rounding.sensor, step=rounding.step))
        notes += notes_on_kinks(final.candidate)
        others = [*in_other_names(self.search, final), *in_more_names(self.search, final)]
        notes += notes_in_other_words(final.candidate, others)
        notes += [*([self.other_unit.sentence] if self.other_unit.sentence and verdict != "none" else []), *self.pieces]
        some, whole = self.search.problem.record.n_samples, self.whole.n_samples
        return [*notes, PIECES_NOTE.format(some=some, whole=whole)] if whole > some else notes
