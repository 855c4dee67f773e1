"""A recursion with limits: without one it is the banded solve, with one it stays within and is the loop written out."""

import numpy as np

from sksurrogate.kernels.banded import recursion_band, solve_recursion
from sksurrogate.kernels.limited import limited_recursion

STARTS = np.array([0, 13, 20])


def system(seed=0, n=2, columns=3, samples=41):
    rng = np.random.default_rng(seed)
    A = 0.5 * rng.normal(size=(n, n, samples))
    b = rng.normal(size=(n, columns, samples))
    return A, b


def test_without_a_limit_it_is_the_linear_recursion_run_by_run():
    A, b = system()
    linear = solve_recursion(recursion_band(A, STARTS), b)
    np.testing.assert_allclose(limited_recursion(A, b, STARTS, lambda s, rows: s), linear, rtol=1e-12, atol=1e-12)


def test_a_limit_acts_at_every_sample_of_every_run_of_unequal_length():
    A, b = system(1)
    most = np.linspace(0.2, 1.0, b.shape[2])
    found = limited_recursion(A, b, STARTS, lambda s, rows: np.minimum(s, most[rows]))
    expected = np.empty_like(b)
    for k in range(b.shape[2]):
        free = b[:, :, k] if k in STARTS else A[:, :, k - 1] @ expected[:, :, k - 1] + b[:, :, k]
        expected[:, :, k] = np.minimum(free, most[k])
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)
