"""Plants handed to python-control and taken back; parameters of its nonlinear systems; systems without states."""

import math

import numpy as np
import pytest

from sksurrogate.exceptions import SimulatorError
from sksurrogate.physics import CalibratedSimulator, CallableSimulator, ControlSimulator, ODESimulator, StepSimulator
from sksurrogate.testing import check_simulator

control = pytest.importorskip("control")


def pendulum(t, x, u, p):
    return [x[1], -p["g"] * np.sin(x[0]) - p["c"] * x[1] + u[0]]


def _system(c=0.2):
    return control.nlsys(
        pendulum, lambda t, x, u, p: [x[0]], states=["th", "w"], inputs=["m"], outputs=["th"], params={"g": 2.0, "c": c}
    )


def test_a_plant_goes_there_and_comes_back():
    plant = ODESimulator(
        pendulum, states=["th", "w"], inputs=["m"], outputs=["th"], params={"g": 2.0, "c": 0.2}, dt=0.1, hold="foh"
    )
    U = np.sin(0.3 * np.arange(80))[:, None]
    there = plant.to_control()
    response = control.input_output_response(
        there, 0.1 * np.arange(80), U[:, 0], [0.5, 0.0], solve_ivp_kwargs={"rtol": 1e-9, "atol": 1e-11}
    )
    expected = plant.simulate(U, x0=[0.5, 0.0])
    np.testing.assert_allclose(response.outputs, expected[:, 0], atol=1e-6)
    back = ControlSimulator(there, dt=0.1, hold="foh")
    np.testing.assert_allclose(back.simulate(U, x0=[0.5, 0.0]), expected, atol=1e-9)
    step = StepSimulator(
        lambda t, x, u, p, dt: [0.9 * x[0] + u[0]], states=["x"], inputs=["u"], outputs=["x"], dt=0.5
    ).to_control()
    assert step.dt == 0.5 and step.dynamics(0.0, [2.0], [1.0]) == pytest.approx([2.8])
    with pytest.raises(SimulatorError, match="trajectories only"):
        CallableSimulator(np.sin).to_control()


def test_parameters_of_a_nonlinear_system_are_calibrated():
    U = np.repeat(np.random.default_rng(0).normal(size=6), 10)[:, None]
    y = ControlSimulator(_system(), dt=0.1).simulate(U, x0=[1.0, 0.0])[:, 0]
    model = ControlSimulator(_system(), dt=0.1, params={"c": 0.5})
    check_simulator(model, U)
    found = CalibratedSimulator(model, ["c"], fit_x0=False).fit(U, y, x0=[1.0, 0.0])
    assert found.params_["c"] == pytest.approx(0.2, abs=1e-5)


def test_a_gain_has_no_states():
    gain = ControlSimulator(control.ss([], [], [], [[2.0]]), dt=0.1)
    np.testing.assert_allclose(gain.simulate([[1.0], [3.0]]), [[2.0], [6.0]])


def test_a_nonlinear_system_that_branches_is_called_once_for_all_points_of_a_branch():
    calls = []

    def update(t, x, u, params):
        calls.append(np.shape(x))
        return [-params["c"] * math.copysign(1.0, x[0]) + max(u[0], 0.0)]

    system = control.nlsys(update, None, inputs=["u"], states=["x"], outputs=["x"], params={"c": 0.4})
    simulator = ControlSimulator(system, dt=0.1)
    x, u = np.random.default_rng(0).normal(size=(2, 1, 400))
    simulator.rhs(0.0, x, u, {})  # probes it
    calls.clear()
    np.testing.assert_array_equal(simulator.rhs(0.0, x, u, {})[0], -0.4 * np.sign(x[0]) + np.maximum(u[0], 0.0))
    assert len(calls) < 10


def test_without_a_function_the_outputs_are_the_states_of_all_points(monkeypatch):
    system = control.nlsys(
        lambda t, x, u, params: [x[1], u[0] - params["k"] * x[0]], None,
        inputs=["u"], states=["q", "v"], outputs=["q", "v"], params={"k": 0.4},
    )  # fmt: skip
    simulator = ControlSimulator(system, dt=0.1)
    x = np.random.default_rng(0).normal(size=(2, 5, 80))
    one_by_one = np.stack([system.output(0.0, point, [0.0], {}) for point in x.reshape(2, -1).T], axis=1)
    simulator.output(0.0, x, np.zeros((1, 5, 80)), {})  # probes it
    monkeypatch.setattr(type(system), "output", lambda *given: pytest.fail("asked point by point"))
    np.testing.assert_array_equal(simulator.output(0.0, x, np.zeros((1, 5, 80)), {}), one_by_one.reshape(x.shape))


def test_parameters_of_points_reach_an_interconnected_system_one_by_one():
    plant = control.nlsys(
        lambda t, x, u, params: [u[0] - params["k"] * x[0]], lambda t, x, u, params: [x[0]],
        inputs=["u"], states=["x"], outputs=["y"], params={"k": 0.4}, name="plant",
    )  # fmt: skip
    loop = control.interconnect([plant], inplist=["plant.u"], outlist=["plant.y"], inputs=["u"], outputs=["y"])
    simulator = ControlSimulator(loop, dt=0.1, params={"k": 0.4})
    x, k = np.random.default_rng(0).normal(size=(2, 1, 6))
    found = simulator.rhs(0.0, x, np.ones((1, 6)), {"k": k[0]})
    np.testing.assert_allclose(found, 1.0 - k * x, rtol=1e-12)


def _loop():
    """A plant with a controller, a sensor with a gain, and a subsystem of subsystems; parameters of two of them."""
    plant = control.nlsys(
        lambda t, x, u, params: [x[1], u[0] - params["k"] * x[0] - params["c"] * abs(x[1]) * x[1]],
        lambda t, x, u, params: [x[0], x[1]],
        inputs=["force"], states=["q", "v"], outputs=["q", "v"], params={"k": 4.0, "c": 0.3}, name="plant",
    )  # fmt: skip
    lag = control.ss([[-2.0]], [[1.0]], [[2.0]], [[0.0]], inputs=["e"], outputs=["lagged"], name="lag")
    gain = control.nlsys(
        None, lambda t, x, u, params: [params["gain"] * (u[0] - u[1])], inputs=["r", "y"], outputs=["e"], params={"gain": 3.0}, name="gain"
    )  # fmt: skip
    controller = control.interconnect([gain, lag], inputs=["r", "y"], outputs=["lagged"], name="controller")
    return control.interconnect(
        [plant, controller],
        connections=[["plant.force", "controller.lagged"], ["controller.y", "plant.q"]],
        inplist=["controller.r"], outlist=["plant.q", "plant.v", "controller.lagged"], inputs=["r"], outputs=["q", "v", "f"],
    )  # fmt: skip


@pytest.mark.parametrize("what", ["rhs", "output"])
def test_an_interconnected_system_is_asked_for_all_points_at_once(what, monkeypatch):
    loop = _loop()
    simulator = ControlSimulator(loop, dt=0.1, params={"k": 4.0, "gain": 3.0})
    rng = np.random.default_rng(0)
    x, u, k = rng.normal(size=(3, 4, 7)), rng.normal(size=(1, 4, 7)), rng.uniform(1, 3, (4, 7))
    asked = getattr(loop, "dynamics" if what == "rhs" else "output")
    points = zip(x.reshape(3, -1).T, u.reshape(1, -1).T, k.ravel())
    one_by_one = np.stack([asked(0.0, *point, {"k": value, "gain": 3.0}) for *point, value in points], axis=1)
    getattr(simulator, what)(0.0, x, u, {"k": k, "gain": 3.0})  # probes it
    for name in ("dynamics", "output"):
        monkeypatch.setattr(type(loop), name, lambda *given: pytest.fail("asked point by point"))
    found = getattr(simulator, what)(0.0, x, u, {"k": k, "gain": 3.0})
    np.testing.assert_allclose(found, one_by_one.reshape(found.shape), rtol=1e-12, atol=1e-12)


def test_an_algebraic_loop_is_said():
    gains = [
        control.nlsys(None, lambda t, x, u, params: [2.0 * u[0]], inputs=["u"], outputs=["y"], name=name)
        for name in "ab"
    ]
    plant = control.ss([[-1.0]], [[1.0]], [[1.0]], [[0.0]], inputs=["u"], outputs=["y"], name="plant")
    loop = control.interconnect(
        [*gains, plant], connections=[["a.u", "b.y"], ["b.u", "a.y"], ["plant.u", "b.y"]], inplist=["a.u"], outlist=["plant.y"],
        inputs=["r"], outputs=["y"],
    )  # fmt: skip
    with pytest.raises(SimulatorError, match="algebraic loop"):
        ControlSimulator(loop, dt=0.1).simulate(np.ones((5, 1)))


@pytest.mark.parametrize("varied", [False, True])
def test_a_nonlinear_system_with_vectors_is_asked_for_all_points(varied):
    def update(t, x, u, params):
        dx = np.zeros(2)
        dx[0] = x[1]
        dx[1] = np.array([-params["k"], -0.3]) @ x + u[0]
        return dx

    system = control.nlsys(update, None, inputs=["u"], states=["q", "v"], outputs=["q", "v"], params={"k": 4.0})
    simulator, rng = ControlSimulator(system, dt=0.1), np.random.default_rng(0)
    x, u, k = rng.normal(size=(2, 60)), rng.normal(size=(1, 60)), rng.uniform(1, 3, 60) if varied else 2.0
    expected = [x[1], -k * x[0] - 0.3 * x[1] + u[0]]
    np.testing.assert_allclose(simulator.rhs(0.0, x, u, {"k": k}), expected, rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize("place", [0, 1], ids=["state", "input"])
@pytest.mark.parametrize(
    "special", [np.logical_not, lambda v: v > 0, lambda v: v < 0, lambda v: abs(v) > 0.1, lambda v: (v != 0) & (abs(v) < 1e-3)],
    ids=["zero", "positive", "negative", "large", "small"],
)  # fmt: skip
def test_a_system_that_asks_about_any_of_its_points_is_asked_one_by_one(place, special):
    def update(t, x, u, params):
        return [0 * x[0] + (2.0 if np.any(special((x, u)[place][0])) else 1.0)]

    system = control.nlsys(update, None, inputs=["u"], states=["x"], outputs=["x"])
    points = np.array([[0.0, 1e-4, -1e-4, 0.04, -0.04, 0.5, -0.5]])
    found = ControlSimulator(system, dt=0.1).rhs(0.0, points, points, {})
    np.testing.assert_array_equal(found[0], 1.0 + special(points[0]))
