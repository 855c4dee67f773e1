"""What is kept on disk belongs to one simulator, one estimator: by their value, not by their name."""

import functools
import importlib.metadata
import io
import multiprocessing
import os
import shutil
import subprocess
import sys
import sysconfig
import threading
import types

import numpy as np
import pytest
import threadpoolctl
from sklearn.linear_model import LinearRegression
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import FunctionTransformer

from sksurrogate._fingerprint import fingerprint
from sksurrogate.datasets import make_reactor, simulate_experiments
from sksurrogate.effects import CATALOGUE, AugmentedSimulator
from sksurrogate.exceptions import DataError
from sksurrogate.model_selection import Remembered
from sksurrogate.physics import CallableSimulator, FMUSimulator, ODESimulator

GAIN = 1.0


def closure(gain):
    return lambda U, x0=None, t=None: gain * np.asarray(U)


def default(gain):
    def simulate(U, x0=None, t=None, gain=gain):
        return gain * np.asarray(U)

    return simulate


def bound(gain):
    class Plant:
        def run(self, U, x0=None, t=None):
            return self.gain * np.asarray(U)

    plant = Plant()
    plant.gain = gain
    return plant.run


def of_a_class(gain):
    class Plant:
        factor = gain

        def __call__(self, U, x0=None, t=None):
            return self.factor * np.asarray(U)

    return Plant()


def nested(gain):
    def inner(U):
        return (lambda: gain * np.asarray(U))()

    def simulate(U, x0=None, t=None):
        return inner(U)

    return simulate


def cached(gain):
    @functools.lru_cache
    def factor():
        return gain

    return lambda U, x0=None, t=None: factor() * np.asarray(U)


def partial(gain):
    def simulate(U, x0=None, t=None, *, gain):
        return gain * np.asarray(U)

    return functools.partial(simulate, gain=gain)


def of_a_module(gain):
    helper = types.ModuleType("own_helper")
    exec(f"def scaled(U):\n    return {gain} * U", vars(helper))
    return lambda U, x0=None, t=None: helper.scaled(np.asarray(U))


def property_of_a_base(gain):
    class Base:
        @property
        def factor(self):
            return gain

    class Plant(Base):
        def __call__(self, U, x0=None, t=None):
            return self.factor * np.asarray(U)

    return Plant()


class Scaled:
    """A wrapper of one's own, with a number of its own."""

    def __init__(self, function, gain):
        functools.update_wrapper(self, function)
        self.function, self.gain = function, gain

    def __call__(self, U, x0=None, t=None):
        return self.gain * self.function(U)


def wrapped(gain):
    return Scaled(lambda U: np.asarray(U), gain)


class Quantity(np.ndarray):
    """An array with a unit."""

    def __reduce__(self):
        rebuilt = super().__reduce__()
        return (*rebuilt[:2], (rebuilt[2], vars(self)))


def with_a_unit(gain):
    factor = np.ones(1).view(Quantity)
    factor.unit = gain
    return lambda U, x0=None, t=None: factor.unit * np.asarray(U)


def with_a_mask(gain):
    factor = np.ma.array([[1.0, 2.0]], mask=[[gain != 1.0, gain != 2.0]])
    return lambda U, x0=None, t=None: float(factor.sum()) * np.asarray(U)


def module_of_an_object(gain):
    plant = of_a_class(1.0)
    plant.tables = types.ModuleType("own_tables")
    plant.tables.gain = gain
    plant.simulate = lambda U: plant.tables.gain * np.asarray(U)
    return lambda U, x0=None, t=None: plant.simulate(U)


FORMS = [closure, default, bound, of_a_class, nested, cached, partial, of_a_module, property_of_a_base]
FORMS += [wrapped, with_a_unit, with_a_mask, module_of_an_object]


def kept(simulate, folder):
    plant = CallableSimulator(simulate, inputs=["u"], outputs=["y"], dt=1.0)
    return simulate_experiments(plant, None, {"u": (0, 1)}, n_runs=2, n_samples=5, cache=folder, random_state=0)


@pytest.mark.parametrize("form", FORMS)
def test_another_simulator_of_the_same_name_is_simulated(form, tmp_path):
    one, two = kept(form(1.0), tmp_path), kept(form(2.0), tmp_path)
    np.testing.assert_allclose(two.y, 2 * one.y, rtol=1e-12)
    assert len(list(tmp_path.iterdir())) == 2
    kept(form(2.0), tmp_path)
    assert len(list(tmp_path.iterdir())) == 2


def test_a_global_belongs_to_the_function_that_reads_it(tmp_path, monkeypatch):
    def simulate(U, x0=None, t=None):
        return GAIN * np.asarray(U)

    one = kept(simulate, tmp_path)
    monkeypatch.setitem(globals(), "GAIN", 3.0)
    np.testing.assert_allclose(kept(simulate, tmp_path).y, 3 * one.y, rtol=1e-12)


def test_what_a_simulator_has_learned_belongs_to_it(tmp_path):
    X = np.arange(6.0)[:, None]
    one, two = (kept(LinearRegression().fit(X, k * X[:, 0]).predict, tmp_path) for k in (1.0, 2.0))
    np.testing.assert_allclose(two.y, 2 * one.y, rtol=1e-9)


def test_shapes_of_the_design_belong_to_it(tmp_path):
    def simulate(U, x0=None, t=None):
        return np.full((len(U), 1), float(len(U)))

    plant = CallableSimulator(simulate, inputs=["u"], outputs=["y"], dt=1.0)
    for runs, rows in ((2, 6), (3, 4)):
        data = simulate_experiments(
            plant, design=np.zeros((runs, rows, 1)), n_runs=runs, n_samples=rows, cache=tmp_path, batch_size=runs
        )
        assert set(data.y) == {rows}


def test_a_simulator_without_a_value_is_refused(tmp_path):
    lock = threading.Lock()

    def simulate(U, x0=None, t=None):
        with lock:
            return np.asarray(U)

    with pytest.raises(
        DataError, match=r"with cache=, simulator cannot be distinguished .*lock.*give its class a __getstate__"
    ):
        kept(simulate, tmp_path)
    with pytest.raises(DataError, match="with memory=, estimator cannot be distinguished"):
        model = make_pipeline(FunctionTransformer(simulate), LinearRegression())
        Remembered(model, tmp_path).fit(np.eye(3), np.arange(3.0))


class Port(io.RawIOBase):
    """As a serial port: a pickle takes its number without a word."""


def test_what_is_open_has_no_value():
    one, other = multiprocessing.Pipe()
    with one, other, Port() as port:
        for handle in (port, one, lambda U: port.write(U)):
            with pytest.raises(DataError, match=r"plant cannot be distinguished .* is an open file or connection"):
                fingerprint(handle, "plant")
    assert fingerprint(io.BytesIO(b"1"), "memory") != fingerprint(io.BytesIO(b"2"), "memory")


COMPILED = """
#include <Python.h>
static PyObject *gain(PyObject *self, PyObject *none) { return PyFloat_FromDouble(GAIN); }
static PyMethodDef methods[] = {{"gain", gain, METH_NOARGS, ""}, {0}};
static struct PyModuleDef module = {PyModuleDef_HEAD_INIT, "own_compiled", "", -1, methods};
PyMODINIT_FUNC PyInit_own_compiled(void) { return PyModule_Create(&module); }
"""


@pytest.mark.skipif(shutil.which("cc") is None, reason="no compiler")
def test_code_of_ones_own_that_is_compiled_counts_by_its_file(tmp_path):
    (tmp_path / "own.c").write_text(COMPILED)
    line = "import own_compiled as o; from sksurrogate._fingerprint import fingerprint as f; print(f(lambda: o.gain(), 'x'))"
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), *sys.path])}
    include = f"-I{sysconfig.get_paths()['include']}"
    found = []
    for gain in (1.0, 2.0, 2.0):
        make = ["cc", "-shared", "-fPIC", f"-DGAIN={gain}", include, "own.c", "-o", "own_compiled.so"]
        if subprocess.run(make, cwd=tmp_path, capture_output=True).returncode:
            pytest.skip("no headers of Python")
        told = subprocess.run([sys.executable, "-c", line], env=environment, capture_output=True, text=True, check=True)
        found.append(told.stdout)
    assert found[0] != found[1] == found[2]


def test_a_package_that_does_not_say_its_version_has_the_one_it_was_installed_with(monkeypatch):
    monkeypatch.delattr(threadpoolctl, "__version__")
    found = set()
    for version in ("1.0", "2.0"):
        monkeypatch.setattr(importlib.metadata, "version", lambda name, version=version: version)
        found.add(fingerprint(threadpoolctl.threadpool_info, "function"))
    assert len(found) == 2


def test_what_an_except_covers_belongs_to_a_function():
    def simulate(U):
        try:
            return 1.0 / U
        except ZeroDivisionError:
            return 0.0

    bare = types.FunctionType(simulate.__code__.replace(co_exceptiontable=b""), globals())
    assert fingerprint(bare, "plant") != fingerprint(simulate, "plant")


def test_another_unit_at_the_same_path_is_another_simulator(tmp_path):
    (tmp_path / "unit.fmu").write_bytes(b"one")
    unit = FMUSimulator(tmp_path / "unit.fmu", inputs=["u"], outputs=["y"])
    before = fingerprint(unit, "unit")
    assert before == fingerprint(FMUSimulator(tmp_path / "unit.fmu", inputs=["u"], outputs=["y"]), "unit")
    (tmp_path / "unit.fmu").write_bytes(b"two")
    assert fingerprint(unit, "unit") != before


def test_a_simulator_that_has_run_is_still_the_same():
    def drop(t, x, u, p):
        return x[1], u[0] - 9.81 + 0 * x[0]

    bounce = [(lambda t, x, u, p: x[0], lambda t, x, u, p: (0 * x[0], -0.5 * x[1]))]
    lagged = AugmentedSimulator(make_reactor(), [CATALOGUE["input_lag"]("u")], [{"time_constant": 0.05}])
    ball = ODESimulator(
        drop, states=["h", "v"], inputs=["f"], outputs=["h"], params={}, dt=0.1, x0=[1.0, 0.0], events=bounce
    )
    for plant in (make_reactor(), lagged, ball):
        before = fingerprint(plant, "plant")
        plant.simulate(np.full((9, 1), 0.1))
        assert fingerprint(plant, "plant") == before, plant


PLANT = """
import numpy as np
from sklearn.linear_model import LinearRegression
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import FunctionTransformer
from sksurrogate.model_selection import Remembered

NAMES = {"one", "two", "three", "four"}

def scaled(X):
    import shapes
    return shapes.of(X) if "one" in NAMES else X

model = make_pipeline(FunctionTransformer(scaled), LinearRegression(fit_intercept=False))
X = np.arange(1.0, 9.0)[:, None]
print(Remembered(model, "fits").fit(X, X[:, 0]).estimator_[-1].coef_[0])
"""


def test_what_the_estimator_has_learned_is_seen_through_and_nothing_else(tmp_path):
    model = Remembered(LinearRegression(), tmp_path)
    with pytest.raises(AttributeError, match="'Remembered' has no attribute 'coef_'"):
        model.coef_  # noqa: B018
    model.fit(np.eye(3), np.arange(3.0))
    np.testing.assert_array_equal(model.coef_, model.estimator_.coef_)
    assert model.intercept_ == model.estimator_.intercept_
    for name in ("fit_intercept", "__len__", "coef"):
        with pytest.raises(AttributeError, match=f"'Remembered' has no attribute '{name}'"):
            getattr(model, name)


@pytest.mark.slow
def test_an_edited_file_is_fitted_anew_and_the_same_one_is_read(tmp_path):
    (tmp_path / "plant.py").write_text(PLANT)
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), "PYTHONDONTWRITEBYTECODE": "1"}
    found, folders = [], []
    for factor in (2.0, 2.0, 4.0):
        (tmp_path / "shapes.py").write_text(f"def of(X):\n    return {factor} * X\n")
        line = [sys.executable, "-c", "import plant"]
        out = subprocess.run(line, cwd=tmp_path, env=environment, capture_output=True, text=True, check=True)
        found.append(float(out.stdout))
        folders.append(len(list((tmp_path / "fits").rglob("output.pkl"))))
    np.testing.assert_allclose(found, [0.5, 0.5, 0.25])
    assert folders == [1, 1, 2]
