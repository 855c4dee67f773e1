"""The certified law of the missing term, and how far the gap shrinks with it; empty where the report has none."""

from __future__ import annotations

from html import escape

import numpy as np

from sksurrogate.gap.render._values import percent
from sksurrogate.gap.results._report_data import ReportData

__all__ = ["after_law_html", "law_html", "law_lines"]


def _formula(report: ReportData) -> str:
    """The law as text; empty without one."""
    law = getattr(report.missing_term, "law", None)
    return "" if law is None else str(law)


def _after(report: ReportData) -> float:
    """RMSE with the law; nan where it was not measured."""
    value = getattr(report.shrink, "after_law", None)
    return float("nan") if value is None else float(value)


def law_html(report: ReportData) -> str:
    """The formula."""
    formula = _formula(report)
    return (
        f'<div class="card"><strong>Law found</strong><p class="change"><code>{escape(formula)}</code></p></div>'
        if formula
        else ""
    )


def after_law_html(report: ReportData) -> str:
    """The error with the law."""
    after = _after(report)
    if not np.isfinite(after):
        return ""
    return f"<p>With the law of what remains the error is {after:.3g} ({percent(after / report.shrink.before)} of before).</p>"


def law_lines(report: ReportData) -> list[str]:
    """Formula and error, for the terminal."""
    formula, after = _formula(report), _after(report)
    lines = [f"Law found: {formula}"] if formula else []
    return lines + ([f"  RMSE with it: {after:.4g}"] if formula and np.isfinite(after) else [])
