"""The runs of a report: their errors, their order, the noise of their outputs."""

from __future__ import annotations

import numpy as np

from sksurrogate.gap.results._report_data import ReportData
from sksurrogate.gap.results._trace import Trace

__all__ = ["noise_of", "run_error", "worst_first", "worst_output"]


def deviations(report: ReportData) -> np.ndarray:
    """Standard deviation of every output over all runs (n_outputs,)."""
    measured = np.concatenate([trace.measured for trace in report.traces])
    return np.maximum(np.nanstd(measured, axis=0), 1e-300)


def run_error(report: ReportData, trace: Trace) -> tuple[float, float]:
    """RMSE of one run before and after, each output over its deviation over all runs."""
    spread = deviations(report)
    return tuple(  # type: ignore[return-value]
        float(np.sqrt(np.nanmean(((trace.measured - run) / spread) ** 2))) for run in (trace.before, trace.after)
    )


def worst_first(report: ReportData) -> list[int]:
    """Places of the runs in ``report.traces``, those that the simulator misses most first."""
    errors = [run_error(report, trace)[0] for trace in report.traces]
    return sorted(range(len(errors)), key=lambda k: (-np.nan_to_num(errors[k], nan=-1.0), k))


def worst_output(report: ReportData, trace: Trace) -> int:
    """The output of a run that the simulator misses most, over its deviation."""
    missed = ((trace.measured - trace.before) / deviations(report)) ** 2
    known = np.isfinite(missed)
    return int(np.argmax(np.sum(np.where(known, missed, 0.0), axis=0) / np.maximum(known.sum(axis=0), 1)))


def noise_of(report: ReportData, j: int) -> float:
    """Standard deviation of the sensor noise of an output; nan where it is not known."""
    name = report.outputs[j] if j < len(report.outputs) else None
    rows = [row for row in report.shrink.by_output if row["output"] == name]
    return float(rows[0]["floor"]) if rows else float("nan")
