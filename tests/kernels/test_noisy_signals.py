"""Signals without their noise."""

import numpy as np
import pytest

from sksurrogate.kernels.noisy_signals import _periodic_levels, held_levels, smooth_path


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


@pytest.mark.parametrize(("period", "begin"), [(12, 0), (12, 5), (7, 3)])
def test_levels_of_one_period_are_the_means_between_its_places(period, begin):
    """Also of levels that differ by less than what a place of their own costs: they would be taken for one."""
    for seed in range(5):
        rng = np.random.default_rng(seed)
        edges = np.r_[0, np.arange(begin or period, 240, period), 240]
        u = np.repeat(rng.uniform(-6.0, 6.0, len(edges) - 1), np.diff(edges)) + 1.2 * rng.normal(size=240)
        means = np.concatenate([np.full(b - a, u[a:b].mean()) for a, b in zip(edges[:-1], edges[1:])])
        np.testing.assert_allclose(held_levels(u), means, atol=1e-12)
        np.testing.assert_allclose(held_levels(1e3 * u + 1e9), 1e3 * means + 1e9, rtol=1e-12)


def test_levels_of_one_period_are_the_best_of_all_its_places():
    # Two ways to one number: every place of the period.
    rng = np.random.default_rng(0)
    for _ in range(50):
        n = int(rng.integers(6, 40))
        period, u = int(rng.integers(2, n + 1)), rng.normal(size=n) + 5 * rng.integers(0, 2, n)
        paths = []
        for begin in range(period):
            edges = np.unique(np.r_[0, np.arange(begin, n, period), n])
            path = np.concatenate([np.full(b - a, u[a:b].mean()) for a, b in zip(edges[:-1], edges[1:])])
            paths.append((np.sum((u - path) ** 2) / 0.7**2 + (len(edges) + 1) * np.log(n), path))
        price, levels = _periodic_levels(u, 0.7, period)
        assert price == pytest.approx(min(price for price, _ in paths))
        np.testing.assert_allclose(levels, min(paths, key=lambda one: one[0])[1], atol=1e-12)


def test_levels_at_random_places_are_not_put_on_a_period():
    rng = np.random.default_rng(0)
    edges = np.r_[0, np.sort(rng.choice(np.arange(5, 235), 9, replace=False)), 240]
    u = np.repeat(rng.uniform(-6.0, 6.0, 10), np.diff(edges)) + 0.3 * rng.normal(size=240)
    found = np.flatnonzero(np.diff(held_levels(u))) + 1
    assert set(found) >= set(edges[1:-1]) and len(found) <= 10


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
