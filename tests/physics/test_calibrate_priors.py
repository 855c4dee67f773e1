"""Normal priors of a calibration against the closed form of linear least squares."""

import numpy as np
import pytest

from sksurrogate.exceptions import DataError
from sksurrogate.physics import CalibratedSimulator, StepSimulator

RNG = np.random.default_rng(0)
U = RNG.normal(size=(60, 2))
NOISE = 0.3


def gains(t, x, u, p, dt):
    return x * 0.0 + p["a"] * u[:1] + p["b"] * u[1:2]


def simulator(**params):
    return StepSimulator(
        gains, states=["x"], inputs=["u", "v"], outputs=["x"], params={"a": 1.0, "b": 1.0, **params}, dt=1.0
    )


Y = simulator(a=1.2, b=0.7).simulate(U)[:, 0] + NOISE * RNG.normal(size=60)


def test_the_fit_is_the_mean_of_the_posterior():
    fitted = CalibratedSimulator(simulator(), priors={"a": (1.0, 0.02), "b": 0.5}, fit_x0=False).fit(U, Y)
    rows, y = U[:-1], Y[1:]  # an input acts a sample later
    noise = fitted.noise_[0]
    H = rows.T @ rows / noise**2 + np.diag([1 / 0.02**2, 1 / 0.5**2])
    expected = np.linalg.solve(H, rows.T @ y / noise**2 + np.array([1.0 / 0.02**2, 1.0 / 0.5**2]))
    found = np.array([fitted.params_["a"], fitted.params_["b"]])
    sd = np.sqrt(np.diag(np.linalg.inv(H)))
    assert np.all(
        np.abs(found - expected) < 0.15 * sd
    )  # a fit ends where a step promises less than 0.02 in chi-squared
    half = [np.ptp(fitted.intervals_[name]) / 2 / 1.645 for name in "ab"]
    np.testing.assert_allclose(half, sd, rtol=0.15)  # Student's t, memory of the residual


def test_a_wide_prior_changes_nothing():
    free = CalibratedSimulator(simulator(), fit_x0=False).fit(U, Y)
    held = CalibratedSimulator(simulator(), priors={"a": 1e6, "b": (3.0, 1e6)}, fit_x0=False).fit(U, Y)
    assert held.params_ == pytest.approx(free.params_, abs=1e-5)


def test_what_the_data_do_not_fix_a_prior_fixes():
    only = np.column_stack([U[:, 0], U[:, 0]])  # a and b act together
    y = simulator(a=1.2, b=0.7).simulate(only)[:, 0] + NOISE * RNG.normal(size=60)
    free = CalibratedSimulator(simulator(), fit_x0=False).fit(only, y)
    held = CalibratedSimulator(simulator(), priors={"b": (0.7, 0.01)}, fit_x0=False).fit(only, y)
    assert not free.identifiable_["a"] and held.identifiable_["a"]
    assert held.params_["a"] == pytest.approx(1.2, abs=0.15)
    assert np.isfinite(held.covariance_).all()


@pytest.mark.parametrize(
    ("priors", "message"),
    [
        ({"c": 0.1}, "priors names 'c', which is not fitted"),
        ({"a": -0.1}, r"priors\['a'\]=-0.1: expected a relative standard deviation above 0"),
        ({"a": True}, r"priors\['a'\]=True"),
        ([0.1], r"priors=\[0.1\]: expected a dict by name, for instance priors=\{'a': 0.05\}"),
    ],
)
def test_mistakes(priors, message):
    with pytest.raises(DataError, match=message):
        CalibratedSimulator(simulator(), priors=priors).fit(U, Y)
