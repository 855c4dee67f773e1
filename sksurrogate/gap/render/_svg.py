"""Pictures of the HTML page: inline SVG, lines told apart by dash and width before colour, axes with ticks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np

__all__ = ["BLACK", "BLUE", "GREY", "ORANGE", "Line", "bars", "chart"]

# Okabe and Ito's colours.
BLACK, BLUE, ORANGE, GREY = "#000000", "#0072b2", "#d55e00", "#8a8a8a"

#: The picture in its own units; letters of 14 are about 11 px on a phone.
_WIDTH, _HEIGHT, _LEFT, _RIGHT, _TOP, _BOTTOM, _FONT = 480, 270, 58, 22, 40, 46, 14

_LARGEST = 600  #: points a line is thinned to


@dataclass(frozen=True, eq=False)
class Line:
    """One line of a chart.

    Attributes
    ----------
    label : str
        For the legend; empty: not in it.
    x, y : ndarray (n_points,)
    colour, dash : str
    width : float
    """

    label: str
    x: np.ndarray
    y: np.ndarray
    colour: str = BLACK
    dash: str = ""
    width: float = 1.6


def ticks(low: float, high: float, wanted: int = 5) -> list[float]:
    """Round numbers within [low, high], about ``wanted`` of them."""
    span = high - low
    if not np.isfinite(span) or span <= 0:
        return [low] if np.isfinite(low) else []
    raw = span / wanted
    size = 10.0 ** np.floor(np.log10(raw))
    step = next(size * m for m in (1, 2, 5, 10) if size * m >= raw * 0.999)
    first = np.ceil(low / step - 1e-9)
    return [float(k * step) for k in np.arange(first, np.floor(high / step + 1e-9) + 1)]


def limits(values: Sequence[np.ndarray], room: float = 0.04) -> tuple[float, float]:
    """Ends of an axis that holds all finite values."""
    joined = np.concatenate([np.ravel(v) for v in values])
    joined = joined[np.isfinite(joined)]
    if not len(joined):
        return 0.0, 1.0
    low, high = float(joined.min()), float(joined.max())
    pad = room * (high - low) if high > low else 0.5 * max(abs(high), 1e-12)
    return low - pad, high + pad


def chart(
    lines: Sequence[Line],
    xlabel: str,
    ylabel: str,
    title: str,
    *,
    ylim: tuple[float, float] | None = None,
    band: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None,
) -> str:
    """Lines over a common axis.

    Parameters
    ----------
    lines : sequence of Line
    xlabel, ylabel, title : str
        Escaped here; ``title`` is for readers that cannot see the picture.
    ylim : (float, float), optional
        Lines are cut off beyond it, never bent.
    band : (x, low, high), optional
        A grey band behind the lines.

    Returns
    -------
    str
    """
    x_low, x_high = limits([line.x for line in lines], room=0.0)
    inside = [line.y for line in lines] + ([band[1], band[2]] if band is not None else [])
    y_low, y_high = limits(inside) if ylim is None else ylim
    box = (x_low, x_high, y_low, y_high)
    body = _band(band, box) if band is not None else ""
    body += "".join(_polyline(line, box) for line in lines)
    width, height = _WIDTH - _LEFT - _RIGHT, _HEIGHT - _TOP - _BOTTOM
    return (
        f'<svg viewBox="0 0 {_WIDTH} {_HEIGHT}" role="img" aria-label="{escape(title)}" font-size="{_FONT}">'
        f"{_frame(box, xlabel, ylabel)}{_legend(lines)}"
        f'<svg x="{_LEFT}" y="{_TOP}" width="{width}" height="{height}" viewBox="0 0 {width} {height}">{body}</svg></svg>'
    )


def _place(x: np.ndarray, y: np.ndarray, box: tuple[float, float, float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Points of the picture's inner field; far ones are held near it, beyond its border."""
    width, height = _WIDTH - _LEFT - _RIGHT, _HEIGHT - _TOP - _BOTTOM
    px = width * (x - box[0]) / max(box[1] - box[0], 1e-300)
    py = height * (1 - (y - box[2]) / max(box[3] - box[2], 1e-300))
    return px, np.clip(py, -10 * height, 11 * height)


def _polyline(line: Line, box: tuple[float, float, float, float]) -> str:
    """A line, broken where values are missing."""
    x, y = np.asarray(line.x, dtype=float), np.asarray(line.y, dtype=float)
    every = max(1, len(y) // _LARGEST)
    x, y = x[::every], y[::every]
    px, py = _place(x, y, box)
    out = []
    finite = np.isfinite(y) & np.isfinite(x)
    edges = np.flatnonzero(np.diff(np.r_[False, finite, False].astype(int)))
    for a, b in zip(edges[::2], edges[1::2]):
        points = " ".join(f"{p:.1f},{q:.1f}" for p, q in zip(px[a:b], py[a:b]))
        dash = f' stroke-dasharray="{line.dash}"' if line.dash else ""
        out.append(
            f'<polyline points="{points}" fill="none" stroke="{line.colour}" stroke-width="{line.width}"'
            f'{dash} stroke-linejoin="round"/>'
        )
    return "".join(out)


def _band(band: tuple[np.ndarray, np.ndarray, np.ndarray], box: tuple[float, float, float, float]) -> str:
    """A grey band."""
    x, low, high = (np.asarray(part, dtype=float) for part in band)
    good = np.isfinite(low) & np.isfinite(high)
    if good.sum() < 2:
        return ""
    upper, lower = _place(x[good], high[good], box), _place(x[good][::-1], low[good][::-1], box)
    points = " ".join(f"{p:.1f},{q:.1f}" for part in (upper, lower) for p, q in zip(*part))
    return f'<polygon points="{points}" fill="#d9d9d9" stroke="none"/>'


def _frame(box: tuple[float, float, float, float], xlabel: str, ylabel: str) -> str:
    """Border, ticks with numbers, names of both axes."""
    right, bottom = _WIDTH - _RIGHT, _HEIGHT - _BOTTOM
    out = [f'<rect x="{_LEFT}" y="{_TOP}" width="{right - _LEFT}" height="{bottom - _TOP}" fill="none" stroke="#777"/>']
    for value in ticks(box[0], box[1]):
        px = _LEFT + (right - _LEFT) * (value - box[0]) / max(box[1] - box[0], 1e-300)
        out.append(f'<path d="M{px:.1f} {bottom}v5" stroke="#777"/>')
        out.append(f'<text x="{px:.1f}" y="{bottom + 19}" text-anchor="middle">{_number(value)}</text>')
    for value in ticks(box[2], box[3], 4):
        py = bottom - (bottom - _TOP) * (value - box[2]) / max(box[3] - box[2], 1e-300)
        out.append(f'<path d="M{_LEFT} {py:.1f}h-5" stroke="#777"/>')
        out.append(f'<text x="{_LEFT - 8}" y="{py + 5:.1f}" text-anchor="end">{_number(value)}</text>')
    out.append(f'<text x="{(_LEFT + right) / 2}" y="{_HEIGHT - 6}" text-anchor="middle">{escape(xlabel)}</text>')
    out.append(f'<text x="4" y="14">{escape(ylabel)}</text>')
    return "".join(out)


def _number(value: float) -> str:
    """A tick's number, short, with a real minus."""
    return format(0.0 if abs(value) < 1e-300 else value, ".4g").replace("-", "\N{MINUS SIGN}")


def _legend(lines: Sequence[Line]) -> str:
    """Samples of the lines with their names, above the frame."""
    named = [line for line in lines if line.label]
    out, x = [], float(_LEFT)
    for line in named:
        dash = f' stroke-dasharray="{line.dash}"' if line.dash else ""
        out.append(f'<path d="M{x:.0f} 30h26" stroke="{line.colour}" stroke-width="{line.width}"{dash}/>')
        out.append(f'<text x="{x + 31:.0f}" y="35">{escape(line.label)}</text>')
        x += 31 + 8.0 * len(line.label) + 16
    return "".join(out)


def bars(rows: Sequence[tuple[str, float]]) -> str:
    """Bars with their numbers, as plain boxes that flow with the page.

    Parameters
    ----------
    rows : sequence of (label, value)

    Returns
    -------
    str
    """
    longest = max([value for _, value in rows] + [1e-300])
    out = []
    for label, value in rows:
        share = 100 * value / longest
        out.append(
            f'<div class="row"><span class="name">{escape(label)}</span><span class="rail">'
            f'<span class="bar" style="width:{max(share, 0.3):.1f}%"></span></span><span class="size">{value:.3g}</span></div>'
        )
    return f'<div class="bars">{"".join(out)}</div>'
