"""Normal equations in the form of an arrow, against dense least squares."""

import numpy as np
import pytest

from sksurrogate.kernels.arrow import Arrow

STARTS, N = np.array([0, 20, 55]), 90


def problem(rng, n_theta=4, n_x=2, n_outputs=2):
    """Slopes, residual, noise, and the dense matrix of all unknowns: parameters, then initial states run by run."""
    Jt, Jx = rng.normal(size=(n_outputs, n_theta, N)), rng.normal(size=(n_outputs, n_x, N))
    r, sd = rng.normal(size=(n_outputs, N)), np.array([0.5, 2.0])[:n_outputs]
    own = np.zeros((n_outputs, len(STARTS) * n_x, N))
    for k, (a, b) in enumerate(zip(STARTS, [*STARTS[1:], N])):
        own[:, k * n_x : (k + 1) * n_x, a:b] = Jx[:, :, a:b]
    dense = np.concatenate([Jt, own], axis=1) / sd[:, None, None]
    return Jt, Jx, r, sd, dense.transpose(0, 2, 1).reshape(-1, dense.shape[1]), (r / sd[:, None]).ravel()


@pytest.mark.parametrize("n_x", [0, 1, 2])
def test_the_undamped_step_is_that_of_dense_least_squares(n_x):
    Jt, Jx, r, sd, A, b = problem(np.random.default_rng(n_x), n_x=n_x)
    arrow = Arrow.build(Jt, Jx, r, sd, STARTS, np.zeros(4), np.zeros(4))
    dt, dx, drop = arrow.step(0.0)
    exact = np.linalg.lstsq(A, b, rcond=None)[0]
    np.testing.assert_allclose(np.r_[dt, dx.T.ravel()], exact, rtol=1e-6, atol=1e-8)  # the ridge of 1e-9
    np.testing.assert_allclose(drop, b @ b - np.sum((b - A @ exact) ** 2), rtol=1e-8)
    np.testing.assert_allclose(arrow.covariance(), np.linalg.inv(A.T @ A)[:4, :4], rtol=1e-6, atol=1e-10)


def test_held_parameters_move_as_told_and_the_others_make_the_best_of_it():
    Jt, Jx, r, sd, A, b = problem(np.random.default_rng(3))
    held = np.array([np.nan, 0.1, np.nan, -0.2])
    dt, dx, _ = Arrow.build(Jt, Jx, r, sd, STARTS, np.zeros(4), np.zeros(4)).step(0.0, held)
    rest = np.r_[0, 2, 4 : A.shape[1]]
    exact = np.linalg.lstsq(A[:, rest], b - A[:, [1, 3]] @ [0.1, -0.2], rcond=None)[0]
    np.testing.assert_allclose(dt[[1, 3]], [0.1, -0.2])
    np.testing.assert_allclose(np.r_[dt[[0, 2]], dx.T.ravel()], exact, rtol=1e-6, atol=1e-8)


def test_a_prior_pulls_and_what_is_not_seen_stays_where_it_is():
    Jt, Jx, r, sd, _, _ = problem(np.random.default_rng(4))
    Jt[:, 2], Jx[:, 1] = 0.0, 0.0
    dt, dx, _ = Arrow.build(Jt, Jx, r, sd, STARTS, np.array([0, 0, 4.0, 0]), np.array([0, 0, 2.0, 0])).step(0.0)
    np.testing.assert_allclose(dt[2], 0.5)
    np.testing.assert_allclose(dx[1], 0.0)
