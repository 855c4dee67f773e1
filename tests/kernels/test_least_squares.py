"""Nonlinear least squares: closed forms, scipy's answers, and the parts against differences."""

import numpy as np
import pytest
from scipy.optimize import approx_fprime, least_squares

from sksurrogate.kernels.least_squares import dense, levenberg_marquardt, several_starts, with_memory
from sksurrogate.kernels.separable import Separable


def exponentials(t):
    """Columns exp(-omega_j t) and their slopes, rows last."""

    def basis(omega):
        phi = np.exp(-omega[:, None] * t)
        return phi, phi

    def tangent(phi, theta):
        return [-t * phi * column[:, None] for column in theta.T]

    return basis, tangent


def test_a_linear_problem_ends_at_the_least_squares_solution():
    rng = np.random.default_rng(0)
    A, b = rng.normal(size=(30, 4)), rng.normal(size=30)
    fit = levenberg_marquardt(dense(lambda theta: (A @ theta - b, A)), np.zeros(4))
    np.testing.assert_allclose(fit.theta, np.linalg.lstsq(A, b, rcond=None)[0], rtol=1e-8)
    assert fit.done


def test_cost_never_rises_and_the_history_holds_it():
    fit = levenberg_marquardt(
        dense(lambda t: (np.array([10 * (t[1] - t[0] ** 2), 1 - t[0]]), np.array([[-20 * t[0], 10.0], [-1.0, 0.0]]))),
        np.array([-1.2, 1.0]),
        floor=1e-25,
    )
    assert np.all(np.diff(fit.history) < 0)
    assert fit.history[-1] == fit.cost <= 1e-25
    np.testing.assert_allclose(fit.theta, 1.0, atol=1e-10)
    assert "floor" in fit.message


def test_a_noisy_decay_agrees_with_scipy():
    rng = np.random.default_rng(1)
    t = np.linspace(0, 5, 60)
    y = 2.0 * np.exp(-0.7 * t) + 0.02 * rng.normal(size=t.size)

    def residual(theta):
        e = np.exp(-theta[1] * t)
        return theta[0] * e - y, np.stack([e, -theta[0] * t * e], axis=1)

    fit = levenberg_marquardt(dense(residual), np.array([1.0, 1.0]))
    peer = least_squares(lambda q: residual(q)[0], [1.0, 1.0], jac=lambda q: residual(q)[1], method="lm", xtol=1e-14)
    np.testing.assert_allclose(fit.theta, peer.x, rtol=1e-6)


def test_a_step_out_of_the_admissible_region_is_taken_back():
    fit = levenberg_marquardt(
        dense(lambda t: (np.sqrt(t) - 0.1, np.array([[0.5 / np.sqrt(t[0])]])) if t[0] > 0 else (t + np.inf, t[None])),
        np.array([4.0]),
        floor=1e-24,
    )
    np.testing.assert_allclose(fit.theta, 0.01, rtol=1e-8)


def test_a_start_that_is_not_admissible_says_so():
    fit = levenberg_marquardt(dense(lambda t: (t + np.inf, np.eye(1))), np.zeros(1))
    assert fit.done and fit.cost == np.inf
    assert "not admissible" in fit.message


@pytest.mark.parametrize("weighted", [False, True])
@pytest.mark.parametrize("ridge", [0.0, 0.3])
@pytest.mark.parametrize("n_outputs", [1, 2])
def test_variable_projection_has_the_gradient_of_the_eliminated_cost(weighted, ridge, n_outputs):
    rng = np.random.default_rng(2)
    t = np.linspace(0, 3, 40)
    y = rng.normal(size=(40, n_outputs))
    root = np.sqrt(rng.uniform(0.2, 2, 40)) if weighted else None
    penalty = np.full(2, ridge) if ridge else None
    problem = Separable(*exponentials(t), y, root_weights=root, ridge=penalty, ridge_omega=penalty)
    omega = np.array([0.4, 1.7])

    def eliminated(omega):
        w = np.ones(40) if root is None else root
        phi = np.exp(-omega[:, None] * t).T * w[:, None]
        theta = np.linalg.solve(phi.T @ phi + ridge * np.eye(2), phi.T @ (y * w[:, None]))
        misfit = phi @ theta - y * w[:, None]
        return np.sum(misfit**2) + ridge * (np.sum(theta**2) + omega @ omega)

    cost, gradient, _ = problem(omega)
    np.testing.assert_allclose(cost, eliminated(omega), rtol=1e-12)
    np.testing.assert_allclose(2 * gradient, approx_fprime(omega, eliminated, 1e-7), rtol=1e-5, atol=1e-5)


def test_variable_projection_and_the_full_problem_agree_with_scipy():
    rng = np.random.default_rng(3)
    t = np.linspace(0, 6, 80)
    y = 3.0 * np.exp(-0.3 * t) - 2.0 * np.exp(-2.0 * t) + 0.01 * rng.normal(size=t.size)
    problem = Separable(*exponentials(t), y[:, None])
    fit = levenberg_marquardt(problem, np.array([0.1, 1.0]))
    theta = problem.solve(fit.theta)[:, 0]
    peer = least_squares(
        lambda q: q[2] * np.exp(-q[0] * t) + q[3] * np.exp(-q[1] * t) - y, [0.1, 1, 1, -1], method="lm", xtol=1e-14
    )
    np.testing.assert_allclose([*fit.theta, *theta], peer.x, rtol=1e-5)
    np.testing.assert_allclose(fit.cost, 2 * peer.cost, rtol=1e-10)


def test_weights_count_as_repeated_rows():
    t = np.array([0.0, 0.5, 1.0, 2.0, 3.0])
    y = np.array([2.0, 1.4, 1.2, 0.4, 0.3])[:, None]
    counts = np.array([1, 3, 2, 1, 2])
    weighted = Separable(*exponentials(t), y, root_weights=np.sqrt(counts))(np.array([0.5]))
    repeated = Separable(*exponentials(np.repeat(t, counts)), np.repeat(y, counts, axis=0))(np.array([0.5]))
    for one, other in zip(weighted, repeated):
        np.testing.assert_allclose(one, other, rtol=1e-10)


def test_a_basis_without_full_rank_is_not_admissible_but_has_a_minimum_norm_solution():
    t = np.linspace(0, 1, 10)
    problem = Separable(*exponentials(t), np.ones((10, 1)))
    assert problem(np.array([0.5, 0.5]))[0] == np.inf
    theta = problem.solve(np.array([0.0, 0.0]))
    np.testing.assert_allclose(theta, 0.5)


def test_several_starts_leave_a_local_minimum():
    # r = sin-shaped valley: minima near every 2 pi, the lowest at 0
    problem = dense(
        lambda t: (np.array([0.1 * t[0], 1 - np.cos(t[0])]), np.array([[0.1], [np.sin(t[0])]])),
    )
    alone = levenberg_marquardt(problem, np.array([6.0]))
    assert abs(alone.theta[0]) > 5
    fit, costs = several_starts(problem, [np.array([s]) for s in (6.0, -12.0, 1.0)], floor=1e-20)
    assert abs(fit.theta[0]) < 1e-3
    assert len(costs) == 3
    assert costs[0] == pytest.approx(alone.cost)


def test_no_start_left_when_the_first_solves_it():
    problem = dense(lambda t: (t - 1.0, np.eye(1)))
    _, costs = several_starts(problem, [np.array([5.0]), np.array([7.0])], solved=1e-10, floor=1e-20)
    assert len(costs) == 1


def test_no_start_at_all_is_refused():
    with pytest.raises(ValueError, match="at least one start"):
        several_starts(dense(lambda t: (t, np.eye(1))), [])


def test_memory_of_earlier_rows_gives_the_fit_of_all_rows():
    rng = np.random.default_rng(4)
    A, b = rng.normal(size=(30, 3)), rng.normal(size=30)
    first = np.linalg.lstsq(A[:20], b[:20], rcond=None)[0]
    later = with_memory(dense(lambda theta: (A[20:] @ theta - b[20:], A[20:])), first, A[:20].T @ A[:20])
    fit = levenberg_marquardt(later, first)
    np.testing.assert_allclose(fit.theta, np.linalg.lstsq(A, b, rcond=None)[0], rtol=1e-7)


def test_watch_ends_a_search():
    seen = []
    fit = levenberg_marquardt(
        dense(lambda t: (t**3, np.diag(3 * t**2))),
        np.array([2.0]),
        watch=lambda fit: seen.append(fit.cost) or len(seen) == 3,
    )
    assert len(seen) == 3 and "validation" in fit.message
