"""Steps that follow the bend of a valley."""

import numpy as np
import pytest

from sksurrogate.kernels.geodesic import CORRECTION_OVER_STEP, PROBE, bent, second_order


def errors(theta):
    """Five smooth errors of two numbers."""
    a, b = theta
    return np.array([np.exp(a) - 2.0, a * b + 1.0, np.sin(b), a**2 - b, np.cosh(a * b)])


def slopes(theta, h=1e-5):
    """Their slopes by central differences."""
    return np.stack([(errors(theta + h * d) - errors(theta - h * d)) / (2 * h) for d in np.eye(2)], axis=1)


def test_the_second_derivative_along_a_step_is_that_of_second_differences():
    theta, v = np.array([0.3, -0.7]), np.array([0.02, 0.05])
    h = 1e-3
    differences = (errors(theta + h * v) - 2 * errors(theta) + errors(theta - h * v)) / h**2
    found = second_order(errors(theta), errors(theta + PROBE * v), slopes(theta) @ v)
    np.testing.assert_allclose(found, differences, rtol=0.05, atol=1e-4 * np.abs(differences).max())


def test_the_bent_path_keeps_the_promise_of_its_slopes_one_order_longer():
    """Within what the slopes can reach, the errors along the path are ``e + s J v`` up to a third order; a straight one: second."""
    theta, v = np.array([0.3, -0.7]), np.array([1.0, 0.5])
    J, probe = slopes(theta), 1e-3 * v  # so short that the probe measures the second order alone
    second = second_order(errors(theta), errors(theta + PROBE * probe), J @ probe) * 1e6
    correction = -np.linalg.solve(J.T @ J, J.T @ second)

    def missed(s, bend):
        at = theta + s * v + bend * 0.5 * s**2 * correction
        return np.linalg.norm(J.T @ (errors(at) - errors(theta) - s * J @ v))

    for bend, order in ((0.0, 2), (1.0, 3)):
        assert np.log2(missed(0.04, bend) / missed(0.02, bend)) == pytest.approx(order, abs=0.25)


def test_a_correction_too_large_for_its_step_is_left_out():
    step, size = np.array([1.0, 0.0]), np.array([1.0, 4.0])
    small, large = (np.array([0.0, factor * CORRECTION_OVER_STEP / 4]) for factor in (0.99, 1.01))
    np.testing.assert_allclose(bent(step, small, size), step + small / 2)
    np.testing.assert_array_equal(bent(step, large, size), step)
    np.testing.assert_array_equal(bent(step, np.array([np.nan, 0.0]), size), step)  # the probe ran away
