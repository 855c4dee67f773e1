"""Events: the ball that bounces, against its closed form."""

import pickle

import numpy as np
import pytest
from sklearn.base import clone

from sksurrogate.exceptions import SimulatorError
from sksurrogate.physics import CalibratedSimulator, ODESimulator
from sksurrogate.physics._events import EventMap
from sksurrogate.testing import check_simulator


def fall(t, x, u, p):
    return x[1], u[0] - p["g"] + 0 * x[0]


def floor(t, x, u, p):
    return x[0]


def bounce(t, x, u, p):
    return 0 * x[0], -p["e"] * x[1]


def ball(g=9.81, e=0.8, **options):
    return ODESimulator(
        fall, states=["h", "v"], inputs=["a"], outputs=["h"], params={"g": g, "e": e}, dt=0.02, x0=[1.0, 0.0],
        **{"events": [(floor, bounce)], **options},
    )  # fmt: skip


def height(t, g=9.81, e=0.8):
    start, v = np.sqrt(2 / g), np.sqrt(2 * g) * e
    if t < start:
        return 1 - g * t**2 / 2
    while t >= start + 2 * v / g and v > 1e-9:
        start, v = start + 2 * v / g, v * e
    return v * (t - start) - g * (t - start) ** 2 / 2 if v > 1e-9 else 0.0


def test_a_ball_follows_its_closed_form_until_it_rests():
    y = ball().simulate(np.zeros((260, 1)))[:, 0]  # it rests from t = 4.06, row 203
    np.testing.assert_allclose(y[:195], [height(0.02 * k) for k in range(195)], atol=1e-9)
    assert np.all(np.abs(y[204:]) < 1e-6)
    assert ball().simulate(np.full((30, 1), 20.0), x0=[0.0, 0.0])[-1, 0] > 1.0  # and rises again


@pytest.mark.slow
def test_it_keeps_the_protocol():
    plant = ball()
    check_simulator(plant, np.zeros((60, 1)))
    U, X0 = np.zeros((2, 60, 1)), [[1.0, 0.0], [0.3, 2.0]]
    batch = plant.simulate_batch(U, X0)
    for k in range(2):
        np.testing.assert_allclose(batch[k], plant.simulate(U[k], x0=X0[k]), atol=1e-9)
    other = pickle.loads(pickle.dumps(clone(plant)))
    np.testing.assert_array_equal(other.simulate(U[0]), plant.simulate(U[0]))
    states, slopes = plant.simulate_states(U[0])
    assert np.all(slopes[:, 1] == -9.81) and np.array_equal(slopes[:, 0], states[:, 1])
    assert not hasattr(ball(events=None), "step")


def test_calibration_goes_through_a_bounce():
    rng = np.random.default_rng(0)
    y = ball().simulate(np.zeros((40, 1)))[:, 0] + 1e-3 * rng.normal(size=40)
    found = CalibratedSimulator(ball(g=9.6, e=0.75), fit_x0=False).fit(np.zeros((40, 1)), y)
    assert found.params_["g"] == pytest.approx(9.81, rel=5e-3)
    assert found.params_["e"] == pytest.approx(0.8, rel=5e-3)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"hold": "foh"}, "hold"),
        ({"method": "Radau"}, "method"),
        ({"events": [floor]}, r"^events\[0\]=.*\(when, then\)"),
        ({"events": [(floor, lambda t, x, u, p: None)]}, r"^events\[0\] then.*returned None"),
    ],
)
def test_mistakes_speak(options, message):
    with pytest.raises(SimulatorError, match=message):
        ball(**options).simulate(np.zeros((40, 1)))


def test_every_point_takes_the_substeps_that_it_needs():
    """Decays of rates from slow to fast, against their exponentials; a point does not depend on those beside it."""
    calls = []

    def decay(t, x, u, p):
        calls.append(np.shape(x)[-1])
        return (u[0] - p["k"] * x[0],)

    samples, k = EventMap(decay, (), ["x"]), np.array([0.01, 0.1, 1.0, 3.0])
    x, u = np.full((1, 4), 3.0), np.full((1, 4), 0.5)
    samples.rhs.probe(0.0, x[:, 0], u[:, 0], {"k": 1.0})
    calls.clear()
    found = samples.sample(0.0, x, u, {"k": k}, 1.0)
    exact = 0.5 / k + (3.0 - 0.5 / k) * np.exp(-k)
    assert np.all(np.abs(found[0] - exact) < 1e-8 * x[0])
    assert calls[:12] == [4] * 12 and sum(calls) < 4 * 4 * (1 + 2 + 4 + 8 + 16 + 32 + 64)
    for i in range(4):
        alone = samples.sample(0.0, x[:, [i]], u[:, [i]], {"k": k[[i]]}, 1.0)
        assert alone[0, 0] == found[0, i]


@pytest.mark.parametrize("unit", [1.0, 1e-12, 1e9])
def test_a_condition_that_stays_below_zero_has_one_event(unit):
    """At a moment the state is raised once; a level that is passed counts once. Closed form: two exponentials, and a count of one."""
    t, moment = 0.1 * np.arange(40), 1.234
    once = ODESimulator(
        lambda t, x, u, p: (-x[0],), states=["x"], inputs=["u"], outputs=["x"], params={}, dt=0.1, x0=[unit],
        events=[(lambda t, x, u, p: moment - t + 0 * x[0], lambda t, x, u, p: (x[0] + unit,))],
    )  # fmt: skip
    expected = np.exp(-t) + np.where(t < moment, 0.0, np.exp(moment - t))
    np.testing.assert_allclose(once.simulate(np.zeros((40, 1)))[:, 0] / unit, expected, atol=1e-7)
    counted = ODESimulator(
        lambda t, x, u, p: (unit + 0 * x[0], 0 * x[0]), states=["level", "n"], inputs=["u"], outputs=["n"], params={}, dt=0.1,
        x0=[0.0, 0.0], events=[(lambda t, x, u, p: 1.03 * unit - x[0], lambda t, x, u, p: (x[0], x[1] + 1.0))],
    )  # fmt: skip
    found = counted.simulate(np.zeros((40, 1)))[:, 0]
    np.testing.assert_array_equal(found, np.where(t < 1.03, 0.0, 1.0))


def test_a_valve_that_opens_for_good_opens_once():
    """It says so again while the pressure goes on rising; the pressure does not stop there."""
    plant = ODESimulator(
        lambda t, x, u, p: (1.0 - 0.4 * x[1], 0 * x[0]), states=["pressure", "open"], inputs=["u"], outputs=["pressure"],
        params={}, dt=0.1, x0=[0.0, 0.0],
        events=[(lambda t, x, u, p: 1.03 - x[0], lambda t, x, u, p: (x[0], 1.0 + 0 * x[1]))],
    )  # fmt: skip
    t = 0.1 * np.arange(40)
    expected = np.where(t < 1.03, t, 1.03 + 0.6 * (t - 1.03))
    np.testing.assert_allclose(plant.simulate(np.zeros((40, 1)))[:, 0], expected, atol=1e-9)


@pytest.mark.parametrize("unit", [1e-12, 1e-6, 1e6])
def test_a_ball_bounces_alike_in_any_unit_of_length(unit):
    def run(size):
        plant = ball(g=9.81 * size).set_params(x0=[size, 0.0])
        return plant.simulate(np.zeros((150, 1)))[:, 0] / size

    np.testing.assert_allclose(run(unit), run(1.0), atol=1e-9)


def test_conditions_and_rates_of_one_component_may_be_arrays_without_axes():
    """``np.where`` of one number gives one."""
    where, plain = (
        ODESimulator(
            rate,
            states=["x"],
            inputs=["u"],
            outputs=["x"],
            params={},
            dt=0.1,
            x0=[1.0],
            events=[(when, lambda t, x, u, p: (x[0] + 1.0,))],
        )
        for rate, when in (
            (
                lambda t, x, u, p: np.where(x[0] > 0, -x[0], -2 * x[0]),
                lambda t, x, u, p: np.where(x[0] > 0, x[0] - 0.5, x[0]),
            ),
            (lambda t, x, u, p: (-x[0],), lambda t, x, u, p: x[0] - 0.5),
        )
    )
    np.testing.assert_allclose(where.simulate(np.zeros((40, 1))), plain.simulate(np.zeros((40, 1))), atol=1e-12)
