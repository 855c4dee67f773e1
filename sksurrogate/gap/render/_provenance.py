"""Where a report comes from, at the foot of the page and of the terminal text."""

from __future__ import annotations

from html import escape

import numpy as np

from sksurrogate.gap.render._units import TIME
from sksurrogate.gap.render._values import quantity
from sksurrogate.gap.results._report_data import ReportData


def provenance_pairs(report: ReportData) -> list[tuple[str, str]]:
    """What is known of where the report comes from."""
    origin = report.provenance
    pairs = [
        ("simulator", f"{origin.simulator} ({origin.access})" if origin.access else origin.simulator),
        ("data", ", ".join(origin.files)),
        ("runs, rows", f"{origin.n_runs}, {origin.n_rows}" if origin.n_rows else ""),
        ("sample time", quantity(origin.dt, report.units.get(TIME, "")) if np.isfinite(origin.dt) else ""),
        ("free parameters", ", ".join(origin.free)),
        ("effects", origin.effects if origin.n_rows else ""),
        ("other settings", origin.settings),
        ("seed", origin.seed),
        ("sksurrogate", origin.version),
        ("date", origin.date[:16].replace("T", " ")),
        ("time taken", f"{report.seconds:.1f} s" if np.isfinite(report.seconds) else ""),
        ("command", origin.command),
    ]
    return [(name, text) for name, text in pairs if text]


def provenance_html(report: ReportData) -> str:
    """A list; empty where nothing is known."""
    pairs = provenance_pairs(report)
    if not pairs:
        return ""
    entries = "".join(f"<dt>{escape(name)}</dt><dd>{escape(text)}</dd>" for name, text in pairs)
    return f"<h2>Where this comes from</h2><dl>{entries}</dl>"


def provenance_line(report: ReportData) -> str:
    """One sentence for the terminal."""
    return "; ".join(f"{name}: {text}" for name, text in provenance_pairs(report))
