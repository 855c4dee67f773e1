"""The report drawn with matplotlib."""

from __future__ import annotations

from typing import Any

import numpy as np

from sksurrogate.exceptions import require
from sksurrogate.gap._page import waterfall
from sksurrogate.gap._report import GapReport

__all__ = ["GapDisplay"]


class GapDisplay:
    """Waterfall, evidence, one run, error by frequency, and the missing term.

    Parameters
    ----------
    report : GapReport

    Attributes
    ----------
    figure_ : matplotlib Figure
    axes_ : list of matplotlib Axes
    """

    def __init__(self, report: GapReport):
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
        panels = [self._waterfall, self._ranking, self._trace, self._frequency]
        if report.missing_term is not None and report.missing_term.curves:
            panels.append(self._missing)
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
        if not self.report.traces:
            return
        trace = self.report.traces[0]
        ax.plot(trace.t, trace.measured[:, 0], color="#8a8a8a", lw=3, label="measured")
        ax.plot(trace.t, trace.before[:, 0], color="#d55e00", ls="--", label="simulator")
        ax.plot(trace.t, trace.after[:, 0], color="#000000", lw=1, label="with the effects")
        ax.set(xlabel="time", ylabel=self.report.outputs[0])
        ax.legend(loc="upper center", bbox_to_anchor=(0.5, 1.25), ncols=3, frameon=False)

    def _frequency(self, ax: Any) -> None:
        rows = self.report.where.by_frequency
        if not len(rows):
            return
        middle = [(r["low"] + r["high"]) / 2 for r in rows]
        ax.step(middle, [r["gap"] for r in rows], where="mid", color="#d55e00", label="error of the simulator")
        ax.step(middle, [r["noise"] for r in rows], where="mid", color="#000000", ls=":", label="noise")
        ax.set(xscale="log", yscale="log", xlabel="frequency / cycles per time unit", ylabel="power")
        ax.legend(frameon=False)

    def _missing(self, ax: Any) -> None:
        assert self.report.missing_term is not None
        curve = self.report.missing_term.curves[0]
        ax.fill_between(curve.at, curve.low, curve.high, color="#0072b2", alpha=0.3, label="90 % band")
        ax.plot(curve.at, curve.value, color="#000000", label="missing term")
        ax.set(xlabel=curve.variable, ylabel=f"d({self.report.missing_term.location})/dt")
        ax.legend(frameon=False)
