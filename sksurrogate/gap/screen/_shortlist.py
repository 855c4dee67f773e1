"""Which candidates are worth a linearisation about a base: by the null's columns against what the base leaves."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np

from sksurrogate.effects._base_effect import BaseEffect
from sksurrogate.gap.fit._normal_equations import eliminate_rows, scores, start_bases
from sksurrogate.gap.screen._responses import Responses

#: Starting values by the effect's key.
Shortlist: TypeAlias = dict[tuple, list[tuple[float, ...]]]
#: Effects, and starting values of each, that are linearised about a base.
MOST_LISTED, MOST_STARTS = 60, 5


def shortlist(
    effects: Sequence[BaseEffect],
    raw: Sequence[np.ndarray],
    columns: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    s: Responses,
) -> Shortlist:
    """The effects whose columns remove most of what a base leaves.

    Both linearisations follow the measured trajectory, so the columns of the null are near to those of the base: near
    enough to choose, not to score.

    ``effects, raw, columns, low, high``: of the null's screen, one entry a starting value.
    ``s``: the linearisation of the base.
    Returns starting values by the effect's key.
    """
    starts, lin = s.problem.record.starts, s.lin
    if not (np.isfinite(lin.J_theta).all() and np.isfinite(lin.J_x).all() and np.isfinite(lin.y).all()):
        return {}
    few = s.white.reshape(len(s.white), -1)
    flat = columns.reshape(len(columns), -1)
    rows = np.concatenate([few @ few.T, (flat @ few.astype(np.float32).T).T.astype(float)], axis=1)
    size = np.einsum("kn,kn->k", flat, flat, dtype=float)
    for a, b, q in start_bases(s.J_x, starts, columns.shape[-1]):
        part = columns[:, :, a:b].reshape(len(columns), -1) @ q.astype(np.float32)
        size -= np.einsum("kn,kn->k", part, part, dtype=float)
    diagonal = np.r_[np.zeros(len(few)), np.maximum(size, 1e-12)]
    drop, _ = scores(*eliminate_rows(rows, diagonal, *s.base.step_prior), low, high)
    groups: dict[tuple, list[int]] = {}
    for k, effect in enumerate(effects):
        groups.setdefault(effect.key, []).append(k)
    order = sorted(groups, key=lambda key: -max(drop[k] for k in groups[key]))[:MOST_LISTED]
    out: Shortlist = {}
    for key in order:
        best = sorted(groups[key], key=lambda k: -drop[k])[:MOST_STARTS]
        names = [p.name for p in effects[best[0]].parameters]
        if "phase" in names:  # both quadratures of a frequency
            frequencies = {float(raw[k][1]) for k in best}
            best = [k for k in groups[key] if float(raw[k][1]) in frequencies]
        out[key] = [tuple(float(v) for v in raw[k]) for k in sorted(best)]
    return out
