"""More models that leave the house, and those that must not leave in silence with another meaning."""

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
from sksurrogate.export import to_graph
from sksurrogate.linear import LaggedLinearRegressor
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
        np.testing.assert_allclose(_run(to_graph(plant, n_sub=16), np.array([0.4, 0.1]), rows), expected, atol=1e-7)


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
