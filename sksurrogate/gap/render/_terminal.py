"""The report as plain text for a terminal."""

from __future__ import annotations

import textwrap
from itertools import chain

from sksurrogate.gap.render._budget import budget_lines
from sksurrogate.gap.render._headline import changes, headline, next_steps, not_identified, related_forms
from sksurrogate.gap.render._law import law_lines
from sksurrogate.gap.render._provenance import provenance_line
from sksurrogate.gap.render._record import record_lines
from sksurrogate.gap.render._tables import grid
from sksurrogate.gap.render._units import TIME, labelled, range_text, unit_column
from sksurrogate.gap.render._values import EVENLY, held_out, percent, spread_evenly
from sksurrogate.gap.render._waterfall import caption, closed, longest_bar, waterfall
from sksurrogate.gap.results._report_data import ReportData

#: Rows of a table of where or when.
MOST_ROWS = 4


def terminal_page(report: ReportData, width: int = 80) -> str:
    """Plain text, 80 columns."""
    title = [report.provenance.title, ""] if report.provenance.title else []
    lines = [*title, f"VERDICT  {report.verdict}" + ("" if report.complete else "  (interrupted)"), ""]
    lines += [*textwrap.wrap(headline(report), width), ""]
    lines += _block(budget_lines(report.budget, width, report.shrink.fraction, held_out(report)))
    lines += _block(_changes(report, width))
    lines += _block(_numbered("What to do next", next_steps(report), width))
    lines += _block(record_lines(report.data, width))
    lines += _block(_errors(report))
    lines += _block(_where(report, width))
    lines += _block(_missing(report, width))
    for note in report.notes:
        lines += [*textwrap.wrap(f"Note: {note}", width), ""]
    if report.untestable:
        text = f"Could not be tested with this simulator: {', '.join(report.untestable)}."
        lines += [*textwrap.wrap(text, width), ""]
    lines += textwrap.wrap(provenance_line(report), width)
    return printable("\n".join(lines).rstrip("\n"))


def _block(lines: list[str]) -> list[str]:
    """Lines and an empty one behind them; nothing where there are none."""
    return [*lines, ""] if lines else []


def _changes(report: ReportData, width: int) -> list[str]:
    """What was found: effects with their numbers, how sure they are, what else explains the data."""
    lines: list[str] = []
    for what, values, sure in changes(report):
        lines += textwrap.wrap(f"- {what}" + (f": {sure}" if sure else ""), width, subsequent_indent="  ")
        lines += [f"    {value}" for value in values]
    said = [[effect.why] * bool(not_identified(effect)) + related_forms(effect) for effect in report.effects]
    for text in dict.fromkeys(chain.from_iterable(said)):
        lines += textwrap.wrap(text, width, initial_indent="  ", subsequent_indent="  ")
    return lines


def _numbered(heading: str, entries: list[str], width: int) -> list[str]:
    """A numbered list."""
    lines = [heading] if entries else []
    for k, entry in enumerate(entries, start=1):
        lines += textwrap.wrap(f"{k}. {entry}", width, initial_indent="  ", subsequent_indent="     ")
    return lines


def _errors(report: ReportData) -> list[str]:
    """The waterfall, and how much of the gap is closed."""
    rows = waterfall(report)
    if not rows:
        return []
    width = max(len(label) for label, _ in rows)
    longest, lines = longest_bar(rows), [caption(report)]
    for label, value in rows:
        bar = "#" * round(30 * min(value / longest, 1.0)) + ">" * (value > longest)
        lines.append(f"  {label:<{width}} {value:9.4g}  {bar}".rstrip())
    return [*lines, *(f"  {line}" for line in closed(report))]


def _where(report: ReportData, width: int) -> list[str]:
    """The most likely place; outputs, operating range and time where they say more than everywhere and always."""
    where = report.where
    lines = [] if where.location is None else [f"Most likely place: {where.kind} {where.location}"]
    if spread_evenly(where.by_region):
        lines.append(EVENLY)
    elif len(where.by_region) > 1:
        rows = sorted(where.by_region, key=lambda row: -row.get("share", 0.0))[:MOST_ROWS]
        lines.append("Where the gap arises")
        for row in rows:
            text = f"{percent(row['share'])} at {range_text(row['rule'], report.units)} ({percent(row['samples'])} of the samples)"
            lines += textwrap.wrap(text, width, initial_indent="  ", subsequent_indent="      ")
    outputs = unit_column(where.by_output, "output", report.units)
    time = labelled("By time", report.units.get(TIME, "")) + ": RMS of the signal that is missing"
    for heading, table in (("By output", outputs), (time, where.by_time[:MOST_ROWS])):
        if len(table) > 1:
            lines += [heading, *(_cut(f"  {line}", width) for line in grid(table))]
    return lines


def _missing(report: ReportData, width: int) -> list[str]:
    """The laws of the missing term."""
    term = report.missing_term
    lines: list[str] = []
    for k, text in enumerate(law_lines(report)):
        lines += textwrap.wrap(text, width, initial_indent="  " if k else "", subsequent_indent="    ")
    if term is not None and term.candidates and report.certified_law is None:
        lines.append(f"What is missing at {term.location}, simple laws that come close")
        for text in term.candidates:
            lines += textwrap.wrap(text, width, initial_indent="  ", subsequent_indent="      ")
    return lines


def _cut(line: str, width: int) -> str:
    """A line of a table; one that is too long says so."""
    return line if len(line) <= width else line[: width - 3] + "..."


def printable(text: str) -> str:
    """Without control characters: a name in a file must not steer the terminal."""
    return "".join(c if c == "\n" or c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in text)
