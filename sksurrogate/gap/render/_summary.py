"""The report as a table of estimates, in the manner of statisticians, and its tables by name."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

import numpy as np

from sksurrogate.gap.render._budget import listed_parts, part_name
from sksurrogate.gap.render._headline import not_identified
from sksurrogate.gap.render._tables import grid, table_html
from sksurrogate.gap.render._units import TIME, parameter_unit
from sksurrogate.gap.render._values import effect_text, held_out, number, percent, quantity
from sksurrogate.gap.render._waterfall import caption
from sksurrogate.gap.results._report_data import ReportData
from sksurrogate.gap.results._table import EMPTY, Table
from sksurrogate.gap.results._trace import Trace

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
        blocks = [_facts(self.facts), *map(grid, self.tables)]
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
        parts = [f"<table><caption>{escape(self.title)}</caption>{facts}</table>", *map(table_html, self.tables)]
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
        Table(
            tuple(
                {"part": part_name(row), **{k: row[k] for k in ("share", "low", "high")}}
                for row in listed_parts(report.budget)
            )
        ),
        _notes(report),
    )


def _facts_of(report: ReportData) -> tuple[tuple[str, str], ...]:
    """What is said of the whole, in pairs of columns."""
    shrink, origin = report.shrink, report.provenance
    low, high = (f"{100 * end:.1f}" for end in shrink.interval)
    closed = f"{percent(shrink.fraction)} [{low}, {high}]" if report.effects or len(report.retuned) else "-"
    law = (
        () if report.law is None or np.isnan(shrink.after_law) else (("RMSE with the law:", number(shrink.after_law)),)
    )
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
        ("Sample time:", quantity(origin.dt, report.units.get(TIME, ""))),
        ("RMSE of the noise:", number(shrink.floor)),
        ("Free parameters:", str(len(report.retuned))),
        ("Gap closed:", closed),
        ("Seed:", origin.seed or "-"),
        ("Remainder / gap:", percent(report.remainder.share)),
        ("Date:", origin.date[:10] or "-"),
        *law,
    )


def _effects(report: ReportData) -> Table:
    """One row a parameter of a named effect."""
    rows = []
    for effect in report.effects:
        for name, value in effect.params.items():
            low, high = effect.intervals.get(name, (np.nan, np.nan))
            rows.append(
                {
                    "effect": effect_text(effect),
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
    own = [f"{caption(report)}."]
    if report.effects or len(report.retuned) or len(report.budget):
        own.append(f"from, to: 90 % interval. share: of the gap's power on {held_out(report)}.")
    tied = [effect_text(effect) for effect in report.effects if not_identified(effect)]
    if tied:
        own.append(f"These data do not identify {', '.join(tied)} uniquely; see report.effects[i].equivalents.")
    return (*own, *report.notes)


def _facts(facts: Sequence[tuple[str, str]]) -> list[str]:
    """Two pairs a line."""
    half = (_WIDTH - 4) // 2
    cells = [f"{name}{value:>{max(half - len(name), len(value) + 1)}}" for name, value in facts]
    cells += [""] * (len(cells) % 2)
    return [f"{a:<{half}}    {b}".rstrip() for a, b in zip(cells[::2], cells[1::2])]


def table_of(report: ReportData, name: str) -> Table:
    """One table of a report.

    Raises
    ------
    ValueError
        There is no such table.
    """
    where, experiment = report.where, report.next_experiment
    known = {
        "effects": lambda: summary_of(report).effects,
        "budget": lambda: report.budget,
        "ranking": lambda: report.ranking,
        "retuned": lambda: report.retuned,
        "by_output": lambda: where.by_output,
        "by_location": lambda: where.by_location,
        "by_region": lambda: where.by_region,
        "by_time": lambda: where.by_time,
        "by_frequency": lambda: where.by_frequency,
        "shrink_by_output": lambda: report.shrink.by_output,
        "data": lambda: report.data.table(),
        "experiments": lambda: EMPTY if experiment is None else experiment.options,
        "traces": lambda: _samples(report),
    }
    if name not in known:
        raise ValueError(f"table={name!r}: expected one of {sorted(known)}.")
    return known[name]()


def _samples(report: ReportData) -> Table:
    """One row a sample of every run."""
    return Table(tuple(row for trace in report.traces for row in _rows(report, trace)))


def _rows(report: ReportData, trace: Trace) -> list[dict[str, Any]]:
    """The samples of one run."""
    runs = {"measured": trace.measured, "before": trace.before, "after": trace.after, "with the law": trace.law}
    columns = {} if trace.inputs is None else dict(zip(report.inputs, trace.inputs.T))
    for j, output in enumerate(report.outputs):
        columns |= {f"{output} {name}": run[:, j] for name, run in runs.items() if run is not None}
    rows = zip(*(np.asarray(values, float).tolist() for values in (trace.t, *columns.values())))
    return [{"run": trace.label, **dict(zip(("t", *columns), row))} for row in rows]
