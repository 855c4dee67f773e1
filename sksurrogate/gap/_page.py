"""The report as a page: text for a terminal, one self-contained HTML page with inline SVG."""

from __future__ import annotations

import textwrap
from html import escape

import numpy as np

from sksurrogate.gap._report import Curve, GapReport, Table, Trace

__all__ = ["html_fragment", "html_page", "terminal_page"]

# Okabe and Ito's colours, and line styles that tell the lines apart without colour.
_BLACK, _BLUE, _ORANGE, _GREY = "#000000", "#0072b2", "#d55e00", "#8a8a8a"

_STYLE = """
body{font:16px/1.5 system-ui,sans-serif;max-width:60rem;margin:1rem auto;padding:0 1rem;color:#111;background:#fff}
h1{font-size:1.5rem;line-height:1.25}h2{font-size:1.15rem;margin-top:2rem;border-bottom:1px solid #ccc}
.verdict{font-weight:700;border:2px solid #111;padding:.1rem .5rem}.scroll{overflow-x:auto}
table{border-collapse:collapse;font-size:.9rem}th,td{padding:.2rem .6rem;border-bottom:1px solid #ddd;text-align:left}
td.n{text-align:right;font-variant-numeric:tabular-nums}svg{max-width:100%;height:auto}figure{margin:1rem 0}
figcaption{font-size:.9rem;color:#333}@media print{body{max-width:none}h2,figure,table{break-inside:avoid}}
"""


def terminal_page(report: GapReport, width: int = 80) -> str:
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
    lines += ["", "Free run on runs left out, RMSE over the deviation of each output"]
    rows = waterfall(report)
    longest = max([value for _, value in rows] + [1e-300])
    for label, value in rows:
        lines.append(f"  {label:<24} {value:9.4g}  " + "#" * round(30 * value / longest))
    if np.isfinite(report.shrink.fraction):
        low, high = report.shrink.interval
        lines.append(
            f"  closed: {100 * report.shrink.fraction:.1f} % of the gap above the noise [{100 * low:.1f}, {100 * high:.1f}]"
        )
    if report.where.location is not None:
        lines += ["", f"Where: {report.where.kind} {report.where.location}"]
    for title, table in (
        ("By output", report.where.by_output),
        ("By region", report.where.by_region[:4]),
        ("Re-tuned", report.retuned),
    ):
        if len(table):
            lines += ["", title, *(f"  {line}"[:width] for line in str(table).splitlines())]
    if report.missing_term is not None and report.missing_term.candidates:
        lines += ["", f"Missing term at {report.missing_term.location}, closest simple laws"]
        lines += [f"  {text}"[:width] for text in report.missing_term.candidates]
    if report.next_experiment is not None:
        lines += [
            "",
            "Next experiment",
            *textwrap.wrap(report.next_experiment.sentence, width, initial_indent="  ", subsequent_indent="  "),
        ]
    for note in report.notes:
        lines += ["", *textwrap.wrap(f"Note: {note}", width)]
    return "\n".join(lines)


def waterfall(report: GapReport) -> list[tuple[str, float]]:
    """Errors before, after re-tuning, after a generic correction, after the effects, and the noise."""
    s = report.shrink
    rows = [
        ("simulator", s.before),
        ("parameters re-tuned", s.after_retuning),
        ("generic correction", s.after_correction),
        ("effects added", s.after),
        ("noise", s.floor),
    ]
    return [(label, float(value)) for label, value in rows if np.isfinite(value)]


def html_page(report: GapReport) -> str:
    """One page that needs nothing from outside; names are escaped."""
    return (
        '<!doctype html><html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width,initial-scale=1">'
        f"<title>Sim-to-real gap: {escape(report.verdict)}</title><style>{_STYLE}</style></head><body>{html_fragment(report)}</body></html>"
    )


def html_fragment(report: GapReport) -> str:
    """The body of the page."""
    parts = [f'<h1><span class="verdict">{escape(report.verdict)}</span> {escape(report.sentence)}</h1>']
    if not report.complete:
        parts.append("<p><strong>Interrupted:</strong> the page holds what was known by then.</p>")
    if report.effects:
        rows = tuple(
            {
                "effect": e.name,
                "at": e.location,
                "in": e.variable,
                "share of the gap": f"{100 * e.share:.1f} %",
                "parameters, 90 % interval": "; ".join(
                    f"{k} {v:.4g} [{e.intervals[k][0]:.4g}, {e.intervals[k][1]:.4g}]" for k, v in e.params.items()
                ),
                "probability": e.probability,
                "cannot be told from": "; ".join(_key(k) for k in e.equivalents) or "-",
            }
            for e in report.effects
        )
        parts.append("<h2>What is missing</h2>" + _table(Table(rows)))
        parts += [f"<p>{escape(e.why)}</p>" for e in report.effects if e.equivalents]
    parts.append("<h2>How far the gap shrinks</h2>" + _bars(waterfall(report)))
    parts += [_trace(trace, report.outputs) for trace in report.traces[:2]]
    where = report.where
    if where.location is not None:
        parts.append(
            f"<h2>Where</h2><p>Most accused: {escape(str(where.kind))} <strong>{escape(where.location)}</strong>.</p>"
        )
    for title, table in (
        ("By output", where.by_output),
        ("By location", where.by_location),
        ("By region", where.by_region),
        ("By time", where.by_time),
        ("By frequency", where.by_frequency),
    ):
        if len(table):
            parts.append(f"<h3>{title}</h3>{_table(table)}")
    term = report.missing_term
    if term is not None and term.curves:
        parts.append(
            f"<h2>Shape of the missing term at {escape(term.location)}</h2>"
            + "".join(_curve(c) for c in term.curves[:3])
        )
        parts.append("<ul>" + "".join(f"<li>{escape(text)}</li>" for text in term.candidates) + "</ul>")
    if report.next_experiment is not None:
        parts.append(
            f"<h2>Next experiment</h2><p>{escape(report.next_experiment.sentence)}</p>{_table(report.next_experiment.options[:8])}"
        )
    if len(report.retuned):
        parts.append("<h2>Re-tuned parameters</h2>" + _table(report.retuned))
    parts.append("<h2>All rivals</h2>" + _table(report.ranking[:25]))
    if report.notes or report.untestable:
        parts.append("<h2>Notes</h2><ul>" + "".join(f"<li>{escape(note)}</li>" for note in report.notes))
        if report.untestable:
            parts.append(f"<li>Could not be tested with this simulator: {escape(', '.join(report.untestable))}.</li>")
        parts.append("</ul>")
    return "\n".join(parts)


def _key(key: tuple[str, str, str | None]) -> str:
    return f"{key[0]} at {key[1]}" + (f" in {key[2]}" if key[2] else "")


def _table(table: Table) -> str:
    """An HTML table."""
    if not len(table):
        return ""

    def cell(value: object) -> str:
        if isinstance(value, (bool, np.bool_)):
            return f"<td>{'yes' if value else 'no'}</td>"
        if isinstance(value, (int, float, np.floating)):
            return f'<td class="n">{"-" if not np.isfinite(value) else format(value, ".4g")}</td>'
        return f"<td>{'-' if value is None else escape(str(value))}</td>"

    head = "".join(f"<th>{escape(name)}</th>" for name in table.columns)
    body = "".join("<tr>" + "".join(cell(row[name]) for name in table.columns) + "</tr>" for row in table)
    return f'<div class="scroll"><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>'


def _bars(rows: list[tuple[str, float]]) -> str:
    """The waterfall as bars with their numbers."""
    if not rows:
        return ""
    longest = max(max(value for _, value in rows), 1e-300)
    out = [f'<svg viewBox="0 0 640 {34 * len(rows) + 6}" role="img" aria-label="free-run error">']
    for i, (label, value) in enumerate(rows):
        y, size = 34 * i + 4, 340 * value / longest
        out.append(f'<text x="170" y="{y + 18}" text-anchor="end" font-size="15">{escape(label)}</text>')
        out.append(f'<rect x="180" y="{y}" width="{max(size, 1):.1f}" height="26" fill="{_BLUE}"/>')
        out.append(f'<text x="{186 + size:.1f}" y="{y + 18}" font-size="15">{value:.3g}</text>')
    return (
        "<figure>"
        + "".join(out)
        + "</svg><figcaption>Free-run RMSE on runs left out, over the deviation of each output.</figcaption></figure>"
    )


def _polyline(
    x: np.ndarray,
    y: np.ndarray,
    box: tuple[float, float, float, float],
    colour: str,
    dash: str = "",
    width: float = 1.5,
) -> str:
    """A line within (x low, x high, y low, y high) on a 640 x 240 picture; at most 600 points."""
    keep = np.isfinite(y)
    keep[np.arange(len(y)) % max(1, len(y) // 600) != 0] = False
    px = 60 + 560 * (x[keep] - box[0]) / max(box[1] - box[0], 1e-300)
    py = 210 - 190 * (np.clip(y[keep], box[2], box[3]) - box[2]) / max(box[3] - box[2], 1e-300)
    points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(px, py))
    return (
        f'<polyline points="{points}" fill="none" stroke="{colour}" stroke-width="{width}" stroke-dasharray="{dash}"/>'
    )


def _axes(box: tuple[float, float, float, float], xlabel: str, ylabel: str) -> str:
    """Frame with the ends of both axes."""
    return (
        '<rect x="60" y="20" width="560" height="190" fill="none" stroke="#999"/>'
        f'<text x="60" y="226" font-size="13">{box[0]:.4g}</text><text x="620" y="226" font-size="13" text-anchor="end">{box[1]:.4g}</text>'
        f'<text x="340" y="234" font-size="13" text-anchor="middle">{escape(xlabel)}</text>'
        f'<text x="55" y="210" font-size="13" text-anchor="end">{box[2]:.3g}</text><text x="55" y="30" font-size="13" text-anchor="end">{box[3]:.3g}</text>'
        f'<text x="64" y="14" font-size="13">{escape(ylabel)}</text>'
    )


def _trace(trace: Trace, outputs: tuple[str, ...]) -> str:
    """A run: measured, simulator, simulator with the effects."""
    y = np.concatenate([trace.measured[:, 0], trace.before[:, 0][np.isfinite(trace.before[:, 0])]])
    low, high = float(np.min(y)), float(np.max(y))
    room = 0.5 * float(np.ptp(trace.measured[:, 0])) + 1e-12
    low, high = max(low, float(trace.measured[:, 0].min()) - room), min(high, float(trace.measured[:, 0].max()) + room)
    box = (float(trace.t[0]), float(trace.t[-1]), low, high)
    lines = (
        _polyline(trace.t, trace.measured[:, 0], box, _GREY, width=3.5)
        + _polyline(trace.t, trace.before[:, 0], box, _ORANGE, "6 4")
        + _polyline(trace.t, trace.after[:, 0], box, _BLACK)
    )
    name = outputs[0] if outputs else "output"
    return (
        f'<figure><svg viewBox="0 0 640 240" role="img" aria-label="run {escape(str(trace.label))}">{_axes(box, "time", name)}{lines}</svg>'
        f"<figcaption>Run {escape(str(trace.label))}, left out of the fit: measured (thick grey), simulator (dashed), with the effects (thin black).</figcaption></figure>"
    )


def _curve(curve: Curve) -> str:
    """The missing term against one variable, with its band."""
    box = (float(curve.at.min()), float(curve.at.max()), float(curve.low.min()), float(curve.high.max()))
    body = (
        _polyline(curve.at, curve.value, box, _BLACK, width=2)
        + _polyline(curve.at, curve.low, box, _BLUE, "3 3")
        + _polyline(curve.at, curve.high, box, _BLUE, "3 3")
    )
    return (
        f'<figure><svg viewBox="0 0 640 240" role="img">{_axes(box, curve.variable, "missing term")}{body}</svg>'
        f"<figcaption>Against {escape(curve.variable)}: mean and 90 % band; explains {100 * max(curve.explained, 0):.0f} % on runs left out.</figcaption></figure>"
    )
