"""The last stage of a diagnosis: what no name explains as a formula, and the simulator that carries what was found."""

from __future__ import annotations

from dataclasses import replace

from sksurrogate.effects._catalogue import name_of
from sksurrogate.effects._simulator import AugmentedSimulator
from sksurrogate.gap._state import DiagnosisState
from sksurrogate.gap.decide._choice_by_fold import names_by_fold
from sksurrogate.gap.decide._held_out import HeldOut, held_out
from sksurrogate.gap.decide._law_certificate import (
    CONSTANTS,
    CertifiedLaw,
    certified_law,
    closes_clearly_more,
    law_of,
    n_parts,
    share_of_law,
    takes_the_place,
)
from sksurrogate.gap.decide._one_curve import LARGEST_CORRECTION
from sksurrogate.gap.decide._rules import Rule, certified, first_rule
from sksurrogate.gap.faults._input_timing import with_joined_inputs
from sksurrogate.gap.fit._closeness import NEARLY_WHITE
from sksurrogate.gap.fit._evidence import C, Evidence
from sksurrogate.gap.fit._known_parameters import value_of
from sksurrogate.gap.render._values import capitalised
from sksurrogate.gap.results._law import Law
from sksurrogate.gap.search._stopping import STACK
from sksurrogate.gap.unnamed._law_evidence import place_and_signal

#: Said of names that one law does without.
INSTEAD = "{names} passed the evidence, but one law without a name explains the gap better than all of them; no name is given."
#: Said of names that a rule withdraws.
WITHDRAWN = "{names} passed the evidence. "


class LawStage(DiagnosisState[C]):
    """The last stage, and the simulator that carries what was found."""

    def look_for_a_law(self) -> None:
        """What no name explains as a formula, fitted and certified on runs left out."""
        found, features = self.found, self.features()
        if features is None or found.held is None or found.shrink is None or not found.shrink.measurable:
            return
        rule = first_rule(features)
        beside = self.chosen_law(rule, features.share_left)
        if beside is not None:
            self.take_law(beside)
        if rule.verdict == "unknown" and self.posterior.rejected is not None and not self.final.effects:
            found.nearer = self.closes_more_than_the_law(self.posterior.rejected)

    def chosen_law(self, rule: Rule, share_left: float) -> CertifiedLaw | None:
        """The law in the place of the names, which are withdrawn then, or the one beside what stands; None where the rule asks for none."""
        assert self.found.held is not None
        instead, rest = None, None
        if rule.withdraws:
            self.withdraw_names(WITHDRAWN + rule.sentence)
        elif self.names_may_imitate(rule.verdict, share_left):
            instead, rest = self.law_in_place_of_names(self.found.held, rule.verdict)
        if instead is not None or not rule.law or rule.verdict not in ("partial", "unknown"):
            return instead
        base = self.final if rule.verdict == "partial" else self.null
        return self.access.law_beside(base, self.final, self.found.held) if rest is None else rest

    def take_law(self, beside: CertifiedLaw) -> None:
        """The runs with a law are measured; it is told where it is certified, or closes a share of the gap."""
        found = self.found
        found.held, found.beside = beside.held, beside
        self.measure()
        assert found.shrink is not None
        law = law_of(beside, self.problem.plant, found.shrink)
        found.law = replace(law, certified=law.certified and not self.did_not_stand(law))
        self.measure()  # above the noise of the simulator with the law
        share = share_of_law(found.shrink)
        found.law = replace(found.law, share=share) if found.law.certified or share > 0.0 else None

    def closes_more_than_the_law(self, rejected: Evidence[C]) -> tuple[Evidence[C], float] | None:
        """An effect that was rejected for a law in its place, and the share of the gap (amplitude) that it closes on runs left out; None
        where that is not clearly more than the law does that was found.

        The law in its place was linear along the measured path, which knows more than a free run.
        """
        assert self.found.held is not None and self.found.shrink is not None
        finals = names_by_fold(self.search, rejected, [])
        named = self.measured(held_out(finals, self.found.held))
        more = closes_clearly_more(named.fraction, self.found.shrink.fraction_law)
        return (rejected, named.fraction) if more and certified(named, lambda: False) else None

    def did_not_stand(self, law: Law) -> bool:
        """Whether a law is an effect of the catalogue that was asked and is not named: a constant."""
        asked = {(effect.name, effect.location) for effect in self.search.library}
        return law.is_constant and (CONSTANTS[law.kind], law.location) in asked

    def names_may_imitate(self, verdict: str, share_left: float) -> bool:
        """Whether one effect without a name may be behind all names: they leave more than the tolerance, are a stack, or leave more than
        noise from several places or signals. One name that leaves no more than a correction of its form does not imitate.
        """
        effects = self.final.effects
        if len(effects) == 1:
            return verdict == "partial" and share_left > LARGEST_CORRECTION * self.search.tolerance
        apart = len({place_and_signal(effect) for effect in effects}) > 1 and self.final.left > NEARLY_WHITE
        return verdict == "partial" or (verdict == "explained" and (len(effects) >= STACK or apart))

    def law_in_place_of_names(self, held: HeldOut, verdict: str) -> tuple[CertifiedLaw | None, CertifiedLaw | None]:
        """One formula that is clearly likelier than all names, and than these with the law that they leave: they are withdrawn.

        One of as many parts as there are names must also close a practical share of what they leave on runs left out.
        None where the names stand; and the law that they leave, where it was asked for.
        """
        beside, leave_a_law = self.access.law_beside(self.null, self.final, held), verdict == "partial"
        if beside is None or not (leave_a_law or takes_the_place(self.search, beside.law, self.final)):
            return None, None
        rest = self.access.law_beside(self.final, self.final, held)
        if not takes_the_place(self.search, beside.law, self.final, None if rest is None else rest.law):
            return None, rest
        fewer = n_parts(beside.law, self.final) < len(self.final.effects)
        if not (fewer or certified_law(self.measured(beside.held))):
            return None, rest
        after = self.withdraw_names(INSTEAD)
        return replace(beside, held=replace(after, law=beside.held.law)), None

    def withdraw_names(self, why: str) -> HeldOut:
        """The null stands, measured again on runs left out."""
        after = self.withdraw(why.format(names=capitalised("; ".join(map(name_of, self.final.effects)))))
        self.share_the_gap()
        return after

    @property
    def carried_law(self) -> Law | None:
        """The law that the augmented simulator carries."""
        law = self.found.law
        return law if self.include_law and law is not None and law.certified else None

    def carried(self) -> Evidence:
        """What the augmented simulator carries, on the record of the search."""
        beside = self.found.beside
        return beside.law.found if self.carried_law and beside is not None else self.final

    def augmented(self) -> AugmentedSimulator:
        """The simulator with what was found, and with a certified law."""
        beside, known = self.found.beside, self.found.values
        final = self.final if known is None else known.fitted
        final = beside.fitted if self.carried_law and beside is not None else final
        named, scale = final.candidate, self.access.scale
        problem, plant = named.problem, named.problem.plant
        values = [
            {p.name: float(v) for p, v in zip(effect.parameters, named.theta_of(i))}
            for i, effect in enumerate(named.effects)
        ]
        phi = named.fit.theta[named.n_parameters :]
        tuned = {name: value_of(plant.params[name], v) for name, v in zip(problem.free, phi)}
        some = None if self.acts_in is None else [list(self.acts_in)] * len(values)
        simulator = with_joined_inputs(plant.simulator) if problem.record.joined else plant.simulator
        return AugmentedSimulator(
            simulator,
            [effect.settled_form for effect in named.effects],
            values,
            tuned or None,
            some,
            scale=scale,
            sharpness=problem.sharpness,
        )
