"""More models that can be exported, and those that must not be exported in silence with another meaning."""

import shutil
import subprocess

import numpy as np
import pytest
from sklearn.base import clone
from sklearn.compose import TransformedTargetRegressor
from sklearn.cross_decomposition import PLSRegression
from sklearn.decomposition import PCA
from sklearn.linear_model import PoissonRegressor, Ridge
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import MaxAbsScaler, MinMaxScaler, PolynomialFeatures, RobustScaler

from sksurrogate.compose import DerivativeRegressor, StateSpaceRegressor
from sksurrogate.datasets import make_reactor_runs
from sksurrogate.exceptions import SurrogateError
from sksurrogate.export import to_c, to_casadi, to_graph, to_onnx
from sksurrogate.linear import LaggedLinearRegressor, NonlinearBasisRegressor
from sksurrogate.neural import FNNRegressor
from sksurrogate.physics import ControlSimulator, ODESimulator

RNG = np.random.default_rng(0)
X = RNG.normal(size=(80, 3)) * [1.0, 5.0, 0.2] + [0.0, 10.0, 3.0]
Y = np.c_[np.sin(X[:, 0]) + X[:, 1] * X[:, 2], X[:, 0] ** 2]


@pytest.mark.parametrize("y", [Y, Y[:, 0]], ids=["two outputs", "one output"])
@pytest.mark.parametrize(
    "model",
    [
        PLSRegression(2),
        make_pipeline(RobustScaler(), Ridge()),
        make_pipeline(MaxAbsScaler(), Ridge()),
        make_pipeline(PCA(2, whiten=True), Ridge()),
        TransformedTargetRegressor(Ridge(), transformer=MinMaxScaler()),
    ],
    ids=lambda m: type(m).__name__,
)
def test_static_models_equal_predict(model, y):
    model = clone(model).fit(X, y)
    graph = to_graph(model)
    new = X[:10] + 0.1
    np.testing.assert_allclose(
        np.stack([graph(x=row)["y"] for row in new]), model.predict(new).reshape(10, -1), atol=1e-11
    )


def _of_numpy(model, rows, tmp_path):
    graph = to_graph(model)
    return [graph(x=row)["y"] for row in rows]


def _of_casadi(model, rows, tmp_path):
    pytest.importorskip("casadi")
    return np.array(to_casadi(model)(rows.T)).T


def _of_onnx(model, rows, tmp_path):
    pytest.importorskip("onnx")
    runtime = pytest.importorskip("onnxruntime")
    to_onnx(model, tmp_path / "model.onnx")
    session = runtime.InferenceSession(str(tmp_path / "model.onnx"), providers=["CPUExecutionProvider"])
    return session.run(["y"], {"x": rows})[0]


def _of_c(model, rows, tmp_path):
    casadi, compiler = pytest.importorskip("casadi"), shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        pytest.skip("no C compiler")
    to_c(model, tmp_path / "model.c")
    subprocess.run(
        [compiler, "-O2", "-fPIC", "-shared", "-o", tmp_path / "model.so", tmp_path / "model.c", "-lm"], check=True
    )
    function = casadi.external(to_casadi(model).name(), str(tmp_path / "model.so"))
    return np.stack([np.array(function(casadi.DM(row))).ravel() for row in rows])


EVERYWHERE = pytest.mark.parametrize(
    "run", [_of_numpy, _of_casadi, _of_onnx, _of_c], ids=["numpy", "casadi", "onnx", "C"]
)


@EVERYWHERE
@pytest.mark.parametrize("y", [Y + 60.0, Y[:, 0] + 60.0], ids=["two outputs", "one output"])
def test_networks_equal_predict_everywhere(run, y, tmp_path):
    model = FNNRegressor((5,), alpha=1e-12, random_state=0).fit(X, y)
    expected = model.predict(X[:20]).reshape(20, -1)
    np.testing.assert_allclose(run(model, X[:20], tmp_path), expected, rtol=1e-12)


@EVERYWHERE
def test_a_network_whose_weights_nearly_cancel_is_off_by_their_rounding_at_most(run, tmp_path):
    model = FNNRegressor((5,), random_state=0).fit(X, Y)
    model.coefs_[-1][:] *= 1e6  # the same as what training to the last digit may end with
    rows = X[:20]
    hidden = np.tanh(rows @ model.coefs_[0] + model.intercepts_[0])
    expected = hidden @ model.coefs_[-1] + model.intercepts_[-1]
    bound = 50 * np.finfo(float).eps * (np.abs(hidden) @ np.abs(model.coefs_[-1]) + np.abs(model.intercepts_[-1]))
    assert np.all(np.abs(np.asarray(run(model, rows, tmp_path)) - expected) < bound)


@EVERYWHERE
@pytest.mark.parametrize("y", [Y, Y[:, 0]], ids=["two outputs", "one output"])
@pytest.mark.parametrize(
    ("basis", "degree"), [("gaussian", 3), ("spline", 1), ("spline", 2), ("spline", 3), ("knots", 1), ("knots", 3)]
)
def test_free_places_and_widths_equal_predict_everywhere(run, basis, degree, y, tmp_path):
    model = NonlinearBasisRegressor(basis, 3, degree=degree, n_starts=1, max_iter=20, random_state=0).fit(X, y)
    rows = np.concatenate([X[:20], 3.0 * X[:5]])  # beyond the data too
    expected = model.predict(rows).reshape(len(rows), -1)
    # truncated powers cancel by themselves: 1e-10
    np.testing.assert_allclose(run(model, rows, tmp_path), expected, rtol=1e-10, atol=1e-10 * np.abs(expected).max())


def test_slopes_of_free_places_and_widths_are_those_of_the_model():
    for basis in ("gaussian", "spline", "knots"):
        model = NonlinearBasisRegressor(basis, 3, n_starts=1, max_iter=20, random_state=0).fit(X, Y)
        graph, slopes = to_graph(model), model.jacobian(X[:5])
        for row, slope in zip(X[:5], slopes):
            np.testing.assert_allclose(graph.jacobian(x=row)["y", "x"], slope, rtol=1e-9, atol=1e-9)


def test_coefficients_behind_a_link_are_refused():
    with pytest.raises(SurrogateError, match="PoissonRegressor cannot be exported"):
        to_graph(PoissonRegressor().fit(X, np.abs(Y[:, 0])))


def _run(graph, x, rows):
    out = []
    for row in rows:
        found = graph(x=x, u=row)
        x, _ = found["x_next"], out.append(found["y"])
    return np.array(out)


U, V, GROUPS = make_reactor_runs(3, 60, noise=0.01, random_state=0)


@pytest.mark.slow
@pytest.mark.parametrize("hidden", [(), (3,)])
def test_a_state_space_model_runs_freely_as_predict(hidden):
    model = StateSpaceRegressor(2, hidden_layer_sizes=hidden, init="mean").fit(U, V, groups=GROUPS)
    graph = to_graph(model)
    np.testing.assert_allclose(_run(graph, graph.initial, U[:60])[:, 0], model.predict(U[:60]), atol=1e-10)


def test_a_derivative_model_runs_freely_as_predict():
    model = DerivativeRegressor(make_pipeline(PolynomialFeatures(2), Ridge(1e-8)), dt=0.02).fit(U, V, groups=GROUPS)
    predicted = model.predict(U[:60], y0=[[V[0]]])
    np.testing.assert_allclose(_run(to_graph(model), V[:1], U[:60])[:, 0], predicted, atol=1e-10)


def test_a_filter_runs_as_predict():
    model = LaggedLinearRegressor([0, 3]).fit(U, V, groups=GROUPS)
    found = _run(to_graph(model), np.repeat(U[0], 3), U[:60])
    np.testing.assert_allclose(found[:, 0], model.predict(U[:60]), atol=1e-11)


def test_systems_of_python_control_are_read():
    control = pytest.importorskip("control")
    linear = ControlSimulator(control.ss([[0, 1], [-2, -0.3]], [[0], [1]], np.eye(2), [[0], [0.5]]), dt=0.1)
    nonlinear = ControlSimulator(
        control.nlsys(
            lambda t, x, u, p: [x[1], -np.sin(x[0]) - p["c"] * x[1] + u[0]], lambda t, x, u, p: [x[0]],
            states=["th", "w"], inputs=["m"], outputs=["th"], params={"c": 0.2},
        ), dt=0.1, params={"c": 0.4},
    )  # fmt: skip
    rows = np.sin(np.arange(30.0))[:, None]
    for plant in (linear, nonlinear):
        expected = plant.simulate(rows, x0=[0.4, 0.1])
        graph = to_graph(plant, n_sub=plant.substeps(rows, x0=[0.4, 0.1]))
        np.testing.assert_allclose(_run(graph, np.array([0.4, 0.1]), rows), expected, atol=1e-9)


@pytest.mark.parametrize(
    ("rhs", "options", "message"),
    [
        (lambda t, x, u, p: [np.sin(t) - x[0]], {}, "depends on the time"),
        (lambda t, x, u, p: [u[0] if x[0] > 0 else -u[0]], {}, "branch on values"),
        (lambda t, x, u, p: [-x[0]], {"hold": "foh"}, "foh"),
        (
            lambda t, x, u, p: [-1.0 + 0 * x[0]],
            {"events": [(lambda t, x, u, p: x[0], lambda t, x, u, p: [1 + 0 * x[0]])]},
            "events",
        ),
    ],
)
def test_simulators_that_are_no_fixed_formula_say_why(rhs, options, message):
    plant = ODESimulator(rhs, states=["x"], inputs=["u"], outputs=["x"], params={}, dt=0.1, **options)
    with pytest.raises(SurrogateError, match=message):
        to_graph(plant)
