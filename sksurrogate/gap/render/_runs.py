"""Every run on the page, the worst first: outputs, residuals with the band of the noise, inputs; their errors and the noise of their outputs."""

from __future__ import annotations

from html import escape
from typing import NamedTuple

import numpy as np

from sksurrogate.gap.render._svg import Line, Panel, figure, limits
from sksurrogate.gap.render._units import TIME, axis
from sksurrogate.gap.render._values import piece
from sksurrogate.gap.results._report_data import ReportData
from sksurrogate.gap.results._trace import Trace


def deviations(report: ReportData) -> np.ndarray:
    """Standard deviation of every output over all runs (n_outputs,)."""
    measured = np.concatenate([trace.measured for trace in report.traces])
    return np.maximum(np.nanstd(measured, axis=0), 1e-300)


class Missed(NamedTuple):
    """A run, and its RMSE before and after, each output over its deviation over all runs."""

    trace: Trace
    before: float
    after: float

    def __str__(self) -> str:
        return f"{self.before:.3g} -> {self.after:.3g}"


def worst_first(report: ReportData) -> list[Missed]:
    """The runs with their errors, those that the simulator misses most first."""
    spread = deviations(report)

    def error(trace: Trace, run: np.ndarray) -> float:
        return float(np.sqrt(np.nanmean(((trace.measured - run) / spread) ** 2)))

    runs = [Missed(trace, error(trace, trace.before), error(trace, trace.corrected)) for trace in report.traces]
    return sorted(runs, key=lambda run: -np.nan_to_num(run.before, nan=-1.0))


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


#: Runs that are drawn; further ones stand in a table.
DRAWN = 24
#: Outputs and inputs of the run that is drawn large.
MOST_SIGNALS = 6
#: Residuals within this many deviations of the noise are noise.
NOISE_BAND = 2.0
#: Room that is drawn beyond the readings, over their range.
BEYOND_READINGS = 0.6
#: Below this share of the residual before, the one after could not be seen beside it.
MUCH_SMALLER = 0.3


def runs_html(report: ReportData) -> str:
    """The worst run large, the others as small multiples in the order of their error."""
    if not report.traces:
        return ""
    first, *further = worst_first(report)
    others, rest = further[: DRAWN - 1], further[DRAWN - 1 :]
    out = [
        f"<h2>Every {piece(report)}, the worst first</h2>",
        f'<p class="small">Each {piece(report)} is simulated by a fit without it. {_starts(report)}<span class="noprint">Drag over a figure to zoom, '
        "double-click to go back.</span></p>",
        _large(first, report),
    ]
    if others:
        out.append(f'<div class="grid">{"".join(_small(run, report) for run in others)}</div>')
    if rest:
        errors = "; ".join(f"{escape(str(run.trace.label))}: {run}" for run in rest)
        out.append(
            f'<details><summary>{len(rest)} more {piece(report)}s</summary><p class="small">{errors}</p></details>'
        )
    return "".join(out)


def starts_fitted(report: ReportData) -> bool:
    """Whether the simulator as it was given is drawn from initial states that are fitted to each run: where it has states."""
    return report.provenance.access in ("rhs", "step")


def _starts(report: ReportData) -> str:
    """Where the curves of the simulator begin."""
    if not starts_fitted(report):
        return ""
    return f"The dashed curve is the simulator as it was given, from initial states that are fitted to this {piece(report)} too. "


def run_name(label: object, blocks: bool = False) -> str:
    """A run as a heading; one run that was cut gives blocks.

    >>> run_name(3), run_name("run 3"), run_name("calm"), run_name(0, blocks=True)
    ('Run 3', 'run 3', 'Run calm', 'Block 0')
    """
    if blocks:
        return f"Block {label}"
    return str(label) if str(label).lower().startswith("run") else f"Run {label}"


def _called(trace: Trace, report: ReportData) -> str:
    """The heading of a run of this report."""
    return run_name(trace.label, piece(report) == "block")


def _caption(run: Missed, report: ReportData) -> str:
    return f"<figcaption><strong>{escape(_called(run.trace, report))}</strong>: RMSE / deviation {run}</figcaption>"


def _large(run: Missed, report: ReportData) -> str:
    """All outputs with their residuals, and the inputs."""
    trace = run.trace
    outputs = range(min(trace.measured.shape[1], MOST_SIGNALS))
    panels = [panel for j in outputs for panel in (_output(trace, j, report, 150), *_residuals(trace, j, report, 70))]
    panels += _inputs(trace, report, 70)
    label = axis(TIME, report.units)
    picture = figure(panels, label, _called(trace, report), width=900)
    return f'<figure><div class="wide">{picture}</div>{_caption(run, report)}</figure>'


def _small(run: Missed, report: ReportData) -> str:
    """The output that is missed most, its residual, the first input."""
    trace, j = run.trace, worst_output(report, run.trace)
    panels = [_output(trace, j, report, 120), *_residuals(trace, j, report, 50), *_inputs(trace, report, 45)[:1]]
    picture = figure(panels, axis(TIME, report.units), _called(trace, report))
    return f"<figure>{picture}{_caption(run, report)}</figure>"


def _name(names: tuple[str, ...], j: int, letter: str) -> str:
    return names[j] if j < len(names) else f"{letter}{j}"


def fitted_name(report: ReportData) -> str:
    """What distinguishes the third curve of a run from the simulator."""
    if any(trace.law is not None for trace in report.traces):
        return "with the effects and the law" if report.effects else "with the law"
    if report.effects:
        return "with the effects"
    return "re-tuned" if len(report.retuned) else "initial states fitted"


def _output(trace: Trace, j: int, report: ReportData, height: int) -> Panel:
    """Measured, simulator, simulator with what was found."""
    measured, before, after = trace.measured[:, j], trace.before[:, j], trace.corrected[:, j]
    known = np.isfinite(measured)
    lines = [
        Line("measured", trace.t[known], measured[known], "measured", width=4.0),
        Line("simulator", trace.t, before, "before", "6 4", 1.8),
        Line(fitted_name(report), trace.t, after, "ink", width=1.3),
    ]
    ends = near_readings(limits([measured, before, after]), measured[known])
    return Panel(lines, axis(_name(report.outputs, j, "y"), report.units), ends, height=height)


def near_readings(ends: tuple[float, float], readings: np.ndarray) -> tuple[float, float]:
    """Ends of an axis, not far beyond the readings (n_values,): a simulator that runs away must not flatten them.

    >>> near_readings((-1.0, 1e9), np.array([0.0, 10.0]))
    (-1.0, 16.0)
    """
    if not len(readings) or not np.ptp(readings) > 0.0:
        return ends
    room = BEYOND_READINGS * float(np.ptp(readings))
    return max(ends[0], float(readings.min()) - room), min(ends[1], float(readings.max()) + room)


def _residuals(trace: Trace, j: int, report: ReportData, height: int) -> list[Panel]:
    """Measured minus simulated, before and after, over the band of the noise.

    A residual after that is much smaller than the one before has a panel of its own: it is to be compared with the noise.
    """
    known = np.isfinite(trace.measured[:, j])
    t = trace.t[known]
    before, after = (trace.measured[known, j] - run[known, j] for run in (trace.before, trace.corrected))
    noise = NOISE_BAND * noise_of(report, j)
    ends = np.array([trace.t[0], trace.t[-1]])
    band = (ends, np.full(2, -noise), np.full(2, noise)) if np.isfinite(noise) and noise > 0 else None
    summary = "noise, two deviations" if band else ""
    first = Line("residual before", t, before, "before", "6 4", 1.2)
    second = Line("residual after", t, after, "ink", width=1.0)
    name = _name(report.outputs, j, "y")
    if not known.any() or np.nanstd(after) > MUCH_SMALLER * np.nanstd(before):
        label = f"residual, {axis(name, report.units)}"
        return [Panel([first, second], label, _range(before, after), band, summary, height)]
    return [
        Panel(
            [first], f"residual before, {axis(name, report.units)}", _range(before, before), height=height, legend=False
        ),
        Panel([second], f"residual after, {axis(name, report.units)}", _range(after, after), band, summary, height),
    ]


def _range(before: np.ndarray, after: np.ndarray) -> tuple[float, float] | None:
    """Residuals of a simulator that runs away are cut at ten times the 95th percentile of the rest."""
    sizes = np.abs(np.concatenate([before, after]))
    sizes = sizes[np.isfinite(sizes)]
    if not len(sizes) or not sizes.max() > 10 * np.quantile(sizes, 0.95):
        return None
    end = 10 * float(np.quantile(sizes, 0.95)) or float(sizes.max())
    return -end, end


def _inputs(trace: Trace, report: ReportData, height: int) -> list[Panel]:
    """The inputs, held between samples."""
    if trace.inputs is None:
        return []
    colours = ("accent", "second", "third")
    return [
        Panel(
            [Line(name, trace.t, trace.inputs[:, i], colours[i % 3], width=1.4, steps=True)],
            axis(name, report.units),
            height=height,
            legend=False,
        )
        for i, name in ((i, _name(report.inputs, i, "u")) for i in range(min(trace.inputs.shape[1], MOST_SIGNALS)))
    ]
