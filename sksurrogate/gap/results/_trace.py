"""One run for the eye."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True, eq=False)
class Trace:
    """One run for the eye: measured, simulated, simulated with the effects; held out from the fit that drew it.

    Attributes
    ----------
    label : object
    t : ndarray (n_samples,)
    measured, before, after : ndarray (n_samples, n_outputs)
    inputs : ndarray (n_samples, n_inputs) or None
        Inputs of the run.
    law : ndarray (n_samples, n_outputs) or None
        Simulated with the effects and a certified law, where ``augmented_`` carries one.
    """

    label: Any
    t: np.ndarray
    measured: np.ndarray
    before: np.ndarray
    after: np.ndarray
    inputs: np.ndarray | None = None
    law: np.ndarray | None = None

    @property
    def corrected(self) -> np.ndarray:
        """Simulated with all that ``augmented_`` carries."""
        return self.after if self.law is None else self.law
