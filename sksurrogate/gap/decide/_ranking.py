"""All rivals with what the screen expected of them, what their fit costs, and their evidence."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeVar

import numpy as np

from sksurrogate.effects._effect import BaseEffect
from sksurrogate.gap.fit._evidence import Evidence
from sksurrogate.gap.results._table import Table
from sksurrogate.gap.search._search import Search

__all__ = ["ranking", "ranking_of"]

T = TypeVar("T")


def ranking(
    candidates: Sequence[BaseEffect],
    fitted: Mapping[Any, T],
    gain: Callable[[T], float],
    cost: Callable[[T], float],
    bar: Callable[[int], float],
    expected: Mapping[Any, float],
    named: Sequence[Any],
) -> Table:
    """One row a candidate, the most evident first; nan where it was not fitted.

    Parameters
    ----------
    fitted : mapping
        Fit of a single effect, by its key.
    gain, cost : callable (fit) -> float
        Evidence over the null (twice nats) and cost of a fit.
    bar : callable (n_parameters) -> float
        What the evidence must exceed.
    expected : mapping
        What the screen expected, by key.
    named : sequence
        Keys of the effects that are named.
    """
    rows: list[dict[str, Any]] = []
    for effect in candidates:
        fit = fitted.get(effect.key)
        rows.append(
            {
                "name": effect.name,
                "location": effect.location,
                "variable": effect.variable,
                "evidence": gain(fit) if fit is not None else float("nan"),
                "bar": bar(len(effect.parameters)),
                "cost": cost(fit) if fit is not None else float("nan"),
                "screen": expected.get(effect.key, 0.0),
                "named": effect.key in named,
            }
        )
    rows.sort(key=lambda row: (-np.nan_to_num(row["evidence"], nan=-np.inf), -row["screen"]))
    return Table(tuple(rows))


def ranking_of(search: Search, final: Evidence) -> Table:
    """The singles of a search; no rows before its null is fitted."""
    if search.null is None:
        return Table()
    fitted = {rival.keys[0]: rival for rival in search.first_round}
    expected: dict[Any, float] = {}
    for start in search.first_screen.starts if search.first_screen is not None else ():
        expected[start.effect.key] = max(expected.get(start.effect.key, -np.inf), start.white)
    return ranking(
        search.candidates, fitted, search.gain, lambda rival: rival.fit.cost, search.bar, expected, final.candidate.keys
    )
