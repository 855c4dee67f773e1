"""The budget of the gap as one bar: for the terminal and for the page."""

from __future__ import annotations

import itertools
import textwrap
from collections.abc import Mapping, Sequence
from html import escape
from typing import Any, NamedTuple

import numpy as np

from sksurrogate.gap.render._values import percent
from sksurrogate.gap.results._table import Table


class _Kind(NamedTuple):
    """How parts of one kind look."""

    letter: str  #: In the terminal's bar
    fills: tuple[str, ...]  #: Of Okabe and Ito's colours, in turn
    name: str = ""  #: What such a part is called; an effect has a name of its own


_LOOKS = {
    "effect": _Kind("#", ("#0072b2", "#009e73", "#cc79a7")),
    "re-tuning": _Kind("=", ("#56b4e9",), "re-tuned parameters"),
    "unnamed law": _Kind("?", ("#e69f00",), "a law without a name"),
    "disturbance": _Kind(".", ("#bbbbbb",), "disturbance (follows no law found)"),
}
#: A share of amplitude and one of power that are nearer to each other than this pass for the same.
_SEEN_APART = 0.05
#: Parts below this share are left out of the text, unless they are effects.
_LEAST_SHARE = 0.0005


def listed_parts(budget: Table) -> list[Mapping[str, Any]]:
    """The parts that the text lists."""
    return [row for row in budget if row["kind"] == "effect" or row["share"] >= _LEAST_SHARE]


def of_power(closed: float) -> str:
    """How a share of the gap's amplitude, as the other lines of a report give it, stands in a budget of power; empty where both are about the same.

    >>> of_power(0.698)
    'Where 69.8 % of the gap is closed, that is its amplitude: 1 - (1 - 0.698)^2 = 90.9 % of its power.'
    """
    power = 1.0 - (1.0 - closed) ** 2
    if not power - closed > _SEEN_APART:
        return ""
    return f"Where {percent(closed)} of the gap is closed, that is its amplitude: 1 - (1 - {closed:.3f})^2 = {percent(power)} of its power."


def budget_lines(budget: Table, width: int, closed: float = np.nan, held: str = "held-out runs") -> list[str]:
    """A bar of letters and one line a part.

    ``closed``: share of the gap's amplitude that the report says to be closed.
    ``held``: the data that the fits did not see.

    >>> rows = ({"part": "friction", "kind": "effect", "share": 0.75, "low": 0.7, "high": 0.8},
    ...         {"part": "disturbance", "kind": "disturbance", "share": 0.25, "low": 0.2, "high": 0.3})
    >>> for line in budget_lines(Table(rows), 50):
    ...     print(line)
    Budget of the gap (shares of its power on held-out runs, 90 %)
      [###############.....]
      # 75.0 % [70.0, 80.0] friction
      . 25.0 % [20.0, 30.0] disturbance (follows no law found)
    """
    rows = listed_parts(budget)
    if not rows:
        return []
    room = max(width - 30, 10)
    ends = np.round(np.cumsum([row["share"] for row in rows]) * room).astype(int)
    counts = np.diff(ends, prepend=0)
    bar = "".join(_LOOKS[row["kind"]].letter * int(count) for row, count in zip(rows, counts))
    lines = [f"Budget of the gap (shares of its power on {held}, 90 %)", f"  [{bar:<{room}}]"]
    lines += [f"  {_LOOKS[row['kind']].letter} {_percent(row)} {part_name(row)}" for row in rows]
    return lines + textwrap.wrap(of_power(closed), width, initial_indent="  ", subsequent_indent="  ")


def fills(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """A colour for each part.

    >>> fills([{"kind": "effect"}, {"kind": "effect"}, {"kind": "disturbance"}])
    ['#0072b2', '#009e73', '#bbbbbb']
    """
    fills_of = {kind: itertools.cycle(look.fills) for kind, look in _LOOKS.items()}
    return [next(fills_of[row["kind"]]) for row in rows]


def budget_html(budget: Table, closed: float = np.nan, held: str = "held-out runs") -> str:
    """One bar with its legend; empty where there is no gap.

    ``closed``: share of the gap's amplitude that the report says to be closed.
    ``held``: the data that the fits did not see.
    """
    rows = listed_parts(budget)
    if not rows:
        return ""
    parts = legend = ""
    for row, fill, name in zip(rows, fills(rows), (escape(part_name(row)) for row in rows)):
        flex = f"flex:{max(row['share'], 1e-4):.5f} 0 0"
        parts += f'<span style="{flex};background:{fill}" title="{name}"></span>'
        legend += f'<li><span class="key" style="background:{fill}"></span>{_percent(row)} {name}</li>'
    return (
        f'<figure class="budget"><div class="budgetbar" role="img" aria-label="budget of the gap">{parts}</div>'
        f"<ul>{legend}</ul><figcaption>Budget of the gap: shares of its power on {held}, with 90 % intervals. "
        f"{of_power(closed)}</figcaption></figure>"
    )


def _percent(row: Mapping[str, Any]) -> str:
    """Share and interval in per cent; no interval narrower than the digits."""
    low, high = f"{100 * row['low']:.1f}", f"{100 * row['high']:.1f}"
    share = f"{100 * row['share']:.1f} %"
    return share if low == high else f"{share} [{low}, {high}]"


def part_name(row: Mapping[str, Any]) -> str:
    """What a part is called; an effect that its own state drives is called by its place alone.

    >>> part_name({"part": "coulomb_friction at speed in speed", "kind": "effect"})
    'coulomb friction at speed'
    """
    if str(row["part"]).startswith("law: "):
        return "the law of the missing term"
    if _LOOKS[row["kind"]].name:
        return _LOOKS[row["kind"]].name
    name, _, place = str(row["part"]).partition(" at ")
    own = next((p for p in [place[: (len(place) - 4) // 2]] if place == f"{p} in {p}"), place)
    where, driven, by = own.partition(" in ")
    own = f"{where}, driven by {by}" if driven else own
    return f"{name.replace('_', ' ')} at {own}" if own else name
