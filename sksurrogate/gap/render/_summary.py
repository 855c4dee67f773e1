"""The report as a table of estimates, in the manner of statisticians."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np

from sksurrogate.gap.render._units import parameter_unit
from sksurrogate.gap.render._values import interval_text, number, percent, readable
from sksurrogate.gap.results._report_data import ReportData
from sksurrogate.gap.results._table import EMPTY, Table

__all__ = ["GapSummary", "summary_of"]

_WIDTH = 78


@dataclass(frozen=True)
class GapSummary:
    """What ``report.summary()`` returns: text when printed, tables for programs.

    Attributes
    ----------
    title : str
    facts : tuple of (str, str)
        What the report says of the whole: verdict, data, errors.
    effects : Table
        One row a parameter of a named effect: effect, parameter, unit, estimate, low, high (90 %), probability, share.
    retuned : Table
        The free parameters: parameter, unit, nominal, estimate, low, high.
    budget : Table
        part, share, low, high.
    notes : tuple of str

    Examples
    --------
    >>> print(GapSummary("Diagnosis", (("Verdict:", "none"), ("Runs:", "3"))).as_text())  # doctest: +ELLIPSIS
                                      Diagnosis
    ==============================================================================
    Verdict:                          none    Runs:                              3
    ==============================================================================
    """

    title: str
    facts: tuple[tuple[str, str], ...]
    effects: Table = EMPTY
    retuned: Table = EMPTY
    budget: Table = EMPTY
    notes: tuple[str, ...] = ()

    @property
    def tables(self) -> tuple[Table, ...]:
        """The tables that have rows, in the order in which they are printed."""
        return tuple(table for table in (self.effects, self.retuned, self.budget) if len(table))

    def as_text(self) -> str:
        """Plain text, 78 columns or as wide as the names need."""
        blocks = [_facts(self.facts), *(_grid(table) for table in self.tables)]
        width = max([_WIDTH, *(len(line) for block in blocks for line in block)])
        rule, thin = "=" * width, "-" * width
        lines = [self.title.center(width).rstrip(), rule]
        for k, block in enumerate(blocks):
            lines += block if k == 0 else [block[0], thin, *block[1:]]
            lines.append(rule)
        for k, note in enumerate(self.notes, start=1):
            lines += textwrap.wrap(f"[{k}] {note}", width, subsequent_indent="    ")
        return "\n".join(lines)

    def as_html(self) -> str:
        """The same as HTML tables."""
        facts = "".join(f"<tr><th>{escape(name)}</th><td>{escape(value)}</td></tr>" for name, value in self.facts)
        parts = [f"<table><caption>{escape(self.title)}</caption>{facts}</table>"]
        for table in self.tables:
            head = "".join(f"<th>{escape(name)}</th>" for name in table.columns)
            body = "".join(
                "<tr>" + "".join(f"<td>{escape(_cell(name, row[name]))}</td>" for name in table.columns) + "</tr>"
                for row in table
            )
            parts.append(f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>")
        return "\n".join([*parts, *(f"<p>{escape(note)}</p>" for note in self.notes)])

    def _repr_html_(self) -> str:
        return self.as_html()

    def __str__(self) -> str:
        return self.as_text()


def summary_of(report: ReportData) -> GapSummary:
    """The summary of a report."""
    return GapSummary(
        "Diagnosis of the sim-to-real gap",
        _facts_of(report),
        _effects(report),
        _retuned(report),
        Table(tuple({key: row[key] for key in ("part", "share", "low", "high")} for row in report.budget)),
        _notes(report),
    )


def _facts_of(report: ReportData) -> tuple[tuple[str, str], ...]:
    """What is said of the whole, in pairs of columns."""
    shrink, origin = report.shrink, report.provenance
    closed = f"{percent(shrink.fraction)} {interval_text(*(100 * end for end in shrink.interval))}".rstrip()
    return (
        ("Verdict:", report.verdict + ("" if report.complete else " (interrupted)")),
        ("Simulator:", origin.simulator or "-"),
        ("Rule:", report.reasons.rule),
        ("Access:", origin.access or "-"),
        ("Place:", f"{report.where.kind} {report.where.location}" if report.where.location else "-"),
        ("No. runs:", str(origin.n_runs or "-")),
        ("RMSE before:", number(shrink.before)),
        ("No. rows:", str(origin.n_rows or "-")),
        ("RMSE after:", number(shrink.after)),
        ("Sample time:", number(origin.dt)),
        ("RMSE of the noise:", number(shrink.floor)),
        ("Free parameters:", str(len(report.retuned))),
        ("Gap closed:", closed),
        ("Seed:", origin.seed or "-"),
        ("Remainder / gap:", percent(report.remainder.share)),
        ("Date:", origin.date[:10] or "-"),
    )


def _effects(report: ReportData) -> Table:
    """One row a parameter of a named effect."""
    rows = []
    for effect in report.effects:
        driver = f"({effect.variable})" if effect.variable else ""
        for name, value in effect.params.items():
            low, high = effect.intervals.get(name, (np.nan, np.nan))
            rows.append(
                {
                    "effect": f"{readable(effect.name)} @ {effect.location}{driver}",
                    "parameter": name,
                    "unit": parameter_unit(effect, name, report.units),
                    "estimate": value,
                    "low": low,
                    "high": high,
                    "probability": effect.probability,
                    "share": effect.share,
                }
            )
    return Table(tuple(rows))


def _retuned(report: ReportData) -> Table:
    """The free parameters."""
    rows = []
    for row in report.retuned:
        unit = report.units.get(row["parameter"], "")
        first = {"re-tuned": row["parameter"], "unit": unit, "nominal": row["nominal"], "estimate": row["value"]}
        rows.append({**first, "low": row["low"], "high": row["high"]})
    return Table(tuple(rows))


def _notes(report: ReportData) -> tuple[str, ...]:
    """What the columns mean, then the notes of the report."""
    own = ["RMSE: free run on runs left out of choice and fit, each output over its standard deviation."]
    if report.effects or len(report.retuned) or len(report.budget):
        own.append("low, high: 90 % interval. share: of the gap's power on runs left out.")
    tied = [f"{readable(e.name)} at {e.location}" for e in report.effects if e.equivalents]
    if tied:
        own.append(f"These data do not identify {', '.join(tied)} uniquely; see report.effects[i].equivalents.")
    return (*own, *report.notes)


def _facts(facts: Sequence[tuple[str, str]]) -> list[str]:
    """Two pairs a line."""
    half = (_WIDTH - 4) // 2
    cells = [f"{name}{value:>{max(half - len(name), len(value) + 1)}}" for name, value in facts]
    cells += [""] * (len(cells) % 2)
    return [f"{a:<{half}}    {b}".rstrip() for a, b in zip(cells[::2], cells[1::2])]


def _grid(table: Table) -> list[str]:
    """Columns: text to the left, numbers to the right."""
    names = [name for name in table.columns if any(row[name] != "" for row in table)]
    text = {name: [_cell(name, row[name]) for row in table] for name in names}
    left = {name: isinstance(table[0][name], str) for name in names}
    widths = {name: max(len(name), *(len(cell) for cell in text[name])) for name in names}

    def line(cells: Sequence[str]) -> str:
        return "  ".join(
            cell.ljust(widths[n]) if left[n] else cell.rjust(widths[n]) for n, cell in zip(names, cells)
        ).rstrip()

    return [line(names), *(line([text[name][k] for name in names]) for k in range(len(table)))]


def _cell(name: str, value: object) -> str:
    """Text of one value."""
    if isinstance(value, (float, int, np.number)) and not isinstance(value, bool):
        return format(float(value), ".3f") if name in ("probability", "share") else number(float(value))
    return str(value)
