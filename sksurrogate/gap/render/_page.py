"""The report as a page: text for a terminal, one self-contained HTML page with inline SVG."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from html import escape

import numpy as np

from sksurrogate.effects._catalogue import CATALOGUE
from sksurrogate.gap.render._budget import budget_html, budget_lines
from sksurrogate.gap.render._record import record_html, record_lines
from sksurrogate.gap.render._svg import BLACK, GREY, ORANGE, Line, bars, chart, limits
from sksurrogate.gap.render._waterfall import waterfall
from sksurrogate.gap.results._effect_estimate import EffectEstimate, values_of, weight_of
from sksurrogate.gap.results._missing_term import Curve
from sksurrogate.gap.results._report_data import ReportData
from sksurrogate.gap.results._table import Table
from sksurrogate.gap.results._trace import Trace

__all__ = ["html_fragment", "html_page", "terminal_page"]

# Everything hangs below .skgap, so that a notebook keeps its own look.
_STYLE = """
.skgap{font:16px/1.5 system-ui,sans-serif;max-width:46em;margin:1em auto;padding:0 1em;color:#111;background:#fff;
overflow-wrap:anywhere}
.skgap h1{font-size:1.5em;line-height:1.25;margin:.5em 0}.skgap .lead{font-size:1.1em}
.skgap h2{font-size:1.2em;margin-top:2em;border-bottom:1px solid #999}.skgap h3{font-size:1em;margin:1.2em 0 .3em}
.skgap .verdict{border:2px solid #111;padding:0 .5em}.skgap .scroll{overflow-x:auto;
background:linear-gradient(90deg,#fff 2em,#fff0) local,linear-gradient(270deg,#fff 2em,#fff0) right local no-repeat,
linear-gradient(90deg,#0003,#0000 .7em),linear-gradient(270deg,#0003,#0000 .7em)}
.skgap table{border-collapse:collapse;font-size:.9em}
.skgap th,.skgap td{padding:.2em .9em .2em 0;border-bottom:1px solid #ccc;text-align:left;vertical-align:top;
overflow-wrap:normal;white-space:nowrap}
.skgap th.n,.skgap td.n{text-align:right;font-variant-numeric:tabular-nums}
.skgap tr.named td{font-weight:700}
.skgap figure{margin:1em 0}.skgap svg{width:100%;max-width:40em;height:auto;overflow:hidden}
.skgap svg text{font-family:system-ui,sans-serif;fill:#111}
.skgap figcaption,.skgap .small{font-size:.9em;color:#333}
.skgap .bars{max-width:40em}.skgap .row{display:flex;gap:.5em;align-items:center;margin:.25em 0}
.skgap .name{flex:0 0 10.5em}.skgap .rail{flex:1 1 auto}.skgap .size{flex:0 0 4.5em;font-variant-numeric:tabular-nums}
.skgap .bar{display:block;height:1.2em;background:#0072b2;border-right:2px solid #000;print-color-adjust:exact;
-webkit-print-color-adjust:exact}
.skgap .budgetbar{display:flex;gap:2px;height:1.8em;max-width:40em}.skgap .budgetbar span{min-width:2px;
print-color-adjust:exact;-webkit-print-color-adjust:exact}.skgap .budget ul{list-style:none;padding:0;margin:.4em 0}
.skgap .key{display:inline-block;width:.8em;height:.8em;margin-right:.5em;border:1px solid #111;print-color-adjust:exact;
-webkit-print-color-adjust:exact}
.skgap .effect{border-left:4px solid #111;padding:.1em 0 .1em .8em;margin:.8em 0}
.skgap .effect p{margin:.2em 0}
@media(max-width:30rem){.skgap th,.skgap td{padding-right:.6em;white-space:normal}.skgap td.n{white-space:nowrap}
.skgap .name{flex-basis:7em;font-size:.85em}.skgap .size{flex-basis:3.6em;font-size:.85em}}
@media print{.skgap{max-width:none;font-size:12px}.skgap figure,.skgap tr,.skgap .effect,.skgap .bars{break-inside:avoid}
.skgap h2,.skgap h3{break-after:avoid}.skgap .scroll{overflow:visible;background:none}.skgap td{white-space:normal}
.skgap svg{max-width:25em}}
"""

#: Column -> what the page writes over it.
_HEADS = {
    "gap": "gap",
    "samples": "share of the samples",
    "evidence": "evidence",
    "bar": "needed",
    "cost": "cost",
    "screen": "first look",
    "rule": "where",
    "low": "from",
    "high": "to",
    "gain": "separation / nats",
    "within": "in the recorded range",
}
_SHARES = ("share", "samples", "fraction")


def terminal_page(report: ReportData, width: int = 80) -> str:
    """Plain text, 80 columns.

    Parameters
    ----------
    report : GapReport
    width : int, default=80

    Returns
    -------
    str
    """
    lines = [f"VERDICT  {report.verdict}" + ("" if report.complete else "  (interrupted)"), ""]
    lines += textwrap.wrap(report.sentence, width) + [""]
    bar = budget_lines(report.budget, width)
    lines += [*bar, ""] if bar else []
    for effect in report.effects:
        lines += textwrap.wrap(f"- {effect}", width, subsequent_indent="  ")
        if effect.equivalents:
            lines += textwrap.wrap(
                "these data cannot tell it from: " + "; ".join(_key(k) for k in effect.equivalents),
                width,
                initial_indent="  ",
                subsequent_indent="    ",
            )
            lines += textwrap.wrap(effect.why, width, initial_indent="  ", subsequent_indent="    ")
    rows = waterfall(report)
    if rows:
        lines += [""] if report.effects else []
    lines += ["Free run on runs left out, RMSE over the deviation of each output"]
    longest = max([value for _, value in rows] + [1e-300])
    for label, value in rows:
        lines.append(f"  {label:<24} {value:9.4g}  " + "#" * round(30 * value / longest))
    if np.isfinite(report.shrink.fraction):
        low, high = report.shrink.interval
        lines.append(
            f"  closed: {100 * report.shrink.fraction:.1f} % of the gap above the noise [{100 * low:.1f}, {100 * high:.1f}]"
        )
    lines += [f"  {_kept(report)}"] if _kept(report) else []
    if report.where.location is not None:
        lines += ["", f"Where: {report.where.kind} {report.where.location}"]
    for title, table in (
        ("By output", report.where.by_output),
        ("By region", _telling(report.where.by_region)[:4]),
        ("By time", _telling(report.where.by_time)[:4]),
        ("Re-tuned", report.retuned),
    ):
        if len(table):
            lines += ["", title, *(_cut(f"  {line}", width) for line in str(table).splitlines())]
    if report.missing_term is not None and report.missing_term.candidates:
        lines += ["", f"Missing term at {report.missing_term.location}, closest simple laws"]
        for text in report.missing_term.candidates:
            lines += textwrap.wrap(text, width, initial_indent="  ", subsequent_indent="      ")
    if report.next_experiment is not None:
        lines += [
            "",
            "Next experiment",
            *textwrap.wrap(report.next_experiment.sentence, width, initial_indent="  ", subsequent_indent="  "),
        ]
    for note in report.notes:
        lines += ["", *textwrap.wrap(f"Note: {note}", width)]
    lines += ["", *record_lines(report.data, width)] if report.data else []
    if report.untestable:
        lines += ["", *textwrap.wrap(_untestable(report), width)]
    return printable("\n".join(lines))


def _untestable(report: ReportData) -> str:
    """What was asked for and could not be tested, in a sentence."""
    return f"Could not be tested with this simulator: {', '.join(report.untestable)}."


def _telling(table: Table) -> Table:
    """A table of where or when, nothing where it only says everywhere or always."""
    return table if len(table) > 1 else Table()


def printable(text: str) -> str:
    """Without control characters: a name in a file must not steer the terminal."""
    return "".join(c if c == "\n" or c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in text)


def _cut(line: str, width: int) -> str:
    """A line of a table; one that is too long says so."""
    return line if len(line) <= width else line[: width - 3] + "..."


def html_page(report: ReportData) -> str:
    """One page that needs nothing from outside; names are escaped.

    Parameters
    ----------
    report : GapReport

    Returns
    -------
    str
    """
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width,initial-scale=1">'
        f"<title>Sim-to-real gap: {escape(report.verdict)}</title></head>"
        f'<body style="margin:0">{html_fragment(report)}</body></html>\n'
    )


def html_fragment(report: ReportData) -> str:
    """The body of the page, with its style: for a notebook too.

    Parameters
    ----------
    report : GapReport

    Returns
    -------
    str
    """
    parts = [
        f'<style>{_STYLE}</style><div class="skgap">',
        f'<h1>Verdict: <span class="verdict">{escape(report.verdict)}</span></h1>',
        f'<p class="lead">{escape(report.sentence)}</p>',
        budget_html(report.budget),
    ]
    if not report.complete:
        parts.append("<p><strong>Interrupted:</strong> the page holds what was known by then.</p>")
    if report.effects:
        parts.append("<h2>What is missing</h2>" + "".join(_effect(effect) for effect in report.effects))
    parts += [_shrink(report), *_traces(report), *_where(report), *_missing(report)]
    if report.next_experiment is not None:
        parts.append(f"<h2>Next experiment</h2><p>{escape(report.next_experiment.sentence)}</p>")
        options = report.next_experiment.options[:8]
        one_pair = len({str(row.get("between")) for row in options}) == 1  # the sentence above names it
        parts.append(_table(options, leave_out=("between",) if one_pair else ()))
    parts.append(record_html(report.data))
    if len(report.retuned):
        parts.append("<h2>Re-tuned parameters, 90 % intervals</h2>" + _table(report.retuned))
    if len(report.ranking):
        parts.append("<h2>All rivals</h2>" + _table(report.ranking[:25]))
        parts.append(
            f'<p class="small">The first {min(25, len(report.ranking))} of {len(report.ranking)}, named ones in bold. '
            "Evidence: gain in twice the log-likelihood over no effect; it must pass what is needed.</p>"
        )
    notes = [escape(note) for note in report.notes]
    if report.untestable:
        notes.append(escape(_untestable(report)))
    if notes:
        parts.append("<h2>Notes</h2><ul>" + "".join(f"<li>{note}</li>" for note in notes) + "</ul>")
    if np.isfinite(report.seconds):
        parts.append(
            f'<p class="small">Diagnosed in {report.seconds:.1f} s. Times are in the unit of the sample time.</p>'
        )
    return "\n".join([*parts, "</div>"])


def _effect(effect: EffectEstimate) -> str:
    """One named effect, as lines that fit a phone."""
    place = f" at {effect.location}" + (f", driven by {effect.variable}" if effect.variable else "")
    form = CATALOGUE[effect.name].equation if effect.name in CATALOGUE else ""
    out = [
        f"<p><strong>{escape(effect.name.replace('_', ' '))}</strong>{escape(place)}</p>",
        f"<p>Form: <code>{escape(form)}</code></p>" if form else "",
        f"<p>{escape(values_of(effect))} (intervals: 90 %)</p>",
        f"<p>{weight_of(effect)}</p>",
    ]
    if effect.equivalents:
        others = "; ".join(_key(key) for key in effect.equivalents)
        out.append(f"<p>These data cannot tell it from: {escape(others)}. {escape(effect.why)}</p>")
    return f'<div class="effect">{"".join(out)}</div>'


def _shrink(report: ReportData) -> str:
    """The waterfall with its sentence."""
    rows = waterfall(report)
    if not rows:
        return ""
    shrink, closed = report.shrink, ""
    if np.isfinite(shrink.fraction):
        low, high = (100 * end for end in shrink.interval)
        closed = f" Closed: {100 * shrink.fraction:.1f} % of the gap above the noise [{low:.1f}, {high:.1f}]."
    return (
        f"<h2>How far the gap shrinks</h2><figure>{bars(rows)}<figcaption>Free-run RMSE on runs left out, each output "
        f"over its standard deviation.{closed} {_kept(report)}</figcaption></figure>"
    )


def _kept(report: ReportData) -> str:
    """How much of the data chooses the names again; nothing where nothing is named."""
    kept = report.shrink.same_names
    return f"Names kept by the other runs: {100 * kept:.0f} % of the folds." if np.isfinite(kept) else ""


def _traces(report: ReportData) -> list[str]:
    """Two runs: every output of the first (four at most), the first output of the second."""
    out = []
    for trace, most in zip(report.traces[:2], (4, 1)):
        for j in range(min(trace.measured.shape[1], most)):
            out.append(_trace(trace, j, report.outputs[j] if j < len(report.outputs) else f"output {j}"))
    return out


def _trace(trace: Trace, j: int, name: str) -> str:
    """A run: measured, simulator, simulator with the effects."""
    known = np.isfinite(trace.measured[:, j])
    measured, before, after = trace.measured[known, j], trace.before[:, j], trace.after[:, j]
    low, high = limits([measured, before, after])
    room = (
        0.6 * float(np.ptp(measured)) + 1e-12 if known.any() else np.inf
    )  # a run-away must not flatten the measurement
    ylim = (max(low, float(min(measured, default=low)) - room), min(high, float(max(measured, default=high)) + room))
    lines = [
        Line("measured", trace.t[known], measured, GREY, width=4.0),
        Line("simulator", trace.t, before, ORANGE, "6 4", 1.8),
        Line("with the effects", trace.t, after, BLACK, width=1.3),
    ]
    label = escape(str(trace.label))
    return (
        f"<figure>{chart(lines, 'time', name, f'run {trace.label}, {name}', ylim=ylim)}"
        f"<figcaption>Run {label}, left out of the fit: measured (thick grey), simulator (dashed), with the effects "
        "(thin black).</figcaption></figure>"
    )


def _where(report: ReportData) -> list[str]:
    """The place most accused and the tables."""
    where, parts = report.where, ["<h2>Where</h2>"]
    if where.location is not None:
        parts.append(f"<p>Most accused: {escape(str(where.kind))} <strong>{escape(where.location)}</strong>.</p>")
    for title, table in (
        ("By output (units of the output)", where.by_output),
        ("By location", where.by_location),
        ("By region of the operating range", where.by_region),
        ("By time", where.by_time),
        ("By frequency (cycles per unit of time)", where.by_frequency),
    ):
        if len(table):
            parts.append(f"<h3>{title}</h3>{_table(table)}")
        if len(table) and table is where.by_location:
            share = "what effects named there hold of the gap" if report.effects else "its probability"
            parts.append(f'<p class="small">Share: {share}. Evidence: of a free signal there alone, in nats.</p>')
        if table is where.by_time and any(row.get("kind") == "change between runs" for row in table):
            parts.append('<p class="small">Runs are counted from 1 in the order of the data.</p>')
    return parts if len(parts) > 1 else []


def _missing(report: ReportData) -> list[str]:
    """The shape of the missing term."""
    term = report.missing_term
    if term is None or not term.curves:
        return []
    out = [f"<h2>Shape of the missing term at {escape(term.location)}</h2>"]
    out += [_curve(curve) for curve in term.curves[:3]]
    if term.candidates:
        out.append("<p>Closest simple laws:</p><ul>")
        out += [f"<li><code>{escape(text)}</code></li>" for text in term.candidates] + ["</ul>"]
    return out


def _curve(curve: Curve) -> str:
    """The missing term against one variable, with its band."""
    picture = chart(
        [Line("mean", curve.at, curve.value, BLACK, width=2.0)],
        curve.variable,
        "missing term",
        f"missing term against {curve.variable}",
        band=(curve.at, curve.low, curve.high),
    )
    return (
        f"<figure>{picture}<figcaption>Against {escape(curve.variable)}: mean and 90 % band; explains "
        f"{100 * max(curve.explained, 0):.0f} % on runs left out.</figcaption></figure>"
    )


def _key(key: Sequence[str | None]) -> str:
    return f"{key[0]} at {key[1]}" + (f" in {key[2]}" if key[2] else "")


def _percent(value: float) -> str:
    """A share as people read it."""
    if not np.isfinite(value):
        return "-"
    return "< 0.1 %" if 0 < value < 0.001 else f"{100 * value:.1f} %"


def _table(table: Table, leave_out: Sequence[str] = ()) -> str:
    """An HTML table; numbers to the right, shares in per cent."""
    if not len(table):
        return ""
    columns = [name for name in table.columns if name not in leave_out]
    numeric = {
        name: any(isinstance(row[name], (int, float, np.number)) and not isinstance(row[name], bool) for row in table)
        for name in columns
    }
    head = "".join(
        f"<th{' class=n' if numeric[name] else ''}>{escape(_HEADS.get(name, name))}</th>" for name in columns
    )
    body = "".join(_row(row, columns) for row in table)
    return f'<div class="scroll"><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>'


def _row(row: Mapping[str, object], columns: Sequence[str]) -> str:
    """One line of a table."""
    cells = []
    for name in columns:
        value = row[name]
        if isinstance(value, (bool, np.bool_)):
            cells.append(f"<td>{'yes' if value else 'no'}</td>")
        elif isinstance(value, (int, float, np.number)):
            number = float(value)
            text = _percent(number) if name in _SHARES else _plain(number)
            cells.append(f"<td class=n>{text}</td>")
        else:
            cells.append(f"<td>{'-' if value is None else escape(str(value))}</td>")
    kind = ' class="named"' if row.get("named") in (True, np.True_) else ""
    return f"<tr{kind}>{''.join(cells)}</tr>"


def _plain(value: float) -> str:
    """A number; a dash where there is none, 0 for what underflowed."""
    if np.isnan(value):
        return "-"
    return format(0.0 if abs(value) < 1e-200 else value, ".4g")
