"""Every public estimator: pickled, cloned, in worker processes, on memory maps, odd arrays and odd units.

Estimators are found through the faces; one whose constructor needs arguments is built in ``BUILD``.
"""

import inspect
import pickle
import warnings
from importlib import import_module

import joblib
import numpy as np
import pytest
from sklearn.base import BaseEstimator, clone
from sklearn.linear_model import Ridge
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from sksurrogate.compose import HybridRegressor, RecursivePredictor
from sksurrogate.datasets import make_reactor, make_reactor_runs
from sksurrogate.gap import GapDiagnoser
from sksurrogate.physics import CalibratedSimulator, ODESimulator

FACES = ("features", "linear", "neural", "compose", "physics", "model_selection", "gap")
X, y, groups = make_reactor_runs(4, 60, y0_range=(4.0, 6.0), u_range=(0.1, 0.16), noise=0.01, random_state=0)

BUILD = {
    "RecursivePredictor": lambda c: c(Ridge(1e-3), 2, 2),
    "DerivativeRegressor": lambda c: c(Ridge(1e-3)),
    "HybridRegressor": lambda c: c(make_reactor(second=90.0), Ridge(1e-3)),
    "CalibratedSimulator": lambda c: c(make_reactor(), params=["feed"]),
    "GapDiagnoser": lambda c: c(make_reactor(feed=4.4), effects=["sensor_bias", "parameter_error"], random_state=0),
    "FNNRegressor": lambda c: c((3,), random_state=0, max_epochs=10),
    "Remembered": lambda c: c(RecursivePredictor(Ridge(1e-3), 2, 2)),
    "ConformalFreeRun": lambda c: c(RecursivePredictor(Ridge(1e-3), 2, 2), coverage=0.5),
    "NonlinearBasisRegressor": lambda c: c(n_basis=3, random_state=0),
}


def found():
    """Estimators that have ``fit``, by name."""
    classes = {}
    for face in FACES:
        module = import_module(f"sksurrogate.{face}")
        for name in module.__all__:
            value = getattr(module, name)
            if inspect.isclass(value) and issubclass(value, BaseEstimator) and hasattr(value, "fit"):
                classes[name] = value
    return classes


CLASSES = found()
ALL = pytest.mark.parametrize("name", sorted(CLASSES))
LEARNERS = pytest.mark.parametrize("name", sorted(set(CLASSES) - {"GapDiagnoser"}))


def build(name):
    """An unfitted estimator; one that draws numbers draws the same ones every time."""
    estimator = BUILD[name](CLASSES[name]) if name in BUILD else CLASSES[name]()
    params = estimator.get_params(deep=False)
    if "random_state" in params:
        estimator.set_params(random_state=0)
    if "max_epochs" in params:
        estimator.set_params(max_epochs=min(params["max_epochs"] or 20, 20))
    return estimator


def fitted(estimator, X=X, y=y, groups=groups):
    """Fitted, with runs where it knows of runs."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # twenty epochs are not enough to converge, and need not be
        if "groups" in inspect.signature(estimator.fit).parameters:
            return estimator.fit(X, y, groups=groups)
        return estimator.fit(X, y)


def answer(estimator, X=X, groups=groups):
    """What a fitted estimator says."""
    if hasattr(estimator, "report_") and hasattr(estimator.report_, "verdict"):  # of a diagnosis
        report = estimator.report_
        return np.r_[report.shrink.before, report.shrink.after, [v for e in report.effects for v in e.params.values()]]
    method = estimator.predict if hasattr(estimator, "predict") else estimator.transform
    if "groups" in inspect.signature(method).parameters:
        return np.asarray(method(X, groups=groups))
    return np.asarray(method(X))


def fit_and_answer(estimator, X, y, groups):
    """For worker processes."""
    return answer(fitted(estimator, X, y, groups), X, groups)


@pytest.fixture(scope="module")
def reference():
    """Answers on plain arrays, made once."""
    return {name: answer(fitted(build(name))) for name in CLASSES}


@ALL
def test_pickled(name, reference):
    again = pickle.loads(pickle.dumps(fitted(build(name))))
    np.testing.assert_array_equal(answer(again), reference[name])


@ALL
def test_unfitted_pickles_and_clones_fit_alike(name, reference):
    estimator = pickle.loads(pickle.dumps(clone(build(name))))
    np.testing.assert_array_equal(answer(fitted(estimator)), reference[name])


@ALL
def test_fit_writes_no_parameter(name):
    estimator = build(name)
    before = {key: pickle.dumps(value) for key, value in estimator.get_params(deep=False).items()}
    fitted(estimator)
    after = {key: pickle.dumps(value) for key, value in estimator.get_params(deep=False).items()}
    assert before == after


@ALL
def test_fitted_twice_is_fitted_once(name, reference):
    estimator = fitted(build(name), X[:120], y[:120], groups[:120])
    np.testing.assert_array_equal(answer(fitted(estimator)), reference[name])


def read_only(array):
    array = array.copy()
    array.setflags(write=False)
    return array


FORMS = {
    "read-only": read_only,
    "Fortran order": np.asfortranarray,
    "strided": lambda a: np.repeat(a, 2, axis=0)[::2],
    "list": lambda a: a.tolist(),
}


@pytest.mark.parametrize("form", FORMS)
@ALL
def test_odd_arrays(name, form, reference):
    turn = FORMS[form]
    found = fit_and_answer(build(name), turn(X), turn(y), turn(groups))
    np.testing.assert_allclose(found, reference[name], rtol=1e-9, atol=1e-12)


@ALL
def test_memory_maps(name, tmp_path, reference):
    maps = []
    for key, array in {"X": X, "y": y, "groups": groups}.items():
        np.save(tmp_path / f"{key}.npy", array)
        maps.append(np.load(tmp_path / f"{key}.npy", mmap_mode="r"))
    np.testing.assert_array_equal(fit_and_answer(build(name), *maps), reference[name])


@LEARNERS
def test_single_precision_input(name):
    """Single precision in, the same answer as for the numbers that it holds, computed in double."""
    rounded_X, rounded_y = X.astype(np.float32), y.astype(np.float32)
    single = fit_and_answer(build(name), rounded_X, rounded_y, groups)
    double = fit_and_answer(build(name), rounded_X.astype(float), rounded_y.astype(float), groups)
    np.testing.assert_allclose(single, double, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("rows", [1, 30])
@LEARNERS
def test_the_first_rows_of_a_run_do_not_know_the_others(name, rows, reference):
    """One row, and half a run, get the answer that they get in the whole."""
    found = answer(fitted(build(name)), X[:rows], groups[:rows])
    np.testing.assert_allclose(found, reference[name][:rows], rtol=1e-6)  # 1e-8 of a network in single precision


PLAIN = sorted(set(CLASSES) - {"GapDiagnoser", "HybridRegressor", "CalibratedSimulator"})
NETWORKS = {"FNNRegressor", "RecurrentRegressor", "NonlinearBasisRegressor"}  # a column more is another draw of weights


@pytest.mark.parametrize("name", PLAIN)
def test_a_constant_column_changes_nothing(name, reference):
    seven, three = (fit_and_answer(build(name), np.c_[X, np.full(len(X), c)], y, groups) for c in (7.0, 3.0))
    if seven.ndim == 1:  # a prediction
        np.testing.assert_allclose(seven, three, rtol=1e-12)
        if name not in NETWORKS:
            # a refinement that ends at the border of stability refuses steps: there rounding chooses the next one
            np.testing.assert_allclose(seven, reference[name], rtol=1e-6 if name == "StateSpaceRegressor" else 1e-8)
        return
    n = reference[name].shape[1]  # features of the first column, then those of the constant one
    np.testing.assert_array_equal(seven[:, :n], reference[name])
    rest = seven[:, n:][np.isfinite(seven).all(axis=1)]
    assert np.ptp(rest, axis=0).max() == 0


#: Units go through: features of the knots' own scale stay, what passes signals on and what predicts goes with them.
STAY = {"FourierFeatures", "GaussianFeatures", "HeavisideFeatures", "SplineFeatures"}
#: Networks are trained for 20 steps, in single precision where torch trains them.
LOOSE = {"FNNRegressor": 1e-2, "RecurrentRegressor": 1e-3}


@pytest.mark.parametrize("unit", [1e-9, 1e9])
@pytest.mark.parametrize("name", PLAIN)
def test_huge_and_tiny_units(name, unit, reference):
    estimator = build(name)
    for key, value in estimator.get_params().items():
        if isinstance(value, Ridge):  # its penalty has the unit of X squared
            estimator.set_params(**{f"{key}__alpha": value.alpha * unit**2})
    found = fit_and_answer(estimator, unit * X, unit * y, groups)
    size = np.nanmax(np.abs(reference[name]))
    wanted = reference[name] * (1.0 if name in STAY else unit)
    atol = LOOSE.get(name, 1e-7) * size * (1.0 if name in STAY else unit)
    np.testing.assert_allclose(found, wanted, rtol=0, atol=atol)


@pytest.mark.parametrize("name", sorted(set(CLASSES) - {"RecurrentRegressor"}))  # skops does not know torch's tensors
def test_skops_needs_to_trust_this_package_alone(name, reference):
    skops = pytest.importorskip("skops.io")
    stored = skops.dumps(fitted(build(name)))
    types = skops.get_untrusted_types(data=stored)
    assert all(kind.startswith("sksurrogate.") for kind in types)
    np.testing.assert_array_equal(answer(skops.loads(stored, trusted=types)), reference[name])


@pytest.mark.slow
def test_worker_processes(reference):
    """All estimators fitted in two processes; arrays arrive there as read-only memory maps."""
    names = sorted(CLASSES)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # loky's own resource tracking
        answers = joblib.Parallel(n_jobs=2, backend="loky", max_nbytes=100)(
            joblib.delayed(fit_and_answer)(build(name), X, y, groups) for name in names
        )
    for name, found in zip(names, answers):
        np.testing.assert_allclose(found, reference[name], rtol=1e-7, atol=1e-9, err_msg=name)


# ---- those with a simulator


def mixer(t, x, u, p):
    """Inflow of two streams."""
    return [p["a"] * u[0] + p["b"] * u[1] - p["k"] * x[0]]


def around(name, a=1.0, k=0.5):
    """An estimator around a simulator with two inputs."""
    simulator = ODESimulator(
        mixer, states=["level"], inputs=["one", "two"], outputs=["level"], params={"a": a, "b": 1.0, "k": k}, dt=0.1
    )
    return {
        "HybridRegressor": lambda: HybridRegressor(simulator, make_pipeline(StandardScaler(), Ridge(1e-3))),
        "CalibratedSimulator": lambda: CalibratedSimulator(simulator, params=["a", "k"]),
        "GapDiagnoser": lambda: GapDiagnoser(simulator, effects=["sensor_bias", "parameter_error"], random_state=0),
    }[name]()


def mixed(unit=1.0):
    """Four runs of the plant; the second input never moves."""
    rng = np.random.default_rng(0)
    U = np.repeat(rng.uniform(0.5, 1.5, (4, 8, 2)), 10, axis=1)
    U[..., 1] = 1.0
    plant = around("GapDiagnoser", a=1.2).simulator
    Y = plant.simulate_batch(U, np.zeros((4, 1)))[..., 0] + 0.005 * rng.normal(size=(4, 80))
    return U.reshape(-1, 2), unit * Y.ravel(), np.repeat(np.arange(4), 80)


AROUND = pytest.mark.parametrize("name", ["HybridRegressor", "CalibratedSimulator", "GapDiagnoser"])


@AROUND
def test_an_input_that_never_moves_is_legal(name):
    """The gain of the other input is off by a fifth: that is found, and less than a tenth of the error is left."""
    U, level, runs = mixed()
    alone = around(name).simulator.simulate_batch(U.reshape(4, 80, 2), np.zeros((4, 1))).ravel() - level
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = fitted(around(name), U, level, runs)
    if name == "GapDiagnoser":
        named = [(effect.name, effect.location) for effect in found.report_.effects]
        assert (found.report_.verdict, named) == ("explained", [("parameter_error", "a")])
    else:
        error = found.predict(U, groups=runs) - level
        assert np.sqrt(np.mean(error**2)) < 0.1 * np.sqrt(np.mean(alone**2))


@pytest.mark.slow
@AROUND
def test_single_precision_around_a_simulator(name):
    U, level, runs = mixed()
    single = fit_and_answer(around(name), U.astype(np.float32), level.astype(np.float32), runs)
    double = fit_and_answer(
        around(name), U.astype(np.float32).astype(float), level.astype(np.float32).astype(float), runs
    )
    np.testing.assert_allclose(single, double, rtol=1e-4, atol=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("unit", [1e-9, 1e9])
@AROUND
def test_outputs_in_huge_and_tiny_units_around_a_simulator(name, unit):
    """Level in another unit: gains and states go with it, answers too."""
    U, level, runs = mixed()
    plain, scaled = around(name), around(name)
    scaled.simulator.params = {**scaled.simulator.params, "a": unit * 1.0, "b": unit * 1.0}
    one, other = fit_and_answer(plain, U, level, runs), fit_and_answer(scaled, U, unit * level, runs)
    if name == "GapDiagnoser":
        assert scaled.report_.verdict == plain.report_.verdict
        assert [e.name for e in scaled.report_.effects] == [e.name for e in plain.report_.effects]
        np.testing.assert_allclose(other[:2], one[:2], rtol=0.02)  # errors over standard deviations
    else:
        np.testing.assert_allclose(other / unit, one, rtol=1e-3, atol=1e-3)
