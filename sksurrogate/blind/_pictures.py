"""Figures of a blind check; without matplotlib there are none."""

from __future__ import annotations

import base64
import io
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from sksurrogate.blind._cases import ARMS
from sksurrogate.blind._limits import wilson
from sksurrogate.blind._probabilities import reliability_points

Row = Mapping[str, Any]

BLUE, RED, GREEN, GREY = "#4878a8", "#b5482a", "#6a9a58", "#999999"
#: Missing terms that are drawn at most.
MOST_CURVES = 12


def _figure(width: float, height: float) -> Any:
    """A figure without a screen; None without matplotlib."""
    try:
        from matplotlib.figure import Figure
    except ImportError:
        return None
    return Figure(figsize=(width, height), layout="constrained")


def embedded(figure: Any) -> str:
    """A figure as PNG in base64."""
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=100)
    return base64.b64encode(stream.getvalue()).decode()


def overview(result: Any) -> Any:
    """Right answers by arm, detection over the size of the gap, probabilities, shrink; None without matplotlib."""
    figure = _figure(10.5, 7.2)
    if figure is None:
        return None
    (first, second), (third, fourth) = figure.subplots(2, 2)
    _by_arm(first, [row for row in result.rows if row.get("right") is not None])
    _over_size(second, result.detection())
    points = result.calibration()
    third.plot([0, 1], [0, 1], color="#bbbbbb")
    for p in points:
        low, high = wilson(round(p["right"] * p["count"]), p["count"])
        third.plot([p["stated"]] * 2, [low, high], color=RED, linewidth=1)
        third.annotate(f"{p['count']}", (p["stated"], p["right"]), (4, -9), textcoords="offset points", fontsize=7)
    third.plot([p["stated"] for p in points], [p["right"] for p in points], "o", color=RED)
    third.set(xlabel="probability stated (counts; bars: 90 %)", ylabel="share true", xlim=(0, 1.06), ylim=(0, 1.05))
    _shrink(fourth, result.rows)
    return figure


def reliability(pairs: Sequence[tuple[float, bool]]) -> Any:
    """Stated probability of names, with their class, against the share that acts; None without matplotlib."""
    figure = _figure(4.6, 4.2)
    if figure is None:
        return None
    axes = figure.subplots()
    axes.plot([0, 1], [0, 1], color="#bbbbbb")
    for stated, share, count in reliability_points(pairs):
        low, high = wilson(round(share * count), count)
        axes.plot([stated] * 2, [low, high], color=RED, linewidth=1)
        axes.plot([stated], [share], "o", color=RED)
        axes.annotate(
            f"{count}", (stated, share), (-6, 0), textcoords="offset points", fontsize=8, ha="right", va="center"
        )
    axes.set(
        xlabel="probability stated (mean of a bin)",
        ylabel="share that acts in the plant",
        xlim=(0, 1.03),
        ylim=(0, 1.05),
    )
    axes.set_title("Names with their class: counts, 90 % limits", fontsize=10)
    return figure


def _by_arm(axes: Any, rows: Sequence[Row]) -> None:
    """Shares of right answers with their 90 % intervals."""
    have = {row["arm"] for row in rows}
    arms = [arm for arm in ARMS if arm in have]
    for k, arm in enumerate(arms):
        right = [bool(row["right"]) for row in rows if row["arm"] == arm]
        low, high = wilson(sum(right), len(right))
        axes.barh(k, sum(right) / len(right), color=BLUE, height=0.7)
        axes.plot([low, high], [k, k], color="#222222", linewidth=1)
        axes.text(0.01, k, f"{sum(right)} of {len(right)}", va="center", color="white", fontsize=7)
    axes.set_yticks(range(len(arms)), arms, fontsize=8)
    axes.invert_yaxis()
    axes.set(xlim=(0, 1.01), xlabel="share of right answers (lines: 90 %)")


def _over_size(axes: Any, points: Sequence[Row]) -> None:
    """The detection curve."""
    x = [p["middle"] for p in points]
    if x:
        axes.fill_between(
            x, [p["low"] for p in points], [p["high"] for p in points], color=GREEN, alpha=0.25, linewidth=0
        )
        axes.plot(x, [p["named"] for p in points], "o-", color=GREEN, label="true effect in the class named")
        axes.plot(x, [p["false"] for p in points], ".--", color=RED, label="a false name")
        for p in points:
            axes.annotate(f"{p['cases']}", (p["middle"], p["named"]), (0, -11), textcoords="offset points", fontsize=7, ha="center")  # fmt: skip
        axes.set_xscale("log")
        axes.legend(fontsize=8, loc="center right", frameon=False)
    axes.set(ylim=(-0.02, 1.06), xlabel="gap / noise (cases; band: 90 %)", ylabel="share of cases, one effect")


def _shrink(axes: Any, rows: Sequence[Row]) -> None:
    """Gap left on the test runs against what the refitted truth leaves."""
    some = [
        row for row in rows
        if row.get("oracle") is not None and row.get("shrink") is not None and row["expected"] == "explained"
    ]  # fmt: skip
    ends = np.array([1e-4, 1.0])
    axes.loglog(ends, ends, color="#bbbbbb")
    for right, colour, label in ((True, BLUE, "right"), (False, RED, "wrong")):
        part = [row for row in some if bool(row["right"]) is right]
        x, y = ([max(1 - row[key], 1e-4) for row in part] for key in ("oracle", "shrink"))
        axes.plot(x, np.minimum(y, 2.0), "o", color=colour, markersize=3, alpha=0.6, label=f"{label} ({len(part)})")
    axes.set(xlabel="gap left by the true effect, refitted", ylabel="gap left by the diagnosis")
    axes.legend(fontsize=8, loc="lower right", frameon=False)


def missing_terms(rows: Sequence[Row]) -> Any:
    """Learned missing terms over the true ones, spread from the best to the worst; None where there are none."""
    some = sorted((row for row in rows if row.get("curve")), key=lambda row: -row["shape"])
    if not some:
        return None
    some = [some[round(k)] for k in np.linspace(0, len(some) - 1, min(MOST_CURVES, len(some)))]
    columns = min(4, len(some))
    lines = -(-len(some) // columns)
    figure = _figure(2.7 * columns, 2.3 * lines)
    if figure is None:
        return None
    for axes, row in zip(figure.subplots(lines, columns, squeeze=False).ravel(), some):
        curve = row["curve"]
        axes.plot(curve["at"], curve["true"], color=GREY, linewidth=4, alpha=0.6, label="true")
        axes.plot(curve["at"], curve["value"], color=RED, linewidth=1.3, label="learned")
        axes.set_title(f"{row['truths'][0]['name']}\n{row['plant']}, r = {row['shape']:.3f}", fontsize=8)
        axes.set_xlabel(curve["variable"], fontsize=8)
        axes.tick_params(labelsize=7)
    for axes in figure.axes[len(some) :]:
        axes.set_axis_off()
    figure.axes[0].legend(fontsize=7, frameon=False)
    return figure


def recorded_terms(rows: Sequence[Row]) -> Any:
    """Missing terms learned from real recordings over the documented ones; None where there are none.

    ``rows``: rows of :func:`~sksurrogate.blind._recorded.run_recorded` that hold ``curve``.
    """
    some = [row for row in rows if row.get("curve")]
    figure = _figure(3.6 * max(len(some), 1), 3.0) if some else None
    if figure is None:
        return None
    for axes, row in zip(figure.subplots(1, len(some), squeeze=False)[0], some):
        curve = row["curve"]
        axes.plot(curve["at"], curve["true"], color=GREY, linewidth=4, alpha=0.6, label=curve["documented"])
        if curve.get("low"):
            axes.fill_between(curve["at"], curve["low"], curve["high"], color=RED, alpha=0.2, linewidth=0)
        axes.plot(curve["at"], curve["value"], color=RED, linewidth=1.3, label="learned without it")
        axes.set_title(row["recording"], fontsize=9)
        axes.set_xlabel(curve["variable"], fontsize=8)
        axes.set_ylabel(f"d {curve['location']} / dt, mean removed", fontsize=8)
        axes.legend(fontsize=7, frameon=False)
        axes.tick_params(labelsize=7)
    return figure
