"""Second moments in blocks against the whole matrix; shift recursion against the explicit lag matrix."""

import pickle

import numpy as np
import pytest
from scipy import sparse

from sksurrogate.kernels.gram import (
    Moments,
    Quadratic,
    gcv_path,
    solve_normal,
    solve_rows,
    triangle,
)
from sksurrogate.kernels.lag_moments import lag_moments

rng = np.random.default_rng(0)


def whole(Z, w):
    mean = w @ Z / w.sum()
    return mean, (Z - mean).T @ (w[:, None] * (Z - mean))


@pytest.mark.parametrize("density", [1.0, 0.3, 0.03])
@pytest.mark.parametrize("as_csr", [False, True])
def test_blocks_equal_the_whole(density, as_csr):
    X = sparse.random(400, 12, density, random_state=0).toarray() + (0 if density < 1 else 1e5)
    Y, w = rng.normal(size=(400, 2)), rng.integers(0, 4, 400).astype(float)
    moments = Moments.zeros(14)
    for a in range(0, 400, 33):
        block = sparse.csr_array(X[a : a + 33]) if as_csr else X[a : a + 33]
        moments.add(block, Y[a : a + 33], w[a : a + 33])
    mean, scatter = whole(np.hstack([X, Y]), w)
    np.testing.assert_allclose(moments.mean, mean, rtol=1e-13, atol=1e-14)
    np.testing.assert_allclose(moments.scatter, scatter, atol=1e-10 * np.abs(scatter).max())
    assert moments.weight == w.sum() and moments.n_rows == np.count_nonzero(w)


def test_weights_count_as_repetition():
    Z, w = rng.normal(size=(50, 3)), rng.integers(0, 4, 50)
    one = Moments.zeros(3).add(Z, weights=w.astype(float))
    two = Moments.zeros(3).add(np.repeat(Z, w, axis=0))
    np.testing.assert_allclose(one.scatter, two.scatter, rtol=1e-12)
    np.testing.assert_allclose(one.mean, two.mean, rtol=1e-12)


def test_moments_of_no_rows_change_nothing():
    Z = rng.normal(size=(5, 3))
    one = Moments.zeros(3).add(Z)
    before = one.scatter.copy()
    one.add(Z[:0]).add(Z, weights=np.zeros(5)).add(sparse.csr_array(np.zeros((2, 3))), weights=np.zeros(2))
    one.merge(Moments.zeros(3))
    np.testing.assert_array_equal(one.scatter, before)
    assert one.n_rows == 5


def test_duplicate_entries_of_csr_are_summed():
    block = sparse.csr_array((np.array([1.0, 2.0]), np.array([0, 0]), np.array([0, 2])), shape=(1, 2))
    np.testing.assert_array_equal(Moments.zeros(2).add(block).mean, [3.0, 0.0])


def test_pickle_leaves_the_buffer_behind():
    moments = Moments.zeros(3).add(rng.normal(size=(10_000, 3)))
    assert len(pickle.dumps(moments)) < 2000
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(moments)).scatter, moments.scatter)


def test_selected_columns():
    Z = rng.normal(size=(20, 4))
    np.testing.assert_allclose(
        Moments.zeros(4).add(Z).select([3, 1]).scatter, Moments.zeros(2).add(Z[:, [3, 1]]).scatter
    )


@pytest.mark.parametrize("weighted", [False, True])
@pytest.mark.parametrize("block", [7, 300])
def test_triangle_is_a_factor_of_the_moments(weighted, block):
    X, Y = rng.normal(size=(100, 5)) + 3, rng.normal(size=(100, 2))
    w = rng.uniform(size=100) if weighted else None
    cut = [slice(a, a + block) for a in range(0, 100, block)]
    R = triangle((X[s], Y[s], None if w is None else w[s]) for s in cut)
    moments = Moments.zeros(7).add(X, Y, w)
    np.testing.assert_allclose(R[1:, 1:].T @ R[1:, 1:], moments.scatter, atol=1e-11)
    np.testing.assert_allclose(R[0, 1:] * R[0, 0] / moments.weight, moments.mean, atol=1e-12)


def test_triangle_of_fewer_rows_than_columns():
    X, Y = rng.normal(size=(3, 5)), rng.normal(size=(3, 1))
    R = triangle([(X[:2], Y[:2], None), (X[2:], Y[2:], None)])
    Z = np.c_[np.ones(3), X, Y]
    assert R.shape == (3, 7)
    np.testing.assert_allclose(R.T @ R, Z.T @ Z, atol=1e-12)


def test_normal_equations_give_lstsq():
    A, B = rng.normal(size=(60, 6)), rng.normal(size=(60, 2))
    theta, condition, doubtful = solve_normal(A.T @ A, A.T @ B)
    np.testing.assert_allclose(theta, np.linalg.lstsq(A, B)[0], atol=1e-12)
    assert condition < 10 and not doubtful


@pytest.mark.parametrize("rows", [60, 4])
def test_null_space_gets_the_shortest_solution(rows):
    A = rng.normal(size=(rows, 6))
    A[:, 5] = A[:, 0] - A[:, 1]
    B = rng.normal(size=(rows, 2))
    slash = np.linalg.pinv(A) @ B
    theta, condition, doubtful = solve_normal(A.T @ A, A.T @ B)
    np.testing.assert_allclose(theta, slash, atol=1e-9)
    assert np.isinf(condition) and not doubtful
    theta, condition = solve_rows(A, B)
    np.testing.assert_allclose(theta, slash, atol=1e-12)
    assert np.isinf(condition)


def test_units_do_not_count_as_bad_condition():
    units = 10.0 ** np.array([-8, -3, 0, 4, 9])
    A, B = rng.normal(size=(60, 5)), rng.normal(size=(60, 1))
    plain, scaled = np.linalg.lstsq(A, B)[0], A * units
    theta, condition, doubtful = solve_normal(scaled.T @ scaled, scaled.T @ B)
    np.testing.assert_allclose(theta * units[:, None], plain, rtol=1e-9)
    assert condition < 10 and not doubtful
    theta, condition = solve_rows(scaled, B)
    np.testing.assert_allclose(theta * units[:, None], plain, rtol=1e-9)
    assert condition < 10


def test_rows_keep_what_the_gram_loses():
    x = np.linspace(0, 1, 200)
    A = np.vander(x, 12, increasing=True)
    theta = np.ones((12, 1))
    B = A @ theta
    found, condition = solve_rows(A, B)
    assert 1e7 < condition < 1e10
    np.testing.assert_allclose(found, theta, atol=1e-5)
    assert solve_normal(A.T @ A, A.T @ B)[2]


def test_a_column_of_zeros_gets_no_coefficient():
    A = np.c_[np.zeros(9), rng.normal(size=9)]
    B = rng.normal(size=(9, 1))
    assert solve_normal(A.T @ A, A.T @ B)[0][0] == 0
    assert solve_rows(A, B)[0][0] == 0
    assert not solve_rows(A[:, :1], B)[0].any() and not solve_normal(np.zeros((1, 1)), np.ones((1, 1)))[0].any()


@pytest.mark.parametrize("kind", ["ridge", "prior", "differences"])
def test_gcv_path_equals_the_hat_matrix(kind):
    A, B = rng.normal(size=(40, 8)), rng.normal(size=(40, 2))
    L = np.diff(np.eye(8), 2, axis=0) if kind == "differences" else np.eye(8)
    t = rng.normal(size=(len(L), 2)) if kind == "prior" else np.zeros((len(L), 2))
    data = Quadratic(np.zeros((8, 8)), np.zeros((8, 2)), np.zeros(2)).plus(A, B)
    penalty = Quadratic(np.zeros((8, 8)), np.zeros((8, 2)), np.zeros(2)).plus(L, t)
    alphas = np.array([0.0, 1e-3, 1.0, 100.0])
    scores, dof = gcv_path(data, penalty, alphas, 40.0)
    for alpha, score, df in zip(alphas, scores, dof):
        H = A.T @ A + alpha * L.T @ L
        hat = A @ np.linalg.solve(H, A.T)
        residual = B - A @ np.linalg.solve(H, A.T @ B + alpha * L.T @ t)
        assert df == pytest.approx(np.trace(hat))
        assert score == pytest.approx(40 * np.sum(residual**2) / (40 - np.trace(hat)) ** 2)


def test_gcv_of_an_interpolant_is_infinite():
    A, B = rng.normal(size=(5, 8)), rng.normal(size=(5, 1))
    data = Quadratic(A.T @ A, A.T @ B, np.sum(B**2, axis=0))
    penalty = Quadratic(np.eye(8), np.zeros((8, 1)), np.zeros(1))
    scores, _ = gcv_path(data, penalty, np.array([0.0, 1.0]), 5.0)
    assert np.isinf(scores[0]) and np.isfinite(scores[1])


def test_quadratic_loss_is_the_sum_of_squares():
    A, B, theta = rng.normal(size=(9, 3)), rng.normal(size=(9, 2)), rng.normal(size=(3, 2))
    q = Quadratic(np.zeros((3, 3)), np.zeros((3, 2)), np.zeros(2)).plus(A, B, 2.0)
    np.testing.assert_allclose(q.loss(theta), 2 * np.sum((A @ theta - B) ** 2, axis=0))


@pytest.mark.parametrize("max_lag", [0, 1, 5, 12])
@pytest.mark.parametrize("chunk", [7, 8192])
@pytest.mark.parametrize("n_targets", [0, 2])
def test_shift_recursion_equals_the_lag_matrix(max_lag, chunk, n_targets):
    runs = [rng.normal(size=(n, 3)) + [1e4, 0, -3] for n in (40, 13, 5, 60)]
    targets = [rng.normal(size=(len(run), n_targets)) + 7 for run in runs]
    rows = [
        np.concatenate([*(run[t - i] for i in range(max_lag + 1)), y[t]])
        for run, y in zip(runs, targets)
        for t in range(max_lag, len(run))
    ]
    expected = Moments.zeros(3 * (max_lag + 1) + n_targets).add(np.array(rows))
    found = lag_moments(runs, max_lag, targets if n_targets else None, chunk)
    assert found.n_rows == expected.n_rows == len(rows)
    np.testing.assert_allclose(found.mean, expected.mean, rtol=1e-12)
    np.testing.assert_allclose(found.scatter, expected.scatter, atol=1e-8)


def test_runs_shorter_than_the_lags_contribute_nothing():
    assert lag_moments([np.ones((3, 1))], 3).n_rows == 0
