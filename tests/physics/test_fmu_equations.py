"""Units as right-hand sides and steps: the same plant written as equations is the oracle."""

import pickle

import numpy as np
import pytest
from sklearn.base import clone

from sksurrogate.effects import CATALOGUE, AugmentedSimulator
from sksurrogate.exceptions import SimulationDiverged, SimulatorError, SurrogateError
from sksurrogate.export import to_graph
from sksurrogate.gap import GapDiagnoser
from sksurrogate.physics import CalibratedSimulator, FMUSimulator, ODESimulator, linearise
from sksurrogate.physics._simulator import describe
from sksurrogate.testing import check_simulator

PARAMS = {"g": 9.0, "c": 0.4}
U = np.random.default_rng(0).normal(size=(60, 1))


def swing(t, x, u, p):
    return x[1], u[0] - p["g"] * np.sin(x[0]) - p["c"] * x[1]


def torque(t, x, u, p):
    return x[0], p["g"] * np.sin(x[0])


def _equations(**options):
    given = {"outputs": ["angle"], "params": PARAMS, "dt": 0.05, "x0": [0.5, 0.0], **options}
    return ODESimulator(swing, states=["angle", "rate"], inputs=["push"], **given)


def _unit(path, **options):
    return FMUSimulator(path, **{"outputs": ["angle"], "params": PARAMS, "dt": 0.05, **options})


@pytest.fixture(params=["as it comes", "through ctypes"])
def calls(request, monkeypatch):
    """The calls at points as this machine makes them, and without machine code."""
    if request.param == "through ctypes":
        monkeypatch.setattr("sksurrogate.physics._call_loop.machine_code", lambda shape: None)


@pytest.mark.slow
@pytest.mark.parametrize("hold", ["zoh", "foh"])
def test_model_exchange_is_the_same_right_hand_side(swing_unit, hold):
    unit, plant = _unit(swing_unit, hold=hold), _equations(hold=hold)
    known = describe(unit)
    assert (known.access, known.states, known.inputs, known.x0.tolist()) == (
        "rhs",
        ("angle", "rate"),
        ("push",),
        [0.5, 0],
    )
    np.testing.assert_array_equal(unit.simulate(U), plant.simulate(U))  # the start is the unit's own
    np.testing.assert_array_equal(unit.simulate(U, x0=[-1.0, 2.0]), plant.simulate(U, x0=[-1.0, 2.0]))
    for one, other in zip(unit.simulate_states(U), plant.simulate_states(U)):
        np.testing.assert_array_equal(one, other)
    t = np.cumsum(np.random.default_rng(1).uniform(0.01, 0.1, 60))
    np.testing.assert_array_equal(unit.simulate(U, t=t), plant.simulate(U, t=t))
    check_simulator(unit, U)


def test_outputs_that_are_no_states_are_read_from_the_unit(swing_unit):
    unit = FMUSimulator(swing_unit, params=PARAMS, dt=0.05)
    assert describe(unit).outputs == ("angle", "torque")
    plant = _equations(outputs=["angle", "torque"], output=torque)
    np.testing.assert_allclose(unit.simulate(U), plant.simulate(U), rtol=1e-14)
    check_simulator(unit, U)


def test_points_of_any_order_with_parameters_of_their_own(swing_unit, calls):
    unit, random = _unit(swing_unit), np.random.default_rng(2)
    n = 400
    x, u, t = random.normal(size=(2, n)), random.normal(size=(1, n)), random.uniform(size=n)
    x[:, 100:200], u[:, 100:200], t[100:200] = x[:, :100], u[:, :100], t[:100]  # equal points
    p = {"g": random.choice([8.0, 9.0, 10.0], n), "c": 0.4}
    np.testing.assert_array_equal(unit.rhs(t, x, u, p), np.array(swing(t, x, u, p)))
    shaped = unit.rhs(t.reshape(4, 100), x.reshape(2, 4, 100), u.reshape(1, 4, 100), {**p, "g": p["g"].reshape(4, 100)})
    np.testing.assert_array_equal(shaped.reshape(2, n), unit.rhs(t, x, u, p))
    np.testing.assert_allclose(linearise(unit, [0.0, 0.0], [0.0]).A, [[0.0, 1.0], [-9.0, -0.4]], atol=1e-9)


def test_states_stand_in_the_order_of_initial(swing_unit):
    unit = _unit(swing_unit, initial=["rate", "angle"])
    assert unit.states == ["rate", "angle"]
    x = np.random.default_rng(3).normal(size=(2, 50))
    expected = np.array(swing(0.0, x[::-1], np.ones((1, 50)), PARAMS))[::-1]
    np.testing.assert_array_equal(unit.rhs(0.0, x, np.ones((1, 50)), PARAMS), expected)
    np.testing.assert_array_equal(unit.simulate(U, x0=[0.0, 0.5]), _equations().simulate(U))


@pytest.mark.slow
def test_refused_points_are_nan_and_the_others_are_right(swing_unit, capfd, calls):
    unit = _unit(swing_unit)
    x = np.random.default_rng(4).normal(size=(2, 60))
    expected = np.array(swing(0.0, x, np.ones((1, 60)), PARAMS))
    x[1, [0, 30]], x[0, 31], x[0, 59] = 2e3, np.nan, 1e300  # too fast for the unit; never offered
    found = unit.rhs(0.0, x, np.ones((1, 60)), PARAMS)
    bad = [0, 30, 31, 59]
    assert np.isnan(found[:, bad]).all()
    np.testing.assert_array_equal(np.delete(found, bad, axis=1), np.delete(expected, bad, axis=1))
    with pytest.raises(SimulationDiverged, match=r"The unit said: too fast for this model"):
        unit.simulate(1e6 * np.ones((60, 1)))
    assert capfd.readouterr() == ("", "")
    np.testing.assert_array_equal(unit.simulate(U), _equations().simulate(U))


def test_co_simulation_with_a_copy_of_its_state_is_a_step(swing_unit, calls):
    unit, plant = _unit(swing_unit, fmi_type="CoSimulation"), _equations()
    assert describe(unit).access == "step" and not hasattr(unit, "rhs")
    np.testing.assert_allclose(unit.simulate(U), plant.simulate(U), atol=2e-7)
    np.testing.assert_allclose(unit.simulate(U, x0=[-1.0, 2.0]), plant.simulate(U, x0=[-1.0, 2.0]), atol=2e-7)
    random = np.random.default_rng(5)
    x, u, g = random.normal(size=(2, 8)), random.normal(size=(1, 8)), random.uniform(8, 10, 8)
    moved = unit.step(0.3, x, u, {"g": g, "c": 0.4}, 0.05)
    for k in range(8):
        alone = (
            clone(plant).set_params(params__g=g[k]).simulate_states(np.repeat(u[:, k : k + 1], 2, axis=0), x[:, k])[0]
        )
        np.testing.assert_allclose(moved[:, k], alone[1], atol=2e-7)
    check_simulator(unit, U)


def test_outputs_of_a_co_simulation_show_the_input_of_their_own_sample(swing_unit):
    def shown(t, x, u, p):
        return x[0], u[0] - p["g"] * np.sin(x[0]) - p["c"] * x[1]

    unit = _unit(swing_unit, outputs=["angle", "der(rate)"], fmi_type="CoSimulation")
    plant = _equations(outputs=["angle", "der(rate)"], output=shown)
    assert (
        describe(unit).access == "step"
    )  # the states determine the future, though a master reads outputs a sample late
    np.testing.assert_allclose(unit.simulate(U), plant.simulate(U), atol=2e-6)
    check_simulator(unit, U)


def test_parameters_of_a_unit_are_calibrated(swing_unit):
    y = _equations(params={"g": 9.0, "c": 0.7}).simulate(U, x0=[1.0, 0.0])
    for kind in ("ModelExchange", "CoSimulation"):
        found = CalibratedSimulator(_unit(swing_unit, fmi_type=kind), ["c"]).fit(U, y[:, 0])
        assert found.params_["c"] == pytest.approx(0.7, abs=1e-5)


@pytest.mark.slow
def test_a_diagnosis_of_a_unit_names_what_a_diagnosis_of_its_equations_names(swing_unit):
    plant, random = _equations(), np.random.default_rng(6)
    drag = AugmentedSimulator(plant, [CATALOGUE["quadratic_drag"]("rate", "rate")], [{"coefficient": 0.3}])
    runs = [np.repeat(4 * random.normal(size=(8, 1)), 8, axis=0) for _ in range(2)]
    y = np.concatenate([drag.simulate(run) for run in runs]) + 2e-3 * random.normal(size=(128, 1))
    X, groups = np.concatenate(runs), np.repeat([0, 1], 64)
    reports = []
    for simulator in (plant, _unit(swing_unit), _unit(swing_unit, fmi_type="CoSimulation")):
        asked = ["quadratic_drag", "input_gain"]
        reports.append(GapDiagnoser(simulator, effects=asked, random_state=0).fit(X, y, groups=groups).report_)
    names = [[(e.name, e.location, e.variable) for e in report.effects] for report in reports]
    assert names == 3 * [
        [("quadratic_drag", "rate", "rate")]
    ]  # not at the push, whatever the solver of the unit smears
    values = [report.effects[0].params["coefficient"] for report in reports]
    assert values[0] == values[1] == pytest.approx(0.3, abs=0.01)
    assert values[2] == pytest.approx(values[0], abs=2e-3)  # the terms stand beside the step, not within it (Strang)


# ---- events ----------------------------------------------------------------------------------------------------------
def _ball(e=0.8):
    return ODESimulator(
        lambda t, x, u, p: (x[1], u[0] - p["g"] + 0 * x[0]),
        states=["height", "speed"], inputs=["push"], outputs=["height", "speed"], params={"g": 9.81, "e": e}, dt=0.02,
        x0=[1.0, 0.0],
        events=[(lambda t, x, u, p: x[:1], lambda t, x, u, p: (0 * x[0], -p["e"] * x[1]))],
    )  # fmt: skip


def test_state_events_of_a_unit_equal_those_of_the_equations(ball_unit):
    unit = FMUSimulator(ball_unit, outputs=["height", "speed"], params={"g": 9.81, "e": 0.8}, dt=0.02)
    known, V = describe(unit), 0.3 * U
    assert known.access == "step" and known.x0.tolist() == [1.0, 0.0] and "events" in unit.explain_access()
    np.testing.assert_allclose(unit.simulate(V), _ball().simulate(V), atol=1e-9)
    x, u = np.array([[0.01, 0.2, 0.0], [-1.0, 0.5, -2.0]]), np.array([[0.0, 1.0, 0.0]])
    p = {"g": 9.81, "e": np.array([0.8, 0.8, 0.5])}
    np.testing.assert_allclose(unit.step(0.0, x, u, p, 0.02), _ball().step(0.0, x, u, p, 0.02), atol=1e-10)
    check_simulator(unit, V)


def test_a_time_event_of_a_unit_equals_the_closed_form(ball_unit):
    unit = FMUSimulator(ball_unit, outputs=["height"], params={"load": 3.0}, dt=0.02)
    t = 0.02 * np.arange(20)
    late = np.maximum(t - 0.35, 0.0)  # the load begins between two samples
    expected = 1.0 - 9.81 / 2 * t**2 - 3.0 / 2 * late**2
    np.testing.assert_allclose(unit.simulate(np.zeros((20, 1)))[:, 0], expected, atol=1e-12)
    x = np.array([1.0 - 9.81 / 2 * 0.34**2, -9.81 * 0.34])
    moved = unit.step(0.34, x[:, None], np.zeros((1, 1)), {"load": 3.0}, 0.02)[0, 0]
    assert moved == pytest.approx(expected[18], abs=1e-12)


def test_a_unit_that_remembers_more_than_its_states_gives_trajectories_alone(ball_unit):
    unit = FMUSimulator(ball_unit, outputs=["height"], params={"wear": 0.3}, dt=0.02)
    assert describe(unit).access == "trajectory" and unit.states is None
    assert "do not determine its future: 'height' at t=" in unit.explain_access()
    with pytest.raises(SimulatorError, match=r"access='step'.*restarts at every sample"):
        describe(clone(unit).set_params(access="step"))
    assert describe(clone(unit).set_params(params={"wear": 0.0})).access == "step"


def test_an_access_that_is_not_there_is_refused_with_its_reason(swing_unit, ball_unit):
    with pytest.raises(SimulatorError, match=r"access='rhs'.*it has events"):
        describe(FMUSimulator(ball_unit, access="rhs"))
    with pytest.raises(SimulatorError, match=r"access='rhs'.*needs model exchange"):
        describe(_unit(swing_unit, access="rhs", fmi_type="CoSimulation"))
    with pytest.raises(SimulatorError, match=r'access=.equations.: expected "rhs"'):
        describe(_unit(swing_unit, access="equations"))
    with pytest.raises(SimulatorError, match="hold='foh': inputs of a unit without right-hand side"):
        _unit(swing_unit, hold="foh", access="trajectory").simulate(U)
    started = _unit(swing_unit, initial=["angle"])
    assert "initial=['angle'] are not its continuous states" in started.explain_access()
    np.testing.assert_allclose(started.simulate(U, x0=[0.5]), _equations().simulate(U), atol=1e-5)
    with pytest.raises(SimulatorError, match=r"U=\[nan\] in row 3"):
        started.simulate(np.where(np.arange(60)[:, None] == 3, np.nan, U), x0=[0.5])


def test_a_unit_goes_to_python_control_and_says_why_it_is_not_written_down(swing_unit):
    control = pytest.importorskip("control")
    system = _unit(swing_unit).to_control()
    assert isinstance(system, control.NonlinearIOSystem)
    np.testing.assert_allclose(
        system.dynamics(0.0, [0.3, 1.0], [0.5]), swing(0.0, [0.3, 1.0], [0.5], PARAMS), rtol=1e-14
    )
    np.testing.assert_allclose(system.output(0.0, [0.3, 1.0], [0.5]), [0.3])
    with pytest.raises(SurrogateError, match="can be called but not written as a graph"):
        to_graph(_unit(swing_unit, inputs=["push"]))
    with pytest.raises(SurrogateError, match=r"does not name its signals: give it inputs=\[...\]"):
        to_graph(_unit(swing_unit))


def test_a_unit_travels_without_its_instance(swing_unit):
    unit = _unit(swing_unit)
    expected = unit.simulate(U)
    for other in (clone(unit), pickle.loads(pickle.dumps(unit))):
        assert not {"_handle", "_engine_kept", "_looked"} & set(vars(other))
        np.testing.assert_array_equal(other.simulate(U), expected)
        other.close()
    unit.close()
    np.testing.assert_array_equal(unit.simulate(U), expected)


# ---- FMI 3, without a compiler ----------------------------------------------------------------------------------------
HOPPING = """
from pythonfmu3 import Fmi3Causality, Fmi3Initial, Fmi3SlaveBase, Fmi3UpdateDiscreteStatesResult, Fmi3Variability, Float64, ModelExchange


class Hopping(Fmi3SlaveBase, ModelExchange):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.time, self.u, self.h, self.v, self.der_h, self.der_v, self.z = 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0
        free, held = Fmi3Variability.continuous, Fmi3Initial.exact
        self.register_variable(Float64("time", causality=Fmi3Causality.independent, variability=free))
        self.register_variable(Float64("u", causality=Fmi3Causality.input, start=0.0, variability=free))
        self.register_variable(Float64("h", causality=Fmi3Causality.output, start=1.0, variability=free, initial=held))
        self.register_variable(Float64("v", causality=Fmi3Causality.output, start=0.0, variability=free, initial=held))
        for name, of in (("der_h", "h"), ("der_v", "v")):
            place = next(one.value_reference for one in self.vars.values() if one.name == of)
            self.register_variable(Float64(name, causality=Fmi3Causality.local, variability=free, derivative=place))
        self.register_variable(Float64("z", causality=Fmi3Causality.local, variability=free))
        self.event_indicators.append(next(one.value_reference for one in self.vars.values() if one.name == "z"))

    def get_continuous_state_derivatives(self):
        self.der_h, self.der_v = self.v, self.u - 9.81
        return [self.der_h, self.der_v]

    def get_event_indicators(self):
        self.z = self.h
        return [self.z]

    def update_discrete_states(self):
        found = Fmi3UpdateDiscreteStatesResult()
        if self.h <= 0 and self.v < 0:
            self.v = -0.8 * self.v
            found.valuesOfContinuousStatesChanged = True
        return found
"""


def test_events_of_a_unit_of_fmi_3(tmp_path):
    builder = pytest.importorskip("pythonfmu3.builder")
    pytest.importorskip("fmpy")
    (tmp_path / "hopping.py").write_text(HOPPING)
    builder.FmuBuilder.build_FMU(tmp_path / "hopping.py", dest=tmp_path)
    unit = FMUSimulator(tmp_path / "Hopping.fmu", outputs=["h", "v"], dt=0.02)
    assert describe(unit).access == "step"
    np.testing.assert_allclose(
        unit.simulate(U[:12], x0=[0.1, -1.0]), _ball().simulate(U[:12], x0=[0.1, -1.0]), atol=1e-9
    )


def test_names_that_the_arguments_leave_to_the_unit_reach_a_simulator_with_effects(swing_unit):
    loss = [CATALOGUE["linear_loss"]("rate", "rate")], [{"coefficient": 0.3}]
    unit = AugmentedSimulator(FMUSimulator(swing_unit, params=PARAMS, dt=0.05), *loss)
    assert (list(unit.inputs), list(unit.outputs), list(unit.x0)) == (["push"], ["angle", "torque"], [0.5, 0.0])
    plant = AugmentedSimulator(_equations(outputs=["angle", "torque"], output=torque), *loss)
    np.testing.assert_allclose(unit.simulate(U), plant.simulate(U), rtol=1e-12)
    x, u = np.array([[0.2], [1.0]]), np.ones((1, 1))
    np.testing.assert_allclose(unit.rhs(0.0, x, u, PARAMS), plant.rhs(0.0, x, u, PARAMS), rtol=1e-14)
