"""What a user's function writes into its arguments stays its own."""

import math
import warnings

import numpy as np
import pytest

from sksurrogate.blind._own_simulator import plant_of
from sksurrogate.compose import HybridRegressor
from sksurrogate.datasets import simulate_experiments
from sksurrogate.effects import CATALOGUE, AugmentedSimulator
from sksurrogate.exceptions import SimulatorError
from sksurrogate.gap import GapDiagnoser
from sksurrogate.physics import CalibratedSimulator, CallableSimulator, ODESimulator, StepSimulator

U = np.repeat([[1.0], [-2.0], [0.5]], 8, axis=0)
SIGNALS = {"states": ["a", "b"], "inputs": ["u"], "outputs": ["b"], "params": {"k": 1.5}, "dt": 0.1}


def clean(t, x, u, p):
    a = np.tanh(x[0])
    return u[0] - p["k"] * a, a - x[1]


def writes_state(t, x, u, p):
    x[0] = np.tanh(x[0])
    return u[0] - p["k"] * x[0], x[0] - x[1]


def writes_sometimes(t, x, u, p):
    a = np.tanh(x[0])
    if np.any(x[0] < -0.5):  # not where it is probed
        x[0] = a
        return u[0] - p["k"] * x[0], x[0] - x[1]
    return u[0] - p["k"] * a, a - x[1]


def writes_input(t, x, u, p):
    u -= p["k"] * np.tanh(x[0])
    return u[0], np.tanh(x[0]) - x[1]


def writes_parameter(t, x, u, p):
    p["k"] *= np.tanh(x[0])
    return u[0] - p["k"], np.tanh(x[0]) - x[1]


def writes_point(t, x, u, p):
    x[0] = math.tanh(x[0])  # point by point
    return u[0] - p["k"] * x[0], x[0] - x[1]


FORMS = [writes_state, writes_sometimes, writes_input, writes_parameter, writes_point]
QUIET = pytest.mark.filterwarnings("ignore:.*(writes into its argument|point by point)")


@QUIET
@pytest.mark.parametrize("rhs", FORMS)
def test_a_right_hand_side_that_writes_simulates_the_same(rhs):
    kept = U.copy()
    expected = ODESimulator(clean, **SIGNALS).simulate_states(U, [0.3, 0.1])
    plant = ODESimulator(rhs, **SIGNALS)
    for found, wanted in zip(plant.simulate_states(U, [0.3, 0.1]), expected):
        np.testing.assert_allclose(found, wanted, rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(plant.simulate(U, [0.3, 0.1])[:, 0], expected[0][:, 1], rtol=1e-12, atol=1e-14)
    np.testing.assert_array_equal(U, kept)
    assert plant.params == {"k": 1.5}


@pytest.mark.parametrize("rhs", [writes_state, writes_sometimes])
def test_a_right_hand_side_that_writes_is_told_so(rhs):
    with pytest.warns(UserWarning, match=r"rhs writes into its argument x and is handed copies.*x = x\.copy\(\)"):
        ODESimulator(rhs, **SIGNALS).simulate(U, [0.3, 0.1])


def test_a_function_that_wants_writable_arrays_and_does_not_write_is_not_blamed():
    def typed(t, x, u, p):
        if not x.flags.writeable:
            raise ValueError("buffer source array is read-only")  # as Cython says
        return clean(t, x, u, p)

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = ODESimulator(typed, **SIGNALS).simulate(U, [0.3, 0.1])
    np.testing.assert_array_equal(found, ODESimulator(clean, **SIGNALS).simulate(U, [0.3, 0.1]))


@QUIET
def test_a_step_an_output_and_an_event_that_write():
    def step(t, x, u, p, dt):
        x += dt * u
        return x

    def plain(t, x, u, p, dt):
        return x + dt * u

    def reading(t, x, u, p):
        x *= 2.0
        return [x[0]]

    names = {"states": ["a"], "inputs": ["u"], "outputs": ["y"], "dt": 0.1}
    found = StepSimulator(step, **names, output=reading).simulate(U)
    np.testing.assert_allclose(found, StepSimulator(plain, **names, output=lambda *a: [2 * a[1][0]]).simulate(U))

    def jump(t, x, u, p):
        x[1] *= -0.8
        return x

    def when(t, x, u, p):
        x *= 1.0
        return x[0]

    def fall(t, x, u, p):
        return x[1], u[0] - 9.81 + 0 * x[0]

    ball = {"states": ["h", "v"], "inputs": ["f"], "outputs": ["h"], "params": {}, "dt": 0.02, "x0": [1.0, 0.0]}
    bounce = [(lambda t, x, u, p: x[0], lambda t, x, u, p: (x[0], -0.8 * x[1]))]
    push = np.zeros((60, 1))
    found = ODESimulator(fall, **ball, events=[(when, jump)]).simulate(push)
    np.testing.assert_allclose(found, ODESimulator(fall, **ball, events=bounce).simulate(push), atol=1e-12)


def test_a_step_that_forgets_dt_is_told_what_it_is_given():
    simulator = StepSimulator(lambda t, x, u, p: x, states=["a"], inputs=["u"], outputs=["a"], dt=0.1)
    with pytest.raises(
        SimulatorError, match=r"step\(t, x, u, p, dt\) failed at t=0.*takes 4 positional arguments but 5"
    ):
        GapDiagnoser(simulator).fit(U, U)


def shifts(U, x0=None, t=None):
    U += 1.0
    return np.cumsum(U, axis=0)


class Shifts:
    states, inputs, outputs, dt = [], ["u"], ["y"], 1.0

    def simulate(self, U, x0=None, t=None):
        U += 1.0
        return np.cumsum(U, axis=0)


@pytest.mark.parametrize("plant", [CallableSimulator(shifts, inputs=["u"], outputs=["y"]), Shifts()])
def test_a_simulator_that_writes_leaves_the_data_alone(plant):
    rows, y = U.copy(), np.cumsum(U + 1.0, axis=0)[:, 0] + 0.1
    data = simulate_experiments(plant, design=rows[:, 0], n_runs=1, n_samples=24)
    np.testing.assert_array_equal(data.X, U)
    np.testing.assert_allclose(data.y, np.cumsum(U + 1.0, axis=0)[:, 0])
    model = HybridRegressor(plant, form="static").fit(rows, y)
    model.predict(rows)
    bias = AugmentedSimulator(plant, [CATALOGUE["sensor_bias"]("y")], [{"value": 0.5}])
    np.testing.assert_allclose(bias.simulate(rows)[:, 0], np.cumsum(U + 1.0, axis=0)[:, 0] + 0.5)
    np.testing.assert_array_equal(rows, U)


def test_a_function_that_writes_leaves_the_users_arrays_alone():
    def starts(U, x0, t):
        x0 += 1.0
        t += 1.0
        return x0 + 0 * U

    x0, t, rows = np.array([1.0]), np.arange(24.0), U.copy()
    plant = CallableSimulator(starts, inputs=["u"], outputs=["y"], x0=x0)
    for _ in range(2):
        np.testing.assert_array_equal(plant.simulate(rows, t=t), np.full((24, 1), 2.0))
    CallableSimulator(shifts, inputs=["u"]).simulate(rows)
    assert x0 == [1.0] and t[0] == 0.0
    np.testing.assert_array_equal(rows, U)


@QUIET
def test_a_calibration_is_that_of_the_clean_right_hand_side():
    y = ODESimulator(clean, **{**SIGNALS, "params": {"k": 1.2}}).simulate(U, [0.3, 0.1])[:, 0]
    found = [CalibratedSimulator(ODESimulator(f, **SIGNALS), params=["k"]).fit(U, y) for f in (clean, writes_state)]
    assert found[0].params_["k"] == pytest.approx(1.2, rel=1e-4)
    assert found[1].params_["k"] == pytest.approx(found[0].params_["k"], rel=1e-9)


def test_the_blind_check_hands_out_copies():
    ranges = {"u": (-1.0, 1.0)}
    found = [plant_of(ODESimulator(f, **SIGNALS), input_ranges=ranges)[0] for f in (clean, writes_state, writes_input)]
    x, u = np.array([[-1.0, 0.5], [0.2, 0.3]]), np.array([[0.3, -0.4]])
    for plant in found:
        np.testing.assert_allclose(np.stack(plant.rhs(0.0, x, u, {"k": 1.5})), np.stack(clean(0.0, x, u, {"k": 1.5})))
        assert plant.kinematic == found[0].kinematic
    assert x[0, 0] == -1.0 and u[0, 0] == 0.3


def test_python_control_keeps_its_states():
    pytest.importorskip("control")
    system = ODESimulator(writes_state, **SIGNALS).to_control()
    x = np.array([-1.0, 0.5])
    system.dynamics(0.0, x, [0.3])
    assert x[0] == -1.0
