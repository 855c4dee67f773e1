"""Readings that were not measured: likelihoods against the dense Gaussian of the measured ones, slopes against differences."""

import numpy as np
import pytest

from sksurrogate.kernels.disturbance import Disturbance, Noise
from sksurrogate.kernels.noise_slopes import noise_slopes
from sksurrogate.kernels.record import Record, bridged
from sksurrogate.kernels.smoother import noise_of_differences

STARTS, N = [0, 13, 25], 40


def plant(seed=0, n=2, b=1, m=2, known=None):
    """A stable plant of three runs; a residual with anything where nothing was measured; a noise."""
    rng = np.random.default_rng(seed)
    A = 0.85 * np.eye(n)[:, :, None] + 0.1 / n * rng.normal(size=(n, n, N))
    B, C = 0.1 * rng.normal(size=(n, b, N)), rng.normal(size=(m, n, N))
    model = Disturbance(A, B, C, np.array(STARTS), np.full(n, 2.0), np.full(n, 1e-3), known)
    noise = Noise(rng.uniform(0.05, 0.2, m), rng.uniform(0.1, 0.5, b), 7.0, rng.uniform(0.02, 0.1, m), 12.0)
    return model, 0.2 * rng.normal(size=(m, N)), noise


def some_known(seed=1):
    known = np.random.default_rng(seed).random((2, N)) > 0.3
    known[1] &= np.arange(N) % 5 == 0  # a slow sensor
    known[1, 13:25] = False  # one that has failed for a run
    return known


def test_likelihood_is_that_of_the_measured_values_alone():
    known = some_known()
    whole, r, noise = plant()
    precision, _ = whole.gram(np.eye(2 * N).reshape(2, N, 2 * N).transpose(0, 2, 1), noise)
    S = np.linalg.inv(precision)[np.ix_(known.ravel(), known.ravel())]
    seen = r.ravel()[known.ravel()]
    dense = -0.5 * (seen @ np.linalg.solve(S, seen) + np.linalg.slogdet(S)[1])
    assert plant(known=known)[0].log_likelihood(r, noise) == pytest.approx(dense, rel=1e-7)


def test_all_forms_of_the_gram_agree_and_do_not_see_what_was_not_measured():
    known = some_known()
    model, _, noise = plant(known=known)
    rng = np.random.default_rng(3)
    columns = rng.normal(size=(2, 6, N))
    G, logdet = model.gram(columns, noise)
    other = np.where(known[:, None], columns, rng.normal(size=columns.shape))
    np.testing.assert_allclose(model.gram(other, noise)[0], G, rtol=1e-10)
    runs, logdets = model.gram_by_run(other, noise)
    np.testing.assert_allclose(runs.sum(axis=0), G, rtol=1e-9)
    assert logdets.sum() == pytest.approx(logdet)
    rows, diagonal = model.gram_rows(other.transpose(1, 0, 2), noise, 2)
    np.testing.assert_allclose(rows, G[:2], rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(diagonal, np.diag(G), rtol=1e-8)
    (each,) = model.grams_beside(other[:, :2], noise)([other[:, 2:]])
    np.testing.assert_allclose(each, G, rtol=1e-9)


def test_slopes_equal_differences_of_the_likelihood():
    model, r, noise = plant(known=some_known())
    slopes = noise_slopes(model, r, noise, model.factor(noise))
    eta, h = noise.pack(), 1e-4
    differences = [
        (model.log_likelihood(r, noise.unpack(eta - step)) - model.log_likelihood(r, noise.unpack(eta + step)))
        / (2 * h)
        for step in h * np.eye(len(eta))
    ]
    np.testing.assert_allclose(slopes, differences, rtol=1e-4, atol=1e-3)


def test_spread_is_that_of_sums_of_measured_values():
    known = some_known()
    v = np.random.default_rng(4).normal(size=(2, 3, N))
    masked, noise = plant(known=known)[0], plant()[2]
    expected = plant()[0].spread(np.where(known[:, None], v, 0.0), noise)
    np.testing.assert_allclose(masked.spread(v, noise), expected, rtol=1e-10)


def test_noise_of_a_slow_sensor_and_of_one_with_dropouts_is_found():
    t = 0.1 * np.arange(4000)
    rng = np.random.default_rng(5)
    y = np.stack([np.sin(0.2 * t), np.cos(0.1 * t)]) + np.array([[0.05], [0.2]]) * rng.normal(size=(2, len(t)))
    known = np.stack([rng.random(len(t)) > 0.4, np.arange(len(t)) % 5 == 0])
    found = noise_of_differences(np.where(known, y, 1e9), np.array([0, 2000]), known, t)
    np.testing.assert_allclose(found, [0.05, 0.2], rtol=0.1)


def test_divided_differences_of_all_values_are_plain_ones():
    y = np.random.default_rng(6).normal(size=(2, 300))
    starts, all_known = np.array([0, 120]), np.ones((2, 300), bool)
    np.testing.assert_allclose(noise_of_differences(y, starts, all_known), noise_of_differences(y, starts), rtol=1e-12)


def test_a_record_bridges_within_a_run_and_takes_no_residual_there():
    nan = np.nan
    Y = [np.array([[nan, 1.0], [2.0, nan], [nan, 3.0]]), np.array([[nan, 5.0], [nan, nan]])]
    record = Record.from_runs([np.zeros((3, 1)), np.zeros((2, 1))], Y, [np.arange(3.0), np.arange(2.0)], 1.0)
    np.testing.assert_array_equal(record.y, [[2, 2, 2, 2, 2], [1, 2, 3, 5, 5]])
    np.testing.assert_array_equal(record.counts, [[1, 2], [0, 1]])
    assert record.n_values == 4
    np.testing.assert_array_equal(record.residual(np.zeros((2, 5))), [[0, 2, 0, 0, 0], [1, 0, 3, 5, 0]])
    np.testing.assert_allclose(record.spread, [1e-300, np.std([1, 3, 5])])
    np.testing.assert_allclose(record.rms(record.residual(np.zeros((2, 5)))), [2, np.sqrt(35 / 3)])
    one = record.select([1])
    assert one.n_values == 1 and one.known.shape == (2, 2)


def test_a_whole_record_keeps_no_mask():
    record = Record.from_runs([np.zeros((3, 0))], [np.ones((3, 1))], [np.arange(3.0)], 1.0)
    assert record.known is None and record.n_values == 3
    np.testing.assert_array_equal(bridged(record.y, np.ones((1, 3), bool), record.starts), record.y)
