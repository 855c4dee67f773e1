"""Stated probabilities: evidence compares the effects that were tried; how often names that it is certain of act was counted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.special import expit

from sksurrogate.gap.results._effect_estimate import EffectEstimate
from sksurrogate.gap.results._remainder import Remainder

#: Log odds that a name acts of which the evidence is certain: beside no rest, and what each ratio of :func:`calibrated` takes from them.
#: Fitted by ``docs/_scripts/calibration.py`` to the names of a thousand diagnoses (``docs/calibration_names.csv``).
LOG_ODDS, PER_REST, PER_SMALLNESS = 3.6, 4.5, 1.7
#: A smaller share of the gap's power counts as so many tolerances.
SMALLEST_PART = 1.0 / 3.0


def calibrated(evidence: float, rest: float, share: float, tolerance: float) -> float:
    """Probability that a name acts in the plant.

    Two things make a name doubtful that the evidence is certain of: a lawful rest beside it, for then something else acts too, which it may
    imitate in part; and a small share of the gap, for then it may only correct the form of a larger name.

    ``evidence``: probability among the effects and laws that were compared.
    ``rest``: lawful rest beside all names, a share of the gap (amplitude).
    ``share``: of the gap's power that the name closes.
    ``tolerance``: share of the gap (amplitude) that counts as closed.

    >>> [round(calibrated(1.0, rest, share, 0.1), 2) for rest, share in ((0.0, 1.0), (0.05, 1.0), (0.15, 1.0), (0.0, 0.01))]
    [0.97, 0.76, 0.26, 0.87]
    """
    part = max(np.sqrt(max(share, 0.0)), SMALLEST_PART * tolerance)
    beyond = min(rest / tolerance, 1.0)  # a larger rest is of other causes, whatever its size
    return float(evidence * expit(LOG_ODDS - PER_REST * beyond - PER_SMALLNESS * tolerance / part))


def with_stated(effects: Sequence[EffectEstimate], remainder: Remainder, tolerance: float) -> list[EffectEstimate]:
    """Effects with the probability that is stated in the place of that of the evidence; what is not known yet takes nothing from it."""
    rest = float(np.nan_to_num(remainder.lawful))

    def stated(effect: EffectEstimate) -> float:
        return calibrated(effect.probability, rest, float(np.nan_to_num(effect.share, nan=1.0)), tolerance)

    return [replace(effect, probability=stated(effect)) for effect in effects]
