"""The report as one self-contained HTML page: what was found first, what it rests on below."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

import numpy as np

from sksurrogate.gap.render._budget import budget_html
from sksurrogate.gap.render._code import code_of
from sksurrogate.gap.render._curves import curve_html, effect_html, form_of
from sksurrogate.gap.render._headline import (
    changes,
    headline,
    joined,
    next_steps,
    not_identified,
    related_forms,
    separating,
)
from sksurrogate.gap.render._law import law_html, law_line
from sksurrogate.gap.render._provenance import provenance_html
from sksurrogate.gap.render._record import record_html
from sksurrogate.gap.render._runs import runs_html
from sksurrogate.gap.render._script import SCRIPT
from sksurrogate.gap.render._style import STYLE
from sksurrogate.gap.render._svg import bars
from sksurrogate.gap.render._tables import explained
from sksurrogate.gap.render._units import TIME, labelled, range_text, unit_column
from sksurrogate.gap.render._values import EVENLY, capitalised, effect_text, held_out, spread_evenly
from sksurrogate.gap.render._waterfall import caption, closed, longest_bar, waterfall
from sksurrogate.gap.results._effect_estimate import EffectEstimate
from sksurrogate.gap.results._missing_term import Curve, MissingTerm
from sksurrogate.gap.results._report_data import ReportData
from sksurrogate.gap.results._table import Table

#: Candidates that the ranking shows before the rest is folded away; candidates at most.
RANKED_SHOWN, MOST_RANKED = 6, 60
#: A curve that explains less of the missing term on held-out runs (share of its variance) shows nothing.
LEAST_EXPLAINED = 0.02
#: What is said of the column "kind" of the table by time.
HOW_IT_CHANGES = "how the size goes over a run: constant, one change, a drift; or one change between runs"


def html_page(report: ReportData) -> str:
    """One page that needs nothing from outside; names are escaped."""
    title = report.provenance.title or f"Sim-to-real gap: {report.verdict}"
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width,initial-scale=1">'
        f"<title>{escape(title)}</title><style>body{{margin:0;background:#fff}}"
        "@media(prefers-color-scheme:dark){body{background:#15181b}}@media print{body{background:#fff}}</style></head>"
        f"<body>{html_fragment(report)}</body></html>\n"
    )


def html_fragment(report: ReportData) -> str:
    """The body of the page, with its style and script: for a notebook too."""
    parts = [
        f'<style>{STYLE}</style><div class="skgap">',
        _first_screen(report),
        *(_named(effect, report) for effect in report.effects),
        _unequalled(report.effects),
        record_html(report.data),
        _missing(report),
        _shrink(report),
        runs_html(report),
        _where(report),
        _experiments(report),
        _retuned(report),
        _ranking(report),
        _notes(report),
        _code(report),
        provenance_html(report),
        f"</div><script>{SCRIPT}</script>",
    ]
    return "\n".join(part for part in parts if part)


def _first_screen(report: ReportData) -> str:
    """Verdict, budget, changes with their confidence, what to do next."""
    title = report.provenance.title or "Diagnosis of the sim-to-real gap"
    parts = [f'<p class="eyebrow">{escape(title)}</p><h1><span class="word {escape(report.verdict)}">']
    parts.append(f"{escape(report.verdict)}</span> {escape(headline(report))}</h1>")
    if not report.complete:
        parts.append("<p><strong>Interrupted:</strong> this page holds the results so far.</p>")
    parts.append(budget_html(report.budget, report.shrink.fraction, held_out(report)))
    for what, lines, sure in changes(report):
        body = "".join(f'<p class="change">{escape(line)}</p>' for line in lines)
        sure = f'<p class="small">{escape(sure)}</p>' if sure else ""
        parts.append(f'<div class="card"><strong>{escape(what)}</strong>{body}{sure}</div>')
    steps = next_steps(report)
    if steps:
        entries = "".join(f"<li>{escape(step)}</li>" for step in steps)
        parts.append(f'<h3>What to do next</h3><ol class="steps">{entries}</ol>')
    return "".join(parts)


def _named(effect: EffectEstimate, report: ReportData) -> str:
    """One named effect: its form, its curve, what else explains the data."""
    others = not_identified(effect)
    parts = [
        f"<h2>{escape(capitalised(effect_text(effect)))}</h2>",
        form_of(effect),
        effect_html(effect, report),
    ]
    if others:
        parts.append(f"<p>{escape(effect.why)}</p>")
    parts += [f'<p class="small">{escape(text)}</p>' for text in related_forms(effect)]
    return "".join(parts)


def _unequalled(effects: Sequence[EffectEstimate]) -> str:
    """Why no other effect explains the data as well, each reason once; of several effects, of which it holds."""
    alone: dict[str, list[str]] = {}
    for effect in effects:
        if effect.why and not effect.equivalents:
            alone.setdefault(effect.why, []).append(effect_text(effect))
    several = len(effects) > 1
    said = (
        f"In place of {joined(names)}: {why[0].lower()}{why[1:]}" if several else why for why, names in alone.items()
    )
    return "".join(f'<p class="small">{escape(one)}</p>' for one in said)


def _shrink(report: ReportData) -> str:
    """The waterfall with its sentences."""
    rows = waterfall(report)
    if not rows:
        return ""
    said = " ".join([f"{caption(report)}.", *closed(report)])
    return f"<h2>How far the gap shrinks</h2><figure>{bars(rows, longest_bar(rows))}<figcaption>{escape(said)}</figcaption></figure>"


def _where(report: ReportData) -> str:
    """The most likely place, then the tables; those that say more than everywhere or always."""
    where = report.where
    parts = ["<h2>Where the gap arises</h2>"]
    if where.location is not None:
        parts.append(f"<p>Most likely place: {escape(str(where.kind))} <strong>{escape(where.location)}</strong>.</p>")
    even = spread_evenly(where.by_region)
    parts += [f"<p>{EVENLY}</p>"] * even
    place = {
        "share": "of the gap, held by the named effects there" if report.effects else "probability of the place",
        "evidence": "of a free signal there alone: log-likelihood difference to the least likely place",
    }
    time = report.units.get(TIME, "unit of time")
    outputs = where.by_output if len(where.by_output) > 1 else _without(where.by_output, "share")  # of one output: all
    regions = [
        {name: range_text(value, report.units) if name == "rule" else value for name, value in row.items()}
        for row in where.by_region
    ]
    tables = [
        ("By output", unit_column(outputs, "output", report.units), {}),
        ("By place", where.by_location, place),
        ("By operating range", Table(() if even else tuple(regions)), {}),
        (labelled("By time", report.units.get(TIME, "")), where.by_time, {"kind": HOW_IT_CHANGES}),
        (f"By frequency (cycles per {time})", where.by_frequency, {"gap": "power of the error", "noise": "power"}),
    ]
    shown = [(title, table, other) for title, table, other in tables if len(table)]
    parts += [f"<div><h3>{title}</h3>{explained(table, other)}</div>" for title, table, other in shown[:2]]
    if len(shown) > 2:
        heading = "time and frequency" if even else "operating range, time and frequency"
        inner = "".join(f"<h3>{title}</h3>{explained(table, other)}" for title, table, other in shown[2:])
        parts.append(f"<details><summary>By {heading}</summary>{inner}</details>")
    return "".join(parts) if len(parts) > 1 else ""


def _without(table: Table, column: str) -> Table:
    """A table without one of its columns."""
    return Table(tuple({name: value for name, value in row.items() if name != column} for row in table))


def _missing(report: ReportData) -> str:
    """The shape of the missing term and its formula."""
    term = report.missing_term
    if term is None or not (term.curves or term.candidates or term.law):
        return ""
    out = [f"<h2>What is missing at {escape(term.location)}</h2>", law_html(report)]
    curves = _telling(term)
    out += [curve_html(curve, term.location, term.kind, report, law_line(report, curve)) for curve in curves]
    if term.curves and not curves:
        out.append(f"<p>No single signal explains it on {held_out(report)}.</p>")
    if term.candidates and report.certified_law is None:
        laws = "".join(f"<li><code>{escape(text)}</code></li>" for text in term.candidates)
        out.append(f"<p>Simple laws that come close:</p><ul>{laws}</ul>")
    return "".join(out)


def _telling(term: MissingTerm) -> list[Curve]:
    """The curves that explain something, and that of the law."""
    law = () if term.law is None else tuple(term.law.variables)
    return [c for c in term.curves if c.explained > LEAST_EXPLAINED or (c.variable,) == law][:3]


def _experiments(report: ReportData) -> str:
    """The experiments that separate something."""
    rows = separating(report)
    if not rows:
        return ""
    one_pair = len({str(row.get("between")) for row in rows}) == 1  # the first screen names it
    table = Table(tuple(rows[:8]))
    return "<h2>Experiments that separate what is tied</h2>" + explained(
        _without(table, "between") if one_pair else table
    )


def _retuned(report: ReportData) -> str:
    """The free parameters, before and after: folded away, for the first screen has those that moved."""
    if not len(report.retuned):
        return ""
    other = {"low": "lower end of the 90 % interval", "high": "upper end"}
    table = explained(unit_column(report.retuned, "parameter", report.units), other)
    return f"<details><summary>All re-tuned parameters</summary>{table}</details>"


def _ranking(report: ReportData) -> str:
    """The candidates alone, by the column that decides; the rest folded away."""
    if not len(report.ranking):
        return ""
    rows = [_with_margin(dict(row)) for row in report.ranking]
    rows = sorted(rows, key=lambda row: -np.nan_to_num(row["margin"], nan=-np.inf))[:MOST_RANKED]
    short = Table(
        tuple(
            {k: row.get(k) for k in ("name", "location", "variable", "margin", "named")} for row in rows[:RANKED_SHOWN]
        )
    )
    rest = explained(Table(tuple(rows)))
    count = f"{len(rows)} of {len(report.ranking)}" if len(rows) < len(report.ranking) else "all"
    return (
        f"<h2>Single effects compared</h2>{explained(short)}"
        f"<details><summary>{count} candidates, all columns</summary>{rest}</details>"
    )


def _with_margin(row: dict) -> dict:
    """Evidence over what is needed, before the columns that it is made of."""
    margin = row.get("evidence", np.nan) - row.get("bar", np.nan)
    first = {name: row.pop(name) for name in ("name", "location", "variable") if name in row}
    return {**first, "margin": margin, **row}


def _notes(report: ReportData) -> str:
    """What a careful reader should know."""
    notes = [escape(note) for note in report.notes]
    if report.untestable:
        notes.append(escape(f"Could not be tested with this simulator: {', '.join(report.untestable)}."))
    return "<h2>Notes</h2><ul>" + "".join(f"<li>{note}</li>" for note in notes) + "</ul>" if notes else ""


def _code(report: ReportData) -> str:
    """Code to paste, where there is a corrected simulator."""
    if report.verdict not in ("explained", "partial") or not report.outputs:
        return ""
    return f"<h2>Code to paste</h2><pre><code>{escape(code_of(report))}</code></pre>"
