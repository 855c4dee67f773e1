"""The evidence against closed forms: a linear model with known noise and prior, and runs that are really left out."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from sksurrogate.kernels.evidence import correlation_length, left_out, weigh
from sksurrogate.kernels.start_rows import found_start


def linear(seed=0, n=400, prior=2.0, noise=0.3, sizes=(12, 8), second=0.1):
    rng = np.random.default_rng(seed)
    J = rng.normal(size=(n, sum(sizes) + 1))
    groups = np.r_[np.repeat(np.arange(len(sizes)), sizes), -1]
    scale = np.where(groups == 0, prior, second * prior)
    theta = scale * rng.normal(size=J.shape[1])
    return J, J @ theta + noise * rng.normal(size=n), groups


def settled(J, y, groups, n_groups):
    penalty = np.ones(n_groups)
    for _ in range(200):
        weight = np.where(groups >= 0, penalty[groups], 0.0)
        theta = np.linalg.solve(J.T @ J + np.diag(weight), J.T @ y)
        found = weigh(J.T @ J, theta, groups, penalty, float(np.sum((y - J @ theta) ** 2)), len(y))
        penalty = found.penalty
    return penalty, found, theta


def test_the_fixed_point_is_the_maximum_of_the_marginal_likelihood():
    J, y, groups = linear()
    penalty, found, _ = settled(J, y, groups, 2)

    def marginal(log_prior, log_noise):
        # y ~ N(0, noise I + J diag(prior) J'); the free parameter has a very wide prior
        prior = np.where(groups >= 0, np.exp(log_prior)[groups], 1e3)
        cov = np.exp(log_noise) * np.eye(len(y)) + (J * prior) @ J.T
        return multivariate_normal(np.zeros(len(y)), cov).logpdf(y)

    at = np.log(found.noise / penalty), np.log(found.noise)
    best = marginal(*at)
    for step in (0.1, -0.1):
        for g in range(2):
            assert marginal(at[0] + step * np.eye(2)[g], at[1]) < best
        assert marginal(at[0], at[1] + step) < best


def test_noise_and_effective_parameters_are_those_planted():
    noises, effective = [], []
    for seed in range(20):
        J, y, groups = linear(seed, prior=1.0, second=0.0)  # a group without any effect
        _, found, _ = settled(J, y, groups, 2)
        noises.append(found.noise)
        effective.append(found.effective)
    assert np.mean(effective, axis=0)[0] > 11.5 and np.median(np.array(effective)[:, 1]) < 6
    assert np.mean(noises) == pytest.approx(0.09, rel=0.05)


def test_the_log_evidence_ranks_as_the_marginal_likelihood_does():
    J, y, _ = linear(sizes=(12,))
    groups, found, exact = np.zeros(13, int), [], []
    for penalty in (1e-3, 0.1, 10.0):
        theta = np.linalg.solve(J.T @ J + penalty * np.eye(13), J.T @ y)
        squares = float(np.sum((y - J @ theta) ** 2))
        fit = weigh(J.T @ J, theta, groups, np.array([penalty]), squares, len(y))
        found.append(fit.log_evidence)
        cov = fit.noise * (np.eye(len(y)) + J @ J.T / penalty)
        exact.append(multivariate_normal(np.zeros(len(y)), cov).logpdf(y))
    np.testing.assert_allclose(np.diff(found), np.diff(exact), rtol=1e-6)


def test_the_covariance_is_that_of_repeated_data():
    J, y, groups = linear(sizes=(5,), n=200)
    mean = J @ np.linalg.lstsq(J, y, rcond=None)[0]
    rng, estimates = np.random.default_rng(1), []
    gram, weight = J.T @ J, np.where(groups >= 0, 1e-6, 0.0)
    for _ in range(2000):
        estimates.append(np.linalg.solve(gram + np.diag(weight), J.T @ (mean + 0.5 * rng.normal(size=len(y)))))
    found = weigh(gram, estimates[0], groups, np.array([1e-6]), 0.25 * (200 - 6), 200).covariance
    np.testing.assert_allclose(np.diag(found), np.var(estimates, axis=0), rtol=0.15)  # 2000 draws: 3 % each


def test_alike_residuals_count_as_fewer_rows():
    rng = np.random.default_rng(0)
    white = rng.normal(size=(5, 4000, 1))
    pole = 0.8
    coloured = np.zeros_like(white)
    for t in range(1, 4000):
        coloured[:, t] = pole * coloured[:, t - 1] + white[:, t]
    assert correlation_length(white) == pytest.approx(1.0, abs=0.05)
    assert correlation_length(coloured) == pytest.approx((1 + pole) / (1 - pole), rel=0.15)
    assert correlation_length(np.zeros((2, 50, 1))) == 1.0


def test_runs_left_out_are_those_of_fits_without_them():
    J, y, _ = linear(sizes=(6,), n=90)
    penalty = np.full(7, 0.5)
    parts = np.array_split(np.arange(90), 4)
    theta = np.linalg.solve(J.T @ J + np.diag(penalty), J.T @ y)
    found = left_out(J, J @ theta - y, parts, penalty * theta, penalty)
    for part, value in zip(parts, found):
        rest = np.setdiff1d(np.arange(90), part)
        other = np.linalg.solve(J[rest].T @ J[rest] + np.diag(penalty), J[rest].T @ y[rest])
        assert value == pytest.approx(np.mean((J[part] @ other - y[part]) ** 2), rel=1e-8)


def decays(n_runs=40, n=60, seed=0):
    """y[t] = 0.9 y[t-1] + u[t]."""
    rng = np.random.default_rng(seed)
    U, y = 0.3 * rng.normal(size=(n_runs, n, 1)), np.zeros((n_runs, n, 1))
    y[:, 0, 0] = rng.normal(size=n_runs)
    for t in range(1, n):
        y[:, t] = 0.9 * y[:, t - 1] + U[:, t]
    return U, y


def run_decay(U, first):
    y = np.empty((*U.shape[:2], 1))
    y[:, : first.shape[1]] = first
    for t in range(first.shape[1], U.shape[1]):
        y[:, t] = 0.9 * y[:, t - 1] + U[:, t]
    return y


def test_more_rows_find_the_start():
    V, z = decays(300, 20, seed=3)
    noisy = z + 0.2 * np.random.default_rng(4).normal(size=z.shape)
    found = found_start(lambda first: run_decay(V, first), noisy, 2, 0.04)
    weights = 0.9 ** np.arange(20)
    assert np.mean((found[:, 1] - z[:, 1]) ** 2) == pytest.approx(0.04 / np.sum(weights[:19] ** 2), rel=0.3)
    noisy[:, 1] = np.nan
    assert np.isfinite(found_start(lambda first: run_decay(V, first), noisy, 2, 0.04)).all()
