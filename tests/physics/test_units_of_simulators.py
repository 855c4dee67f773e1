"""Units by name on every simulator: kept by clone, repr, pickle and set_params, checked, passed on."""

import pickle
import zipfile

import numpy as np
import pytest
from sklearn.base import clone

from sksurrogate.compose import RecursivePredictor
from sksurrogate.effects import CATALOGUE, AugmentedSimulator
from sksurrogate.exceptions import SimulatorError
from sksurrogate.linear import PCRRegressor
from sksurrogate.physics import (
    CallableSimulator,
    CasadiSimulator,
    ControlSimulator,
    FMUSimulator,
    MuJoCoSimulator,
    ODESimulator,
    StepSimulator,
    SurrogateSimulator,
    TableSimulator,
)
from sksurrogate.physics._simulator import describe, units_of

UNITS = {"level": "m", "flow": "m^3/s", "time": "s"}
NAMES = {"inputs": ["flow"], "outputs": ["level"]}
PENDULUM = """
<mujoco><worldbody>
  <body name="arm"><joint name="hinge" axis="0 1 0"/><geom type="sphere" size="0.05" pos="0 0 -0.5" mass="1"/></body>
  <body name="cart"><joint name="rail" type="slide"/><geom type="sphere" size="0.05" mass="1"/></body>
</worldbody><actuator><motor name="torque" joint="hinge"/></actuator></mujoco>"""


def rhs(t, x, u, p):
    return [u[0] - p["k"] * x[0]]


def step(t, x, u, p, dt):
    return [x[0] + dt * (u[0] - p["k"] * x[0])]


def ode(**kwargs):
    return ODESimulator(rhs, states=["level"], params={"k": 1.0}, dt=0.1, **NAMES, **kwargs)


def casadi_simulator():
    casadi = pytest.importorskip("casadi")
    t, x, u, p = casadi.SX.sym("t"), casadi.SX.sym("x"), casadi.SX.sym("u"), casadi.SX.sym("p")
    function = casadi.Function("rhs", [t, x, u, p], [u - p * x])
    return CasadiSimulator(function, states=["level"], params={"k": 1.0}, dt=0.1, units=UNITS, **NAMES)


def control_simulator():
    control = pytest.importorskip("control")
    system = control.ss([[-1.0]], [[1.0]], [[1.0]], [[0.0]], inputs=["flow"], outputs=["level"], states=["level"])
    return ControlSimulator(system, dt=0.1, units=UNITS)


def surrogate():
    X = np.sin(np.arange(60.0))[:, None]
    model = RecursivePredictor(PCRRegressor(), input_lags=1, output_lags=1).fit(X, 0.5 * X[:, 0])
    return SurrogateSimulator(model, units=UNITS, **NAMES)


SIMULATORS = {
    "ode": lambda: ode(units=UNITS),
    "step": lambda: StepSimulator(step, states=["level"], params={"k": 1.0}, dt=0.1, units=UNITS, **NAMES),
    "callable": lambda: CallableSimulator(np.abs, units=UNITS, **NAMES),
    "table": lambda: TableSimulator(np.zeros((9, 1)), np.zeros((9, 1)), units=UNITS, **NAMES),
    "control": control_simulator,
    "casadi": casadi_simulator,
    "surrogate": surrogate,
}


@pytest.mark.parametrize("kind", SIMULATORS)
def test_units_survive_clone_pickle_and_set_params(kind):
    simulator = SIMULATORS[kind]()
    assert units_of(simulator) == UNITS
    assert units_of(clone(simulator)) == UNITS
    assert simulator.get_params()["units"] == UNITS
    changed = clone(simulator).set_params(units={"level": "cm"})
    assert units_of(changed) == {"level": "cm"} and units_of(simulator) == UNITS
    if kind != "control":  # its systems hold a lambda
        assert units_of(pickle.loads(pickle.dumps(simulator))) == UNITS
    describe(simulator, n_inputs=1, n_outputs=1)


def test_a_unit_of_an_unknown_name_is_a_mistake():
    with pytest.raises(
        SimulatorError, match=r"units: the simulator has no signal or parameter 'levle'; expected .*'level'"
    ):
        describe(ode(units={"levle": "m"}))


def test_units_of_parameters_and_of_what_an_effect_augments():
    plant = ode(units={**UNITS, "k": "1/s"})
    slow = AugmentedSimulator(plant, [CATALOGUE["input_lag"]("flow")], [{"time_constant": 0.1}])
    assert units_of(slow) == {**UNITS, "k": "1/s"}
    describe(slow)


def test_joints_are_in_si_units_unless_others_are_given():
    pytest.importorskip("mujoco")
    arm = MuJoCoSimulator(PENDULUM)
    units = units_of(arm)
    assert (units["hinge.pos"], units["hinge.vel"], units["hinge"]) == ("rad", "rad/s", "N m")
    assert (units["rail.pos"], units["rail.damping"], units["cart.mass"]) == ("m", "N s/m", "kg")
    assert units["time"] == "s"
    assert units_of(arm.set_params(units={"hinge.pos": "deg"}))["hinge.pos"] == "deg"
    assert units_of(pickle.loads(pickle.dumps(arm)))["hinge.pos"] == "deg"


def test_an_fmu_brings_the_units_of_its_description(tmp_path):
    pytest.importorskip("fmpy")
    description = """<?xml version="1.0" encoding="UTF-8"?>
    <fmiModelDescription fmiVersion="2.0" modelName="tank" guid="tank">
    <CoSimulation modelIdentifier="tank"/>
    <UnitDefinitions><Unit name="m"/></UnitDefinitions>
    <ModelVariables>
    <ScalarVariable name="level" valueReference="0" causality="output"><Real unit="m"/></ScalarVariable>
    <ScalarVariable name="flow" valueReference="1" causality="input"><Real start="0"/></ScalarVariable>
    </ModelVariables>
    <ModelStructure><Outputs><Unknown index="1"/></Outputs></ModelStructure>
    </fmiModelDescription>"""
    with zipfile.ZipFile(tmp_path / "tank.fmu", "w") as archive:
        archive.writestr("modelDescription.xml", description)
    assert units_of(FMUSimulator(tmp_path / "tank.fmu")) == {"time": "s", "level": "m"}
    assert units_of(FMUSimulator(tmp_path / "tank.fmu", units={"flow": "l/s"}))["flow"] == "l/s"
