"""A unit built here of the paper's Eq. (9), against this package's own integrator."""

import pickle
import zipfile

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from sklearn.base import clone

from sksurrogate.datasets import make_reactor
from sksurrogate.exceptions import SimulatorError
from sksurrogate.physics import FMUSimulator

SOURCE = """
from math import exp
from pythonfmu import Fmi2Causality, Fmi2Initial, Fmi2Slave, Fmi2Variability, Real


class Reactor(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.u = 0.15
        self.y = 4.0
        self.feed = 4.0
        self.register_variable(Real("u", causality=Fmi2Causality.input))
        self.register_variable(Real("y", causality=Fmi2Causality.output, initial=Fmi2Initial.exact))
        self.z = 0.0
        self.register_variable(Real("z", causality=Fmi2Causality.output))
        self.register_variable(Real("feed", causality=Fmi2Causality.parameter, variability=Fmi2Variability.tunable))

    def do_step(self, current_time, step_size):
        def f(y):
            return 2 * (self.feed - y) - 100 * exp(-1 / self.u) * y * y + 1000 * exp(-1 / self.u) * y
        n = 20
        h = step_size / n
        for _ in range(n):
            a = f(self.y)
            b = f(self.y + h / 2 * a)
            c = f(self.y + h / 2 * b)
            d = f(self.y + h * c)
            self.y += h / 6 * (a + 2 * b + 2 * c + d)
        return True
"""


@pytest.fixture(scope="module")
def unit(tmp_path_factory):
    builder = pytest.importorskip("pythonfmu.builder")
    pytest.importorskip("fmpy")
    folder = tmp_path_factory.mktemp("unit")
    script = folder / "reactor.py"
    script.write_text(SOURCE)
    builder.FmuBuilder.build_FMU(script, dest=folder)
    return folder / "Reactor.fmu"


def _inputs(n=60):
    return np.random.default_rng(0).uniform(0.1, 0.2, size=(n, 1))


def test_the_unit_equals_the_right_hand_side(unit):
    plant = make_reactor()
    U = _inputs()
    expected = plant.simulate(U, x0=[8.0])
    fmu = FMUSimulator(unit, outputs=["y"], initial=["y"], dt=plant.dt)
    np.testing.assert_allclose(fmu.simulate(U, x0=[8.0]), expected, atol=1e-6)
    for other in (fmu, clone(fmu), pickle.loads(pickle.dumps(fmu))):
        np.testing.assert_array_equal(other.simulate(U, x0=[8.0]), fmu.simulate(U, x0=[8.0]))
        other.close()


def test_parameters_are_set(unit):
    a = FMUSimulator(unit, params={"feed": 3.0}, outputs=["y"], dt=0.01)
    b = clone(a).set_params(params__feed=5.0)
    assert b.simulate(_inputs())[-1, 0] > a.simulate(_inputs())[-1, 0]


def test_mistakes_speak(unit, tmp_path):
    with pytest.raises(SimulatorError, match="no variable 'nope'"):
        FMUSimulator(unit, outputs=["nope"]).simulate(_inputs())
    with pytest.raises(SimulatorError, match=r"initial=\[\.\.\.\]"):
        FMUSimulator(unit).simulate(_inputs(), x0=[1.0])
    with pytest.raises(SimulatorError, match="'z' cannot be set"):
        FMUSimulator(unit, initial=["z"]).simulate(_inputs(), x0=[1.0])
    with pytest.raises(SimulatorError, match="not a file"):
        FMUSimulator(tmp_path / "none.fmu").simulate(_inputs())
    (tmp_path / "text.fmu").write_text("no archive")
    with pytest.raises(SimulatorError, match="zip archive"):
        FMUSimulator(tmp_path / "text.fmu").simulate(_inputs())
    with zipfile.ZipFile(tmp_path / "bad.fmu", "w") as archive:
        archive.writestr("../outside.txt", "x")
    with pytest.raises(SimulatorError, match="leaves its folder"):
        FMUSimulator(tmp_path / "bad.fmu").simulate(_inputs())


EXCHANGE = """
from math import exp

from pythonfmu3 import Fmi3Causality, Fmi3Initial, Fmi3SlaveBase, Fmi3Variability, Float64, ModelExchange


class Reactor3(Fmi3SlaveBase, ModelExchange):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.time = 0.0
        self.u = 0.15
        self.y = 4.0
        self.der_y = 0.0
        self.feed = 4.0
        self.register_variable(Float64("time", causality=Fmi3Causality.independent, variability=Fmi3Variability.continuous))
        self.register_variable(Float64("u", causality=Fmi3Causality.input, start=0.15, variability=Fmi3Variability.continuous))
        self.register_variable(Float64("y", causality=Fmi3Causality.output, start=4.0, variability=Fmi3Variability.continuous, initial=Fmi3Initial.exact))
        self.register_variable(Float64("der_y", causality=Fmi3Causality.local, variability=Fmi3Variability.continuous, derivative=self.vr_of("y")))
        self.register_variable(Float64("feed", causality=Fmi3Causality.parameter, start=4.0, variability=Fmi3Variability.tunable))

    def vr_of(self, name):
        return next(v.value_reference for v in self.vars.values() if v.name == name)

    def get_continuous_state_derivatives(self):
        rate = exp(-1.0 / self.u)
        self.der_y = 2 * (self.feed - self.y) - 100 * rate * self.y**2 + 1000 * rate * self.y
        return [self.der_y]
"""


def _exchange(folder, name="Reactor3", **options):
    builder = pytest.importorskip("pythonfmu3.builder")
    pytest.importorskip("fmpy")
    script = folder / f"{name.lower()}_exchange.py"  # units of one process share Python's modules
    script.write_text(EXCHANGE.replace("Reactor3", name))
    builder.FmuBuilder.build_FMU(script, dest=folder, **options)
    return folder / f"{name}.fmu"


@pytest.fixture(scope="module")
def exchange_unit(tmp_path_factory):
    return _exchange(tmp_path_factory.mktemp("exchange"))


def test_a_unit_for_model_exchange_of_fmi_3_equals_the_right_hand_side(exchange_unit):
    plant = make_reactor()
    U = np.repeat(_inputs(20), 3, axis=0)
    fmu = FMUSimulator(exchange_unit, inputs=["u"], outputs=["y"], initial=["y"], dt=plant.dt)
    found = fmu.simulate(U, x0=[8.0])
    np.testing.assert_allclose(found, plant.simulate(U, x0=[8.0]), rtol=1e-13)  # the same equations, integrated here
    # the instance is used again, reset, and leaves no trace of other parameters
    clone(fmu).set_params(params={"feed": 2.0}).simulate(U, x0=[8.0])
    np.testing.assert_array_equal(fmu.simulate(U, x0=[8.0]), found)
    with pytest.raises(SimulatorError, match=r"offers \['ModelExchange'\]"):
        clone(fmu).set_params(fmi_type="CoSimulation").simulate(U)


CARRY = """
from pythonfmu import Fmi2Causality, Fmi2Initial, Fmi2Slave, Fmi2Variability, Real


class {name}(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.u, self.v, self.y, self.gain = 0.0, 0.0, 1.0, 1.0
        self.hidden = 0.0
        self.register_variable(Real("u", causality=Fmi2Causality.input))
        self.register_variable(Real("v", causality=Fmi2Causality.input))
        self.register_variable(Real("y", causality=Fmi2Causality.output, initial=Fmi2Initial.exact))
        self.register_variable(Real("gain", causality=Fmi2Causality.parameter, variability=Fmi2Variability.tunable))
        if {registered}:
            self.register_variable(Real("hidden", causality=Fmi2Causality.local))

    def do_step(self, current_time, step_size):
        self.hidden += step_size * self.y
        self.y += step_size * (self.gain * self.u - self.v * self.y - self.hidden)
        return True
"""


def _carry(folder, name, registered, offered):
    """A unit with a state that may be missing from the copy of its state."""
    builder = pytest.importorskip("pythonfmu.builder")
    pytest.importorskip("fmpy")
    script = folder / f"{name.lower()}.py"
    script.write_text(CARRY.format(name=name, registered=registered))
    options = {"canGetAndSetFMUstate": True} if offered else {}
    builder.FmuBuilder.build_FMU(script, dest=folder, **options)
    return folder / f"{name}.fmu"


@pytest.mark.parametrize(
    ("name", "registered", "offered", "way"),
    [("Whole", True, True, "state"), ("Partial", False, True, "reset"), ("Without", True, False, "reset")],
)
def test_the_way_back_to_the_start_is_the_first_that_equals_a_new_instance(tmp_path, name, registered, offered, way):
    path = _carry(tmp_path, name, registered, offered)
    U = np.random.default_rng(1).uniform(0, 1, size=(30, 2))
    fmu = FMUSimulator(path, initial=["y"], dt=0.1)

    def fresh(x0, **params):
        other = clone(fmu).set_params(params=params or None)
        found = other.simulate(U, x0=x0)
        other.close()
        return found

    hidden, y, expected = 0.0, 2.0, []
    for u, v in U:  # the unit's own recursion
        expected.append(y)
        hidden += 0.1 * y
        y += 0.1 * (u - v * y - hidden)
    np.testing.assert_allclose(fmu.simulate(U, x0=[2.0])[:, 0], expected, rtol=0, atol=1e-12)
    for x0, gain in [(1.0, 3.0), (2.0, 1.0), (0.5, 1.0), (2.0, 1.0)]:
        found = fmu.set_params(params={"gain": gain}).simulate(U, x0=[x0])
        np.testing.assert_array_equal(found, fresh([x0], gain=gain))
    np.testing.assert_array_equal(fmu.set_params(params=None).simulate(U, x0=[2.0]), fresh([2.0]))
    assert fmu.restart == way
    instance = fmu._opened().instance
    calls = []
    set_state, reset = instance.setFMUState, instance.reset
    instance.setFMUState = lambda state: (calls.append("state"), set_state(state))
    instance.reset = lambda: (calls.append("reset"), reset())
    fmu.simulate(U)
    assert calls == [way]
    fmu.close()


def test_a_unit_that_forgets_nothing_by_neither_way_is_opened_anew(tmp_path, monkeypatch):
    path = _carry(tmp_path, "Stubborn", True, True)
    U = np.ones((10, 2))
    fmu = FMUSimulator(path, dt=0.1)
    first = fmu.simulate(U)
    kind = type(fmu._opened().instance)
    monkeypatch.setattr(kind, "setFMUState", lambda self, state: None)
    monkeypatch.setattr(kind, "reset", lambda self: None)
    for _ in range(4):
        np.testing.assert_array_equal(fmu.simulate(U), first)
    assert fmu.restart == "new"
    fmu.close()


def test_the_state_of_a_unit_of_fmi_3_is_copied(tmp_path):
    fmu = FMUSimulator(
        _exchange(tmp_path, "Copied3", canGetAndSetFMUState=True),
        inputs=["u"],
        outputs=["y"],
        initial=["y"],
        dt=0.01,
        access="trajectory",
    )
    U = _inputs(20)
    first = fmu.simulate(U, x0=[8.0])
    clone(fmu).set_params(params={"feed": 2.0}).simulate(U, x0=[3.0])
    for _ in range(3):
        fmu.set_params(params={"feed": 2.0}).simulate(U, x0=[3.0])
        np.testing.assert_array_equal(fmu.set_params(params=None).simulate(U, x0=[8.0]), first)
    assert fmu.restart == "state"


def _by_scipy(t, u, y0, feed=4.0):
    """Eq. (9) with held inputs, one call of an adaptive solver from sample to sample."""
    y = [y0]
    for a, b, v in zip(t[:-1], t[1:], u[:, 0]):
        rate = np.exp(-1.0 / v)
        y.append(
            solve_ivp(
                lambda _, y, r=rate: 2 * (feed - y) - 100 * r * y**2 + 1000 * r * y,
                (a, b),
                [y[-1]],
                rtol=1e-11,
                atol=1e-11,
            ).y[0, -1]
        )
    return np.array(y)


UNEVEN = {
    "every one another": np.cumsum(np.random.default_rng(1).uniform(0.002, 0.03, size=40)),
    "a few stretches": np.r_[np.arange(15) * 0.01, 0.14 + np.arange(1, 10) * 0.025, 0.365 + np.arange(1, 17) * 0.005],
}


@pytest.mark.parametrize("times", UNEVEN)
def test_uneven_times_of_a_co_simulation_equal_scipy(unit, times):
    t, U = UNEVEN[times], _inputs(40)
    fmu = FMUSimulator(unit, outputs=["y"], initial=["y"], dt=0.01)
    expected = _by_scipy(t, U, 8.0)
    for _ in range(3):  # anew, and by the way back to the start
        np.testing.assert_allclose(fmu.simulate(U, x0=[8.0], t=t)[:, 0], expected, atol=1e-7)
    even = fmu.simulate(U, x0=[8.0])
    np.testing.assert_array_equal(fmu.simulate(U, x0=[8.0], t=0.01 * np.arange(40)), even)


@pytest.mark.parametrize("times", UNEVEN)
def test_uneven_times_of_a_model_exchange_equal_scipy(exchange_unit, times):
    t, U = UNEVEN[times], _inputs(40)
    fmu = FMUSimulator(exchange_unit, inputs=["u"], outputs=["y"], initial=["y"], dt=0.01, access="trajectory")
    np.testing.assert_allclose(fmu.simulate(U, x0=[8.0], t=t)[:, 0], _by_scipy(t, U, 8.0), atol=1e-5)
    constant = np.full((40, 1), 0.15)  # no input of the unit: its own start value holds
    alone = clone(fmu).set_params(inputs=[])
    np.testing.assert_allclose(
        alone.simulate(np.empty((40, 0)), x0=[8.0], t=t)[:, 0], _by_scipy(t, constant, 8.0), atol=1e-5
    )


def test_a_unit_of_one_step_width_says_so_at_uneven_times(tmp_path):
    builder = pytest.importorskip("pythonfmu.builder")
    pytest.importorskip("fmpy")
    script = tmp_path / "rigid.py"
    script.write_text(SOURCE.replace("Reactor", "Rigid"))
    builder.FmuBuilder.build_FMU(script, dest=tmp_path, canHandleVariableCommunicationStepSize=False)
    path = tmp_path / "Rigid.fmu"
    fmu = FMUSimulator(path, outputs=["y"], dt=0.01)
    assert fmu.simulate(_inputs(5), t=np.arange(5) * 0.02).shape == (5, 1)
    with pytest.raises(SimulatorError, match=r"steps from 0.01 to 0.02.*one width only"):
        fmu.simulate(_inputs(4), t=[0.0, 0.01, 0.02, 0.04])
    with pytest.raises(SimulatorError, match=r"t has shape \(3,\), expected \(4,\)"):
        fmu.simulate(_inputs(4), t=[0.0, 0.01, 0.02])
    with pytest.raises(SimulatorError, match="later than the one before"):
        fmu.simulate(_inputs(3), t=[0.0, 0.02, 0.01])
