"""The law of the missing term as a formula, how far the gap shrinks with it, and its line over its variable."""

from __future__ import annotations

from html import escape

import numpy as np

from sksurrogate.gap.render._svg import POINTS, Line
from sksurrogate.gap.render._values import held_out, number, percent, quantity
from sksurrogate.gap.results._law import Law
from sksurrogate.gap.results._missing_term import Curve
from sksurrogate.gap.results._report_data import ReportData


def _title(law: Law) -> str:
    """What it is, and where it acts."""
    what = "Free curve" if law.is_curve else "Law" if law.certified else "A formula that comes close,"
    return f"{what} in {law.place}"


def _kept(law: Law, report: ReportData) -> str:
    """Whether the corrected simulator has it, and where it holds."""
    carried = "augmented_ carries it" if report.provenance.include_law else "augmented_ leaves it out"
    kept = f"certified on {held_out(report)}; {carried}" if law.certified else f"not certified on {held_out(report)}"
    ranges = "; ".join(
        f"{name} from {number(low)} to {quantity(high, report.units.get(name, ''))}"
        for name, (low, high) in law.domain.items()
    )
    return f"{kept}. Fitted for {ranges}." if ranges else f"{kept}."


def _forms(law: Law) -> list[str]:
    """Which of its terms have a name."""
    return [f"{text} has the form of {name.replace('_', ' ')}" for text, name in law.forms.items()]


def _numbers(law: Law) -> list[str]:
    """Coefficients with their standard errors."""
    lines = []
    for name, value in law.params.items():
        error = law.standard_errors.get(name, np.nan)
        text = quantity(value, law.units.get(name, ""))
        lines.append(f"{name}: {text}" + (f" (standard error {number(error, 2)})" if np.isfinite(error) else ""))
    return lines


def law_html(report: ReportData) -> str:
    """The formula with its numbers; empty without one."""
    law = report.law
    if law is None:
        return ""
    numbers = "" if law.is_curve else f'<p class="small">{escape("; ".join([*_forms(law), *_numbers(law)]))}</p>'
    closed = f"closes {percent(law.share)} of the gap's power on {held_out(report)}, " if np.isfinite(law.share) else ""
    return (
        f'<div class="card"><strong>{escape(_title(law))}</strong>'
        f'<p class="change"><code>{escape(str(law))}</code></p>{numbers}'
        f'<p class="small">{escape(closed + _kept(law, report))}</p></div>'
    )


def law_line(report: ReportData, curve: Curve) -> list[Line]:
    """The law over the variable of a curve, where it depends on this signal alone."""
    law = report.law
    if law is None or law.is_curve or tuple(law.variables) != (curve.variable,):
        return []
    try:
        with np.errstate(all="ignore"):
            at = np.linspace(np.min(curve.at), np.max(curve.at), POINTS)
            value = np.broadcast_to(law.value({curve.variable: at}), at.shape)
    except (KeyError, TypeError, ValueError):
        return []  # a law of more than its variable, of a recent past for instance
    return [Line("law", at, value, "before", "6 4", 2.0)]


def law_lines(report: ReportData) -> list[str]:
    """Formula and numbers, for the terminal."""
    law = report.law
    if law is None:
        return []
    lines = [f"{_title(law)}: {law}", _kept(law, report)]
    return lines + ([] if law.is_curve else [*_forms(law), *_numbers(law)])
