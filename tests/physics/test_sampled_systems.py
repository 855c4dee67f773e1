"""Settings that a foreign system would ignore are refused: another sample time, a hold, parameters that go nowhere."""

import numpy as np
import pytest

from sksurrogate.exceptions import SimulatorError
from sksurrogate.physics import CasadiSimulator, ControlSimulator

U = np.ones((5, 1))


def sampled(control, dt=0.1):
    return control.ss([[0.5]], [[0.5]], [[1.0]], [[0.0]], dt)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"dt": 0.2}, "dt=0.2, but the system goes from sample to sample in 0.1"),
        ({"hold": "foh"}, "hold='foh': a system that goes from sample to sample holds its inputs"),
        ({"params": {"k": 1.0}}, "a linear system has no parameters"),
    ],
)
def test_a_sampled_system_has_its_own_time(given, message):
    control = pytest.importorskip("control")
    with pytest.raises(SimulatorError, match=message):
        ControlSimulator(sampled(control), **given).simulate(U)


def test_a_system_without_a_sample_time_gets_one():
    control = pytest.importorskip("control")
    expected = 1 - 0.5 ** np.arange(5)
    assert np.allclose(ControlSimulator(sampled(control), dt=0.1).simulate(U).ravel(), expected)
    assert np.allclose(ControlSimulator(sampled(control, True), dt=7.0).simulate(U).ravel(), expected)


def test_what_has_no_states_is_said():
    control = pytest.importorskip("control")
    with pytest.raises(SimulatorError, match=r"cannot be realised in state space .* control.nlsys"):
        ControlSimulator(control.tf([1, 0, 0], [1, 1]), dt=0.1).simulate(U)


def lag(ca, names=("x", "u", "k")):
    x, u, k = (ca.SX.sym(name) for name in "xuk")
    return ca.Function("lag", [x, u, k], [u - k * x], list(names), ["dx"])


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"discrete": True, "hold": "foh"}, "hold='foh': a system that goes from sample to sample"),
        ({"discrete": True, "method": "LSODA"}, "method='LSODA': a system that goes from sample to sample"),
        ({"params": {"k": 1.0, "z": 2.0}}, "no input of the function takes 'z'; its inputs are .'k', 'u', 'x'."),
        ({"params": {"k": "a"}}, "params: k='a', expected a number"),
        ({"params": ["k"]}, "params=.'k'.: expected a dict"),
    ],
)
def test_a_casadi_function_gets_what_is_given(given, message):
    ca = pytest.importorskip("casadi")
    named = {"states": ["s"], "inputs": ["u"], "outputs": ["s"], "params": {"k": 1.0}, "dt": 0.1, **given}
    with pytest.raises(SimulatorError, match=message):
        CasadiSimulator(lag(ca), **named).simulate(U)


def test_a_parameter_is_not_the_time():
    ca = pytest.importorskip("casadi")
    with pytest.raises(SimulatorError, match="'t' is also what the function calls its time"):
        CasadiSimulator(
            lag(ca, "xut"), states=["s"], inputs=["u"], outputs=["s"], params={"t": 5.0}, dt=0.1
        ).simulate(U)  # fmt: skip
