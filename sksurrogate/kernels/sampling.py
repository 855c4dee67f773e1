"""Signals read between the rows of an even grid: cubic pieces with the slopes on either side of every row.

Readings with stamps that jitter, and sensors that are late or early, are the signal at ``row - shift``.
"""

from __future__ import annotations

import numpy as np


def read_between(
    y: np.ndarray,
    right: np.ndarray,
    left: np.ndarray,
    end: np.ndarray,
    shift: np.ndarray,
    dt: float,
    starts: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A signal at ``row - shift``: the cubic piece in which that lies, exactly there.

    Before the first row of a run its value, behind the last row along the last slope.

    ``y, right, left, end`` (n_columns, n_samples): values at the rows, slopes behind and before them, values just
        before them.
    ``shift`` (n_columns | 1, n_samples | 1): in rows; negative for later than the row.
    ``starts`` int (n_runs,).
    Returns ``values, right, left`` (n_columns, n_samples): of the signal that is read, slopes by time.
    """
    n = y.shape[-1]
    shape = np.broadcast_shapes(y.shape, shift.shape)
    y, right, left, end, shift = (np.broadcast_to(v, shape) for v in (y, right, left, end, shift))
    rows = np.arange(n)
    edges = np.r_[starts, n]
    first = np.repeat(starts, np.diff(edges))
    final = np.repeat(edges[1:] - 1, np.diff(edges))
    whole = np.floor(shift)
    s = 1.0 - (shift - whole)  # place within the piece, in (0, 1]
    piece = rows - np.clip(whole, -n, n).astype(int) - 1
    inside, behind = piece >= first, piece >= final
    here = np.minimum(np.where(inside, piece, first), final)
    last = np.minimum(np.where(inside, piece + 1, first), final)
    y0 = np.take_along_axis(y, here, 1)
    y1 = np.take_along_axis(np.where(whole == shift, y, end), last, 1)
    m0, m1 = dt * np.take_along_axis(right, here, 1), dt * np.take_along_axis(left, last, 1)
    q = 1.0 - s
    value = (1 + 2 * s) * q * q * y0 + s * s * (3 - 2 * s) * y1 + s * q * q * m0 - s * s * q * m1
    slope = (6 * s * q * (y1 - y0) + (1 - 4 * s + 3 * s * s) * m0 + (3 * s * s - 2 * s) * m1) / dt
    value, before = np.where(inside, value, y0), np.where(inside, slope, 0.0)
    # At the end of a piece the slope to the right is that of the next one.
    beyond = np.clip(piece + 1, first, final)
    at_node = np.take_along_axis(right, beyond, 1)
    after = np.where((q == 0) & (piece + 1 >= first), at_node, before)
    if behind.any():
        steep = np.take_along_axis(left, np.broadcast_to(final, shape), 1)
        value = np.where(behind, y0 + (piece + s - final) * dt * steep, value)
        before, after = np.where(behind, steep, before), np.where(behind, steep, after)
    return value, after, before


def with_slopes(y: np.ndarray, dt: float, starts: np.ndarray) -> np.ndarray:
    """Slopes of signals (n_signals, n_samples) by central differences within a run, for what is known at the rows alone."""
    out = np.zeros_like(y)
    edges = np.r_[starts, y.shape[1]]
    for a, b in zip(edges[:-1], edges[1:]):
        if b - a > 1:
            out[:, a:b] = np.gradient(y[:, a:b], dt, axis=1)
    return out


def slopes_so_far(y: np.ndarray, end: np.ndarray, dt: float, starts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Slopes behind and before every row, from the rows up to the end of a piece: a parabola through three of them.

    A recursion can take the same slopes, because no later row is used. The first piece of a run is straight.

    ``y, end`` (n_columns, n_samples): values at the rows, and just before them.
    ``starts`` int (n_runs,).
    Returns ``right, left`` (n_columns, n_samples).

    >>> y = np.array([[1.0, 0.0, 1.0, 4.0]])   # (s - 1)^2
    >>> [slope.tolist() for slope in slopes_so_far(y, y, 1.0, np.array([0]))]
    [[[-1.0, 0.0, 2.0, 4.0]], [[-1.0, -1.0, 2.0, 4.0]]]
    """
    right, left = np.zeros_like(y), np.zeros_like(y)
    for a, b in zip(starts, [*starts[1:], y.shape[1]]):
        if b - a > 1:
            rise = (end[:, a + 1 : b] - y[:, a : b - 1]) / dt
            last = np.concatenate([rise[:, :1], rise[:, :-1]], axis=1)
            right[:, a : b - 1], left[:, a + 1 : b] = (last + rise) / 2, rise + (rise - last) / 2
            left[:, a], right[:, b - 1] = right[:, a], left[:, b - 1]
    return right, left
