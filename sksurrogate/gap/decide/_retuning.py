"""Re-tuned parameters: as they are reported, as the reason of the gap, and the effects that they would hide."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from sksurrogate.effects._base_effect import BaseEffect
from sksurrogate.effects._catalogue import in_words
from sksurrogate.gap.fit._closeness import MOST_LEFT
from sksurrogate.gap.fit._known_parameters import value_of
from sksurrogate.gap.fit._normal_equations import eliminate, project_starts
from sksurrogate.gap.results._effect_estimate import EffectEstimate
from sksurrogate.gap.results._next_experiment import first_of
from sksurrogate.gap.results._table import Table
from sksurrogate.gap.screen._screen import Screen

#: A fit that ends this near to a bound is at it: steps are cut there.
AT_BOUND = 1e-9
#: What is said of parameters that close the gap, and where they would hide effects as large.
RETUNED = "Re-tuning alone closes the gap."
HIDES = " It would hide effects as large: {effects}. To separate them, measure parameters, or free fewer of them (free_params)."


def retuned_table(
    params: Mapping[str, float],
    free: Sequence[str],
    phi: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    bounds: tuple[np.ndarray, np.ndarray] | None = None,
) -> Table:
    """One row a free parameter: nominal, value, 90 % interval, moved or not, at a bound or not.

    >>> rows = retuned_table({"k": -2.0}, ["k"], np.array([0.1]), np.array([0.05]), np.array([0.15]))
    >>> rows[0]["low"] < rows[0]["value"] < rows[0]["high"] < rows[0]["nominal"], rows[0]["moved"]
    (True, True)
    """
    rows = []
    least, most = bounds or (np.full(len(phi), -np.inf), np.full(len(phi), np.inf))
    held = (phi <= least + AT_BOUND) | (phi >= most - AT_BOUND)
    for name, at_bound, *own in zip(free, held, phi, low, high):
        nominal = float(params[name])
        value, *ends = (value_of(nominal, one) for one in own)
        first, last = sorted(ends)
        rows.append(
            {
                "parameter": name,
                "nominal": nominal,
                "value": value,
                "low": first,
                "high": last,
                "moved": not first <= nominal <= last,
                "at_bound": bool(at_bound and value != 0.0),  # what stayed nothing did not end there
            }
        )
    return Table(tuple(rows))


def parameter_errors(
    retuned: Table, share: float, hidden: Sequence[tuple[str, str, str | None]] = ()
) -> list[EffectEstimate]:
    """Re-tuning alone closes the gap: one parameter_error for each parameter that moved, with equal parts of the share.

    The effects ``hidden`` by the re-tuning are equivalents of all of them together.
    """
    rows = [row for row in retuned if row["moved"]]
    why = RETUNED + (HIDES.format(effects=first_of([in_words(*key) for key in hidden])) if hidden else "")
    out = []
    for row in rows:
        p0 = row["nominal"]
        value, *ends = [(row[k] / p0 - 1.0) if p0 != 0 else row[k] for k in ("value", "low", "high")]
        out.append(
            EffectEstimate(
                "parameter_error",
                row["parameter"],
                None,
                share / len(rows),
                {"relative_error": value},
                {"relative_error": (min(ends), max(ends))},
                1.0,
                list(hidden),
                why,
            )
        )
    return out


def imitated_by_retuning(found: Screen, ratios: np.ndarray) -> list[BaseEffect]:
    """Effects of which one that makes up half of what re-tuning closes would be as likely, the parameters tuned beside it.

    To first order: ``-2 log likelihood`` of the residual, the prior of the parameters included, grows by less than ``ln N``.

    ``found``: of the re-tuned simulator alone.
    ``ratios`` (n_free,): its free parameters: logarithms of their ratios to the nominal ones.
    Returns the least noticed first.
    """
    if found.columns is None:
        return []
    stack = np.concatenate([found.known, found.columns])
    flat = project_starts(stack, found.J_x, found.record_starts).reshape(len(stack), -1)
    n, few = flat.shape[1], 1 + len(ratios)
    closed = MOST_LEFT * float(np.linalg.norm(ratios @ flat[1:few]))
    amplitude = closed / np.maximum(np.linalg.norm(flat[few:], axis=1), 1e-300)
    rest = eliminate(flat @ flat.T, len(ratios), found.precision, found.pull)
    either = np.where(found.low < 0.0, np.abs(rest[0, 1:]), rest[0, 1:])
    grown = amplitude**2 * np.diag(rest)[1:] - 2.0 * amplitude * either
    least: dict[tuple, tuple[float, BaseEffect]] = {}
    for start, cost in zip(found.starts, grown):
        if start.effect.kind != "parameter" and cost < least.get(start.effect.key, (np.log(n), None))[0]:
            least[start.effect.key] = float(cost), start.effect
    return [effect for _, effect in sorted(least.values(), key=lambda one: one[0])]
