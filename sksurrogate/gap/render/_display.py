"""The report drawn with matplotlib."""

from __future__ import annotations

from typing import Any

import numpy as np

from sksurrogate.exceptions import require
from sksurrogate.gap.render._page import waterfall
from sksurrogate.gap.results._missing_term import MissingTerm
from sksurrogate.gap.results._report_data import ReportData

__all__ = ["GapDisplay"]


class GapDisplay:
    """Waterfall, evidence, one run, where the gap arises (regions, time, frequency), and the missing term.

    Parameters
    ----------
    report : GapReport

    Attributes
    ----------
    figure_ : matplotlib Figure
    axes_ : list of matplotlib Axes

    Examples
    --------
    >>> display = GapDisplay(diagnoser.report_).plot()   # doctest: +SKIP
    >>> display.figure_.savefig("gap.png")   # doctest: +SKIP
    """

    def __init__(self, report: ReportData):
        self.report = report

    def plot(self) -> GapDisplay:
        """Draw.

        Returns
        -------
        self

        Raises
        ------
        MissingExtraError
            matplotlib is not installed.
        """
        plt = require("matplotlib.pyplot", "plot")
        report = self.report
        panels = [self._waterfall]
        panels += [self._ranking] if len(report.ranking) else []
        panels += [self._trace] if report.traces else []
        panels += [self._regions] if len(report.where.by_region) > 1 else []
        panels += [self._time] if len(report.where.by_time) > 1 else []
        panels += [self._frequency] if len(report.where.by_frequency) else []
        panels += [self._missing] if report.missing_term is not None and report.missing_term.curves else []
        self.figure_, axes = plt.subplots(len(panels), 1, figsize=(8, 2.6 * len(panels)), constrained_layout=True)
        self.axes_ = list(np.atleast_1d(axes))
        for panel, ax in zip(panels, self.axes_):
            panel(ax)
        return self

    def _waterfall(self, ax: Any) -> None:
        rows = waterfall(self.report)[::-1]
        bars = ax.barh([label for label, _ in rows], [value for _, value in rows], color="#0072b2")
        ax.bar_label(bars, fmt="%.3g", padding=3)
        ax.set(
            xlabel="free-run RMSE / deviation of the output (runs left out)", title=f"Verdict: {self.report.verdict}"
        )
        ax.margins(x=0.12)

    def _ranking(self, ax: Any) -> None:
        rows = [row for row in self.report.ranking if np.isfinite(row["evidence"])][:8][::-1]
        labels = [f"{r['name']} at {r['location']}" + (f" in {r['variable']}" if r["variable"] else "") for r in rows]
        colours = ["#000000" if r["named"] else "#999999" for r in rows]
        ax.barh(labels, [max(r["evidence"], 0.0) for r in rows], color=colours)
        ax.set(xlabel="evidence over no effect, 2 (L - L0); named effects in black")

    def _trace(self, ax: Any) -> None:
        trace, j = self.report.traces[0], self._worst()
        measured = trace.measured[:, j]
        ax.plot(trace.t, measured, color="#8a8a8a", lw=3, label="measured")
        ax.plot(trace.t, trace.before[:, j], color="#d55e00", ls="--", label="simulator")
        ax.plot(trace.t, trace.after[:, j], color="#000000", lw=1, label="with the effects")
        low, high = ax.get_ylim()
        room = 0.6 * float(np.ptp(measured))  # a simulator that runs away must not flatten the measurement
        if room > 0:
            ax.set_ylim(max(low, float(measured.min()) - room), min(high, float(measured.max()) + room))
        ax.set(xlabel=f"time (run {trace.label}, left out of the fit)", ylabel=self.report.outputs[j])
        ax.margins(x=0)
        ax.legend(loc="upper center", bbox_to_anchor=(0.5, 1.25), ncols=3, frameon=False)

    def _worst(self) -> int:
        """The output with the largest share of the gap."""
        rows = self.report.where.by_output
        shares = [row["share"] for row in rows if row["output"] in self.report.outputs]
        return int(np.argmax(shares)) if len(shares) == len(self.report.outputs) and shares else 0

    def _regions(self, ax: Any) -> None:
        rows = list(self.report.where.by_region)[:6][::-1]
        at = np.arange(len(rows))
        ax.barh(at + 0.2, [100 * r["share"] for r in rows], 0.4, color="#d55e00", label="of the gap")
        ax.barh(at - 0.2, [100 * r["samples"] for r in rows], 0.4, color="#999999", hatch="//", label="of the samples")
        ax.set_yticks(at, [r["rule"].replace(" and ", "\nand ") for r in rows])
        ax.set(xlabel="per cent: where the gap arises")
        ax.legend(frameon=False)

    def _time(self, ax: Any) -> None:
        rows = list(self.report.where.by_time)
        if rows[0].get("kind") == "change between runs":
            ax.bar([f"runs {r['runs']}" for r in rows], [r["level"] for r in rows], color="#d55e00")
            ax.set(xlabel="runs, counted from 1 in the order of the data", ylabel="size of the gap's source")
            return
        edges = [r["start"] for r in rows] + [rows[-1]["stop"]]
        ax.stairs([r["level"] for r in rows], edges, color="#d55e00", fill=True, alpha=0.4)
        ax.set(xlabel=f"time since the start of a run ({rows[0]['kind']})", ylabel="size of the gap's source")
        ax.margins(x=0)

    def _frequency(self, ax: Any) -> None:
        rows = self.report.where.by_frequency
        middle = [(r["low"] + r["high"]) / 2 for r in rows]
        ax.step(middle, [r["gap"] for r in rows], where="mid", color="#d55e00", label="error of the simulator")
        ax.step(middle, [r["noise"] for r in rows], where="mid", color="#000000", ls=":", label="noise")
        ax.set(
            xscale="log",
            yscale="log",
            xlabel="frequency / cycles per time unit",
            ylabel="power / variance of the output",
        )
        ax.legend(frameon=False)

    def _missing(self, ax: Any) -> None:
        term = self.report.missing_term
        assert term is not None
        curve = term.curves[0]
        ax.fill_between(curve.at, curve.low, curve.high, color="#0072b2", alpha=0.3, label="90 % band")
        ax.plot(curve.at, curve.value, color="#000000", label="missing term")
        ax.set(xlabel=curve.variable, ylabel=_ylabel(term))
        ax.legend(frameon=False)


def _ylabel(term: MissingTerm) -> str:
    """What the missing term is added to: the balance of a state, an input or an output."""
    return f"d({term.location})/dt" if term.kind == "state" else f"added to {term.kind} {term.location}"
