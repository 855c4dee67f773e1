"""Errors from the simulator down to the noise."""

from __future__ import annotations

import numpy as np

from sksurrogate.gap.results._report_data import ReportData

__all__ = ["waterfall"]


def waterfall(report: ReportData) -> list[tuple[str, float]]:
    """Errors before, after re-tuning, after a generic correction, after the effects, and the noise.

    What makes runs left out worse says so: it is not a help.
    """
    s = report.shrink

    def helps(label: str, after: float) -> str:
        return f"{label} (no help)" if after > s.before else label

    rows = [
        ("simulator", s.before),
        (helps("parameters re-tuned", s.after_retuning), s.after_retuning),
        (helps("generic correction", s.after_correction), s.after_correction),
        ("effects added", s.after),
        ("law added too", s.after_law),
        ("noise", s.floor),
    ]
    return [(label, float(value)) for label, value in rows if np.isfinite(value)]
