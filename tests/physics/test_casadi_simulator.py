"""CasADi functions as simulators: the same equations in numpy are the oracle."""

import pickle

import numpy as np
import pytest
from sklearn.base import clone

from sksurrogate.effects import CATALOGUE, AugmentedSimulator
from sksurrogate.exceptions import SimulatorError, SurrogateError
from sksurrogate.export import to_graph
from sksurrogate.physics import CalibratedSimulator, CasadiSimulator, ODESimulator, StepSimulator
from sksurrogate.physics._casadi_tape import tape_of
from sksurrogate.physics._simulator import describe
from sksurrogate.testing import check_simulator

ca = pytest.importorskip("casadi")
U = np.random.default_rng(0).normal(size=(50, 1))
NAMES = {"states": ["q", "v"], "inputs": ["f"], "params": {"k": 4.0, "c": 0.3}, "dt": 0.1}
x, u, k, c, t = ca.SX.sym("x", 2), ca.SX.sym("u"), ca.SX.sym("k"), ca.SX.sym("c"), ca.SX.sym("t")
p = ca.SX.sym("p", 2)
RATE = ca.vertcat(x[1], u - k * ca.sin(x[0]) - c * x[1])
ENERGY = x[1] ** 2 / 2 - k * ca.cos(x[0])
BY_VECTOR = ca.substitute(RATE, ca.vertcat(k, c), p)


def rhs(t, x, u, p):
    return x[1], u[0] - p["k"] * np.sin(x[0]) - p["c"] * x[1]


def energy(t, x, u, p):
    return (x[1] ** 2 / 2 - p["k"] * np.cos(x[0]),)


def _plant(**options):
    return ODESimulator(rhs, **{**NAMES, "outputs": ["q"], **options})


def _simulator(function, **options):
    return CasadiSimulator(function, **{**NAMES, "outputs": ["q"], **options})


@pytest.mark.slow
@pytest.mark.parametrize(
    "function",
    [
        ca.Function("f", [x, u, p], [BY_VECTOR]),
        ca.Function("f", [p, u, x], [BY_VECTOR], ["p", "u", "x"], ["dx"]),
        ca.Function("f", [u, x, p], [BY_VECTOR], ["inputs", "states", "params"], ["dx"]),
        ca.Function("f", [c, x, u, k], [RATE], ["c", "x", "u", "k"], ["dx"]),
    ],
    ids=["by position", "by name", "in words", "parameters by name"],
)
def test_inputs_are_found_by_name_or_position(function):
    simulator = _simulator(function)
    assert describe(simulator).access == "rhs"
    np.testing.assert_allclose(simulator.simulate(U, x0=[1.0, 0.0]), _plant().simulate(U, x0=[1.0, 0.0]), atol=1e-13)
    random = np.random.default_rng(1)
    points, inputs = random.normal(size=(2, 4, 30)), random.normal(size=(1, 4, 30))
    values = {"k": random.uniform(3, 5, (4, 30)), "c": 0.3}
    np.testing.assert_allclose(simulator.rhs(0.0, points, inputs, values), rhs(0.0, points, inputs, values), atol=1e-13)
    check_simulator(simulator, U)


def test_time_a_second_output_and_a_function_of_outputs():
    timed = ca.Function("f", [t, x, u, p], [BY_VECTOR + ca.vertcat(0, ca.sin(t))], ["t", "x", "u", "p"], ["dx"])

    def late(t, x, u, p):
        dq, dv = rhs(t, x, u, p)
        return dq, dv + np.sin(t)

    expected = ODESimulator(late, **NAMES, outputs=["q"]).simulate(U)
    np.testing.assert_allclose(_simulator(timed).simulate(U), expected, atol=1e-13)
    both = ca.Function("f", [x, u, k, c], [RATE, ENERGY], ["x", "u", "k", "c"], ["dx", "y"])
    apart = ca.Function("y", [x, k], [ENERGY], ["x", "k"], ["y"])
    expected = _plant(outputs=["energy"], output=energy).simulate(U, x0=[1.0, 0.0])
    one = ca.Function("f", [x, u, k, c], [RATE], ["x", "u", "k", "c"], ["dx"])
    for simulator in (_simulator(both, outputs=["energy"]), _simulator(one, outputs=["energy"], output_function=apart)):
        np.testing.assert_allclose(simulator.simulate(U, x0=[1.0, 0.0]), expected, atol=1e-13)


def test_a_map_from_sample_to_sample():
    function = ca.Function("f", [x, u, k, c], [x + 0.1 * RATE], ["x", "u", "k", "c"], ["next"])
    simulator = _simulator(function, discrete=True)
    assert describe(simulator).access == "step" and not hasattr(simulator, "rhs")
    euler = StepSimulator(lambda t, x, u, p, dt: x + 0.1 * np.array(rhs(t, x, u, p)), **NAMES, outputs=["q"])
    np.testing.assert_allclose(simulator.simulate(U, x0=[1.0, 0.0]), euler.simulate(U, x0=[1.0, 0.0]), atol=1e-13)
    check_simulator(simulator, U)


def test_it_is_a_nominal_model_with_effects_and_free_parameters():
    simulator, plant = _simulator(ca.Function("f", [x, u, p], [BY_VECTOR])), _plant()
    effects = [CATALOGUE["quadratic_drag"]("v", "v"), CATALOGUE["parameter_error"]("k"), CATALOGUE["input_lag"]("f")]
    values = [{"coefficient": 0.2}, {"relative_error": 0.1}, {"time_constant": 0.15}]
    found, expected = (AugmentedSimulator(s, effects, values).simulate(U, x0=[1.0, 0.0]) for s in (simulator, plant))
    np.testing.assert_allclose(found, expected, atol=1e-10)
    y = _plant(params={"k": 4.0, "c": 0.5}).simulate(U, x0=[1.0, 0.0])[:, 0]
    fitted = [CalibratedSimulator(s, ["c"]).fit(U, y).params_["c"] for s in (simulator, plant)]
    assert fitted[0] == pytest.approx(fitted[1], abs=1e-9) == pytest.approx(0.5, abs=1e-4)


def test_points_that_fail_are_nan_and_the_others_are_right():
    z, a = ca.SX.sym("z"), ca.SX.sym("a")
    solver = ca.rootfinder("s", "newton", {"x": z, "p": a, "g": z**2 - a}, {"error_on_fail": True})
    state = ca.MX.sym("x")
    function = ca.Function("f", [state], [-solver(x0=1.0, p=state)["x"]], ["x"], ["dx"])  # no root below zero
    simulator = CasadiSimulator(function, states=["h"], inputs=[], outputs=["h"], dt=0.1)
    found = simulator.rhs(0.0, np.array([[4.0, -1.0, 9.0, np.nan, 1e200]]), np.empty((0, 5)), {})
    np.testing.assert_allclose(found[0], [-2.0, np.nan, -3.0, np.nan, np.nan], atol=1e-9)


def test_mistakes_speak():
    with pytest.raises(SimulatorError, match=r"input 'w' is none of t, x, u, p and no parameter"):
        _simulator(ca.Function("f", [x, u, p], [BY_VECTOR], ["x", "w", "p"], ["dx"])).simulate(U)
    with pytest.raises(SimulatorError, match=r"input 'p' is of shape \(2, 1\), expected \(1, 1\)"):
        _simulator(ca.Function("f", [x, u, p], [BY_VECTOR], ["x", "u", "p"], ["dx"]), params={"k": 4.0}).simulate(U)
    with pytest.raises(SimulatorError, match=r"outputs are of shape \[\(1, 1\)\], expected \(2, 1\) at place 0"):
        _simulator(ca.Function("f", [x, u, p], [BY_VECTOR[1]])).simulate(U)
    with pytest.raises(SimulatorError, match=r"is not a casadi.Function"):
        _simulator(rhs).simulate(U)
    with pytest.raises(SurrogateError, match=r"use simulator.function itself"):
        to_graph(_simulator(ca.Function("f", [x, u, p], [BY_VECTOR])))


def test_it_travels():
    simulator = _simulator(ca.Function("f", [x, u, p], [BY_VECTOR]), method="auto")
    expected = simulator.simulate(U)
    for other in (clone(simulator), pickle.loads(pickle.dumps(simulator))):
        np.testing.assert_array_equal(other.simulate(U), expected)
    assert clone(simulator).set_params(params__k=5.0).params == {"k": 5.0, "c": 0.3}


def _instructions():
    """A term of every kind of instruction, of x[0] > 0, x[1] of both signs and p."""
    x, u, p = ca.SX.sym("x", 2), ca.SX.sym("u"), ca.SX.sym("p")
    a, b = x[0], x[1]
    terms = [
        a + b, a - b, a * b, a / (1 + b * b), -a, a * a, 1 / a, ca.sqrt(a), a**b, a**3, ca.exp(b), ca.log(a), ca.fabs(b), ca.sign(b),
        ca.copysign(a, b), ca.floor(b), ca.ceil(b), ca.fmod(b, a), ca.fmin(a, b), ca.fmax(a, u), ca.erf(b), ca.sin(b), ca.cos(b),
        ca.tan(b), ca.asin(ca.tanh(b)), ca.acos(ca.tanh(b)), ca.atan(b), ca.atan2(a, b), ca.sinh(b), ca.cosh(b), ca.tanh(b), ca.asinh(b),
        ca.acosh(1 + a), ca.atanh(ca.tanh(b)), ca.hypot(a, b), ca.log1p(a), ca.expm1(b), 2 * a, a < u, a <= b, ca.eq(a, b), ca.ne(a, b),
        ca.logic_not(a < u), ca.logic_and(a < u, b < u), ca.logic_or(a < u, b < u), ca.if_else(b > 0, a, p), 3.5 + 0 * a,
    ]  # fmt: skip
    return ca.Function("f", [x, u, p], [ca.vertcat(*terms), p * a], ["x", "u", "p"], ["terms", "second"]), len(terms)


@pytest.mark.parametrize("kind", ["SX", "MX"])
def test_instructions_on_arrays_equal_casadi(kind):
    function, n = _instructions()
    if kind == "MX":
        given = [ca.MX.sym("x", 2), ca.MX.sym("u"), ca.MX.sym("p")]
        function = ca.Function("g", given, function.call(given), ["x", "u", "p"], ["terms", "second"])
    rng = np.random.default_rng(0)
    x, u, p = (
        np.array([rng.uniform(0.1, 2, 99), rng.normal(size=99)]),
        rng.normal(size=(1, 99)),
        rng.normal(size=(1, 99)),
    )
    tape, expected = tape_of(function), function.call([ca.DM(x), ca.DM(u), ca.DM(p)])
    for place, size in ((0, n), (1, 1)):
        found = tape(place, [x, u, p], 99)
        assert found.shape == (size, 99)
        np.testing.assert_allclose(found, expected[place].full(), rtol=1e-13, atol=1e-15)


def test_what_calls_a_solver_has_no_instructions():
    z, x = ca.SX.sym("z"), ca.SX.sym("x")
    root = ca.rootfinder("root", "newton", {"x": z, "p": x, "g": z**3 + z - x})
    y = ca.MX.sym("x")
    assert tape_of(ca.Function("f", [y], [root(0.0, y)])) is None
