"""Errors from the simulator down to the noise, and how much of the gap is closed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sksurrogate.gap.render._values import held_out, percent
from sksurrogate.gap.results._report_data import ReportData


def caption(report: ReportData) -> str:
    """What the numbers are."""
    return f"RMSE of the free run on {held_out(report)} / standard deviation of each output"


def waterfall(report: ReportData) -> list[tuple[str, float]]:
    """Errors before, after re-tuning, after a generic correction, with the effects, and the noise.

    What makes held-out runs worse says so: it is not a help.
    """
    s, law = report.shrink, report.law
    beside = "with the law too" if report.effects else "with the law"

    def helps(label: str, after: float) -> str:
        return f"{label} (no help)" if after > s.before else label

    rows = [
        ("simulator", s.before),
        (helps("re-tuned parameters alone", s.after_retuning), s.after_retuning),
        (helps("generic correction", s.after_correction), s.after_correction),
        ("with the effects", s.after if report.effects else np.nan),
        (
            beside if law is None or law.certified else f"{beside} (not certified)",
            np.nan if law is None else s.after_law,
        ),
        ("noise", s.floor),
    ]
    return [(label, float(value)) for label, value in rows if np.isfinite(value)]


def longest_bar(rows: Sequence[tuple[str, float]]) -> float:
    """The error that a full bar stands for: the largest of those that are no worse than the simulator's, which comes first.

    >>> longest_bar([("simulator", 0.4), ("generic correction (no help)", 6.0), ("noise", 0.1)])
    0.4
    """
    return max(max(value for _, value in rows if value <= rows[0][1]), 1e-300)


def closed(report: ReportData) -> list[str]:
    """How much of the gap what is named and a certified law close, and how steady the names are."""
    s = report.shrink
    lines = []
    if np.isfinite(s.fraction) and (report.effects or (len(report.retuned) and s.fraction > 0.0)):
        low, high = ("below 0" if end < 0.0 else f"{100 * end:.1f}" for end in s.interval)
        how = "Closed" if report.effects else "Closed by re-tuning"
        lines.append(f"{how}: {percent(s.fraction)} of the gap above the noise, 90 % interval {low} to {high} %.")
    if report.certified_law is not None and np.isfinite(s.fraction_law):
        lines.append(f"Closed with the law: {percent(s.fraction_law)}.")
    if np.isfinite(s.same_names):
        lines.append(f"{100 * s.same_names:.0f} % of the folds choose the same names.")
    return lines
