"""Exact steps of linear systems, against closed forms and scipy.signal."""

import numpy as np
import pytest
from scipy import signal
from scipy.linalg import expm

from sksurrogate.kernels.linear_step import hold_maps, linear_run


def _system(seed, n=4, m=2):
    random = np.random.default_rng(seed)
    A = random.normal(size=(n, n))
    return A - (np.max(np.linalg.eigvals(A).real) + 0.3) * np.eye(n), random.normal(size=(n, m))


@pytest.mark.parametrize("order", [0, 1])
def test_one_sample_equals_scipy_signal(order):
    A, B = _system(0)
    maps = hold_maps(A, B, 0.2, order)
    F, G, *_ = signal.cont2discrete((A, B, np.eye(4), np.zeros((4, 2))), 0.2, "zoh")
    np.testing.assert_allclose(maps.F, F, atol=1e-14)
    np.testing.assert_allclose(maps.G, G, atol=1e-14)
    assert order == 1 or not maps.H.any()


@pytest.mark.parametrize("order", [0, 1])
def test_a_run_equals_scipy_signal_at_even_times(order):
    A, B = _system(1)
    t, U = 0.1 * np.arange(80), np.random.default_rng(2).normal(size=(3, 80, 2))
    X0 = np.random.default_rng(3).normal(size=(3, 4))
    found = linear_run(A, B, U, X0, t, order)
    for u, x0, x in zip(U, X0, found):
        expected = signal.lsim((A, B, np.eye(4), np.zeros((4, 2))), u, t, x0, interp=bool(order))[1]
        np.testing.assert_allclose(x, expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize("order", [0, 1])
def test_uneven_times_equal_the_closed_form_of_a_lag(order):
    a = 3.0
    t = np.cumsum(np.random.default_rng(4).uniform(0.001, 0.5, 60))
    u = np.random.default_rng(5).normal(size=60)
    x = [0.7]
    for h, u0, u1 in zip(np.diff(t), u[:-1], u[1:]):
        rise = (u1 - u0) / h if order else 0.0
        steady = lambda s, u0=u0, rise=rise: (u0 + rise * s) / a - rise / a**2  # the particular solution  # noqa: E731
        x.append(steady(h) + (x[-1] - steady(0.0)) * np.exp(-a * h))
    found = linear_run(np.array([[-a]]), np.array([[1.0]]), u[None, :, None], np.array([[0.7]]), t, order)
    np.testing.assert_allclose(found[0, :, 0], x, rtol=0, atol=1e-13)


def test_an_oscillator_keeps_its_energy_and_a_stiff_system_its_slow_mode():
    t = 0.01 * np.arange(20_001)
    swing = linear_run(np.array([[0.0, 1.0], [-1.0, 0.0]]), np.zeros((2, 0)), np.zeros((1, len(t), 0)), np.array([[1.0, 0.0]]), t, 0)[0]  # fmt: skip
    np.testing.assert_allclose(swing, np.column_stack([np.cos(t), -np.sin(t)]), rtol=0, atol=1e-11)
    stiff = np.array([[-1e8, 1.0], [0.0, -1.0]])
    found = linear_run(stiff, np.zeros((2, 0)), np.zeros((1, 5, 0)), np.array([[0.0, 1.0]]), np.arange(5.0), 0)[0]
    np.testing.assert_allclose(found[:, 1], np.exp(-np.arange(5.0)), rtol=1e-8)


def test_a_map_is_made_once_for_steps_apart_from_rounding():
    A, B = _system(6)
    assert hold_maps(A, B, 0.1, 0) is hold_maps(A.copy(), B.copy(), 0.1, 0)
    with pytest.raises(ValueError, match="read-only"):
        hold_maps(A, B, 0.1, 0).F[0, 0] = 1.0
    np.testing.assert_allclose(
        linear_run(A, B, np.zeros((1, 9, 2)), np.ones((1, 4)), 1e6 + 0.1 * np.arange(9), 0)[0, -1],
        expm(0.8 * A) @ np.ones(4),
        atol=1e-9,  # times of 1e6 hold a step of .1 to ten digits
    )
