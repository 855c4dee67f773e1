"""An input that reaches a sensor at once: ``y + c u`` in every way in which a simulator with effects is run."""

import numpy as np
import pytest

from sksurrogate.effects import CATALOGUE, AugmentedSimulator
from sksurrogate.effects._formula import Term
from sksurrogate.effects._law import SensorLawEffect
from sksurrogate.exceptions import DataError
from sksurrogate.physics import CallableSimulator, ODESimulator, StepSimulator, linearise

#: Of the input in the reading, and error of the actuator's gain.
SHARE, GAIN = 0.3, 0.5
NAMES = {"states": ["a", "b"], "inputs": ["u", "w"], "outputs": ["y", "z"], "params": {"k": 1.5}, "dt": 0.1}


def _rhs(t, x, u, p):
    return u[0] - p["k"] * x[0], x[0] - 0.5 * x[1] + u[1]


def _output(t, x, u, p):
    return x[0] + 0.1 * u[1], x[1] * x[1]


def _step(t, x, u, p, dt):
    return [value + dt * rate for value, rate in zip(x, _rhs(t, x, u, p))]


RHS, STEP = ODESimulator(_rhs, output=_output, **NAMES), StepSimulator(_step, output=_output, **NAMES)
SIMULATE = CallableSimulator(lambda U, x0=None: RHS.simulate(U), inputs=["u", "w"], outputs=["y", "z"], dt=0.1)
U = np.random.default_rng(0).normal(size=(60, 2))


@pytest.mark.parametrize("simulator", [RHS, STEP, SIMULATE], ids=["rhs", "step", "simulate"])
def test_the_input_behind_the_actuator_is_added_to_the_reading(simulator):
    effects = [CATALOGUE["input_gain"]("u"), CATALOGUE["sensor_coupling"]("z", "u")]
    found = AugmentedSimulator(simulator, effects, [(GAIN,), (SHARE,)]).simulate(U)
    acting = U * [1.0 + GAIN, 1.0]
    expected = simulator.simulate(acting) + SHARE * acting[:, :1] * [0.0, 1.0]
    np.testing.assert_allclose(found, expected, atol=1e-7)  # its steps are not those of the plain simulator


def test_a_law_of_an_input_is_added_too():
    law = SensorLawEffect("y", "w", (Term((("drag", "w", 0.0, 0.0),)),), (2.0,))
    found = AugmentedSimulator(RHS, [law], [(2.0,)]).simulate(U)
    np.testing.assert_allclose(found[:, 0], RHS.simulate(U)[:, 0] + 2.0 * U[:, 1] * np.abs(U[:, 1]), atol=1e-12)


@pytest.mark.parametrize("simulator", [RHS, STEP], ids=["rhs", "step"])
def test_the_map_from_sample_to_sample_has_it(simulator):
    model = AugmentedSimulator(simulator, [CATALOGUE["sensor_coupling"]("z", "u")], [(SHARE,)])
    n_sub = model.substeps(U)
    graph, x, found = model.to_graph(n_sub), model.start_state(None, U[0], n_sub), []
    for u in U:
        now = graph(x=x, u=u)
        x, _ = np.ravel(now["x_next"]), found.append(np.ravel(now["y"]))
    np.testing.assert_allclose(found, model.simulate(U), atol=1e-9)


def test_it_is_the_feedthrough_of_the_linear_model():
    plain = linearise(RHS, x0=[0.2, 0.3], u0=[0.1, 0.1])
    found = linearise(
        AugmentedSimulator(RHS, [CATALOGUE["sensor_coupling"]("z", "u")], [(SHARE,)]), x0=[0.2, 0.3], u0=[0.1, 0.1]
    )
    np.testing.assert_allclose(np.asarray(found.D) - np.asarray(plain.D), [[0.0, 0.0], [SHARE, 0.0]], atol=1e-6)


def test_a_state_drives_no_sensor():
    with pytest.raises(DataError, match=r"signals of the simulator: \['y', 'z', 'u', 'w'\]"):
        AugmentedSimulator(RHS, [CATALOGUE["sensor_coupling"]("z", "a")], [(SHARE,)]).simulate(U)
