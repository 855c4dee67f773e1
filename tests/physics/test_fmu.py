"""A unit built here of the paper's Eq. (9), against this package's own integrator."""

import pickle
import zipfile

import numpy as np
import pytest
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
