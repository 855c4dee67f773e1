"""Every exported form equals predict to rounding; Jacobians equal differences; the C code compiles and agrees."""

import ctypes
import shutil
import subprocess

import numpy as np
import pytest
from sklearn.compose import TransformedTargetRegressor
from sklearn.decomposition import PCA
from sklearn.ensemble import RandomForestRegressor
from sklearn.linear_model import Lasso, LinearRegression, Ridge
from sklearn.neural_network import MLPRegressor
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import MinMaxScaler, PolynomialFeatures, StandardScaler

from sksurrogate.compose import HybridRegressor, RecursivePredictor
from sksurrogate.datasets import linear_reactor, make_reactor, make_reactor_runs
from sksurrogate.effects import AugmentedSimulator
from sksurrogate.exceptions import SurrogateError
from sksurrogate.export import Graph, state_space, to_c, to_casadi, to_fmu, to_graph, to_onnx
from sksurrogate.neural import FNNRegressor
from sksurrogate.physics import ODESimulator, StepSimulator, steady_state

casadi = pytest.importorskip("casadi")
runtime = pytest.importorskip("onnxruntime")
RNG = np.random.default_rng(0)
X3 = RNG.normal(size=(80, 3))
Y2 = np.c_[np.sin(X3[:, 0]) + X3[:, 1] * X3[:, 2], np.tanh(X3[:, 2]) - X3[:, 0]]


def net(activation, hidden=(5, 4)):
    return MLPRegressor(hidden_layer_sizes=hidden, activation=activation, solver="lbfgs", max_iter=50, random_state=0)


STATIC = {
    "linear": LinearRegression(),
    "scaled ridge": make_pipeline(StandardScaler(), Ridge()),
    "lasso on pca": make_pipeline(MinMaxScaler(), PCA(2), Lasso(1e-3)),
    "polynomials": make_pipeline(StandardScaler(), PolynomialFeatures(3), Ridge(1e-3)),
    "tanh net": make_pipeline(StandardScaler(), net("tanh")),
    "logistic net": net("logistic"),
    "relu net": net("relu"),
    "scaled target": TransformedTargetRegressor(net("tanh"), transformer=StandardScaler()),
    "FNN": FNNRegressor(hidden_layer_sizes=(4,), random_state=0),
}


def onnx_run(model, **given):
    session = runtime.InferenceSession(to_onnx(model).SerializeToString(), providers=["CPUExecutionProvider"])
    return session.run(None, {name: np.atleast_2d(value) for name, value in given.items()})


@pytest.mark.parametrize("y", [Y2, Y2[:, 0]], ids=["two outputs", "one output"])
@pytest.mark.parametrize("name", STATIC)
@pytest.mark.filterwarnings("ignore:lbfgs failed to converge")
def test_static_models_equal_predict(name, y):
    model = STATIC[name].fit(X3, y)
    rows = RNG.normal(size=(30, 3))
    expected = model.predict(rows).reshape(30, -1)
    np.testing.assert_allclose(to_graph(model)(x=rows)["y"], expected, rtol=1e-11, atol=1e-11)
    np.testing.assert_allclose(np.array(to_casadi(model)(rows.T)).T, expected, rtol=1e-11, atol=1e-11)
    np.testing.assert_allclose(onnx_run(model, x=rows)[0], expected, rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize("degree", [0, 1, 2, 4])
def test_polynomials_take_one_product_less_than_their_degree(degree):
    graph = to_graph(make_pipeline(PolynomialFeatures(degree), LinearRegression()).fit(X3, Y2))
    assert [node.op for node in graph.nodes].count("mul") == max(degree - 1, 0)


@pytest.mark.parametrize("name", [name for name in STATIC if name != "relu net"])
@pytest.mark.filterwarnings("ignore:lbfgs failed to converge")
def test_jacobians_equal_differences_and_casadis(name):
    graph = to_graph(STATIC[name].fit(X3, Y2))
    x, h = RNG.normal(size=3), 1e-6
    exact = graph.jacobian(x=x)["y", "x"]
    differences = np.stack([(graph(x=x + h * e)["y"] - graph(x=x - h * e)["y"]) / (2 * h) for e in np.eye(3)], axis=1)
    # a fit by Levenberg-Marquardt may have steep units, whose differences are off by their curvature
    np.testing.assert_allclose(exact, differences, rtol=3e-5, atol=1e-6)
    theirs = to_casadi(graph).jacobian()(x, np.zeros(2))
    np.testing.assert_allclose(exact, np.array(theirs), rtol=1e-10, atol=1e-12)
    many = graph.jacobian(x=np.stack([x, x + 1]))["y", "x"]
    np.testing.assert_allclose(many[0], exact)


def free(step, state, U):
    """Outputs of a graph-like step along a run."""
    out = []
    for u in U:
        state, y = step(state, u)
        out.append(y)
    return np.array(out)


def numpy_step(graph):
    def step(x, u):
        found = graph(x=x, u=u)
        return found["x_next"], found["y"]

    return step


def casadi_step(model):
    function = to_casadi(model)

    def step(x, u):
        following, y = function(x, u)
        return np.array(following)[:, 0], np.array(y)[:, 0]

    return step


def onnx_step(model):
    session = runtime.InferenceSession(to_onnx(model).SerializeToString(), providers=["CPUExecutionProvider"])

    def step(x, u):
        following, y = session.run(None, {"x": x[None], "u": u[None]})
        return following[0], y[0]

    return step


@pytest.mark.parametrize("lags", [(1, 2), ([0, 3], [1, 3]), (0, 1)])
@pytest.mark.filterwarnings("ignore:lbfgs failed to converge", "ignore:the free runs of")
def test_a_recursive_predictor_runs_freely_as_predict(lags):
    X, y, groups = make_reactor_runs(3, 80, random_state=0)
    X = np.c_[X, np.cos(np.arange(len(X)))]
    model = RecursivePredictor(make_pipeline(StandardScaler(), net("tanh", (4,))), *lags).fit(X, y, groups=groups)
    run, n = groups == 0, model.n_initial_
    expected = model.predict(X[run], y0=y[run][:n, None])
    back, past = max([lag for _, lag in model.input_terms_], default=0), max(model.output_lags_)
    state = np.r_[y[run][n - past : n][::-1], X[run][n - back : n][::-1].ravel()]
    graph = to_graph(model)
    for step in (numpy_step(graph), casadi_step(graph), onnx_step(graph)):
        np.testing.assert_allclose(free(step, state, X[run][n:])[:, 0], expected[n:], rtol=1e-9)


def test_two_outputs_run_freely_with_their_lags_and_those_of_two_inputs():
    rng = np.random.default_rng(0)
    X, y = rng.normal(size=(80, 2)), np.zeros((80, 2))
    for k in range(2, 80):
        y[k] = 0.4 * y[k - 1] - 0.2 * y[k - 2, ::-1] + X[k] + [0.5, -0.3] * X[k - 1] + 0.1 * X[k - 2, ::-1]
    model = RecursivePredictor(LinearRegression(), [0, 1, 2], [1, 2]).fit(X, y)
    n = model.n_initial_
    state = np.r_[y[n - 2 : n][::-1].ravel(), X[n - 2 : n][::-1].ravel()]
    graph = to_graph(model)
    for step in (numpy_step(graph), casadi_step(graph), onnx_step(graph)):
        np.testing.assert_allclose(free(step, state, X[n:]), model.predict(X, y0=y[:n])[n:], rtol=1e-9)


@pytest.mark.parametrize("size", [1e-6, 1.0, 1e9])
def test_a_steady_state_is_found_in_every_unit(size):
    plant = StepSimulator(
        lambda t, x, u, p, dt: [0.999 * x[0] + size * u[0] + 0.1 * size * np.tanh(x[0] / size)],
        states=["x"], inputs=["u"], outputs=["x"], params={}, dt=0.02,
    )  # fmt: skip
    found = state_space(plant, [1.0])
    np.testing.assert_allclose(found.x0, 1100.0 * size)
    np.testing.assert_allclose(found.A, [[0.999]])


def leaky(t, x, u, p, dt):
    return [0.9 * x[0] + 0.1 * np.tanh(p["gain"] * u[0])]


def leaky_plant(gain=1.0):
    return StepSimulator(leaky, states=["x"], inputs=["u"], outputs=["x"], params={"gain": gain}, dt=0.02)


def test_a_map_without_a_sample_time_counts_steps():
    class Leak:
        states, inputs, outputs, params = ["x"], ["u"], ["x"], {"gain": 1.0}

        def step(self, t, x, u, p, dt):
            return leaky(t, x, u, p, dt)

    plain = StepSimulator(leaky, states=["x"], inputs=["u"], outputs=["x"], params={"gain": 1.0})
    assert to_graph(Leak()).dt == to_graph(plain).dt == 1.0 and to_graph(leaky_plant()).dt == 0.02


@pytest.mark.slow
@pytest.mark.parametrize("form", ["output", "static", "series"])
@pytest.mark.parametrize("given", [False, True])
def test_a_hybrid_on_a_step_function_runs_freely_as_predict(form, given):
    X, groups = RNG.normal(size=(240, 1)), np.repeat([0, 1, 2], 80)
    y = np.concatenate([leaky_plant(2.0).simulate(X[groups == k])[:, 0] for k in range(3)])
    hybrid = HybridRegressor(leaky_plant(), form=form, n_lags=3).fit(X, y, groups=groups)
    run = groups == 1
    U = X[run] * 1.7  # leaves the box of the data here and there
    y0 = y[run][:3, None] if given else None
    expected = hybrid.predict(U, y0=y0)
    state, begin = hybrid.graph_state(U, y0=y0), 3 if given else 0
    for step in (numpy_step(hybrid.to_graph()), casadi_step(hybrid), onnx_step(hybrid)):
        np.testing.assert_allclose(free(step, state, U[begin:])[:, 0], expected[begin:], rtol=1e-9, atol=1e-11)


@pytest.mark.slow
@pytest.mark.parametrize("form", ["output", "dynamics", "input"])
def test_a_hybrid_on_a_right_hand_side_runs_freely_as_predict(form):
    X, y, groups = make_reactor_runs(4, 80, random_state=0)
    hybrid = HybridRegressor(linear_reactor(), form=form).fit(X, y, groups=groups)
    U = X[groups == 2]
    expected = hybrid.predict(U)
    for step in (numpy_step(hybrid.to_graph()), casadi_step(hybrid), onnx_step(hybrid)):
        np.testing.assert_allclose(free(step, hybrid.graph_state(U), U)[:, 0], expected, rtol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("form", ["output", "static", "series", "dynamics", "input"])
def test_a_hybrid_whose_correction_fades_runs_freely_as_predict(form):
    X, y, groups = make_reactor_runs(4, 80, noise=0.01, u_range=(0.1, 0.2), random_state=0)
    hybrid = HybridRegressor(linear_reactor(), form=form, fade=0.05).fit(X, y, groups=groups)
    n = hybrid.n_initial_
    for U, outside in ((X[groups == 2], False), (0.15 + 2.0 * (X[groups == 2] - 0.15), True)):
        y0 = y[groups == 2][:n, None]
        weight, expected = hybrid.validity(U, y0=y0), hybrid.predict(U, y0=y0)
        assert bool(weight[n:].min() < 0.5) is outside
        state, graph = hybrid.graph_state(U, y0=y0), hybrid.to_graph()
        for step in (numpy_step(graph), casadi_step(hybrid), onnx_step(hybrid)):
            np.testing.assert_allclose(free(step, state, U[n:])[:, 0], expected[n:], rtol=1e-9)


def pendulum(t, x, u, p):
    q, v = x
    return np.stack([v, u[0] - p["g"] * np.sin(q) - p["c"] * np.abs(v) * v - np.maximum(q - 1.0, 0.0) ** 2])


def test_a_right_hand_side_is_read_and_linearised_exactly():
    plant = ODESimulator(pendulum, states=["q", "v"], inputs=["m"], outputs=["q"], params={"g": 3.0, "c": 0.1}, dt=0.05)
    U = RNG.normal(size=(50, 1))
    run = free(numpy_step(to_graph(plant, plant.substeps(U, x0=[0.3, 0.0]))), np.array([0.3, 0.0]), U)
    np.testing.assert_allclose(run, plant.simulate(U, x0=[0.3, 0.0]), atol=1e-9)
    at = state_space(make_reactor(), [0.15], steady_state(make_reactor(), [0.15], x0=[5.0]))
    from sksurrogate.physics import linearise

    continuous = linearise(make_reactor(), at.x0, [0.15])
    assert at.A[0, 0] == pytest.approx(np.exp(0.02 * continuous.A[0, 0]), rel=1e-7)
    assert at.x1 == pytest.approx(at.x0)


@pytest.mark.slow
def test_a_hybrid_has_a_steady_state_and_A_B_C_D():
    control = pytest.importorskip("control")
    X, y, groups = make_reactor_runs(6, 100, random_state=0)
    hybrid = HybridRegressor(linear_reactor()).fit(X, y, groups=groups)
    found = state_space(hybrid, [0.12])
    assert found.y0[0] == pytest.approx(steady_state(make_reactor(), [0.12], x0=[5.0])[0], abs=0.1)
    system = found.to_control()
    assert isinstance(system, control.StateSpace) and system.dt == 0.02


@pytest.mark.filterwarnings("ignore:lbfgs failed to converge")
@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler here")
def test_the_c_code_compiles_and_agrees(tmp_path):
    model = make_pipeline(StandardScaler(), net("tanh", (4,))).fit(X3, Y2)
    to_c(model, tmp_path / "model.c")
    library = tmp_path / "model.so"
    subprocess.run(["cc", "-O1", "-shared", "-fPIC", str(tmp_path / "model.c"), "-o", str(library), "-lm"], check=True)
    function = ctypes.CDLL(str(library)).surrogate
    x, y = RNG.normal(size=3), np.zeros(2)
    pointer = ctypes.POINTER(ctypes.c_double)
    args, res = (pointer * 1)(x.ctypes.data_as(pointer)), (pointer * 1)(y.ctypes.data_as(pointer))
    assert function(args, res, None, None, 0) == 0
    np.testing.assert_allclose(y, model.predict(x[None])[0], rtol=1e-12)


def test_what_cannot_leave_speaks():
    with pytest.raises(SurrogateError, match="RandomForestRegressor cannot be exported"):
        to_graph(RandomForestRegressor(2).fit(X3, Y2))

    def branching(t, x, u, p):
        return [u[0] if x[0] > 0 else -x[0]]

    plant = ODESimulator(branching, states=["x"], inputs=["u"], outputs=["x"], params={}, dt=0.1)
    with pytest.raises(SurrogateError, match=r"branch on values.*np\.maximum"):
        to_graph(plant)
    with pytest.raises(SurrogateError, match="is not recursive"):
        state_space(LinearRegression().fit(X3, Y2), [0.0])
    graph = Graph()
    graph.outputs["y"] = graph.input("x", 2)
    with pytest.raises(ValueError, match=r"x has 3 components, expected shape \(2,\)"):
        graph(x=np.zeros(3))
    with pytest.raises(ValueError, match=r"inputs \['x'\]"):
        graph(u=np.zeros(3))


def decay(t, x, u, p):
    return (u[0] - x[0],)


def decay_plant(rhs=decay):
    return ODESimulator(rhs, states=["x"], inputs=["u"], outputs=["x"], params={}, dt=0.1)


@pytest.mark.parametrize("n_sub", [0, -1, 2.5, True, "4"])
@pytest.mark.parametrize("leave", [to_graph, AugmentedSimulator.to_graph])
def test_substeps_that_are_no_number_of_steps_are_refused(n_sub, leave):
    # Minus one step was no step: the state stayed where it was.
    model = decay_plant() if leave is to_graph else AugmentedSimulator(decay_plant())
    with pytest.raises(SurrogateError, match=r"n_sub=.*expected a whole number of substeps"):
        leave(model, n_sub=n_sub)
    assert leave(model, n_sub=2)(x=[1.0], u=[0.0])["x_next"] == pytest.approx(np.exp(-0.1), rel=1e-6)


@pytest.mark.parametrize("name", ["sinc", "angle"])
def test_functions_that_a_graph_does_not_have_are_said(name):
    with pytest.raises(SurrogateError, match="ODESimulator cannot be exported"):
        to_graph(decay_plant(lambda t, x, u, p: (getattr(np, name)(x[0]) + u[0],)))


@pytest.mark.parametrize("start", [{"x0": [np.nan]}, {"x0": [0.0], "u0": [np.inf]}])
def test_a_unit_starts_at_finite_numbers(start, tmp_path):
    with pytest.raises(SurrogateError, match="expected finite numbers"):
        to_fmu(decay_plant(), tmp_path / "unit.fmu", **start)
    assert not list(tmp_path.iterdir())
