"""Elements whose flow is no straight line of the difference across them: a wall, a pipe, a spring, a damper between two parts.

The plants are integrated by many small steps in plain Python.
"""

import json

import numpy as np
import pytest

from sksurrogate.effects import CATALOGUE, AugmentedSimulator
from sksurrogate.effects._across_element import across_element
from sksurrogate.export import to_casadi
from sksurrogate.gap import GapDiagnoser
from sksurrogate.physics import ODESimulator, StepSimulator
from sksurrogate.physics._simulator import describe

N, RUNS, PARTS = 250, 4, 20


def followed(rate, x0, U, dt):
    """States (n_samples, n_states) by Heun's method."""
    x, out, h = np.array(x0, float), [], dt / PARTS
    for u in U:
        out.append(x.copy())
        for _ in range(PARTS):
            k = np.array(rate(x, u))
            x = x + h * 0.5 * (k + np.array(rate(x + h * k, u)))
    return np.array(out)


def diagnosed(rate, simulator, draw, **settings):
    rng = np.random.default_rng(0)
    runs = [draw(rng) for _ in range(RUNS)]
    Y = np.concatenate([followed(rate, x0, U, simulator.dt) for U, x0 in runs])
    y = Y + 0.005 * Y.std(axis=0) * rng.standard_normal(Y.shape)
    diagnoser = GapDiagnoser(simulator, n_jobs=1, random_state=0, **settings)
    return diagnoser.fit(np.concatenate([U for U, _ in runs]), y, groups=np.repeat(range(RUNS), N))


def key_of(effect):
    return effect.name, effect.location, effect.variable


def held(rng, low, high, rows=25):
    return np.repeat(rng.uniform(low, high, N // rows), rows)


BODY = ODESimulator(
    lambda t, x, u, p: ((u[0] - p["UA"] * (x[0] - u[1])) / p["C"],),
    states=["T"], inputs=["P", "Ta"], outputs=["T"], params={"UA": 2.5, "C": 900.0}, dt=20.0,
    units={"T": "degC", "Ta": "degC", "P": "W", "UA": "W/K", "C": "J/K", "time": "s"},
)  # fmt: skip
TANKS = ODESimulator(
    lambda t, x, u, p: (
        (u[0] - p["k"] * (x[0] - x[1])) / 10.0,
        (u[1] + p["k"] * (x[0] - x[1]) - p["cv"] * np.sqrt(np.maximum(x[1], 0.0))) / 8.0,
    ),
    states=["h1", "h2"], inputs=["q1", "q2"], outputs=["h1", "h2"], params={"k": 0.5, "cv": 0.5}, dt=2.0,
)  # fmt: skip
DRIVE = ODESimulator(
    lambda t, x, u, p: (
        x[1], (u[0] - 0.1 * x[1] - p["k"] * (x[0] - x[2]) - p["d"] * (x[1] - x[3])) / 0.05,
        x[3], (p["k"] * (x[0] - x[2]) + p["d"] * (x[1] - x[3]) - 0.15 * x[3]) / 0.08,
    ),
    states=["q1", "w1", "q2", "w2"], inputs=["M"], outputs=["q1", "w1", "q2", "w2"], params={"k": 40.0, "d": 0.1}, dt=0.02,
)  # fmt: skip


def body(rng):
    room = 15.0 + 10.0 * np.sin(np.arange(N) / 75.0 + rng.uniform(0.0, 6.0)) + rng.uniform(-5.0, 5.0)
    return np.column_stack([held(rng, 0.0, 200.0), room]), [rng.uniform(15.0, 50.0)]


def tanks(rng):
    return np.column_stack([held(rng, 0.0, 1.2), held(rng, 0.0, 1.2)]), rng.uniform(1.0, 4.0, 2)


@pytest.mark.parametrize("free", [[], ["UA"]], ids=["known", "free"])
def test_natural_convection_is_the_power_of_a_quarter(free):
    """``1.1 abs(T - Ta)^0.25 (T - Ta)``: UA depends on the difference across the surface, whether it is re-tuned too or not."""

    def rate(x, u):
        return ((u[0] - 1.1 * (x[0] - u[1]) * abs(x[0] - u[1]) ** 0.25) / 900.0,)

    diagnoser = diagnosed(rate, BODY, body, free_params=free)
    report = diagnoser.report_
    (effect,) = report.effects
    assert report.verdict == "explained" and effect.probability > 0.9
    assert key_of(effect) == ("parameter_dependence", "UA", "abs(T - Ta)")
    assert 1.0 / (1.0 - effect.curvature) == pytest.approx(0.25, abs=0.01)
    at = np.array([5.0, 50.0])
    form, theta = diagnoser.augmented_.effects[0], list(effect.params.values())
    np.testing.assert_allclose(form.value(2.5, 0.0, theta, 0.0, at), 1.1 * at**0.25, rtol=0.01)
    assert "at abs(T - Ta) = " in str(report) and " degC, " in str(report)  # the ends, with their unit
    json.loads(report.to_json())


def test_a_pipe_between_two_tanks_takes_the_root_of_the_difference():
    """In both directions; the two levels, and the flow, go up and down."""

    def rate(x, u):
        q = 0.9 * np.sign(x[0] - x[1]) * np.sqrt(abs(x[0] - x[1]))
        return (u[0] - q) / 10.0, (u[1] + q - 0.5 * np.sqrt(max(x[1], 0.0))) / 8.0

    report = diagnosed(rate, TANKS, tanks).report_
    (effect,) = report.effects
    assert report.verdict == "explained" and key_of(effect) == ("parameter_dependence", "k", "abs(h1 - h2)")
    assert 1.0 / (1.0 - effect.curvature) == pytest.approx(-0.5, abs=0.05)


@pytest.mark.slow
def test_a_coupling_that_hardens_depends_on_the_square():
    """``40 d + 400 d^3`` is ``40 (1 + 10 d^2) d``."""

    def rate(x, u):
        twist, slip = x[0] - x[2], x[1] - x[3]
        through = 40.0 * twist + 400.0 * twist**3 + 0.1 * slip
        return x[1], (u[0] - 0.1 * x[1] - through) / 0.05, x[3], (through - 0.15 * x[3]) / 0.08

    report = diagnosed(rate, DRIVE, lambda rng: (held(rng, -14.0, 14.0, 10)[:, None], np.zeros(4))).report_
    (effect,) = report.effects
    assert report.verdict == "explained" and key_of(effect) == ("parameter_dependence", "k", "(q1 - q2)^2")
    assert effect.params["slope"] == pytest.approx(10.0, rel=0.02)


def test_which_parameters_are_those_of_an_element():
    """What else a parameter scales, or a second signal that counts, makes it none."""
    drive, room, tanks = describe(DRIVE), describe(BODY), describe(TANKS)
    assert across_element(drive, "k") == (("q1", "q2"), True)
    assert across_element(drive, "d") == (("w1", "w2"), True)
    assert across_element(room, "C") is None  # the power counts too
    assert across_element(tanks, "cv") == (("h2",), False)  # in proportion to a root

    def step(t, x, u, p, dt):
        return (x[0] + dt * (p["a"] * (u[0] - x[0]) - p["b"] * x[0]),)

    stepped = StepSimulator(step, states=["x"], inputs=["u"], outputs=["x"], params={"a": 1.0, "b": 0.5}, dt=0.1)
    assert [across_element(describe(stepped), name) for name in "ab"] == [(("x", "u"), True), (("x",), True)]


@pytest.mark.slow
@pytest.mark.parametrize("free", [[], ["k"]], ids=["known", "free"])
def test_play_in_a_coupling_is_a_backlash(free):
    """0.04 rad at each side, as a gear has it; half of the samples lie within."""

    def rate(x, u):
        twist, slip = x[0] - x[2], x[1] - x[3]
        through = 40.0 * np.sign(twist) * max(abs(twist) - 0.04, 0.0) + 0.1 * slip
        return x[1], (u[0] - 0.1 * x[1] - through) / 0.05, x[3], (through - 0.15 * x[3]) / 0.08

    report = diagnosed(
        rate, DRIVE, lambda rng: (held(rng, -8.0, 8.0, 10)[:, None], np.zeros(4)), free_params=free
    ).report_
    (effect,) = report.effects
    assert report.verdict == "explained" and key_of(effect) == ("backlash", "k", "abs(q1 - q2)")
    assert effect.params["half_width"] == pytest.approx(0.04, rel=0.02)


ACROSS = [
    ("parameter_dependence", "abs(h1 - h2)", {"slope": 0.3, "relative_error": -0.2}, 1.0 + 0.3 * 2.0 - 0.2),
    ("parameter_dependence", "(h1 - h2)^2", {"slope": 0.3, "relative_error": -0.2}, 1.0 + 0.3 * 4.0 - 0.2),
    ("backlash", "abs(h1 - h2)", {"half_width": 0.5}, 1.0 - 0.5 / 2.0),
    ("backlash", "abs(h1 - h2)", {"half_width": 2.5}, 0.0),
]


@pytest.mark.parametrize("name, variable, params, factor", ACROSS)
def test_a_difference_acts_alike_in_every_form_of_a_simulator(name, variable, params, factor):
    """The derivative by hand, a run, and the graph of CasADi, stepped."""
    augmented = AugmentedSimulator(TANKS, [CATALOGUE[name]("k", variable)], [params])
    U, x0 = np.full((50, 2), [0.6, 0.3]), np.array([1.0, 3.0])
    flow = 0.5 * factor * (x0[0] - x0[1])
    expected = (0.6 - flow) / 10.0, (0.3 + flow - 0.5 * np.sqrt(3.0)) / 8.0
    np.testing.assert_allclose(augmented.rhs(0.0, x0, U[0], augmented.params), expected, rtol=1e-12)
    function, x, path = to_casadi(augmented), x0, []
    for u in U:
        path.append(x)
        x = np.array(function(x, u)[0]).ravel()
    near = 1e-4 if name == "backlash" else 1e-9  # a kink within a step
    np.testing.assert_allclose(path, augmented.simulate(U, x0=x0), rtol=near)
