"""Which of two exact twins is named does not depend on units or on the order of the states."""

from types import SimpleNamespace

import numpy as np
import pytest

from sksurrogate.effects._catalogue import CATALOGUE
from sksurrogate.gap import GapDiagnoser
from sksurrogate.gap.decide._equivalence import EquivalenceClass, Twin, _first_twin, rank
from sksurrogate.physics import ODESimulator

RUNS, ROWS = 3, 150


def tank(x, u, p):
    return [(u[0] - p["k"] * x["level"]) / p["area"]]


def cart(x, u, p):
    return [x["speed"], (u[0] - p["k"] * x["place"] - p["c"] * x["speed"]) / p["m"]]


def heater(x, u, p):
    return [u[0] - p["h"] * (x["core"] - x["wall"]), p["h"] * (x["core"] - x["wall"]) - p["l"] * x["wall"]]


#: Equations, states, outputs, parameters, sample time, what the real plant adds, the twins that compete.
PLANTS = {
    "tank": (tank, ("level",), ("level",), {"k": 0.5, "area": 2.0}, 0.5, {"level": lambda x: -0.15},
             ["input_bias", "constant_bias"]),
    "cart": (cart, ("place", "speed"), ("place",), {"k": 4.0, "c": 0.4, "m": 1.0}, 0.05,
             {"speed": lambda x: -0.35 * x["speed"]}, ["linear_loss", "parameter_error"]),
    "heater": (heater, ("core", "wall"), ("wall",), {"h": 0.4, "l": 0.2}, 0.5,
               {"wall": lambda x: -0.05 * x["wall"] ** 2}, ["quadratic_loss", "quadratic_drag"]),
}  # fmt: skip


def simulators(name, order, unit):
    """The simulator and the real plant, with its states in an order and time in a unit."""
    law, states, outputs, params, dt, missing, _ = PLANTS[name]
    names = [states[k] for k in order]

    def rates(x, u, p, real):
        x = dict(zip(names, x))
        rate = dict(zip(states, law(x, u, p)))
        for state, term in missing.items() if real else ():
            rate[state] = rate[state] + term(x)
        return [rate[state] / unit for state in names]

    common = {"states": names, "inputs": ["u"], "outputs": list(outputs), "params": params, "dt": dt * unit}
    return (
        ODESimulator(lambda t, x, u, p: rates(x, u, p, False), **common),
        ODESimulator(lambda t, x, u, p: rates(x, u, p, True), **common),
    )


def named(name, order, unit):
    effects = PLANTS[name][-1]
    simulator, real = simulators(name, order, unit)
    rng = np.random.default_rng(1)
    U = np.repeat(rng.uniform(0.2, 1.5, (RUNS, ROWS // 10, 1)), 10, axis=1)
    Y = np.concatenate([real.simulate(u) for u in U])
    Y = Y + 0.01 * np.std(Y) * np.random.default_rng(2).normal(size=Y.shape)
    diagnoser = GapDiagnoser(simulator, effects=effects, n_jobs=1, random_state=0)
    report = diagnoser.fit(U.reshape(-1, 1), Y, np.repeat(np.arange(RUNS), ROWS)).report_
    assert report.verdict == "explained"
    (effect,) = report.effects
    others = {(key[0], key[1]) for key in effect.equivalents}
    saved = [(e.name, e.location) for e in diagnoser.augmented_.effects]
    assert saved == [(effect.name, effect.location)]
    return (effect.name, effect.location), others


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "first"), [("tank", "constant_bias"), ("cart", "parameter_error"), ("heater", "quadratic_loss")]
)
def test_the_same_twin_is_named_in_every_unit_and_order(name, first):
    n = len(PLANTS[name][1])
    summary = named(name, tuple(range(n)), 1.0)
    assert summary[0][0] == first and summary[1]
    assert named(name, tuple(range(n)), 1000.0) == summary
    assert named(name, tuple(range(n)), 1.0 / 60.0) == summary
    if n > 1:
        assert named(name, (1, 0), 1.0) == summary


def test_the_order_of_twins_is_total():
    keys = [("sensor_bias", "a"), ("sensor_bias", "b"), ("input_bias", "a"), ("coulomb_friction", "v", "v")]
    keys.append(("coulomb_friction", "w", "w"))
    effects = [CATALOGUE[name](*where) for name, *where in keys]
    keys = [rank(effect) for effect in effects]
    assert len(set(keys)) == len(keys)
    assert sorted(effects, key=rank) == [effects[3], effects[4], effects[2], effects[0], effects[1]]


@pytest.mark.parametrize("named, other, same, known, stands", [
    ("hidden_mode", "sensor_lag", False, True, True),  # fewer parameters explain these data as well
    ("hidden_mode", "sensor_lag", False, False, True),
    ("sensor_lag", "hidden_mode", False, True, False),
    ("sensor_delay", "sensor_lag", False, True, False),  # as many: the likelier one stands
    ("input_bias", "constant_bias", True, True, True),  # exact twins: the one that comes first
    ("constant_bias", "input_bias", True, True, False),
])  # fmt: skip
def test_the_simplest_member_of_a_class_stands(named, other, same, known, stands):
    effect, twin = (CATALOGUE[name]("level", *(["level"] if name == "hidden_mode" else [])) for name in (named, other))
    its_class = EquivalenceClass(
        0,
        [Twin(SimpleNamespace(effects=[twin], fit=SimpleNamespace(cost=1.0)), same)],
        SimpleNamespace(effects=[effect]) if known else None,
    )
    search = SimpleNamespace(positions=(), is_far=lambda candidate: False, gap_cost=1e3, tolerated_cost=10.0)
    final = SimpleNamespace(candidate=None, effects=[effect], fit=SimpleNamespace(cost=1.0))
    found = _first_twin(search, final, its_class, effect)
    assert (found is not None and found.effect is twin) == stands
    if not same:  # a simpler one that leaves much more does not stand, as likely as it may be beside a law
        final = SimpleNamespace(candidate=None, effects=[effect], fit=SimpleNamespace(cost=0.2))
        assert _first_twin(search, final, its_class, effect) is None


@pytest.mark.parametrize(("cost", "stands"), [(2000.2, True), (2040.0, False), (99.0, True)])
def test_far_from_the_data_a_simpler_member_leaves_hardly_more_or_what_is_tolerated(cost, stands):
    # A delay took the place of a battery's diffusion by likelihood, and left a twentieth of the gap more.
    slow, late = CATALOGUE["hidden_relaxation"]("voltage", "current"), CATALOGUE["input_delay"]("current")
    search = SimpleNamespace(positions=(), is_far=lambda one: True, gap_cost=1000.0, tolerated_cost=100.0)
    twin = Twin(SimpleNamespace(effects=[late], fit=SimpleNamespace(cost=cost)), False)
    its_class = EquivalenceClass(0, [twin], SimpleNamespace(effects=[slow]))
    final = SimpleNamespace(candidate=None, effects=[slow], fit=SimpleNamespace(cost=2000.0 if cost > 1000.0 else 90.0))
    assert (_first_twin(search, final, its_class, slow) is twin) == stands


@pytest.mark.parametrize(
    ("beside", "named", "other", "stands"),
    [
        (
            "sensor_nonlinearity",
            "input_gain",
            "sensor_gain",
            True,
        ),  # gain and bend of one sensor are one characteristic
        ("sensor_nonlinearity", "sensor_gain", "input_gain", False),
        ("sensor_delay", "sensor_gain", "input_gain", True),  # a delay is no part of it: what comes first stands
        ("sensor_nonlinearity", "sensor_gain", "bilinear", False),
    ],
)
def test_what_makes_one_characteristic_with_another_name_stands(beside, named, other, stands):
    """A detector with stray light bends, and its gain is off; the gain of the pump would predict the same."""

    def at_its_place(name):
        return CATALOGUE[name](*(["c", "c*flow"] if name == "bilinear" else ["feed" if "input" in name else "A"]))

    first, own, twin = map(at_its_place, (beside, named, other))
    its_class = EquivalenceClass(
        1,
        [Twin(SimpleNamespace(effects=[first, twin], fit=SimpleNamespace(cost=1.0)), True)],
        SimpleNamespace(effects=[first, own]),
    )
    search = SimpleNamespace(positions=(), is_far=lambda candidate: False, gap_cost=1e3, tolerated_cost=10.0)
    final = SimpleNamespace(candidate=None, effects=[first, own], fit=SimpleNamespace(cost=1.0))
    assert (_first_twin(search, final, its_class, own) is not None) == stands
