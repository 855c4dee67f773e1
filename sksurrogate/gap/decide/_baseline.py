"""What needs no name, worked out while names are looked for: free runs of the simulator, re-tuned, and with a correction."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sksurrogate._parallel._worker_process import WorkerProcess
from sksurrogate.gap.decide._generic_correction import Correction
from sksurrogate.gap.decide._held_out import HeldOut, without_names
from sksurrogate.gap.fit._closeness import NOTHING_TO_LEARN
from sksurrogate.gap.fit._evidence import Evidence
from sksurrogate.gap.fit._folds import run_folds

__all__ = ["Baseline"]


class Baseline:
    """Free runs on runs left out, of all that needs no name.

    Parameters
    ----------
    null : Evidence
    correction : Correction or None
        Learned on some runs, free run on the others.
    early : bool
        Whether it may be learned in a second process.
    later : Second
        Process for what is wanted later.
    """

    def __init__(self, null: Evidence, correction: Correction | None, early: bool, later: WorkerProcess):
        self.correction = correction
        at_once = correction if early and gap_to_learn(null) else None

        def question() -> HeldOut:
            held = without_names(null.candidate)
            return held if at_once is None else corrected(held, at_once)

        self._held = later.ask(question)

    def held(self, null: Evidence, named: bool) -> HeldOut:
        """The free runs; a correction has nothing to learn where nothing is ``named`` and the null is within the noise."""
        held = self._held.answer()
        if self.correction is None or not (named or gap_to_learn(null)):
            return replace(held, corrected=np.full_like(held.before, np.nan))
        return corrected(held, self.correction) if np.isnan(held.corrected).all() else held


def gap_to_learn(null: Evidence) -> bool:
    """Whether the simulator misses anything."""
    return null.left >= NOTHING_TO_LEARN


def corrected(held: HeldOut, correction: Correction) -> HeldOut:
    """Beside the others the free runs of a generic correction."""
    return replace(held, corrected=correction(held.record, run_folds(held.record)))
