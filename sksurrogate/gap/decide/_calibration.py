"""Stated probability of a name: its evidence among the effects that were tried, times the share of such names that were found to act."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import expit

from sksurrogate.gap.results._effect_estimate import EffectEstimate
from sksurrogate.gap.results._remainder import Remainder

#: Log odds that a name acts of which the evidence is certain, and what each of its :func:`ratios` takes from them. Fitted by
#: ``docs/_scripts/calibration.py`` to the 626 names in ``docs/calibration_names.csv``.
LOG_ODDS, PER_REST, PER_SMALLNESS = 3.6, 4.5, 1.7
#: Largest ratio of the tolerance to what a name closes: a share that left-out runs hardly show is no proof against it.
MOST_SMALLNESS = 3.0


def ratios(rest: ArrayLike, share: ArrayLike, tolerance: float) -> tuple[np.ndarray, np.ndarray]:
    """What makes a name doubtful: the lawful rest over the tolerance, and the tolerance over what the name closes (amplitudes).

    Beside a lawful rest something else acts too, which the name may imitate in part; from the tolerance on its size says no more. A name with
    a small share may only correct the form of a larger one.

    ``rest``: lawful rest beside all names, a share of the gap (amplitude).
    ``share``: of the gap's power that the name closes.
    ``tolerance``: share of the gap (amplitude) that counts as closed.
    """
    part = np.sqrt(np.maximum(share, 1e-12))
    return np.minimum(np.divide(rest, tolerance), 1.0), np.minimum(tolerance / part, MOST_SMALLNESS)


def calibrated(evidence: float, rest: float, share: float, tolerance: float) -> float:
    """Probability that a name acts in the plant.

    ``evidence``: probability among the effects and laws that were compared.
    ``rest``, ``share``, ``tolerance``: as in :func:`ratios`.

    >>> [round(calibrated(1.0, rest, share, 0.1), 2) for rest, share in ((0.0, 1.0), (0.05, 1.0), (0.15, 1.0), (0.0, 0.01))]
    [0.97, 0.76, 0.26, 0.87]
    """
    beyond, smallness = ratios(rest, share, tolerance)
    return float(evidence * expit(LOG_ODDS - PER_REST * beyond - PER_SMALLNESS * smallness))


def with_stated(effects: Sequence[EffectEstimate], remainder: Remainder, tolerance: float) -> list[EffectEstimate]:
    """Effects with their stated probability in the place of their evidence; a rest or share that is not known yet does not lower it."""
    rest = float(np.nan_to_num(remainder.lawful))

    def stated(effect: EffectEstimate) -> float:
        return calibrated(effect.probability, rest, float(np.nan_to_num(effect.share, nan=1.0)), tolerance)

    return [replace(effect, probability=stated(effect)) for effect in effects]
