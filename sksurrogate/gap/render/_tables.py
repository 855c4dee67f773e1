"""The tables of a report by name."""

from __future__ import annotations

from typing import Any

from sksurrogate.gap.render._summary import summary_of
from sksurrogate.gap.results._report_data import ReportData
from sksurrogate.gap.results._table import EMPTY, Table
from sksurrogate.gap.results._trace import Trace

__all__ = ["table_of"]


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
    rows = []
    for k, t in enumerate(trace.t):
        row: dict[str, Any] = {"run": trace.label, "t": float(t)}
        if trace.inputs is not None:
            row.update(zip(report.inputs, map(float, trace.inputs[k])))
        for j, output in enumerate(report.outputs):
            row[f"{output} measured"] = float(trace.measured[k, j])
            row[f"{output} before"] = float(trace.before[k, j])
            row[f"{output} after"] = float(trace.after[k, j])
        rows.append(row)
    return rows
