"""What needs no name, worked out while names are looked for: free runs of the simulator, re-tuned, and with a correction."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from sksurrogate._parallel._second import Second
from sksurrogate.gap.decide._generic_correction import generic_correction, known_runs
from sksurrogate.gap.decide._held_out import HeldOut, without_names
from sksurrogate.gap.fit._evidence import left
from sksurrogate.gap.fit._folds import run_folds
from sksurrogate.gap.fit._problem import Problem, Rival
from sksurrogate.kernels.record import Record

__all__ = ["WithoutNames"]

#: A free run this near to the noise has no gap that a correction could learn.
WITHIN_NOISE = 1.05


class WithoutNames:
    """Free runs on runs left out, of all that needs no name.

    Parameters
    ----------
    problem : Problem
    null : Rival
        With its noise.
    correction : estimator or None
        Generic learner; None for the default one, which may be fitted in a second process.
    later : Second
        Process for what is wanted later.
    """

    def __init__(self, problem: Problem, null: Rival, correction: Any, later: Second):
        self.problem, self.null, self.correction = problem, null, correction
        early = self.learned() if correction is None and self.gap_to_learn() else None

        def question() -> HeldOut:
            held = without_names(problem, null)
            return held if early is None else corrected(held, early)

        self._held = later.ask(question)

    def gap_to_learn(self) -> bool:
        """Whether the simulator misses anything."""
        return left(self.null) >= WITHIN_NOISE

    def learned(self) -> Callable[[Record, np.ndarray], np.ndarray]:
        """The correction, beside the runs of the simulator that are known."""
        return generic_correction(self.problem.plant.simulator, self.correction, known_runs(self.problem))

    def held(self, named: bool) -> HeldOut:
        """The free runs; a correction has nothing to learn where nothing is ``named`` and the null is within the noise."""
        held = self._held.answer()
        if not (named or self.gap_to_learn()):
            return replace(held, corrected=np.full_like(held.before, np.nan))
        return corrected(held, self.learned()) if np.isnan(held.corrected).all() else held


def corrected(held: HeldOut, correction: Callable[[Record, np.ndarray], np.ndarray]) -> HeldOut:
    """Beside the others the free runs of a generic correction."""
    return replace(held, corrected=correction(held.record, run_folds(held.record)))
