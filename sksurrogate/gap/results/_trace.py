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
    """

    label: Any
    t: np.ndarray
    measured: np.ndarray
    before: np.ndarray
    after: np.ndarray
    inputs: np.ndarray | None = None
