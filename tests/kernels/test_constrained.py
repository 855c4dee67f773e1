"""Constrained least squares: the Karush-Kuhn-Tucker conditions decide, scipy is asked too."""

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from sksurrogate.kernels.constrained import Infeasible, constrained_least_squares


def check_optimal(A, b, C, lower, upper, theta):
    """Feasible, and the gradient is a combination of the rows that are held, with the right signs."""
    value = C @ theta
    scale = 1 + np.abs(value)
    assert np.all(value >= lower - 1e-8 * scale) and np.all(value <= upper + 1e-8 * scale)
    at_lower = np.isclose(value, lower, atol=1e-8)
    at_upper = np.isclose(value, upper, atol=1e-8)
    gradient = A.T @ (A @ theta - b)
    rows = np.vstack([C[at_lower], -C[at_upper]])
    if not len(rows):
        np.testing.assert_allclose(gradient, 0, atol=1e-8 * np.abs(A.T @ b).max())
        return
    # gradient = rows^T mu with mu >= 0 (an equality is in both lists: free sign)
    mu = lsq_linear(rows.T, gradient, bounds=(0, np.inf), method="bvls", tol=1e-14).x
    np.testing.assert_allclose(rows.T @ mu, gradient, atol=1e-7 * (1 + np.abs(gradient).max()))


@pytest.mark.parametrize("seed", range(12))
def test_random_problems_fulfil_the_optimality_conditions(seed):
    rng = np.random.default_rng(seed)
    A, b = rng.normal(size=(20, 6)), 10 * rng.normal(size=20)
    C = rng.normal(size=(9, 6))
    inside = C @ rng.normal(size=6)
    lower = np.where(rng.random(9) < 0.3, -np.inf, inside - rng.random(9))
    upper = np.where(rng.random(9) < 0.3, np.inf, inside + rng.random(9))
    lower[:2] = upper[:2] = inside[:2]
    theta, active = constrained_least_squares(A, b, C, lower, upper)
    check_optimal(A, b, C, lower, upper, theta)
    np.testing.assert_allclose((C @ theta)[active == -1], lower[active == -1], atol=1e-9)
    np.testing.assert_allclose((C @ theta)[active == 1], upper[active == 1], atol=1e-9)
    assert list(active[:2]) == [2, 2]


@pytest.mark.parametrize("seed", range(5))
def test_bounds_agree_with_scipy(seed):
    rng = np.random.default_rng(seed)
    A, b = rng.normal(size=(30, 8)), rng.normal(size=30)
    lower, upper = -0.05 * rng.random(8), 0.1 * rng.random(8)
    theta, _ = constrained_least_squares(A, b, np.eye(8), lower, upper)
    np.testing.assert_allclose(theta, lsq_linear(A, b, (lower, upper), method="bvls", tol=1e-14).x, atol=1e-9)


def test_constraints_that_do_not_bite_change_nothing():
    rng = np.random.default_rng(0)
    A, b = rng.normal(size=(30, 4)), rng.normal(size=30)
    theta, active = constrained_least_squares(A, b, np.eye(4), np.full(4, -1e3), np.full(4, 1e3))
    np.testing.assert_allclose(theta, np.linalg.lstsq(A, b)[0], rtol=1e-12)
    assert not active.any()


@pytest.mark.parametrize("seed", range(6))
def test_fewer_rows_than_parameters(seed):
    rng = np.random.default_rng(seed)
    A, b = rng.normal(size=(3, 6)), rng.normal(size=3)
    lower = np.full(6, -0.1)
    theta, _ = constrained_least_squares(A, b, np.eye(6), lower, np.full(6, np.inf))
    check_optimal(A, b, np.eye(6), lower, np.full(6, np.inf), theta)


def test_wide_bounds_of_very_different_size():
    A, b = np.diag([1.0, 1e6, 1e-6]), np.array([5.0, 5e9, 5e-3])
    theta, _ = constrained_least_squares(A, b, np.eye(3), np.zeros(3), np.array([1.0, 1e3, 1e3]))
    np.testing.assert_allclose(theta, [1.0, 1e3, 1e3], rtol=1e-9)


def test_contradictions_are_told():
    A, b, one = np.eye(2), np.zeros(2), np.array([[1.0, 0.0], [1.0, 0.0]])
    with pytest.raises(Infeasible):
        constrained_least_squares(A, b, one, np.array([1.0, -np.inf]), np.array([np.inf, 0.0]))
    with pytest.raises(Infeasible):
        constrained_least_squares(A, b, one, np.array([1.0, 0.0]), np.array([1.0, 0.0]))
    with pytest.raises(Infeasible):
        constrained_least_squares(A, b, np.zeros((1, 2)), np.array([1.0]), np.array([2.0]))
    with pytest.raises(Infeasible):
        constrained_least_squares(A, b, np.vstack([np.eye(2), one[:1]]), np.r_[0.0, 0, 1], np.r_[0.0, 0, 2])
