"""Tables of page and terminal: heads in words, numbers to the right, shares in per cent; on the page every column is explained."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape

import numpy as np

from sksurrogate.gap.render._values import number, percent
from sksurrogate.gap.results._next_experiment import ENOUGH
from sksurrogate.gap.results._table import Table

#: Column -> (head, what it means).
COLUMNS = {
    "output": ("output", ""),
    "gap": ("gap", "RMS of what the simulator misses beyond the noise, in the unit of the output"),
    "noise": ("noise", "standard deviation of the sensor noise, in the same unit"),
    "share": ("share", "part of the gap's power"),
    "location": ("place", "state, input, output or parameter"),
    "kind": ("kind", "what the place is"),
    "evidence": ("evidence", "gain in twice the log likelihood over no effect"),
    "bar": ("needed", "evidence that this many parameters and candidates ask for"),
    "margin": (
        "margin",
        "evidence minus what is needed: it decides which single effect comes first; below 0 it is not accepted",
    ),
    "cost": ("misfit", "sum of squares of the residual over the noise"),
    "screen": ("first look", "part of the gap that the linearised screen expected"),
    "named": ("named", "whether the report names it"),
    "name": ("candidate", "effect of the catalogue"),
    "variable": ("driven by", "the signal that the effect depends on"),
    "rule": ("where", "part of the operating range"),
    "samples": ("samples", "part of the samples that lie there"),
    "start": ("from", "time since the start of a run"),
    "stop": ("to", "time since the start of a run"),
    "level": (
        "size",
        "RMS of the signal that is missing: of a rate of change in the balance of a state, else in the unit of the input or output",
    ),
    "runs": ("runs", "runs counted from 1 in the order of the data"),
    "low": ("from", "lower end"),
    "high": ("to", "upper end"),
    "experiment": ("experiment", "what to record"),
    "gain": ("separation", f"expected log-likelihood difference; {ENOUGH}"),
    "between": ("between", "the pair that is hardest to separate"),
    "within": ("within range", "whether its inputs stay where inputs were recorded"),
    "parameter": ("parameter", "of the simulator"),
    "nominal": ("before", "value in the simulator"),
    "value": ("after", "re-tuned value"),
    "part": ("part of the gap", ""),
    "at_bound": (
        "at its bound",
        "whether the value lies at its bound: the one given, else 55 times or 1/55 of the nominal value",
    ),
    "unit": ("unit", ""),
    "moved": ("moved", "whether the 90 % interval leaves the value before out"),
}
_SHARES = ("share", "samples", "fraction")


def explained(table: Table, other: Mapping[str, str] | None = None) -> str:
    """A table and a line for each column; ``other`` has meanings that hold here only."""
    meanings = {name: (other or {}).get(name) or COLUMNS.get(name, (name, ""))[1] for name in table.columns}
    lines = "; ".join(f"<em>{escape(_head(name))}</em>: {escape(text)}" for name, text in meanings.items() if text)
    return table_html(table) + (f'<p class="small">{lines}.</p>' if lines else "")


def table_html(table: Table) -> str:
    """An HTML table; empty without rows."""
    if not len(table):
        return ""
    names = table.columns
    numeric = {name: _numeric(table, name) for name in names}
    head = "".join(f"<th{' class=n' if numeric[name] else ''}>{escape(_head(name))}</th>" for name in names)
    body = "".join(_row(row, names, numeric) for row in table)
    return f'<div class="scroll"><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>'


def grid(table: Table) -> list[str]:
    """Lines of plain text: heads, then one line a row; columns that are empty are left out.

    >>> for line in grid(Table(({"output": "level", "gap": 0.25, "share": 1.0},))):
    ...     print(line)
    output   gap    share
    level   0.25  100.0 %
    """
    names = [name for name in table.columns if any(row[name] != "" for row in table)]
    columns = []
    for name in names:
        cells = [_head(name), *(cell(row, name) for row in table)]
        width = max(map(len, cells))
        columns.append([text.rjust(width) if _numeric(table, name) else text.ljust(width) for text in cells])
    return ["  ".join(cells).rstrip() for cells in zip(*columns)]


def cell(row: Mapping[str, object], name: str) -> str:
    """Text of one value."""
    value = row[name]
    if isinstance(value, (bool, np.bool_)):
        return "yes" if value else "no"
    if isinstance(value, (int, float, np.number)):
        share = name in _SHARES or ("part" in row and name in ("low", "high"))
        return percent(float(value)) if share else number(float(value))
    return "-" if value is None else str(value)


def _numeric(table: Table, name: str) -> bool:
    """Whether a column has numbers."""
    return any(isinstance(row[name], (int, float, np.number)) and not isinstance(row[name], bool) for row in table)


def _head(name: str) -> str:
    return COLUMNS.get(name, (name, ""))[0]


def _row(row: Mapping[str, object], names: Sequence[str], numeric: Mapping[str, bool]) -> str:
    """One line of a table."""
    cells = []
    for name in names:
        text = cell(row, name)
        kind = " class=n" if numeric[name] else " class=wrap" if len(text) > 40 else ""
        cells.append(f"<td{kind}>{escape(text)}</td>")
    named = ' class="named"' if row.get("named") in (True, np.True_) else ""
    return f"<tr{named}>{''.join(cells)}</tr>"
