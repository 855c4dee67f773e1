"""All candidates with what the screen expected of them, what their fit costs, and their evidence."""

from __future__ import annotations

from typing import Any

import numpy as np

from sksurrogate.gap.fit._evidence import C, Evidence
from sksurrogate.gap.results._table import Table
from sksurrogate.gap.search._base import BaseSearch

__all__ = ["ranking"]


def ranking(search: BaseSearch[C], final: Evidence[C]) -> Table:
    """One row a candidate, the most evident first; nan where it was not fitted, no rows before the null is."""
    if search.null is None:
        return Table()
    fitted = {candidate.keys[0]: candidate for candidate in search.first_round}
    expected, rows = search.expected(), []
    for effect in search.library:
        fit = fitted.get(effect.key)
        row: dict[str, Any] = {
            "name": effect.name,
            "location": effect.location,
            "variable": effect.variable,
            "evidence": search.gain(fit) if fit is not None else float("nan"),
            "bar": search.bar(len(effect.parameters)),
            "cost": fit.fit.cost if fit is not None else float("nan"),
            "screen": expected.get(effect.key, 0.0),
            "named": effect.key in final.candidate.keys,
        }
        rows.append(row)
    rows.sort(key=lambda row: (-np.nan_to_num(row["evidence"], nan=-np.inf), -row["screen"]))
    return Table(tuple(rows))
