"""The kernel against closed forms, dense linear algebra, scipy and orders of convergence."""

import numpy as np
import pytest
from scipy.linalg import expm

from sksurrogate.kernels import disturbance
from sksurrogate.kernels.banded import (
    BlockTridiagonal,
    block_steps,
    first_order_scan,
    recursion_band,
    solve_blocks,
    solve_recursion,
    solved_squares,
)
from sksurrogate.kernels.disturbance import Disturbance, Noise
from sksurrogate.kernels.integrate import close, march, rk4
from sksurrogate.kernels.signals import Signal, delay, hold, lag, play, rate_limit
from sksurrogate.kernels.smoother import noise_of_differences

STARTS = np.array([0, 40])
RNG = np.random.default_rng(0)


def test_recursion_equals_the_loop_and_stops_at_runs():
    A, b = 0.5 * RNG.normal(size=(2, 2, 100)), RNG.normal(size=(2, 3, 100))
    s = solve_recursion(recursion_band(A, STARTS), b)
    for k in range(100):
        expected = b[:, :, k] + (A[:, :, k - 1] @ s[:, :, k - 1] if k not in STARTS else 0.0)
        np.testing.assert_allclose(s[:, :, k], expected, atol=1e-12)


def test_scan_equals_the_loop():
    b = RNG.normal(size=100)
    w = first_order_scan(0.7, b, STARTS)
    for k in range(100):
        assert w[k] == pytest.approx(b[k] + (0.7 * w[k - 1] if k not in STARTS else 0.0))


def test_block_tridiagonal_equals_dense():
    n, m = 6, 2
    L = np.tril(RNG.normal(size=(n * m, n * m)))
    for i in range(n * m):
        L[i, : max(0, (i // m - 1) * m)] = 0
    M = L @ L.T + np.eye(n * m)
    for i in range(n):
        for j in range(n):
            if abs(i - j) > 1:
                M[i * m : i * m + m, j * m : j * m + m] = 0
    M += 20 * np.eye(n * m)
    diagonal = np.stack([M[i * m : i * m + m, i * m : i * m + m] for i in range(n)])
    lower = np.stack(
        [M[(i + 1) * m : (i + 2) * m, i * m : i * m + m] if i < n - 1 else np.zeros((m, m)) for i in range(n)]
    )
    T = BlockTridiagonal(diagonal, lower)
    b = RNG.normal(size=(1, n, m))
    np.testing.assert_allclose(T.solve(b).ravel(), np.linalg.solve(M, b.ravel()))


@pytest.mark.parametrize("width", [1, 3, 5, 6])
def test_sample_by_sample_equals_dense_triangles(width):
    n_samples, n = 7, 3
    rows = n_samples * n
    L = np.tril(RNG.normal(size=(rows, rows))) * (np.subtract.outer(np.arange(rows), np.arange(rows)) < width)
    L *= np.subtract.outer(np.arange(rows) // n, np.arange(rows) // n) <= 1  # a sample and the one before it
    L += 3 * np.eye(rows)
    factor = np.stack([np.r_[np.diag(L, -k), np.zeros(k)] for k in range(width)])
    H, b = RNG.normal(size=(n_samples, n, 2)), RNG.normal(size=(n_samples, 2, 4))
    expected = np.linalg.solve(L, (H @ b).reshape(rows, 4)).reshape(n_samples, n, 4)
    np.testing.assert_allclose(solve_blocks(block_steps(factor, H), b), expected, atol=1e-12)


@pytest.mark.parametrize("n_samples", [5, 16, 37])  # fewer than are squared at once, as many, more
def test_squares_of_solutions_equal_those_of_kept_ones(n_samples):
    steps, b = 0.3 * RNG.normal(size=(n_samples, 3, 5)), RNG.normal(size=(n_samples, 2, 4))
    np.testing.assert_allclose(solved_squares(steps, b), np.sum(solve_blocks(steps, b) ** 2, axis=(0, 1)))


def test_runge_kutta_has_order_four():
    def derivative(t, x, u):
        return np.stack([x[1], -np.sin(x[0]) + u[0]])

    x0, t = np.array([[1.0], [0.0]]), np.zeros(1)
    exact = rk4(derivative, t, x0, np.full((256, 1, 1), 0.3), None, 1.0 / 256)
    errors = [np.abs(rk4(derivative, t, x0, np.full((n, 1, 1), 0.3), None, 1.0 / n) - exact).max() for n in (4, 8, 16)]
    assert 14 < errors[0] / errors[1] < 20
    assert 14 < errors[1] / errors[2] < 20


@pytest.mark.parametrize("n_sub", [1, 3])
def test_runge_kutta_is_exact_for_cubics_in_time_and_ramps_and_asks_for_limits_at_its_stages(n_sub):
    h, asked = 0.6 / n_sub, []
    edges = 0.6 * np.arange(n_sub + 1) / n_sub  # the input is t, as mean and half its change over each substep
    mean, half = (edges[1:] + edges[:-1])[:, None, None] / 2, np.full((n_sub, 1, 1), h / 2)

    def clip(x, t, final=False):
        asked.append((float(t[0]), final))
        return x

    x = rk4(lambda t, x, u: 4 * t**3 + 3 * t * u + 0 * x, np.zeros(1), np.zeros((1, 1)), mean, half, h, clip)
    assert x[0, 0] == pytest.approx(0.6**4 + 0.6**3, rel=1e-12)
    stages = [[(a + h / 2, False), (a + h / 2, False), (a + h, False), (a + h, True)] for a in edges[:-1]]
    np.testing.assert_allclose(asked, np.concatenate(stages), rtol=1e-12)


def test_march_and_close_agree_with_the_matrix_exponential():
    A, B = np.array([[0.0, 1.0], [-20.0, -0.3]]), np.array([0.0, 1.0])
    u = RNG.normal(size=60)
    M = expm(np.block([[A, B[:, None]], [np.zeros((1, 3))]]) * 0.05)
    exact = np.empty((2, 60))
    exact[:, 0] = 0.1, 0.0
    for k in range(59):
        exact[:, k + 1] = M[:2, :2] @ exact[:, k] + M[:2, 2] * u[k]

    def derivative(t, x, v):
        return np.stack([x[1], -20 * x[0] - 0.3 * x[1] + v[0]])

    mean = np.broadcast_to(u, (8, 1, 1, 60))
    x = march(derivative, exact[:, :1], np.zeros(1), mean, None, 0.05 / 8)[:, 0]
    np.testing.assert_allclose(x, exact, atol=1e-7)

    def step(x):
        return rk4(derivative, np.zeros(x.shape[1:]), x, np.broadcast_to(u, (8, 1, x.shape[1], 60)), None, 0.05 / 8)

    start = np.zeros((2, 60))
    start[:, 0] = exact[:, 0]
    closed, ok, _ = close(step, start, np.array([0]), np.ones(2), 1e-9)
    assert ok
    np.testing.assert_allclose(closed, exact, atol=1e-7)


@pytest.mark.parametrize("size", [0.0, 0.03, 0.05, 0.131, 0.2])
def test_delay_keeps_two_moments_of_the_shifted_signal(size):
    u = np.repeat(RNG.normal(size=20), 5)
    shifted = delay(hold(u, 2, 0, STARTS), np.array([size]), 0.05, STARTS)
    fine = 1000
    path = np.repeat(u, 2 * fine)
    m = round(size / 0.05 * fine)
    for a, b in ((0, 40), (40, 100)):
        part = path[a * 2 * fine : b * 2 * fine]
        late = np.r_[np.full(m, part[0]), part[: len(part) - m]].reshape(-1, 2, fine)
        np.testing.assert_allclose(shifted.mean[:, 0, a:b].T, late.mean(axis=2), atol=1e-12)


def test_lag_solves_its_equation():
    u, tau, h = np.repeat(RNG.normal(size=20), 5), 0.13, 0.05
    smooth = lag(hold(u, 2, 0, STARTS), np.array([tau]), h, STARTS)
    w = u[0]
    for k in range(40):
        for s in range(2):
            mean = u[k] + (w - u[k]) * tau / h * (1 - np.exp(-h / tau))
            assert smooth.mean[s, 0, k] == pytest.approx(mean)
            w = u[k] + (w - u[k]) * np.exp(-h / tau)


def test_columns_of_a_shifted_ramp_share_its_slope():
    ramp = hold(np.arange(100.0), 2, 1, STARTS)
    shifted = Signal(ramp.mean + np.array([0.0, 1.0])[:, None], ramp.half)
    late = delay(shifted, np.array([0.0]), 0.05, STARTS)
    np.testing.assert_allclose(late.mean[:, 1] - late.mean[:, 0], 1.0)
    np.testing.assert_allclose(late.half, np.broadcast_to(ramp.half, late.half.shape))


def test_play_and_rate_limit_equal_their_recursions():
    u, c, h = RNG.normal(size=100), 0.5, 0.05
    w = play(hold(u, 1, 0, STARTS), np.array([c]), STARTS).mean[0, 0]
    r = rate_limit(hold(u, 1, 0, STARTS), np.array([3.0]), h, STARTS)
    end = r.end()[0, 0]
    for k in range(100):
        if k in STARTS:
            assert w[k] == u[k]
            last = u[k]
        else:
            assert w[k] == pytest.approx(np.clip(w[k - 1], u[k] - c, u[k] + c))
        following = last + np.clip(u[k] - last, -3 * h, 3 * h)
        if abs(u[k] - last) >= 3 * h:  # a full ramp: its two moments give its end
            assert end[k] == pytest.approx(following)
        last = following


def test_runs_of_any_length_and_limits_side_by_side_are_followed_as_each_alone():
    u, limits = RNG.normal(size=42), np.array([2.0, np.inf, 0.0])
    bounds = np.array([0, 5, 30, 31, 42])
    whole = rate_limit(hold(u, 1, 0, bounds[:-1]), limits, 0.05, bounds[:-1]).at_samples()
    assert whole.shape == (3, 42)
    for a, b in zip(bounds[:-1], bounds[1:]):
        for row, limit in zip(whole, limits):
            alone = rate_limit(hold(u[a:b], 1, 0, np.array([0])), np.array([limit]), 0.05, np.array([0])).at_samples()
            np.testing.assert_array_equal(row[a:b], alone[0])
    np.testing.assert_allclose(whole[1, 1:5], u[:4], rtol=1e-14)  # no limit: the input of the sample before


def test_rows_and_diagonal_are_those_of_the_whole_gram(monkeypatch):
    monkeypatch.setattr(disturbance, "MOST_ABREAST", 4)
    A = 0.3 * RNG.normal(size=(2, 2, 100))
    B, C = RNG.normal(size=(2, 2, 100)), RNG.normal(size=(2, 2, 100))
    noise = Noise(np.array([0.5, 2.0]), np.array([0.2, 0.3]), 7.0, np.array([0.4, 0.1]), 5.0)
    model = Disturbance(A, B, C, STARTS, np.ones(2), 1e-3 * np.ones(2))
    r, unit = RNG.normal(size=(9, 2, 100)), np.array([3.0, 0.2])
    rows, diagonal = model.gram_rows(r, noise, 2, unit)
    whole, _ = model.gram(r.transpose(1, 0, 2) * unit[:, None, None], noise)
    np.testing.assert_allclose(rows, whole[:2], atol=1e-9)
    np.testing.assert_allclose(diagonal, np.diag(whole), atol=1e-9)
    known, *blocks = np.split(r.transpose(1, 0, 2), [2, 3, 6, 8], axis=1)
    for block, G in zip(blocks, model.grams_beside(known, noise)(iter(blocks)), strict=True):
        np.testing.assert_allclose(G, model.gram(np.concatenate([known, block], axis=1), noise)[0], atol=1e-9)


def test_likelihood_equals_the_dense_gaussian():
    K, n = 40, 2
    A = np.repeat(np.array([[1.0, 0.05], [-0.9, 0.95]])[:, :, None], K, axis=2)
    B = np.repeat(np.array([[0.0012], [0.05]])[:, :, None], K, axis=2)
    C = np.repeat(np.array([[1.0, 0.0]])[:, :, None], K, axis=2)
    noise = Noise(np.array([0.01]), np.array([0.5]), 7.0, np.array([0.007]), 5.0)
    prior = np.array([0.3, 1.0])
    distance = np.abs(np.subtract.outer(np.arange(K), np.arange(K)))
    moved, start, x, X = np.zeros((K, K)), np.zeros((K, n)), np.zeros((n, K)), np.eye(n)
    for k in range(K):
        moved[k], start[k] = x[0], X[0]
        x = A[:, :, k] @ x
        x[:, k] += B[:, 0, k]
        X = A[:, :, k] @ X
    coloured = (
        moved @ (0.25 * np.exp(-distance / 7.0)) @ moved.T + 0.007**2 * np.exp(-distance / 5.0) + 1e-4 * np.eye(K)
    )
    S = coloured + start @ np.diag(prior**2) @ start.T
    r = 0.05 * RNG.normal(size=(1, K))
    model = Disturbance(A, B, C, np.array([0]), prior, 1e-6 * np.ones(2))
    expected = -0.5 * (r[0] @ np.linalg.solve(S, r[0]) + np.linalg.slogdet(S)[1])
    assert model.log_likelihood(r, noise) == pytest.approx(expected, rel=1e-6)
    V = RNG.normal(size=(1, 3, K))
    np.testing.assert_allclose(model.spread(V, noise), V[0] @ coloured @ V[0].T, rtol=1e-9)


def test_noise_of_a_smooth_signal_is_found():
    t = np.linspace(0, 10, 4000)
    y = np.sin(t)[None] + 0.01 * RNG.normal(size=(1, 4000))
    assert noise_of_differences(y, np.array([0, 2000]))[0] == pytest.approx(0.01, rel=0.06)  # MAD of 4000 values


@pytest.mark.parametrize("measured", [None, "all"])
def test_a_reading_is_known_no_better_than_its_resolution(measured):
    """A slow signal in steps of 2: most differences are zero, and the rounding has the deviation 2 / sqrt(12) all the same."""
    rng = np.random.default_rng(0)
    y = 2.0 * np.round((30.0 * np.sin(np.linspace(0, 6, 900)) + 0.01 * rng.normal(size=900))[None] / 2.0)
    known = None if measured is None else np.ones(y.shape, bool)
    found = noise_of_differences(y, np.array([0]), known)[0]
    assert np.median(np.abs(np.diff(y, n=3))) == 0.0
    assert found == pytest.approx(2.0 / np.sqrt(12.0))
    assert noise_of_differences(np.ones((1, 50)), np.array([0]))[0] == 1e-12
