"""Slopes of the likelihood in the noise: against differences of the likelihood, and their moments against a dense inverse."""

from dataclasses import replace

import numpy as np
import pytest

from sksurrogate.kernels.disturbance import Disturbance, Noise
from sksurrogate.kernels.noise_fit import fit_noise
from sksurrogate.kernels.noise_slopes import _covariances, noise_slopes

SHAPES = [(1, 1, 1), (2, 1, 2), (3, 3, 1), (4, 2, 2)]  # states, balances, outputs


def random_plant(n, b, m, starts, n_samples, seed):
    """A stable plant that changes from sample to sample, every output of which sees all states; a residual, a noise."""
    rng = np.random.default_rng(seed)
    A = 0.85 * np.eye(n)[:, :, None] + 0.1 / n * rng.normal(size=(n, n, n_samples))
    B, C = 0.1 * rng.normal(size=(n, b, n_samples)), rng.normal(size=(m, n, n_samples))
    model = Disturbance(A, B, C, np.array(starts), np.full(n, 2.0), np.full(n, 1e-3))
    noise = Noise(rng.uniform(0.05, 0.2, m), rng.uniform(0.1, 0.5, b), 7.0, rng.uniform(0.02, 0.1, m), 12.0)
    return model, 0.2 * rng.normal(size=(m, n_samples)), noise


@pytest.mark.parametrize(("n", "b", "m"), SHAPES)
@pytest.mark.parametrize("starts", [[0], [0, 37, 38, 90]])
def test_slopes_equal_differences_of_the_likelihood(n, b, m, starts):
    model, r, noise = random_plant(n, b, m, starts, 150, n)
    slopes = noise_slopes(model, r, noise, model.factor(noise))
    eta, h = noise.pack(), 1e-4
    differences = [
        (model.log_likelihood(r, noise.unpack(eta - step)) - model.log_likelihood(r, noise.unpack(eta + step)))
        / (2 * h)
        for step in h * np.eye(len(eta))
    ]
    np.testing.assert_allclose(slopes, differences, rtol=1e-4, atol=1e-3)


@pytest.mark.parametrize(("n", "b", "m"), SHAPES)
def test_moments_equal_those_of_the_dense_inverse(n, b, m):
    model, _, noise = random_plant(n, b, m, [0, 5, 6], 9, n)
    band = model.precision(noise).reshape(-1, model.size + n)
    lower = sum(np.diag(band[: len(band) - d, d], -d) for d in range(band.shape[1]))
    inverse = np.linalg.inv(lower + np.tril(lower, -1).T).reshape(9, model.size, 9, model.size)
    now, ahead = _covariances(model, noise, model.factor(noise))
    for t in range(9):
        np.testing.assert_allclose(now[:, :, t], inverse[t, :, t], rtol=1e-6, atol=1e-9)
    for c in range(b + m):
        expected = [inverse[t, n + c, t + 1, n + c] for t in range(8)]
        np.testing.assert_allclose(ahead[c], expected, rtol=1e-6, atol=1e-9)


def test_a_state_that_no_reading_shows_leaves_the_slopes_finite():
    """What is known of it is lost among the roundings of its own row."""
    model, r, noise = random_plant(2, 1, 1, [0, 60], 120, 3)
    A, B, C = (part.transpose(1, 2, 0).copy() for part in (model.A, model.B, model.C))
    A[0, 1], A[1, 0], A[1, 1], C[:, 1], B[1] = 0.0, 0.0, 1.0, 0.0, 0.0  # an angle whose place nothing depends on
    unseen = Disturbance(A, B, C, model.starts, np.array([2.0, 10.0]), np.array([1e-3, 1e-6]))
    alone = Disturbance(A[:1, :1], B[:1], C[:, :1], model.starts, np.array([2.0]), np.array([1e-3]))
    slopes = [noise_slopes(plant, r, noise, plant.factor(noise)) for plant in (unseen, alone)]
    np.testing.assert_allclose(*slopes, rtol=1e-6, atol=1e-6)


def test_a_fit_ends_where_next_to_nothing_is_left_to_gain():
    model, _, noise = random_plant(2, 1, 1, [0, 500], 1000, 0)
    white = noise.sigma[:, None] * np.random.default_rng(1).normal(size=(1, 1000))
    held = np.array([False, False, True, True, True])
    top, _, _ = fit_noise(model, white, replace(noise, sigma=3 * noise.sigma), np.array([1.0]), held=held)
    slope = noise_slopes(model, white, top, model.factor(top))[0]
    assert slope**2 / (2 * 2 * 1000) < 0.05  # nats, by the curvature of white noise: twice the readings
