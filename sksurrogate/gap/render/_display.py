"""The report drawn with matplotlib."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from sklearn.utils.validation import check_is_fitted

from sksurrogate.effects._catalogue import in_words
from sksurrogate.exceptions import require
from sksurrogate.gap.render._budget import fills, listed_parts, part_name
from sksurrogate.gap.render._curves import balance_axis
from sksurrogate.gap.render._runs import fitted_name, near_readings, noise_of, starts_fitted, worst_first
from sksurrogate.gap.render._svg import bar_number
from sksurrogate.gap.render._units import TIME, axis, range_text
from sksurrogate.gap.render._values import held_out, piece
from sksurrogate.gap.render._waterfall import longest_bar, waterfall
from sksurrogate.gap.results._report_data import ReportData
from sksurrogate.gap.results._trace import Trace

#: Panels that are drawn on demand alone: the overview has the others.
ON_DEMAND = ("budget", "residual", "runs")


class GapDisplay:
    """Figures of a report: waterfall, evidence, runs, residuals, where the gap arises, the missing term.

    Parameters
    ----------
    report : GapReport

    Attributes
    ----------
    figure_ : matplotlib Figure
    axes_ : list of matplotlib Axes
    ax_ : matplotlib Axes
        The first of them.

    Examples
    --------
    >>> display = GapDisplay.from_estimator(diagnoser, kind="residual")   # doctest: +SKIP
    >>> display.figure_.savefig("residual.png")   # doctest: +SKIP
    """

    def __init__(self, report: ReportData):
        self.report = report

    @classmethod
    def from_estimator(cls, diagnoser: Any, kind: str | None = None, ax: Any = None) -> GapDisplay:
        """Draw the report of a fitted diagnoser.

        Parameters
        ----------
        diagnoser : GapDiagnoser
        kind, ax
            As in :meth:`plot`.

        Returns
        -------
        GapDisplay

        Raises
        ------
        NotFittedError
            ``fit`` was not called.
        """
        check_is_fitted(diagnoser, "report_")
        return cls(diagnoser.report_).plot(kind, ax)

    @classmethod
    def from_report(cls, report: ReportData, kind: str | None = None, ax: Any = None) -> GapDisplay:
        """Draw a report; the same as ``report.plot(kind, ax)``."""
        return cls(report).plot(kind, ax)

    def plot(self, kind: str | None = None, ax: Any = None) -> GapDisplay:
        """Draw.

        Parameters
        ----------
        kind : str, optional
            One panel: "budget", "waterfall", "ranking", "trace" (the worst run), "residual" (the same run), "runs" (error of
            every run), "regions", "time", "frequency" or "missing_term". Default: all that the report has.
        ax : matplotlib Axes, optional
            Where one panel is drawn; needs ``kind``.

        Returns
        -------
        self

        Raises
        ------
        MissingExtraError
            matplotlib is not installed.
        ValueError
            There is no such panel, or the report has nothing for it.
        """
        plt = require("matplotlib.pyplot", "plot")
        panels = self._panels()
        there = {name: draw for name, draw in panels.items() if draw is not None}
        if kind is None:
            if ax is not None:
                raise ValueError("ax holds one panel: give kind too, for example plot(kind='trace', ax=ax).")
            chosen = [draw for name, draw in there.items() if name not in ON_DEMAND]
        elif kind not in panels:
            raise ValueError(f"kind={kind!r}: expected one of {list(panels)}, or None for all.")
        elif kind not in there:
            raise ValueError(f"kind={kind!r}: this report has nothing to draw there; it has {list(there)}.")
        else:
            chosen = [there[kind]]
        if ax is None:
            self.figure_, axes = plt.subplots(
                len(chosen), 1, figsize=(8, 2.6 * len(chosen) + 0.6 * (len(chosen) == 1)), constrained_layout=True
            )
            self.axes_ = list(np.atleast_1d(axes))
        else:
            self.figure_, self.axes_ = ax.figure, [ax]
        for panel, one in zip(chosen, self.axes_):
            panel(one)
        self.ax_ = self.axes_[0]
        return self

    def _panels(self) -> dict[str, Callable[[Any], None] | None]:
        """The panels by kind, in the order of the figure; None where the report has no numbers for one."""
        report, term = self.report, self.report.missing_term
        return {
            "budget": self._budget if len(report.budget) else None,
            "waterfall": self._waterfall,
            "ranking": self._ranking if len(report.ranking) else None,
            "trace": self._trace if report.traces else None,
            "residual": self._residual if report.traces else None,
            "runs": self._runs if len(report.traces) > 1 else None,
            "regions": self._regions if len(report.where.by_region) > 1 else None,
            "time": self._time if len(report.where.by_time) > 1 else None,
            "frequency": self._frequency if len(report.where.by_frequency) else None,
            "missing_term": self._missing if term is not None and term.curves else None,
        }

    def _budget(self, ax: Any) -> None:
        left, rows = 0.0, listed_parts(self.report.budget)
        for row, colour in zip(rows, fills(rows)):
            ax.barh([0], [100 * row["share"]], left=left, color=colour, edgecolor="white", label=part_name(row))
            left += 100 * row["share"]
        ax.set(
            xlabel=f"share of the gap's power on {held_out(self.report)} / %",
            yticks=[],
            ylim=(-0.5, 0.5),
            xlim=(0, max(left, 1)),
        )
        ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.35), ncols=2, frameon=False)

    def _waterfall(self, ax: Any) -> None:
        rows = waterfall(self.report)
        longest = longest_bar(rows)
        bars = ax.barh([label for label, _ in rows], [min(value, longest) for _, value in rows], color="#0072b2")
        ax.bar_label(bars, labels=[bar_number(value, longest) for _, value in rows], padding=3)
        ax.invert_yaxis()
        ax.set(
            xlabel=f"free-run RMSE / deviation of the output ({held_out(self.report)})",
            title=f"Verdict: {self.report.verdict}",
        )
        ax.margins(x=0.25)

    def _ranking(self, ax: Any) -> None:
        rows = [row for row in self.report.ranking if np.isfinite(row["evidence"])][:8][::-1]
        labels = [in_words(r["name"], r["location"], r["variable"]) for r in rows]
        colours = ["#000000" if r["named"] else "#999999" for r in rows]
        ax.barh(labels, [max(r["evidence"], 0.0) for r in rows], color=colours)
        most = max([r["evidence"] for r in rows] + [0.0])
        ax.set(xlabel="evidence over no effect, 2 (L - L0); named effects in black", xlim=(0, 1.05 * most or 1.0))

    def _trace(self, ax: Any) -> None:
        trace, j = self._worst_trace(), self._worst()
        known = np.isfinite(trace.measured[:, j])
        measured = trace.measured[known, j]
        ax.plot(trace.t[known], measured, color="#8a8a8a", lw=3, label="measured")
        ax.plot(trace.t, trace.before[:, j], color="#d55e00", ls="--", label=self._given())
        ax.plot(trace.t, trace.corrected[:, j], color="#000000", lw=1, label=fitted_name(self.report))
        ax.set_ylim(near_readings(ax.get_ylim(), measured))
        ax.set(xlabel=self._time_axis(trace.label), ylabel=axis(self.report.outputs[j], self.report.units))
        ax.margins(x=0)
        _legend_above(ax)

    def _residual(self, ax: Any) -> None:
        trace, j = self._worst_trace(), self._worst()
        noise = noise_of(self.report, j)
        if np.isfinite(noise):
            ax.axhspan(-2 * noise, 2 * noise, color="#d9d9d9", label="noise, two deviations")
        ax.plot(trace.t, trace.measured[:, j] - trace.before[:, j], color="#d55e00", ls="--", label=self._given())
        ax.plot(
            trace.t, trace.measured[:, j] - trace.corrected[:, j], color="#000000", lw=1, label=fitted_name(self.report)
        )
        name = self.report.outputs[j]
        ax.set(xlabel=self._time_axis(trace.label), ylabel=f"residual of {axis(name, self.report.units)}")
        ax.margins(x=0)
        _legend_above(ax)

    def _runs(self, ax: Any) -> None:
        runs = worst_first(self.report)
        at = np.arange(len(runs))
        ax.bar(at - 0.2, [run.before for run in runs], 0.4, color="#d55e00", hatch="//", label="simulator")
        ax.bar(at + 0.2, [run.after for run in runs], 0.4, color="#000000", label=fitted_name(self.report))
        ax.set_xticks(at, [str(run.trace.label) for run in runs], rotation=45 if len(runs) > 8 else 0)
        ax.set(xlabel=f"{piece(self.report)}, the worst first", ylabel="RMSE / deviation")
        _legend_above(ax)

    def _given(self) -> str:
        """The simulator as it was given, in a legend."""
        return "simulator, start fitted" if starts_fitted(self.report) else "simulator"

    def _time_axis(self, label: Any) -> str:
        return f"{axis(TIME, self.report.units)} (held-out {piece(self.report)} {label})"

    def _worst_trace(self) -> Trace:
        """The run that the simulator misses most."""
        return worst_first(self.report)[0].trace

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
        ax.set_yticks(at, [range_text(r["rule"], self.report.units).replace(" and ", "\nand ") for r in rows])
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
        time = axis(TIME, self.report.units)
        ax.set(xlabel=f"{time} since the start of a run ({rows[0]['kind']})", ylabel="size of the gap's source")
        ax.margins(x=0)

    def _frequency(self, ax: Any) -> None:
        rows = self.report.where.by_frequency
        middle = [(r["low"] + r["high"]) / 2 for r in rows]
        ax.step(middle, [r["gap"] for r in rows], where="mid", color="#d55e00", label="error of the simulator")
        ax.step(middle, [r["noise"] for r in rows], where="mid", color="#000000", ls=":", label="noise")
        ax.set(
            xscale="log",
            yscale="log",
            xlabel=f"frequency / cycles per {self.report.units.get(TIME, 'unit of time')}",
            ylabel="power / variance of the output",
        )
        ax.legend(frameon=False)

    def _missing(self, ax: Any) -> None:
        term = self.report.missing_term
        assert term is not None
        curve = term.curves[0]
        ax.fill_between(curve.at, curve.low, curve.high, color="#0072b2", alpha=0.3, label="90 % band")
        ax.plot(curve.at, curve.value, color="#000000", label="missing term")
        ax.set(
            xlabel=axis(curve.variable, self.report.units), ylabel=balance_axis(term.location, term.kind, self.report)
        )
        ax.legend(frameon=False)


def _legend_above(ax: Any) -> None:
    """Names of the lines in one row above the field."""
    ax.legend(loc="upper center", bbox_to_anchor=(0.5, 1.25), ncols=3, frameon=False)
