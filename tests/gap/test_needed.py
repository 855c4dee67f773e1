"""Which of several names are needed: none that only corrects the form of another."""

from types import SimpleNamespace

import numpy as np
import pytest

from sksurrogate.effects import CATALOGUE
from sksurrogate.gap import GapDiagnoser
from sksurrogate.gap.decide import _needed
from sksurrogate.gap.decide._needed import needed_only
from sksurrogate.gap.search._nested import of_one_curve
from sksurrogate.physics import CallableSimulator, ODESimulator


@pytest.mark.parametrize(
    ("other", "tolerated", "left"),
    [
        (("lugre_friction", "v", "v"), 400.0, ["hysteresis"]),
        (("lugre_friction", "v", "v"), 200.0, ["hysteresis", "lugre_friction"]),
        (("linear_loss", "v", "v"), 400.0, ["hysteresis", "linear_loss"]),
    ],
)
def test_of_two_forms_of_one_law_the_nearer_is_enough_within_the_tolerance(monkeypatch, other, tolerated, left):
    """A loop between two forms of the catalogue is followed to the noise by their sum."""

    def one(effects, cost):
        return SimpleNamespace(effects=effects, fit=SimpleNamespace(cost=cost), left=1.0)

    both = CATALOGUE["hysteresis"]("v", "y"), CATALOGUE[other[0]](*other[1:])
    final = one(both, 100.0)
    final.candidate = final
    search = SimpleNamespace(
        tolerance=0.1,
        tolerated_cost=tolerated,
        n_values=100,
        stood={},
        plausible=lambda _: True,
        without=lambda _, i: one((both[1 - i],), 500.0 if i == 0 else 300.0),
    )
    monkeypatch.setattr(_needed, "taken", lambda search, fewer, final: fewer)
    monkeypatch.setattr(_needed, "not_sized_beside_others", lambda found: ([], []))
    assert [effect.name for effect in needed_only(search, final).effects] == left


@pytest.mark.parametrize(
    ("second", "without_second", "tolerated", "left"),
    [
        (("parameter_dependence", "capacitance", "charge"), 300.0, 400.0, ["quadratic_loss"]),
        (("parameter_dependence", "capacitance", "charge"), 300.0, 200.0, ["quadratic_loss", "parameter_dependence"]),
        (("parameter_dependence", "capacitance", "charge"), 600.0, 700.0, ["quadratic_loss", "parameter_dependence"]),
        (("drift", "current", None), 300.0, 400.0, ["quadratic_loss", "drift"]),
        (("sensor_nonlinearity", "charge", None), 300.0, 400.0, ["quadratic_loss", "sensor_nonlinearity"]),
    ],
    ids=["follows the form", "beyond the tolerance", "the first is needed less", "another driver", "not rare"],
)
def test_a_rare_one_that_is_driven_as_another_is_left_out(monkeypatch, second, without_second, tolerated, left):
    """A loss whose exponent is not quite two is followed to the noise beside a capacitance that depends on the same charge."""

    def one(effects, cost):
        found = SimpleNamespace(effects=effects, fit=SimpleNamespace(cost=cost), left=1.0)
        found.keys, found.candidate = tuple(effect.key for effect in effects), found
        return found

    both = CATALOGUE["quadratic_loss"]("current", "charge"), CATALOGUE[second[0]](*second[1:])
    search = SimpleNamespace(
        tolerance=0.1,
        tolerated_cost=tolerated,
        n_values=100,
        stood={},
        plausible=lambda _: True,
        without=lambda _, i: one((both[1 - i],), 500.0 if i == 0 else without_second),
    )
    monkeypatch.setattr(_needed, "taken", lambda search, fewer, final: fewer)
    monkeypatch.setattr(_needed, "not_sized_beside_others", lambda found: ([], []))
    assert [effect.name for effect in needed_only(search, one(both, 100.0)).effects] == left


@pytest.mark.parametrize(("tolerated", "left"), [(400.0, "a"), (200.0, "ab")])
def test_of_effects_without_a_magnitude_beside_each_other_one_is_enough_within_the_tolerance(
    monkeypatch, tolerated, left
):
    """Two parameters that act as one: at the noise together, and neither of them has a size."""
    search, one = _sets({"ab": 100.0, "a": 300.0, "b": 500.0})
    search.tolerated_cost, final = tolerated, one("ab")
    final.left = 1.0
    monkeypatch.setattr(_needed, "taken", lambda search, fewer, final: fewer)
    monkeypatch.setattr(_needed, "_one_of_two", lambda one, other: False)
    monkeypatch.setattr(
        _needed, "not_sized_beside_others", lambda found: (list(range(len(found.effects) - 1)) and [0, 1], [])
    )
    assert "".join(effect.name for effect in needed_only(search, final).effects) == left


@pytest.mark.parametrize(("without_b", "left"), [(140.0, "a"), (160.0, "ab")])
def test_an_effect_whose_magnitude_is_not_shown_at_all_is_taken_out_where_it_closes_less_than_the_tolerance(
    monkeypatch, without_b, left
):
    """Its states imitate initial states; the noise alone is more than the tolerance of the gap."""
    search, one = _sets({"ab": 100.0, "a": without_b, "b": 300.0})
    search.tolerated_cost, final = 50.0, one("ab")
    final.left = 1.0
    monkeypatch.setattr(_needed, "taken", lambda search, fewer, final: fewer)
    monkeypatch.setattr(_needed, "_one_of_two", lambda one, other: False)
    monkeypatch.setattr(_needed, "not_sized_beside_others", lambda found: ([], [1]))
    assert "".join(effect.name for effect in needed_only(search, final).effects) == left


def _sets(costs, places=None):
    """A search over sets of named effects with known costs, by their names; each at a place of its own by default."""

    def one(names):
        at = {n: n for n in names} if places is None else places
        kinds = {n: "output" if at[n] == "sensor" else "state" for n in names}
        effects = tuple(SimpleNamespace(name=n, kind=kinds[n], location=at[n], variable="v", rarity=1.0) for n in names)
        found = SimpleNamespace(effects=effects, fit=SimpleNamespace(cost=costs[names]), left=9.0)
        found.candidate = found
        return found

    def without(candidate, i):
        names = "".join(effect.name for k, effect in enumerate(candidate.effects) if k != i)
        return one(names) if names in costs else None

    return SimpleNamespace(
        tolerance=0.1, tolerated_cost=150.0, n_values=100, stood={}, without=without, plausible=lambda _: True
    ), one


@pytest.mark.parametrize(
    ("places", "tolerated", "left"),
    [
        ("xxx", 700.0, "a"),
        ("xxx", 300.0, "abc"),
        ("xxy", 700.0, "abc"),
        ("xyz", 700.0, "abc"),
        (["sensor"] * 3, 700.0, "abc"),
    ],
)
def test_of_a_stack_of_laws_in_one_balance_one_is_enough_within_the_tolerance(monkeypatch, places, tolerated, left):
    """An exchange that saturates is followed to the noise by an exchange, a square and a product; a grid and a lag of a sensor are two."""
    costs = {"abc": 100.0, "ab": 400.0, "ac": 450.0, "bc": 900.0, "a": 600.0, "b": 900.0}
    search, one = _sets(costs, dict(zip("abc", places)))
    search.tolerated_cost, final = tolerated, one("abc")
    final.left = 1.0
    monkeypatch.setattr(_needed, "taken", lambda search, fewer, final: fewer)
    monkeypatch.setattr(_needed, "_one_of_two", lambda one, other: False)
    monkeypatch.setattr(_needed, "not_sized_beside_others", lambda found: ([], []))
    assert "".join(effect.name for effect in needed_only(search, final).effects) == left


def test_names_taken_out_one_by_one_have_not_closed_most_together(monkeypatch):
    """Each step leaves less than four times what was left before; both together leave six times as much: the second stays."""
    search, one = _sets({"abc": 100.0, "ab": 200.0, "ac": 900.0, "bc": 900.0, "a": 600.0, "b": 900.0})
    monkeypatch.setattr(_needed, "taken", lambda search, fewer, final: fewer)
    monkeypatch.setattr(_needed, "not_sized_beside_others", lambda found: ([], []))
    monkeypatch.setattr(_needed, "_of_which_one_is_enough", lambda final, not_sized: [])
    assert "".join(effect.name for effect in needed_only(search, one("abc")).effects) == "ab"


def test_where_a_name_is_not_needed_the_nearest_set_of_the_size_stands(monkeypatch):
    """A third name had changed the two others: without it the two that stood before it come nearer."""
    costs = {"abc": 100.0, "ab": 350.0, "ac": 900.0, "bc": 900.0, "ad": 300.0, "a": 900.0, "d": 900.0, "b": 900.0}
    search, one = _sets(costs)
    search.stood[2] = one("ad")
    monkeypatch.setattr(_needed, "taken", lambda search, fewer, final: fewer)
    monkeypatch.setattr(_needed, "not_sized_beside_others", lambda found: ([], []))
    monkeypatch.setattr(_needed, "_of_which_one_is_enough", lambda final, not_sized: [])
    assert "".join(effect.name for effect in needed_only(search, one("abc")).effects) == "ad"


def test_what_is_left_of_a_set_must_be_plausible_itself(monkeypatch):
    """Without the friction beside it a power law is nearest with an exponent of zero: a friction again."""
    search, one = _sets({"ab": 100.0, "a": 130.0, "b": 120.0})
    monkeypatch.setattr(_needed, "taken", lambda search, fewer, final: fewer)
    monkeypatch.setattr(_needed, "not_sized_beside_others", lambda found: ([], []))
    monkeypatch.setattr(_needed, "_of_which_one_is_enough", lambda final, not_sized: [])
    assert "".join(effect.name for effect in needed_only(search, one("ab")).effects) == "b"
    search.plausible = lambda one: one.effects[0].name != "b"
    assert "".join(effect.name for effect in needed_only(search, one("ab")).effects) == "a"


@pytest.mark.parametrize(
    ("one", "other", "alike"),
    [
        (("coulomb_friction", "v", "v"), ("gravity_tilt", "v", "v"), True),
        (("coulomb_friction", "v", "v"), ("gravity_tilt", "v", "y"), False),
        (("coulomb_friction", "v", "v"), ("linear_loss", "w", "v"), False),
        (("coulomb_friction", "v", "v"), ("hidden_relaxation", "v", "v"), False),
        (("parameter_drift", "k", None), ("parameter_error", "k", None), True),
        (("input_curve", "u", None), ("input_gain", "u", None), True),
        (("input_gain", "u", None), ("input_delay", "u", None), False),
        (("input_gain", "u", None), ("input_quantization", "u", None), False),
        (("sensor_gain", "y", None), ("sensor_bias", "y", None), True),
        (("sensor_gain", "y", None), ("sensor_lag", "y", None), False),
        (("sensor_bias", "v", None), ("constant_bias", "v", None), False),
    ],
)
def test_curves_of_one_signal_at_one_place(one, other, alike):
    """What remembers, stops or rounds is no curve; a sensor and a balance of one name are two places."""
    first, second = (CATALOGUE[name](*at) for name, *at in (one, other))
    assert of_one_curve(first, second) == of_one_curve(second, first) == alike


@pytest.mark.slow
@pytest.mark.parametrize("access", ["rhs", "simulate"])
def test_a_curve_that_bends_otherwise_has_one_name(access):
    """A valve of another form than the catalogue's: a gain beside its curve would only correct the form."""

    def valve(u):
        return 0.45 * u * np.abs(u) ** 1.3 / (1 + 0.3 * np.abs(u))

    def rhs(t, x, u, p):
        return (-x[0] + u[0],)

    simulator = ODESimulator(rhs, states=["q"], inputs=["u"], outputs=["q"], params={}, dt=0.1)
    rng = np.random.default_rng(5)
    U = np.repeat(rng.uniform(-2.0, 2.0, (4, 15)), 12, axis=1)[..., None]
    made = [simulator.simulate(u + valve(u), x0=[0.0]).reshape(-1, 1) for u in U]
    y = np.vstack(made) + rng.normal(0.0, 0.005, (len(U) * U.shape[1], 1))
    if access == "simulate":
        simulator = CallableSimulator(simulator.simulate, inputs=["u"], outputs=["q"], dt=0.1)
    diagnoser = GapDiagnoser(simulator, random_state=0, n_jobs=1)
    report = diagnoser.fit(U.reshape(-1, 1), y, groups=np.repeat(np.arange(4), 180)).report_
    assert report.verdict == "explained" and [effect.name for effect in report.effects] == ["input_curve"]


def test_what_is_left_of_a_set_begins_at_rest_where_that_is_as_likely(monkeypatch):
    """Two lags of a transmitter: beside a delay the memory was in motion, and stood for what was taken out with it."""
    judged, stood = [], []
    search = SimpleNamespace(
        judge=judged.append, polish=lambda one: f"{one}, polished", stand=lambda one: stood.append(one) or one
    )
    monkeypatch.setattr(_needed, "estimate_noise", lambda candidate, noise, curvature: (candidate, noise))
    monkeypatch.setattr(_needed, "from_rest", lambda search, one: f"{one}, at rest")
    before = SimpleNamespace(noise="noise", curvature=None)
    assert _needed.taken(search, "lag", before) == "lag, polished, at rest"
    assert judged == [("lag", "noise")] and stood == ["lag, polished, at rest"]
