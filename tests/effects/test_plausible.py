"""Values at which an effect is not what its name says: a friction without friction at rest, a step outside of the runs."""

import numpy as np
import pytest

from sksurrogate.effects import CATALOGUE, Probe
from sksurrogate.gap import GapDiagnoser
from sksurrogate.physics import ODESimulator

DT, N, RUNS = 0.1, 100, 3
T = DT * np.arange(N)
#: Runs of 10 time units, from 0 to 1 and back.
V = np.tile(np.sin(0.2 * np.pi * T), RUNS)
PROBE = Probe(V, V, 1.0, DT, DT * N, N * np.arange(RUNS))

SAID = {
    "stribeck_friction": (1.0, 1.5, 0.3),
    "lugre_friction": (50.0, 1.0, 1.5, 0.3),
    "parameter_step": (0.2, 5.0),
    "step_disturbance": (0.2, 5.0),
    "hidden_relaxation": (1.0, 3.0),
    "hidden_mode": (1.0, 4.0, 0.1),
    "hysteresis": (1.0, 0.3),
    "end_stop": (1.0, 0.7),
    "power_law": (1.0, 0.5),
    "parameter_dependence": (0.5, 0.1),
    "backlash": (0.5,),
    "parameter_drift": (-0.09,),
}
UNLIKELY = [
    ("lugre_friction", (1e4, 1.0, 1.5, 0.3)),
    ("parameter_step", (0.2, -0.1)),
    ("parameter_step", (0.2, 9.95)),
    ("step_disturbance", (0.2, 0.1)),
    ("hidden_relaxation", (1.0, 1e4)),
    ("hidden_relaxation", (1.0, 1e-3)),
    ("hidden_mode", (1.0, 1e3, 0.1)),
    ("hidden_mode", (1.0, 1.0, 30.0)),
    ("hysteresis", (1.0, 50.0)),
    ("hysteresis", (1.0, 0.005)),  # it yields within a sample
    ("end_stop", (1.0, -1.1)),
    ("power_law", (1.0, 0.1)),
    ("parameter_dependence", (0.5, -0.9)),
    ("backlash", (1.1,)),  # wider than the parts move
    ("parameter_drift", (-0.11,)),
]


def at(name):
    effect = CATALOGUE[name]
    return (
        effect("k", *["v"] * (name in ("parameter_dependence", "backlash")))
        if effect.kind == "parameter"
        else effect("v", "v")
    )


@pytest.mark.parametrize(("settled", "time_constant", "plausible"), [
    (True, 30.0, True), (True, 50.0, False),  # four runs of 10
    (False, 3.0, True), (False, 5.0, False),  # a start that is not forgotten within the runs is a constant of the run
])  # fmt: skip
def test_a_companion_that_did_not_begin_at_rest_forgets_where_it_began(settled, time_constant, plausible):
    t = np.arange(0.0, 10.0, 0.1)
    probe = Probe(v=np.sin(t), x=np.sin(t), rate=1.0, dt=0.1, duration=10.0, starts=np.array([0]))
    effect = CATALOGUE["hidden_relaxation"]("v", "v", settled=settled)
    assert effect.plausible((1.0, time_constant), probe) == plausible


@pytest.mark.parametrize(("name", "theta"), SAID.items())
def test_an_effect_that_the_data_show_is_plausible(name, theta):
    assert at(name).plausible(theta, PROBE)


@pytest.mark.parametrize(("name", "theta"), UNLIKELY)
def test_a_form_that_has_lost_what_makes_the_effect_is_not(name, theta):
    assert not at(name).plausible(theta, PROBE)


def test_a_level_that_stays_positive_may_hardly_depend_on_it():
    level = 2.0 + V
    probe = Probe(level, level, 1.0, DT, DT * N, N * np.arange(RUNS))
    assert at("power_law").plausible((1.0, 0.1), probe)


@pytest.mark.parametrize("name", ["stribeck_friction", "lugre_friction"])
def test_a_friction_is_no_less_at_rest_than_in_motion(name):
    """So it cannot stand for a friction with a width, or for a loss."""
    effect, first = at(name), (50.0,) if name == "lugre_friction" else ()
    low, level = (*first, 1.0, 0.2, 0.3), (*first, 1.0, 1.0, 0.3)
    assert effect.canonical(low) == level
    z, v = np.full((1, len(V)), 0.3), V[None]
    if name == "lugre_friction":
        one, other = (effect.rates(z, 0.0, v, v, theta, 0.0)[0] for theta in (low, level))
    else:
        one, other = (effect.term(0.0, v, v, theta, 0.0) for theta in (low, level))
    np.testing.assert_array_equal(one, other)


def test_a_friction_that_is_no_larger_when_slow_is_a_coulomb_friction():
    effect, probe = at("stribeck_friction"), Probe(V, V, 1.0, DT, DT * N, N * np.arange(RUNS))
    assert effect.plausible((1.0, 1.5, 0.3), probe)
    assert not effect.plausible((1.0, 1.0, 0.3), probe) and not effect.plausible((1.0, 0.2, 0.3), probe)


@pytest.mark.parametrize("name", ["step_disturbance", "parameter_step"])
def test_a_step_at_the_last_two_readings_follows_any_two(name):
    effect = CATALOGUE[name]("k" if name == "parameter_step" else "v")
    v = np.linspace(1.0, 2.0, 44)
    probe = Probe(v, v, 1.0, DT, DT * 43, np.zeros(1, int))
    for time in (1.5 * DT, 41.5 * DT):
        assert not effect.plausible((1.0, time), probe)
    for time in (2.5 * DT, 40.5 * DT):
        assert effect.plausible((1.0, time), probe)


def simulator(extra):
    return ODESimulator(
        lambda t, x, u, p: (u[0] - p["k"] * x[0] + extra(x[0]),), states=["v"], inputs=["f"], outputs=["v"],
        params={"k": 0.3}, dt=DT,
    )  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize(
    ("extra", "name"),
    [
        (lambda v: -0.4 * v * abs(v), "stribeck_friction"),
        (lambda v: -0.2 * v, "hysteresis"),
        (lambda v: -0.2 * v, "hidden_relaxation"),
        (lambda v: -0.2 * (v + 4.0), "end_stop"),
    ],
)
def test_a_law_outside_of_the_catalogue_is_not_named_by_a_form_that_degenerates(extra, name):
    rng = np.random.default_rng(4)
    X = np.repeat(rng.uniform(-1.5, 1.5, (RUNS, N // 10, 1)), 10, axis=1)
    y = np.concatenate([simulator(extra).simulate(U)[:, 0] for U in X]) + 0.02 * rng.normal(size=RUNS * N)
    found = GapDiagnoser(simulator(lambda v: 0.0 * v), effects=[CATALOGUE[name]("v", "v")], random_state=0)
    report = found.fit(X.reshape(-1, 1), y, np.repeat(np.arange(RUNS), N)).report_
    assert report.verdict == "unknown", [(e.name, e.params) for e in report.effects]
