"""Signals without their noise."""

import numpy as np
import pytest

from sksurrogate.kernels.noisy_signals import held_levels, smooth_path


@pytest.mark.parametrize("rows", [25, 60])
def test_levels_far_apart_are_as_exact_as_the_means_between_their_edges(rows):
    u = np.repeat([0.0, 3.0, -1.0, 1.5, 1.0], rows)
    missed = [held_levels(u + 0.05 * np.random.default_rng(k).normal(size=len(u))) - u for k in range(20)]
    # A level too many now and then: its price is that of one place, not of the choice among all.
    assert np.sqrt(np.mean(np.square(missed))) < 1.4 * 0.05 / np.sqrt(rows)


def test_levels_are_the_best_of_all_partitions():
    # Two ways to one number: every partition of a short record, and the pruned recursion.
    rng = np.random.default_rng(3)
    u = np.repeat([0.0, 1.0, 0.4], [4, 3, 4]) + 0.15 * rng.normal(size=11)
    found = held_levels(u)
    sd = np.sqrt(np.sum((u - found) ** 2) / (11 - 2 * len(np.unique(found))))

    def cost(path):
        return np.sum((u - path) ** 2) / sd**2 + 2.0 * np.log(11) * (np.count_nonzero(np.diff(path)) + 1)

    def path(edges):
        parts = np.split(u, np.flatnonzero(edges) + 1)
        return np.concatenate([np.full(len(part), part.mean()) for part in parts])

    every = [cost(path([code >> k & 1 for k in range(10)])) for code in range(1024)]
    assert cost(found) == pytest.approx(min(every))


def test_noise_and_unit_move_levels_as_they_move_the_signal():
    u = np.repeat([0.0, 1.0], 50) + 0.1 * np.random.default_rng(1).normal(size=100)
    np.testing.assert_allclose(held_levels(1e6 * u - 3.0), 1e6 * held_levels(u) - 3.0, rtol=1e-9, atol=1e-6)
    exact = np.repeat([2.0, 5.0], 20)
    np.testing.assert_array_equal(held_levels(exact), exact)
    assert held_levels(np.array([4.0])).tolist() == [4.0]


def test_a_line_passes_and_noise_about_a_wave_does_not():
    rows = np.arange(300)
    np.testing.assert_allclose(smooth_path(np.full(300, 2.5)), 2.5)
    wave = np.cos(np.pi * (rows + 0.5) * 6 / 300)  # of the cosine transform: no error at the ends
    noise = 0.4 * np.random.default_rng(0).normal(size=300)
    assert np.std(smooth_path(wave + noise) - wave) < 0.25 * np.std(noise)
    np.testing.assert_allclose(smooth_path(wave[::-1] + noise[::-1]), smooth_path(wave + noise)[::-1], atol=1e-9)
