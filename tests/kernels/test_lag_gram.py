"""Gram of lagged columns by shift recursion against the lag matrix itself."""

import numpy as np
import pytest

from sksurrogate.kernels.lag_gram import lag_gram, solve_lags
from sksurrogate.kernels.net import lag_rows


def matrix(runs, terms, n_first, mean):
    return np.concatenate([lag_rows(run[None] - mean, terms, n_first).T for run in runs])


@pytest.mark.parametrize("lengths", [(30,), (50, 20_000, 12)])
@pytest.mark.parametrize("n_first", [6, 9])
def test_gram_and_sums_are_those_of_the_matrix(lengths, n_first):
    rng = np.random.default_rng(0)
    runs = [5 + rng.normal(size=(n, 3)).cumsum(axis=0) / 10 for n in lengths]
    terms, mean = [(0, 1), (0, 2), (2, 0), (1, 6), (1, 0), (0, 0)], np.full(3, 5.0)
    Phi = matrix(runs, terms, n_first, mean)
    n_rows, sums, gram = lag_gram(runs, terms, n_first, mean)
    assert n_rows == len(Phi)
    np.testing.assert_allclose(sums, Phi.sum(axis=0), rtol=1e-10, atol=1e-8)
    np.testing.assert_allclose(gram, Phi.T @ Phi, rtol=1e-10, atol=1e-8)


@pytest.mark.parametrize("alpha", [0.0, 3.0])
@pytest.mark.parametrize("intercept", [True, False])
def test_solution_is_least_squares(alpha, intercept):
    rng = np.random.default_rng(1)
    runs = [rng.normal(size=(n, 2)) for n in (400, 90)]
    terms, mean = [(0, 1), (0, 3), (1, 0), (1, 2), (0, 0)], np.zeros(2)
    Z = matrix(runs, terms, 3, mean)
    coef, offset, squares = solve_lags(*lag_gram(runs, terms, 3, mean), 1, alpha, intercept)
    A = Z[:, :4] - Z[:, :4].mean(axis=0) * intercept
    wanted = np.linalg.solve(A.T @ A + alpha * np.eye(4), A.T @ Z[:, 4])
    np.testing.assert_allclose(coef[:, 0], wanted, rtol=1e-10)
    assert squares == pytest.approx(((Z[:, 4] - Z[:, :4] @ coef[:, 0] - offset) ** 2).sum())


def test_dependent_columns_are_left_to_others():
    runs = [np.repeat(np.random.default_rng(0).normal(size=(50, 1)), 2, axis=1)]
    assert solve_lags(*lag_gram(runs, [(0, 1), (1, 1), (0, 0)], 1, np.zeros(2)), 1, 0.0, True) is None
