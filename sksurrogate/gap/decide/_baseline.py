"""What needs no name, worked out while names are looked for: free runs of the simulator, re-tuned, and with a correction."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from sksurrogate._parallel._second import Second
from sksurrogate.gap.decide._generic_correction import generic_correction, known_runs
from sksurrogate.gap.decide._held_out import HeldOut, without_names
from sksurrogate.gap.fit._closeness import NOTHING_TO_LEARN
from sksurrogate.gap.fit._evidence import Evidence
from sksurrogate.gap.fit._folds import run_folds
from sksurrogate.kernels.record import Record

__all__ = ["WithoutNames"]


class WithoutNames:
    """Free runs on runs left out, of all that needs no name.

    Parameters
    ----------
    null : Evidence
    correction : estimator or None
        Generic learner; None for the default one, which may be fitted in a second process.
    later : Second
        Process for what is wanted later.
    """

    def __init__(self, null: Evidence, correction: Any, later: Second):
        self.problem, self.correction = null.candidate.problem, correction
        early = self.learned() if correction is None and gap_to_learn(null) else None

        def question() -> HeldOut:
            held = without_names(null.candidate)
            return held if early is None else corrected(held, early)

        self._held = later.ask(question)

    def learned(self) -> Callable[[Record, np.ndarray], np.ndarray]:
        """The correction, beside the runs of the simulator that are known."""
        return generic_correction(self.problem.plant.simulator, self.correction, known_runs(self.problem))

    def held(self, null: Evidence, named: bool) -> HeldOut:
        """The free runs; a correction has nothing to learn where nothing is ``named`` and the null is within the noise."""
        held = self._held.answer()
        if not (named or gap_to_learn(null)):
            return replace(held, corrected=np.full_like(held.before, np.nan))
        return corrected(held, self.learned()) if np.isnan(held.corrected).all() else held


def gap_to_learn(null: Evidence) -> bool:
    """Whether the simulator misses anything."""
    return null.left >= NOTHING_TO_LEARN


def corrected(held: HeldOut, correction: Callable[[Record, np.ndarray], np.ndarray]) -> HeldOut:
    """Beside the others the free runs of a generic correction."""
    return replace(held, corrected=correction(held.record, run_folds(held.record)))
