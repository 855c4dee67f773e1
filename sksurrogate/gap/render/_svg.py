"""Pictures of the HTML page: inline SVG that a small script makes readable under the pointer.

A figure is a stack of panels over one horizontal axis. Lines are distinguished by dash and width before colour; colours are
names of the style sheet, so that dark screens and paper have their own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np

from sksurrogate.kernels.readings import spans_where

#: Letters of 14 in a picture 480 wide are about 11 px on a phone.
_FONT = 14
_LEFT, _RIGHT, _LEGEND, _LABEL, _BOTTOM = 62, 14, 26, 20, 44

#: Points of a curve that is computed.
POINTS = 201
#: Pairs of lowest and highest points that a line is thinned to.
_PAIRS = 240


@dataclass(frozen=True, eq=False)
class Line:
    """One line of a panel."""

    label: str  #: For the legend and the pointer; empty: in neither
    #: x, y: (n_points,)
    x: np.ndarray
    y: np.ndarray
    colour: str = "ink"  #: Name in the style sheet: "ink", "measured", "before", "accent", "second" or "third"
    dash: str = ""
    width: float = 1.6
    steps: bool = False  #: Whether values are held from one point to the next


@dataclass(frozen=True, eq=False)
class Panel:
    """Lines over the common axis, with a vertical axis of their own."""

    lines: Sequence[Line]
    label: str  #: Name of the vertical axis
    ylim: tuple[float, float] | None = None  #: Lines are cut off beyond it
    band: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None  #: A grey band behind the lines
    band_label: str = ""  #: What the band is, for the legend
    height: int = 180  #: Of the field, in units of the picture
    legend: bool = True  #: Whether the lines are named above the field, where no panel above has named the same


def ticks(low: float, high: float, wanted: int = 5) -> list[float]:
    """Round numbers within [low, high], about ``wanted`` of them."""
    span = high - low
    if not np.isfinite(span) or span <= 0:
        return [low] if np.isfinite(low) else []
    raw = span / wanted
    size = 10.0 ** np.floor(np.log10(raw))
    step = next(size * m for m in (1, 2, 5, 10) if size * m >= raw * 0.999)
    first = np.ceil(low / step - 1e-9)
    found = [float(k * step) for k in np.arange(first, np.floor(high / step + 1e-9) + 1)]
    return found if len(found) > 1 or wanted > 8 else ticks(low, high, wanted + 2)


def limits(values: Sequence[np.ndarray], room: float = 0.04) -> tuple[float, float]:
    """Ends of an axis that holds all finite values."""
    joined = np.concatenate([np.ravel(v) for v in values]) if values else np.array([])
    joined = joined[np.isfinite(joined)]
    if not len(joined):
        return 0.0, 1.0
    low, high = float(joined.min()), float(joined.max())
    pad = room * (high - low) if high > low else 0.5 * max(abs(high), 1e-12)
    return low - pad, high + pad


def figure(panels: Sequence[Panel], xlabel: str, title: str, width: int = 480) -> str:
    """Panels one below the other over a common axis.

    ``xlabel, title``: escaped here; ``title`` is for readers that cannot see the picture.
    """
    x_low, x_high = limits([line.x for panel in panels for line in panel.lines], room=0.0)
    inner = width - _LEFT - _RIGHT
    top, parts = 0, []
    named: set[tuple[str, ...]] = set()
    for panel in panels:
        names = tuple(line.label for line in panel.lines if line.label) + (
            (panel.band_label,) if panel.band_label else ()
        )
        legend = panel.legend and len(names) > 0 and names not in named
        named.add(names)
        parts.append(_panel(panel, x_low, x_high, top, width, inner, legend))
        top += _LABEL + (_LEGEND if legend else 0) + panel.height + 8
    height = top + _BOTTOM
    axis = "".join(
        f'<text x="{_LEFT + inner * (v - x_low) / max(x_high - x_low, 1e-300):.1f}" y="{top + 12}" '
        f'text-anchor="middle">{_number(v)}</text>'
        for v in ticks(x_low, x_high)
    )
    return (
        f'<svg class="plot" viewBox="0 0 {width} {height}" role="img" aria-label="{escape(title)}" font-size="{_FONT}" '
        f'style="max-width:{0.065 * width:.0f}em" data-x="{x_low!r} {x_high!r}" data-left="{_LEFT}" data-inner="{inner}">'
        f'{"".join(parts)}<g class="xaxis">{axis}</g>'
        f'<text x="{_LEFT + inner / 2}" y="{height - 10}" text-anchor="middle">{escape(xlabel)}</text>'
        f'<path class="cursor" d="M0 0V{top}" visibility="hidden"/></svg>'
    )


def _panel(panel: Panel, x_low: float, x_high: float, top: int, width: int, inner: int, legend: bool) -> str:
    """One panel with its axis."""
    inside = [line.y for line in panel.lines] + ([panel.band[1], panel.band[2]] if panel.band is not None else [])
    y_low, y_high = limits(inside) if panel.ylim is None else panel.ylim
    box = (x_low, x_high, y_low, y_high)
    field = top + _LABEL + (_LEGEND if legend else 0)
    body = _band(panel.band, box, inner, panel.height) if panel.band is not None else ""
    body += "".join(_polyline(line, box, inner, panel.height) for line in panel.lines)
    out = [f'<text x="4" y="{top + 14}">{escape(panel.label)}</text>']
    if legend:
        out.append(_legend(panel, top + _LABEL, width))
    out.append(f'<rect class="frame" x="{_LEFT}" y="{field}" width="{inner}" height="{panel.height}"/>')
    for value in ticks(y_low, y_high, max(2, panel.height // 45)):
        y = field + panel.height * (1 - (value - y_low) / max(y_high - y_low, 1e-300))
        out.append(f'<path class="gl" d="M{_LEFT} {y:.1f}h{inner}"/>')
        out.append(f'<text x="{_LEFT - 6}" y="{y + 5:.1f}" text-anchor="end">{_number(value)}</text>')
    out.append(
        f'<svg class="field" x="{_LEFT}" y="{field}" width="{inner}" height="{panel.height}" '
        f'viewBox="0 0 {inner} {panel.height}" preserveAspectRatio="none" data-y="{y_low!r} {y_high!r}">{body}</svg>'
    )
    return "".join(out)


def _points(
    x: np.ndarray, y: np.ndarray, box: tuple[float, float, float, float], width: int, height: int
) -> tuple[np.ndarray, np.ndarray]:
    """Points of a panel's field; far ones are held near it, beyond its border."""
    px = width * (x - box[0]) / max(box[1] - box[0], 1e-300)
    py = height * (1 - (y - box[2]) / max(box[3] - box[2], 1e-300))
    return px, np.clip(py, -10 * height, 11 * height)


def thinned(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The lowest and the highest point of every stretch, in order: peaks are kept.

    >>> x, y = thinned(np.arange(4800.0), (np.arange(4800) == 777).astype(float))
    >>> len(x) <= 480, float(y.max()), float(x[y.argmax()])
    (True, 1.0, 777.0)
    """
    n = len(y)
    if n <= 2 * _PAIRS:
        return x, y
    edges = np.linspace(0, n, _PAIRS + 1).astype(int)
    kept = []
    for a, b in zip(edges[:-1], edges[1:]):
        part = y[a:b]
        if not np.isfinite(part).any():
            kept.append(a)
        else:
            kept += sorted({a + int(np.nanargmin(part)), a + int(np.nanargmax(part))})
    return x[kept], y[kept]


def _polyline(line: Line, box: tuple[float, float, float, float], width: int, height: int) -> str:
    """A line, broken where values are missing."""
    x, y = np.asarray(line.x, dtype=float), np.asarray(line.y, dtype=float)
    x, y = thinned(x, np.where(np.isfinite(y), y, np.nan))
    if line.steps and len(x) > 1:
        x, y = np.repeat(x, 2)[1:], np.repeat(y, 2)[:-1]
    px, py = _points(x, y, box, width, height)
    out = []
    for a, b in spans_where(np.isfinite(y) & np.isfinite(x)):
        points = " ".join(f"{p:.1f},{q:.1f}" for p, q in zip(px[a:b], py[a:b]))
        name = f' data-name="{escape(line.label)}"' if line.label else ""
        out.append(f'<polyline class="{line.colour}" points="{points}"{_pen(line)}{name}/>')
    return "".join(out)


def _pen(line: Line) -> str:
    """Width and dash of a line."""
    return f' stroke-width="{line.width}"' + (f' stroke-dasharray="{line.dash}"' if line.dash else "")


def _band(
    band: tuple[np.ndarray, np.ndarray, np.ndarray], box: tuple[float, float, float, float], width: int, height: int
) -> str:
    """A grey band."""
    x, low, high = (np.asarray(part, dtype=float) for part in band)
    good = np.isfinite(low) & np.isfinite(high)
    if good.sum() < 2:
        return ""
    upper = _points(x[good], high[good], box, width, height)
    lower = _points(x[good][::-1], low[good][::-1], box, width, height)
    points = " ".join(f"{p:.1f},{q:.1f}" for part in (upper, lower) for p, q in zip(*part))
    return f'<polygon class="band" points="{points}"/>'


def _number(value: float) -> str:
    """A tick's number, short, with a real minus."""
    return format(0.0 if abs(value) < 1e-300 else value, ".4g").replace("-", "\N{MINUS SIGN}")


def _legend(panel: Panel, y: float, width: int) -> str:
    """Samples of the lines with their names, above the field."""
    out, x = [], float(_LEFT)
    for line in panel.lines:
        if line.label:
            out.append(f'<path class="{line.colour}" d="M{x:.0f} {y + 10}h24"{_pen(line)}/>')
            out.append(f'<text x="{x + 29:.0f}" y="{y + 15}">{escape(line.label)}</text>')
            x += 29 + 7.9 * len(line.label) + 14
    if panel.band_label and x + 29 + 7.9 * len(panel.band_label) < width:
        out.append(f'<rect class="band" x="{x:.0f}" y="{y + 4}" width="24" height="12"/>')
        out.append(f'<text x="{x + 29:.0f}" y="{y + 15}">{escape(panel.band_label)}</text>')
    return "".join(out)


def bar_number(value: float, longest: float) -> str:
    """The number at the end of a bar, which says whether the bar is cut.

    >>> bar_number(0.4, 0.4), bar_number(6.0, 0.4)
    ('0.4', '6 (cut)')
    """
    return f"{value:.3g} (cut)" if value > longest else f"{value:.3g}"


def bars(rows: Sequence[tuple[str, float]], longest: float) -> str:
    """Bars with their numbers, as plain boxes that flow with the page; what is longer than the longest is cut at the edge."""
    out = []
    for label, value in rows:
        share = min(100 * value / longest, 100.0)
        out.append(
            f'<div class="row"><span class="name">{escape(label)}</span><span class="rail">'
            f'<span class="bar" style="width:{max(share, 0.3):.1f}%"></span></span><span class="size">{bar_number(value, longest)}</span></div>'
        )
    return f'<div class="bars">{"".join(out)}</div>'
