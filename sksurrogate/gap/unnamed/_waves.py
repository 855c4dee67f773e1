"""Sines of a driver that a smoothed signal follows: their frequencies are read off the signal, however many periods the driver covers."""

from __future__ import annotations

import numpy as np

from sksurrogate.effects._formula import Term
from sksurrogate.gap.unnamed._channel import Channel
from sksurrogate.gap.unnamed._drivers import Drivers
from sksurrogate.kernels.linear_fit import linear_least_squares

#: Sines that are read off along a driver, one after the other.
MOST_WAVES = 3
#: Width of a peak, as an angle over the range of a driver: neighbouring frequencies differ by it.
PEAK = 1.5
#: Angle that half of the moves from sample to sample cover: beyond it a sine is not resolved.
RESOLVED = np.pi
#: Periods over the range of a driver, beyond which no law of a plant is looked for: a long record resolves any number.
MOST_PERIODS = 100
#: Share of the range below which a driver stands still.
NO_MOVE = 1e-6


def waves_of(channel: Channel, drivers: Drivers) -> list[Term]:
    """Sines of every driver that the smoothed signal at a place follows."""
    force = channel.force()
    found = []
    for name in drivers.present:
        z = drivers.signals[name]
        found += [Term((("swing", name, k, 0.0, phase),)) for k, phase in waves(z, force, channel.record.starts)]
    return found


def waves(z: np.ndarray, force: np.ndarray, starts: np.ndarray) -> list[tuple[float, float]]:
    """Frequency and phase of the sines of ``z`` that ``force`` is made of, the largest first; (n_samples,) both.

    >>> z = np.linspace(-3.0, 6.0, 700)
    >>> found = waves(z, np.sin(6.0 * z + 0.4) + 0.3 * np.sin(12.0 * z + 1.0), np.array([0]))
    >>> [(round(k), round(phase, 1)) for k, phase in found[:2]]
    [(6, 0.4), (12, 1.0)]
    """
    reach, moves = float(np.ptp(z)), np.delete(np.abs(np.diff(z)), starts[1:] - 1)
    moves = moves[moves > NO_MOVE * reach]
    if not (len(moves) and np.isfinite(reach) and np.isfinite(force).all()):
        return []
    resolved = RESOLVED / np.median(moves) * reach
    grid = np.arange(PEAK, min(resolved, 2.0 * np.pi * MOST_PERIODS), PEAK) / reach
    rest, found = force - force.mean(), []
    for _ in range(MOST_WAVES if len(grid) else 0):
        k = max(grid, key=lambda k: _explained(k, z, rest))
        near = k + np.linspace(-PEAK, PEAK, 31) / reach
        k = max(near[near >= grid[0]], key=lambda k: _explained(k, z, rest))
        columns = _columns(k, z)
        weights = linear_least_squares(columns, rest)
        found.append((float(k), float(np.arctan2(weights[2], weights[1]))))
        rest = rest - columns @ weights
    return found


def _columns(k: float, z: np.ndarray) -> np.ndarray:
    return np.stack([np.ones_like(z), np.sin(k * z), np.cos(k * z)], axis=1)


def _explained(k: float, z: np.ndarray, rest: np.ndarray) -> float:
    """Squares of a signal that a sine of one frequency explains."""
    columns = _columns(k, z)
    g = columns.T @ rest
    return float(g @ linear_least_squares(columns.T @ columns, g))
