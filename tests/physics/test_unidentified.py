"""Combinations of parameters that no data fix."""

import numpy as np
import pytest

from sksurrogate.physics import CalibratedSimulator, ODESimulator


def spring(**params):
    """A mass on a spring, of whose four parameters only the ratios are seen."""

    def rhs(t, x, u, p):
        return x[1], (u[0] * p["gain"] - p["spring"] * x[0] - p["damper"] * x[1]) / p["mass"]

    return ODESimulator(rhs, states=["q", "v"], inputs=["force"], outputs=["q"], params=params, dt=0.05)


@pytest.mark.parametrize("spring_at_first", [5.0, 15.0])
def test_the_direction_is_that_of_the_fitted_values_wherever_the_fit_begins(spring_at_first):
    U = np.repeat(5 * np.random.default_rng(0).normal(size=(24, 1)), 10, axis=0)
    y = spring(spring=20.0, damper=0.3, mass=1.0, gain=1.0).simulate(U)
    with pytest.warns(UserWarning):
        fitted = CalibratedSimulator(spring(spring=spring_at_first, damper=1.0, mass=1.0, gain=1.0)).fit(U, y)
    (direction,) = fitted.unidentified_
    # all four by the same share: nothing that is measured changes
    np.testing.assert_allclose(np.abs(list(direction.values())), 0.5, atol=0.02)
