"""Sines of a driver that a smoothed signal follows: their frequencies are read off the signal, however many periods the driver covers."""

from __future__ import annotations

import numpy as np

from sksurrogate.effects._formula import Term
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
#: Share of their squares' product below which sine and cosine follow each other over the range.
INDEPENDENT = 1e-10
#: Share of the range below which a driver stands still.
NO_MOVE = 1e-6


def waves_of(drivers: Drivers) -> list[Term]:
    """Sines of every driver that the smoothed signal at a place follows."""
    force, starts = drivers.channel.force(), drivers.channel.record.starts
    found = []
    for name in drivers.present:
        z = drivers.signals[name]
        found += [Term((("swing", name, k, 0.0, phase),)) for k, phase in waves(z, force, starts)]
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
        k = grid[np.argmax(explained(grid, z, rest))]
        near = k + np.linspace(-PEAK, PEAK, 31) / reach
        near = near[near >= grid[0]]
        k = near[np.argmax(explained(near, z, rest))]
        columns = np.stack([np.ones_like(z), np.sin(k * z), np.cos(k * z)], axis=1)
        weights = linear_least_squares(columns, rest)
        found.append((float(k), float(np.arctan2(weights[2], weights[1]))))
        rest = rest - columns @ weights
    return found


def explained(frequencies: np.ndarray, z: np.ndarray, rest: np.ndarray) -> np.ndarray:
    """Squares of a signal that a constant and a sine explain beyond the constant, for each of equally spaced frequencies.

    >>> z = np.linspace(0.0, 7.0, 500)
    >>> int(explained(np.array([1.0, 2.0, 3.0]), z, 3.0 * np.sin(2.0 * z)).argmax())
    1
    """
    out, rest = np.empty(len(frequencies)), rest - rest.mean()
    turned = np.exp(1j * frequencies[0] * z)
    further = np.exp(1j * (frequencies[1] - frequencies[0]) * z) if len(frequencies) > 1 else turned
    for i in range(len(frequencies)):
        mean, twice, both = turned.mean(), (turned @ turned) / len(z), (turned @ rest) / len(z)
        # Covariances of sine and cosine with each other and with the signal.
        ss, cc = 0.5 * (1.0 - twice.real) - mean.imag**2, 0.5 * (1.0 + twice.real) - mean.real**2
        sc, s, c = 0.5 * twice.imag - mean.real * mean.imag, both.imag, both.real
        det = ss * cc - sc**2
        if det > INDEPENDENT * ss * cc:
            out[i] = (s**2 * cc - 2.0 * s * c * sc + c**2 * ss) / det
        else:
            out[i] = max(s**2 / max(ss, 1e-300), c**2 / max(cc, 1e-300))
        turned = turned * further
    return out * len(z)
