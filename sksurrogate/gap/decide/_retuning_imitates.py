"""Effects that re-tuning imitates: the data cannot tell whether parameters are off or one of these is missing."""

from __future__ import annotations

import numpy as np

from sksurrogate.effects._effect import BaseEffect
from sksurrogate.gap.fit._normal_equations import eliminate, project_starts
from sksurrogate.gap.screen._screen import Screen

__all__ = ["imitated_by_retuning"]

#: An effect counts that may make up this part of what re-tuning closes (amplitude).
PART_OF_RETUNING = 0.5


def imitated_by_retuning(found: Screen, ratios: np.ndarray) -> list[BaseEffect]:
    """Effects of which one that makes up half of what re-tuning closes would be as likely, the parameters tuned beside it.

    To first order: ``-2 log likelihood`` of the residual, the prior of the parameters included, grows by less than ``ln N``.

    Parameters
    ----------
    found : Screen
        Of the re-tuned simulator alone.
    ratios : ndarray (n_free,)
        Its free parameters: logarithms of their ratios to the nominal ones.

    Returns
    -------
    list of BaseEffect
        The least noticed first.
    """
    if found.columns is None:
        return []
    stack = np.concatenate([found.known, found.columns])
    flat = project_starts(stack, found.J_x, found.record_starts).reshape(len(stack), -1)
    n, few = flat.shape[1], 1 + len(ratios)
    closed = PART_OF_RETUNING * float(np.linalg.norm(ratios @ flat[1:few]))
    amplitude = closed / np.maximum(np.linalg.norm(flat[few:], axis=1), 1e-300)
    rest = eliminate(flat @ flat.T, len(ratios), found.precision, found.pull)
    either = np.where(found.low < 0.0, np.abs(rest[0, 1:]), rest[0, 1:])
    grown = amplitude**2 * np.diag(rest)[1:] - 2.0 * amplitude * either
    least: dict[tuple, tuple[float, BaseEffect]] = {}
    for start, cost in zip(found.starts, grown):
        if start.effect.kind != "parameter" and cost < least.get(start.effect.key, (np.log(n), None))[0]:
            least[start.effect.key] = float(cost), start.effect
    return [effect for _, effect in sorted(least.values(), key=lambda one: one[0])]
