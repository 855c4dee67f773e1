"""Correlation of a residual in time by restricted likelihood, against closed forms and planted autoregressions."""

import numpy as np
import pytest
from scipy.linalg import solve_toeplitz, toeplitz
from scipy.signal import lfilter

from sksurrogate.physics._residual_correlation import (
    _coefficients,
    _continued,
    _correlations,
    _durbin,
    _restricted,
    residual_covariance,
)


def noise(a, n, rng):
    return lfilter([1.0], np.r_[1.0, -np.asarray(a)], rng.normal(size=n + 200))[200:]


def test_correlations_are_those_of_the_recursion():
    np.testing.assert_allclose(_continued(np.array([0.8]), _correlations(np.array([0.8])), 6), 0.8 ** np.arange(6))
    a = np.array([1.2, -0.5])
    rho = _continued(a, _correlations(a), 30)
    np.testing.assert_allclose(rho[1], a[0] / (1 - a[1]))  # Yule and Walker
    np.testing.assert_allclose(rho[2:], a[0] * rho[1:-1] + a[1] * rho[:-2], atol=1e-14)
    np.testing.assert_allclose(_coefficients(np.array([rho[1], a[1]])), a)


def test_the_recursion_of_durbin_solves_the_equations_of_every_order():
    r = _continued(np.array([1.2, -0.5, 0.1]), _correlations(np.array([1.2, -0.5, 0.1])), 9)
    partial, left = _durbin(r, 8)
    for order in range(1, 9):
        a = solve_toeplitz(r[:order], r[1 : order + 1])
        np.testing.assert_allclose([partial[order - 1], left[order - 1]], [a[-1], 1 - a @ r[1 : order + 1]], atol=1e-12)


def test_the_restricted_likelihood_is_that_of_the_dense_matrices():
    rng = np.random.default_rng(0)
    a, sizes = np.array([0.5, 0.2]), (30, 25)
    X = [rng.normal(size=(n, 3)) for n in sizes]
    Z = [rng.normal(size=(n, 2)) for n in sizes]
    e = [rng.normal(size=n) for n in sizes]
    whole = np.zeros((55, 7))
    whole[:, :3], whole[:30, 3:5], whole[30:, 5:] = np.concatenate(X), Z[0], Z[1]
    rho = _continued(a, _correlations(a), 40)
    near = np.abs(np.subtract.outer(np.arange(30), np.arange(30)))
    R = np.zeros((55, 55))
    R[:30, :30], R[30:, 30:] = rho[near], rho[near[:25, :25]]
    R /= 1 - a @ rho[1:3]  # of innovations of size 1
    inverse, y = np.linalg.inv(R), np.concatenate(e)
    middle = whole.T @ inverse @ whole
    P = inverse - inverse @ whole @ np.linalg.solve(middle, whole.T @ inverse)
    variance = y @ P @ y / (55 - 7)
    cost = 0.5 * (np.linalg.slogdet(R)[1] + np.linalg.slogdet(middle)[1] + 48 * np.log(variance))
    found = _restricted(a, e, X, Z)
    np.testing.assert_allclose(found, (cost, variance), rtol=1e-9)


@pytest.mark.parametrize("a", [[0.8], [1.2, -0.5]], ids=["one", "two"])
def test_the_memory_behind_a_fit_is_that_of_the_noise(a):
    rng, found, naive = np.random.default_rng(0), [], []
    n = 120
    t = np.linspace(-1, 1, n)
    X = np.stack([t**k for k in range(6)], axis=1)  # slow columns swallow slow noise
    Q, _ = np.linalg.qr(X)
    for _ in range(25):
        e = noise(a, n, rng)
        e -= Q @ (Q.T @ e)
        cov = residual_covariance([e], [X], [np.zeros((n, 0))])
        if cov is not None:
            found.append(cov[1] / cov[0])
        naive.append((e[1:] @ e[:-1]) / (e @ e))
    true = _correlations(np.array(a))[1]
    assert len(found) > 22
    assert abs(np.median(found) - true) < 0.04
    assert np.median(naive) < true - 0.04


def test_white_noise_has_none():
    rng = np.random.default_rng(1)
    X = rng.normal(size=(200, 4))
    Q, _ = np.linalg.qr(X)
    count = 0
    for _ in range(40):
        e = rng.normal(size=200)
        count += residual_covariance([e - Q @ (Q.T @ e)], [X], [np.zeros((200, 0))]) is not None
    assert count <= 4
    assert residual_covariance([np.zeros(100)], [X[:100]], [np.zeros((100, 0))]) is None
    assert residual_covariance([rng.normal(size=10)], [X[:10]], [np.zeros((10, 0))]) is None


@pytest.mark.parametrize("seed", range(8))
def test_of_a_rigid_fit_there_is_a_memory_where_the_criterion_of_schwarz_says_so(seed):
    """Correlations of 0.075, near where it decides: by least squares of every order."""
    n = 2000
    e = noise([0.075], n, np.random.default_rng(seed))
    r = np.array([e[lag:] @ e[: n - lag] for lag in range(21)]) / (e @ e)
    left = [1.0 - r[1 : p + 1] @ np.linalg.solve(toeplitz(r[:p]), r[1 : p + 1]) for p in range(1, 21)]
    scores = n * np.log(left) + np.log(n) * np.arange(1, 21)
    assert (residual_covariance([e], [np.ones((n, 1))], [np.zeros((n, 0))]) is not None) == (min(scores) < 0)
