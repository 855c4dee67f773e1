"""An exported unit, loaded again by FMPy, runs as the graph does."""

import sys

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from sksurrogate.datasets import make_reactor
from sksurrogate.effects import CATALOGUE, AugmentedSimulator
from sksurrogate.exceptions import SurrogateError
from sksurrogate.export import to_fmu, to_graph
from sksurrogate.export._fmu import _described, _plain
from sksurrogate.export._graph import BINARY, UNARY, Graph
from sksurrogate.export._unit_step import evaluate
from sksurrogate.physics import FMUSimulator, ODESimulator, StepSimulator

U = np.random.default_rng(0).uniform(0.1, 0.2, size=(40, 1))


def worn():
    """Effects at a balance, with memory at the input and at the sensor, and with the time."""
    chosen = {
        "quadratic_loss": {"coefficient": 0.05},
        "periodic_disturbance": {"amplitude": 0.5, "angular_frequency": 9.0, "phase": 0.3},
        "input_lag": {"time_constant": 0.1},
        "sensor_delay": {"delay": 0.04},
        "sensor_quantization": {"step": 0.01},
    }
    places = {"input_lag": ("u",), "periodic_disturbance": ("y",), "quadratic_loss": ("y", "y")}
    effects = [CATALOGUE[name](*places.get(name, ("y",))) for name in chosen]
    return AugmentedSimulator(make_reactor(), effects, list(chosen.values()))


def rolled(graph, x, U):
    """Outputs of a graph from state to state."""
    out = []
    for u in U:
        values = graph(x=x, u=u)
        out.append(values["y"])
        x = values["x_next"]
    return np.array(out)


def unit_of(path, states, U):
    pytest.importorskip("fmpy")
    unit = FMUSimulator(path, inputs=["u"], outputs=["y"], initial=states, dt=0.02, access="trajectory")
    return unit.simulate(U)


def test_the_unit_of_an_augmented_simulator_runs_as_its_graph(tmp_path):
    pytest.importorskip("pythonfmu.builder")
    model = worn()
    path = to_fmu(model, tmp_path / "worn.fmu", x0=[4.0], u0=U[0])
    graph = model.to_graph()
    expected = rolled(graph, model.start_state([4.0], U[0]), U)
    found = unit_of(path, [f"state.{name}" for name in graph.states], U)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9)


def corrected():
    """A reactor whose wrong parameter is found."""
    wrong = [{"relative_error": 2 / 3}]
    return AugmentedSimulator(make_reactor(second=60.0), [CATALOGUE["parameter_error"]("second")], wrong)


@pytest.mark.parametrize("model", [make_reactor(), corrected(), worn()], ids=["plain", "corrected", "worn"])
def test_the_unit_with_the_steps_of_simulate_equals_simulate(model, tmp_path):
    pytest.importorskip("pythonfmu.builder")
    n_sub = model.substeps(U, x0=[4.0])
    path = to_fmu(model, tmp_path / "steps.fmu", x0=[4.0], u0=U[0], n_sub=n_sub)
    states = to_graph(model, n_sub).states or ["y"]
    found = unit_of(path, [f"state.{name}" for name in states], U)
    np.testing.assert_allclose(found, model.simulate(U, x0=[4.0]), rtol=0, atol=1e-9)


@pytest.mark.slow
def test_the_unit_of_a_corrected_simulator_solves_its_equation(tmp_path):
    pytest.importorskip("pythonfmu.builder")
    model, loaded = corrected(), set(sys.modules)
    path = to_fmu(model, tmp_path / "reactor.fmu", x0=[4.0], n_sub=64)
    plant, x, expected = make_reactor(second=100.0), [4.0], []
    for u in U:
        expected.append(x[0])
        x = solve_ivp(
            lambda t, x, u=u: plant.rhs(t, x, u, plant.params), (0, 0.02), x, "DOP853", rtol=1e-12, atol=1e-12
        ).y[:, -1]
    found = unit_of(path, ["state.y"], U)[:, 0]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9)
    assert "reactor" not in set(sys.modules) - loaded  # a unit that runs here takes no module name of somebody else


def test_the_unit_of_a_difference_equation_equals_simulate(tmp_path):
    pytest.importorskip("pythonfmu.builder")

    def step(t, x, u, p, dt):
        return [x[0] + dt * (u[0] - p["k"] * np.sqrt(x[0]))]

    tank = StepSimulator(step, states=["level"], inputs=["u"], outputs=["level"], params={"k": 0.1}, dt=0.02, x0=[1.0])
    path = to_fmu(tank, tmp_path / "tank.fmu")
    unit = FMUSimulator(path, inputs=["u"], outputs=["level"], initial=["state.level"], dt=0.02, access="trajectory")
    np.testing.assert_allclose(unit.simulate(U), tank.simulate(U), rtol=0, atol=1e-12)


def test_every_operation_has_its_value():
    rng = np.random.default_rng(1)
    for op in [*UNARY, *BINARY]:
        graph = Graph()
        x = graph.input("x", 3)
        other = graph.constant([1.5]) if op == "pow" else graph.input("u", 3)
        graph.outputs["y"] = graph.unary(op, x) if op in UNARY else graph.binary(op, x, other)
        given = {"x": rng.uniform(0.2, 3.0, 3), "u": rng.uniform(0.2, 3.0, 3)}
        given = {name: given[name] for name in graph.inputs}
        nodes = [[node.op, list(node.args), _plain(node)] for node in graph.nodes]
        found = evaluate(nodes, {name: value.tolist() for name, value in given.items()})
        np.testing.assert_allclose(found[graph.outputs["y"]], graph(**given)["y"], rtol=1e-14, err_msg=op)


def test_what_is_no_number_stays_none():
    nodes = [["input", [], ["x"]], ["log", [0], []], ["sqrt", [0], []], ["exp", [0], []], ["div", [0, 0], []]]
    values = evaluate(nodes, {"x": [-1.0, 0.0, 1e4]})
    assert np.isnan(values[1][0]) and values[1][1] == -np.inf and np.isnan(values[2][0])
    assert values[3][2] == np.inf and np.isnan(values[4][1])


@pytest.mark.parametrize(
    ("model", "path", "words"),
    [
        (make_reactor(), "two words.fmu", "expected NAME.fmu with a Python name"),
        (make_reactor(), "model.zip", "expected NAME.fmu"),
        (make_reactor(), "model.fmu", "x0 has 2 and u0 1 components: expected 1 states and 1 inputs"),
        (ODESimulator(lambda t, x, u, p: [u[0] - t * x[0]], states=["a"], inputs=["u"], outputs=["a"], params={}, dt=0.1), "model.fmu",
         "depends on the time"),
    ],
)  # fmt: skip
def test_what_cannot_be_a_unit_says_why(model, path, words, tmp_path):
    with pytest.raises(SurrogateError, match=words):
        to_fmu(model, tmp_path / path, x0=[1.0, 2.0])


@pytest.mark.parametrize(("dt", "said"), [(0.25, 0.25), (None, 1.0)])
def test_a_unit_without_a_sample_time_steps_by_one(dt, said):
    graph = Graph()
    x, u = graph.input("x", 1), graph.input("u", 1)
    graph.outputs.update(x_next=graph.binary("add", x, u), y=x)
    graph.dt = dt
    assert _described(graph, None, None, None, None)["dt"] == said


def test_a_matrix_and_what_picks_or_joins_components_have_their_values():
    graph, rng = Graph(), np.random.default_rng(2)
    x, u = graph.input("x", 3), graph.input("u", 2)
    both = graph.affine(graph.concat(x, u), rng.normal(size=(5, 4)), rng.normal(size=4))
    graph.outputs["y"] = graph.take(both, np.array([3, 0]))
    nodes = [[node.op, list(node.args), _plain(node)] for node in graph.nodes]
    given = {"x": rng.normal(size=3), "u": rng.normal(size=2)}
    found = evaluate(nodes, {name: value.tolist() for name, value in given.items()})
    np.testing.assert_allclose(found[graph.outputs["y"]], graph(**given)["y"], rtol=1e-14)
