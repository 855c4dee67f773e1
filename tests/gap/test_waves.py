"""Sines of a driver are read off a smoothed signal, however many periods the driver covers."""

import numpy as np
import pytest

from sksurrogate.gap.unnamed._waves import explained, waves

N = 600
STARTS = N * np.arange(3)


def wandering(reach, seed=0):
    """A driver that wanders in three runs and covers ``reach``."""
    t = np.arange(N) / N
    rng = np.random.default_rng(seed)
    z = np.concatenate([np.sin(2 * np.pi * (f * t + rng.uniform())) for f in (0.7, 1.1, 1.6)])
    return reach * (z - z.min()) / np.ptp(z)


@pytest.mark.parametrize("reach", [2.0, 10.0, 30.0])
def test_two_sines_are_found_whatever_the_range_of_the_driver(reach):
    """Amplitude and phase of what was planted, from the frequencies that were read off, are those of the closed form."""
    z, rng = wandering(reach), np.random.default_rng(1)
    force = 2.0 * np.sin(6.0 * z + 0.4) + 0.5 * np.sin(12.0 * z + 1.0) + 0.1 * rng.normal(size=len(z))
    found = sorted(waves(z, force, STARTS)[:2])
    np.testing.assert_allclose([k for k, _ in found], [6.0, 12.0], atol=1.0 / reach)


def test_what_stands_still_has_none():
    assert waves(np.ones(3 * N), np.random.default_rng(0).normal(size=3 * N), STARTS) == []


def test_a_jump_between_runs_is_no_motion():
    """Of a driver that stands still in each run nothing is resolved by the jumps between runs."""
    assert waves(np.repeat([0.0, 5.0, 1.0], N), np.random.default_rng(0).normal(size=3 * N), STARTS) == []


def test_a_driver_that_is_held_is_resolved_by_its_steps():
    """Thirty levels, each held with rounding noise: no more frequencies than the levels tell apart."""
    rng = np.random.default_rng(0)
    z = np.repeat(rng.uniform(-2.0, 2.0, 30), 3 * N // 30) + 1e-15 * rng.normal(size=3 * N)
    found = waves(z, np.sin(z + 0.3), STARTS)
    assert found and all(k < 10.0 for k, _ in found)


@pytest.mark.parametrize("two_levels", [False, True])
def test_what_a_sine_explains_is_what_least_squares_say(two_levels):
    """Of a driver with two levels sine and cosine are one."""
    rng = np.random.default_rng(3)
    z = np.repeat(rng.integers(0, 2, 100), 20).astype(float) if two_levels else 0.05 * np.cumsum(rng.normal(size=2000))
    force, k = np.sin(3 * z) + 0.3 * rng.normal(size=2000), np.arange(1.5, 60.0, 1.5)
    rest = force - force.mean()
    columns = [np.stack([np.ones_like(z), np.sin(a * z), np.cos(a * z)], axis=1) for a in k]
    expected = [np.sum((one @ np.linalg.lstsq(one, rest, rcond=None)[0]) ** 2) for one in columns]
    np.testing.assert_allclose(explained(k, z, force), expected, rtol=1e-6)
