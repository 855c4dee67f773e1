"""Linear plants are stepped exactly: python-control systems by themselves, right-hand sides on request."""

import numpy as np
import pytest
from scipy import signal

from sksurrogate.effects import CATALOGUE, AugmentedSimulator
from sksurrogate.exceptions import SimulatorError
from sksurrogate.physics import ControlSimulator, ODESimulator
from sksurrogate.testing import check_simulator

control = pytest.importorskip("control")
A, B = np.array([[0.0, 1.0], [-4.0, -0.4]]), np.array([[0.0], [1.0]])
C, D = np.array([[1.0, 0.0], [0.0, 2.0]]), np.array([[0.0], [0.5]])
U = np.random.default_rng(0).normal(size=(120, 1))


def spring(t, x, u, p):
    return x[1], u[0] - p["k"] * x[0] - 0.4 * x[1] - p["g"]


def _plant(**options):
    given = {"params": {"k": 4.0, "g": 0.0}, "dt": 0.1, "method": "exact", **options}
    return ODESimulator(spring, states=["q", "v"], inputs=["f"], outputs=["q", "v"], **given)


@pytest.mark.parametrize("hold", ["zoh", "foh"])
def test_a_continuous_system_equals_scipy_signal(hold):
    plant = ControlSimulator(control.ss(A, B, C, D), dt=0.1, hold=hold, x0=[0.3, -1.0])
    t = 0.1 * np.arange(len(U))
    expected = signal.lsim((A, B, C, D), U, t, [0.3, -1.0], interp=hold == "foh")[1]
    np.testing.assert_allclose(plant.simulate(U), expected, rtol=0, atol=1e-12)
    check_simulator(plant, U)


def test_a_discrete_system_equals_scipy_signal():
    F, G, *_ = signal.cont2discrete((A, B, C, D), 0.1)
    plant = ControlSimulator(control.ss(F, G, C, D, 0.1))
    np.testing.assert_allclose(plant.simulate(U), signal.dlsim((F, G, C, D, 0.1), U)[1], rtol=0, atol=1e-12)


def test_a_transfer_function_is_realised_once(monkeypatch):
    plant = ControlSimulator(control.tf([1.0], [1.0, 2.0, 5.0]), dt=0.1)
    calls, made = [], control.ss
    monkeypatch.setattr(control, "ss", lambda *given: (calls.append(1), made(*given))[1])
    found = plant.simulate(np.ones((40, 1)))
    assert len(calls) == 1
    expected = signal.step(([1.0], [1.0, 2.0, 5.0]), T=0.1 * np.arange(40))[1]
    np.testing.assert_allclose(found[:, 0], expected, rtol=0, atol=1e-12)


def test_a_linear_right_hand_side_is_stepped_exactly_with_its_constant():
    plant = _plant(params={"k": 4.0, "g": 2.0})
    t = 0.1 * np.arange(len(U))
    expected = signal.lsim((A, B, np.eye(2), np.zeros((2, 1))), U - 2.0, t, [1.0, 0.0], interp=False)[1]
    np.testing.assert_allclose(plant.simulate(U, x0=[1.0, 0.0]), expected, rtol=0, atol=1e-12)
    check_simulator(plant, U)
    np.testing.assert_allclose(
        _plant(method="auto", params=plant.params).simulate(U, x0=[1.0, 0.0]), expected, atol=1e-6
    )


@pytest.mark.parametrize(
    "rhs",
    [
        lambda t, x, u, p: (x[1], u[0] - np.sin(x[0])),
        lambda t, x, u, p: (x[1], u[0] * x[0]),
        lambda t, x, u, p: (x[1], u[0] - x[0] + 0.01 * np.sin(t)),
        lambda t, x, u, p: (x[1], u[0] - x[0] - 1e-6 * x[1] * np.abs(x[1])),
    ],
    ids=["sine", "product", "time", "small drag"],
)
def test_what_is_not_linear_says_where(rhs):
    plant = _plant()
    plant.rhs = rhs
    with pytest.raises(SimulatorError, match=r"linear in states.*derivative of 'v'.*method=\"auto\""):
        plant.simulate(U)


def test_effects_on_an_exact_plant_are_those_on_an_integrated_one():
    loss = [CATALOGUE["linear_loss"]("v", "v")], [{"coefficient": 0.3}]
    exact, integrated = (
        AugmentedSimulator(plant, *loss).simulate(U, x0=[1.0, 0.0]) for plant in (_plant(), _plant(method="auto"))
    )
    np.testing.assert_array_equal(exact, integrated)


def test_functions_of_a_system_that_take_arrays_are_called_once():
    sizes = []

    def update(t, x, u, p):
        sizes.append(np.shape(x))
        return [x[1], u[0] - p["k"] * np.sin(x[0])]

    def branching(t, x, u, p):
        return [x[1], u[0] - p["k"] * x[0] if x[0] > 0 else u[0]]

    names = {"states": ["q", "v"], "inputs": ["f"], "outputs": ["q"], "params": {"k": 4.0}}
    x, u, k = np.random.default_rng(1).normal(size=(2, 500)), np.ones((1, 500)), np.linspace(1, 2, 500)
    for function in (update, branching):
        plant = ControlSimulator(control.nlsys(function, lambda t, x, u, p: [x[0]], **names), dt=0.1)
        found = plant.rhs(np.zeros(500), x, u, {"k": k})
        one_by_one = [function(0.0, x[:, i], u[:, i], {"k": k[i]}) for i in range(500)]
        np.testing.assert_allclose(found, np.transpose(one_by_one), rtol=1e-14)
    assert (2, 500) in sizes


def test_a_linear_plant_without_inputs_is_stepped_exactly():
    plant = ODESimulator(
        lambda t, x, u, p: (-0.7 * x[0],),
        states=["x"],
        inputs=[],
        outputs=["x"],
        params={},
        dt=0.3,
        x0=[2.0],
        method="exact",
    )
    np.testing.assert_allclose(plant.simulate(np.zeros((20, 0)))[:, 0], 2.0 * np.exp(-0.21 * np.arange(20)), rtol=1e-12)
