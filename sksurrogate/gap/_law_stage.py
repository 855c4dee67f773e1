"""The last stage of a diagnosis: what no name explains as a formula, and the simulator that carries what was found."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from sksurrogate.effects._simulator import AugmentedSimulator
from sksurrogate.gap.decide._held_out import HeldOut
from sksurrogate.gap.decide._law_certificate import law_of
from sksurrogate.gap.decide._partial_results import PartialResults
from sksurrogate.gap.fit._evidence import Evidence
from sksurrogate.gap.fit._known_parameters import value_of
from sksurrogate.gap.results._law import Law
from sksurrogate.gap.search._stopping import STACK

#: Said of names that one law does without.
INSTEAD = "{names} passed the evidence, but one law without a name explains the gap better than all of them; no name is given."


class LawStage:
    """A part of the pipeline."""

    found: PartialResults
    include_law: bool
    #: Labels of the runs in which what was found acts; None for all.
    acts_in: tuple[Any, ...] | None = None

    def look_for_a_law(self) -> None:
        """What no name explains as a formula, fitted and certified on runs left out."""
        found, verdict = self.found, self.decided()[0]  # type: ignore[attr-defined]
        if found.held is None or found.shrink is None or not found.shrink.measurable:
            return
        pipeline: Any = self
        final, null = pipeline.final, pipeline.null
        beside, stack = None, verdict in ("partial", "explained") and len(final.effects) >= STACK
        if stack:
            beside = pipeline.unnamed.law_beside(null, final, found.held)
            if beside is not None and pipeline.unnamed.law_instead(beside, final):
                names = ", ".join(effect.name for effect in final.effects)
                self.withdraw(INSTEAD.format(names=names))
                pipeline.share_the_gap()
                beside = replace(beside, held=replace(found.held, law=beside.held.law))
            else:
                beside = None
        if beside is None and verdict in ("partial", "unknown"):
            beside = pipeline.unnamed.law_beside(final if verdict == "partial" else null, final, found.held)
        if beside is not None:
            found.held, found.lawful, found.lawful_fitted = beside.held, beside.on_record, beside.fitted
            pipeline.measure()
            found.law = law_of(beside, pipeline.problem.plant, found.shrink)

    def withdraw(self, why: str) -> None:
        """The names are withdrawn: the null stands."""
        pipeline: Any = self
        found, null, held = self.found, pipeline.null, self.found.held
        assert held is not None
        found.uncertified = why
        pipeline.search.final, found.slots, found.finals = null, [], []
        found.shares, found.probabilities, found.fitted, found.bounds, found.experiment = [], [], None, None, None
        pipeline.unnamed.withdraw(null)
        after = held.retuned if pipeline.problem.free else held.before
        found.held = HeldOut(held.record, held.before, after, held.retuned, held.corrected)
        pipeline.measure()

    @property
    def carried_law(self) -> Law | None:
        """The law that the augmented simulator carries."""
        law = self.found.law
        return law if self.include_law and law is not None and law.certified else None

    def carried(self) -> Evidence[Any]:
        """What the augmented simulator carries, on the record of the search."""
        lawful = self.found.lawful if self.carried_law else None
        return lawful or self.final  # type: ignore[attr-defined, no-any-return]

    def augmented(self) -> AugmentedSimulator:
        """The simulator with what was found, and with a certified law."""
        found = self.found
        final = (found.lawful_fitted if self.carried_law else found.fitted) or self.final  # type: ignore[attr-defined]
        named, scale = final.candidate, self.unnamed.scale  # type: ignore[attr-defined]
        problem, plant = named.problem, named.problem.plant
        values = [
            {p.name: float(v) for p, v in zip(effect.parameters, named.theta_of(i))}
            for i, effect in enumerate(named.effects)
        ]
        phi = named.fit.theta[named.n_parameters :]
        tuned = {name: value_of(plant.params[name], v) for name, v in zip(problem.free, phi)}
        some = None if self.acts_in is None else [list(self.acts_in)] * len(values)
        return AugmentedSimulator(plant.simulator, list(named.effects), values, tuned or None, some, scale=scale)
