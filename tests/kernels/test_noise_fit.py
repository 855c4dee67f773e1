"""The noise of a residual, fitted: the same top from starts far away, and the sizes that were planted."""

from dataclasses import replace

import numpy as np
import pytest

from sksurrogate.kernels.disturbance import Disturbance, Noise
from sksurrogate.kernels.noise_fit import fit_noise
from sksurrogate.kernels.run_columns import RunColumns

N, STARTS = 1200, np.array([0, 400, 800])
PLANTED = Noise(np.array([0.05]), np.array([0.3]), 8.0, np.array([1e-3]), 10.0)


def first_order(seed):
    """A first-order lag shaken by a coloured force, read with white noise: the noise model and a residual."""
    rng, a = np.random.default_rng(seed), np.exp(-1.0 / PLANTED.tau)
    x, w, out = 0.0, 0.0, np.empty(N)
    for k in range(N):
        if k in STARTS:
            x, w = 0.0, 0.3 * rng.normal()
        out[k] = x
        x, w = 0.9 * x + 0.1 * w, a * w + 0.3 * np.sqrt(1 - a**2) * rng.normal()
    ones = np.ones((1, 1, N))
    model = Disturbance(0.9 * ones, 0.1 * ones, ones, STARTS, np.array([1.0]), np.array([1e-4]))
    return model, (out + 0.05 * rng.normal(size=N))[None]


@pytest.mark.parametrize("seed", range(3))
def test_the_planted_sizes_are_found(seed):
    model, r = first_order(seed)
    found, value, _ = fit_noise(model, r, replace(PLANTED, force=np.array([0.03])), np.array([1.0]))
    assert found.sigma[0] == pytest.approx(0.05, rel=0.1)
    assert found.force[0] == pytest.approx(0.3, rel=0.3)
    assert value >= model.log_likelihood(r, PLANTED) - 0.1


@pytest.mark.parametrize("factor", [0.05, 0.2, 5.0])
def test_a_start_of_another_size_leads_to_the_same_top(factor):
    """The common size has a closed form: a residual of some hundred times the noise takes no long way down."""
    model, r = first_order(0)
    _, best, _ = fit_noise(model, r, PLANTED, np.array([1.0]))
    far = replace(PLANTED, sigma=factor * PLANTED.sigma, force=factor**2 * PLANTED.force)
    _, value, _ = fit_noise(model, r, far, np.array([1.0]), max_iterations=12)
    assert value == pytest.approx(best, abs=1.0)


def test_a_fit_without_slopes_ends_where_it_stands(monkeypatch):
    def lost(*_):
        raise np.linalg.LinAlgError("not positive definite from its end")

    model, r = first_order(0)
    monkeypatch.setattr("sksurrogate.kernels.noise_fit.noise_slopes", lost)
    noise, value, _ = fit_noise(model, r, PLANTED, np.array([1.0]))
    np.testing.assert_allclose(noise.pack(), PLANTED.pack())
    assert value == pytest.approx(model.log_likelihood(r, PLANTED))


def test_columns_with_weights_of_their_own_in_every_run_are_columns_of_every_run():
    """Taken out run by run they leave the likelihood, the noise and the parameters that as many wide columns leave."""
    model, r = first_order(1)
    rng, run = np.random.default_rng(1), np.repeat(np.arange(3), 400)
    own, J = rng.normal(size=(1, 2, N)), rng.normal(size=(1, 1, N))
    own[:, :, run == 2] = 0.0  # a run that has none
    wide = np.concatenate([own * (run == k) for k in range(2)], axis=1)
    r = r + 0.3 * J[:, 0] + np.einsum("okt,tk->ot", own, np.array([[1.0, -2.0], [0.5, 0.0], [9.0, 9.0]])[run])
    held, free = np.array([4.0]), np.zeros(4)
    given = model, r, replace(PLANTED, sigma=np.array([0.1])), np.array([1.0])
    noise, value, _ = fit_noise(*given, J, held, np.zeros(1), own=RunColumns(own, run))
    other, best, _ = fit_noise(*given, np.concatenate([J, wide], axis=1), np.r_[held, free], np.zeros(5))
    assert value == pytest.approx(best, rel=1e-9)
    np.testing.assert_allclose(noise.pack(), other.pack(), rtol=1e-6)
