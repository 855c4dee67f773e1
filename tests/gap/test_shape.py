"""The shape of a missing term through known dynamics, laws of several terms, rules of regions and moments, closed loops."""

from itertools import combinations
from types import SimpleNamespace

import numpy as np
import pytest

from sksurrogate.effects import LawEffect
from sksurrogate.effects._formula import SHAPES, Term, _spline
from sksurrogate.gap.fit._closed_loop import closed_loop
from sksurrogate.gap.fit._linear_model import LinearModel
from sksurrogate.gap.fit._linear_surrogate import learn
from sksurrogate.gap.unnamed import _term_library
from sksurrogate.gap.unnamed._channel import Channel
from sksurrogate.gap.unnamed._drivers import Drivers, drivers_at
from sksurrogate.gap.unnamed._families import FAMILIES, factors_of
from sksurrogate.gap.unnamed._formula_beam import Beam
from sksurrogate.gap.unnamed._formula_regression import Draft, Regression
from sksurrogate.gap.unnamed._formula_search import drafts_at, simplest, without_repeats
from sksurrogate.gap.unnamed._grammar import terms_of
from sksurrogate.gap.unnamed._missing_term import shape_of
from sksurrogate.gap.unnamed._regions import regions
from sksurrogate.gap.unnamed._term_library import Library
from sksurrogate.gap.unnamed._when import times
from sksurrogate.kernels.disturbance import Disturbance, Noise
from sksurrogate.kernels.record import Record

N_RUNS, N = 4, 250
POLE, SIGMA = 0.95, 0.02


@pytest.fixture
def record():
    rng = np.random.default_rng(0)
    u = np.repeat(rng.uniform(-1, 1, (1, N_RUNS * N // 10)), 10, axis=1)
    return Record(u, np.zeros((1, N_RUNS * N)), np.tile(0.1 * np.arange(N), N_RUNS), N * np.arange(N_RUNS), 0.1)


def channel(record, term, seed=1):
    """A first-order lag into whose balance a known signal enters; its variables are two signals that are known too."""
    rng = np.random.default_rng(seed)
    z = np.stack([np.convolve(rng.normal(size=record.n_samples), np.ones(12) / 3, "same") for _ in range(2)])
    w, x = term(z), np.zeros(record.n_samples)
    for k in range(1, record.n_samples):
        x[k] = 0.3 if k in record.starts else POLE * x[k - 1] + 0.1 * w[k - 1]
    r = (x + SIGMA * rng.normal(size=x.shape))[None]
    ones = np.ones((1, 1, record.n_samples))
    D = Disturbance(POLE * ones, 0.1 * ones, ones, record.starts, np.array([3.0]), np.array([1e-5]))
    noise = Noise(np.array([SIGMA]), np.array([float(np.std(w)) + 0.05]), 5.0, np.array([1e-4]), 10.0)
    held = np.array([False, False, False, True, True])
    signals = {"a": z[0], "b": z[1]}
    return Channel("x", "state", record, D, noise, LinearModel.of(r), 0.1 * ones[0], None, 1.0, held, signals, -np.inf)


def shape(c, changes=()):
    """The term of a channel in the balance of x, and the formulae of its two signals."""
    drivers = Drivers(c, c.signals, {}, changes=changes)
    return shape_of(drivers, drafts_at(drivers))


def test_a_signal_reaches_the_output_as_the_recursion_says(record):
    c = channel(record, lambda z: np.zeros_like(z[0]))
    signal = np.random.default_rng(2).normal(size=(1, record.n_samples))
    x = np.zeros(record.n_samples)
    for k in range(1, record.n_samples):
        x[k] = 0.0 if k in record.starts else POLE * x[k - 1] + 0.1 * signal[0, k - 1]
    np.testing.assert_allclose(c.respond(signal)[0, 0], x, atol=1e-12)


@pytest.mark.slow
def test_a_curve_follows_the_truth_within_its_bands(record):
    inside = []
    for seed in range(4):
        found = shape(channel(record, lambda z: np.abs(z[0]) - 0.5, seed))
        curve = found.curves[0]
        assert curve.variable == "a" and curve.explained > 0.7
        inside.append(np.mean((np.abs(curve.at) - 0.5 >= curve.low) & (np.abs(curve.at) - 0.5 <= curve.high)))
    assert np.mean(inside) > 0.75


def test_a_law_of_two_terms_is_found_and_ready_as_an_effect(record):
    found = shape(channel(record, lambda z: 0.8 * z[0] * z[1] - 0.6 * z[1] * np.abs(z[1])))
    law = found.effects[0]
    terms = dict(zip((term.text for term in law.terms), law.values))
    assert set(terms) == {"a*b", "b*abs(b)"}
    assert terms["a*b"] == pytest.approx(0.8, abs=0.1) and terms["b*abs(b)"] == pytest.approx(-0.6, abs=0.1)
    assert law.location == "x" and law.variable == "a*b" and law.starts(None) == [law.values]


def test_no_law_is_made_of_noise(record):
    assert shape(channel(record, lambda z: np.zeros_like(z[0]))).candidates == ()


def test_grams_of_runs_add_up_to_the_whole(record):
    c = channel(record, lambda z: z[0])
    columns = np.random.default_rng(3).normal(size=(1, 3, record.n_samples))
    whole, _ = c.D.gram(columns, c.noise)
    np.testing.assert_allclose(c.D.gram_by_run(columns, c.noise)[0].sum(axis=0), whole, rtol=1e-8, atol=1e-8)


def test_a_term_that_begins_at_a_time_is_found(record):
    begun = record.t >= 12.0
    found = shape(channel(record, lambda z: 0.8 * begun * z[0]), changes=[12.0])
    assert [term.text for term in found.effects[0].terms] == ["a*(t > 12)"]
    assert found.effects[0].values[0] == pytest.approx(0.8, abs=0.05)


def test_a_formula_says_what_its_effect_says(record):
    found = shape(channel(record, lambda z: 0.8 * z[0] * z[1]))
    assert found.candidates[0].startswith(found.effects[0].text() + "  (explains ")


def test_a_law_of_states_at_an_input_is_one_at_its_port_and_one_of_inputs_is_along_its_path():
    place = SimpleNamespace(location="u", kind="input")
    drivers = Drivers(place, {"u": np.arange(3.0), "v": np.ones(3)}, {}, along=["u"])
    square = [Term((("square", name, 0.0, 0.0),)) for name in ("u", "v")]
    along, at_port = (drivers.effect([term], np.array([0.1]), False) for term in square)
    assert (along.kind, along.variable) == ("input", None)
    assert isinstance(at_port, LawEffect) and (at_port.location, at_port.variable) == ("u", "v")


@pytest.mark.parametrize(
    ("names", "allowed"),
    [
        (("v", "x", "u"), True),
        (("lag(v)#0",), True),
        (("lag(v)#0", "v"), True),  # the past of a signal beside the signal
        (("lag(v)#0", "v", "t"), True),
        (("lag(v)#0", "x"), False),
        (("lag(v)#0", "v", "x"), False),
        (("lag(v)#0", "lag(v)#1"), False),
    ],
)
def test_a_law_of_a_recent_past_holds_no_other_signal_than_its_own(names, allowed):
    drivers = Drivers(SimpleNamespace(location="x", kind="state"), {}, {"lag(v)#0": 0.3, "lag(v)#1": 1.0})
    assert (
        drivers.allows([Term(((("after" if name == "t" else "square"), name, 0.0, 0.0),)) for name in names]) == allowed
    )


@pytest.mark.parametrize(("hold", "at_the_end"), [("zoh", [1.0, 2.0, 3.0]), ("linear", [2.0, 3.0, 3.0])])
def test_a_held_input_is_the_same_at_the_end_of_a_sample_and_one_that_moves_is_the_next(hold, at_the_end):
    record = Record.from_runs([np.array([[1.0], [2.0], [3.0]])], [np.zeros((3, 1))], [np.arange(3.0)], 1.0)
    plant = SimpleNamespace(states=["v"], inputs=["u"], outputs=["v"], hold=hold, simulator=None)
    place = SimpleNamespace(record=record, location="k", kind="parameter", x=np.array([[4.0, 5.0, 6.0]]), n_moved=1)
    found = drivers_at(SimpleNamespace(problem=SimpleNamespace(plant=plant), fit=None), place, ())
    assert found.ends["u"].tolist() == at_the_end and found.ends["v"].tolist() == [5.0, 6.0, 6.0]


@pytest.mark.parametrize("form", SHAPES)
def test_what_a_term_says_is_what_it_gives(form):
    """Its text, read as a formula, has its value, off the kinks."""
    z, name = np.linspace(-1.9, 1.9, 40), "t" if form == "after" else "z"
    known = {
        name: z,
        "max": np.maximum,
        "min": np.minimum,
        "spline": _spline,
        **{f: getattr(np, f) for f in ("abs", "sign", "sqrt", "sin", "cos", "exp", "tanh", "log")},
    }
    for constant in (0.7, 1.3):
        more = (1.4,) if "{d}" in SHAPES[form].text else ()
        term = Term(((form, name, constant, 1e-9, *more),))
        with np.errstate(all="ignore"):
            written = np.broadcast_to(eval(term.text.replace("^", "**"), {}, known), z.shape)
        there = np.isfinite(written)
        assert there.sum() >= 20 and term.variables == (() if name == "t" else ("z",))
        np.testing.assert_allclose(term.value({"z": z}, z)[there], written[there], rtol=1e-6, atol=1e-8)
    both = Term(((form, name, 0.7, 1e-9, *more), ("size", "w", 0.0, 0.0)))
    assert both.text == f"{Term(both.factors[:1]).text}*abs(w)"


def test_a_law_is_an_effect_that_a_simulator_takes():
    from sksurrogate.effects import AugmentedSimulator
    from sksurrogate.physics import ODESimulator

    plant = ODESimulator(lambda t, x, u, p: [u[0]], states=["x"], inputs=["u"], outputs=["x"], params={}, dt=0.1)
    law = LawEffect("x", "u*x", (Term((("v", "u", 0, 0), ("v", "x", 0, 0))),), (-1.0,))
    y = AugmentedSimulator(plant, [law], [law.values]).simulate(np.ones((50, 1)), x0=[0.0])
    np.testing.assert_allclose(y[:, 0], 1 - np.exp(-0.1 * np.arange(50)), atol=1e-6)  # dx/dt = 1 - x


def test_the_same_shape_on_these_data_stands_once(record):
    c = channel(record, lambda z: z[0])
    positive = np.abs(c.signals["a"]) + 0.5  # v |v| is v^2
    texts = [term.text for term in Library.of(Drivers(c, {"v": positive}, {})).terms]
    assert "v^2" in texts and "v*abs(v)" not in texts


@pytest.mark.parametrize("at_once", [1, 7, 1000])
def test_columns_that_repeat_an_earlier_one_are_left_out_in_blocks_of_any_size(at_once, monkeypatch):
    rng = np.random.default_rng(0)
    new = rng.normal(size=(40, 50))
    columns = np.concatenate([new[:20], -3.0 * new[5:15], new[20:], new[:3]])
    monkeypatch.setattr(_term_library, "COMPARED_AT_ONCE", at_once)
    columns[35], columns[40] = np.nan, 0.0
    kept, unit = _term_library._distinct(*columns.shape, columns.__getitem__)
    assert kept.tolist() == [*range(20), *range(30, 35), *range(36, 40), *range(41, 50)]
    np.testing.assert_allclose(unit, columns[kept] / np.sqrt(np.mean(columns[kept] ** 2, axis=1))[:, None], rtol=1e-14)


def test_a_region_is_named_by_its_edges(record):
    rng = np.random.default_rng(6)
    z = rng.uniform(0, 3, record.n_samples)
    w = np.where((z > 1) & (z < 2), 1.0, 0.0) + 0.05 * rng.normal(size=z.shape)
    first = regions(record, {"z": z, "u": record.u[0]}, w)[0]
    low, high = (float(part.split()[-1]) for part in first["rule"].split(" and "))
    assert low == pytest.approx(1, abs=0.05) and high == pytest.approx(2, abs=0.05)
    assert first["share"] > 0.95


def test_a_force_without_region_is_everywhere(record):
    rng = np.random.default_rng(7)
    found = regions(record, dict(zip("ab", rng.normal(size=(2, record.n_samples)))), rng.normal(size=record.n_samples))
    assert [row["rule"] for row in found] == ["everywhere"]


@pytest.mark.parametrize("what", ["mean", "size"])
def test_the_moment_of_a_change_is_found(record, what):
    rng = np.random.default_rng(8)
    on = record.t >= 9.3
    w = on * (1.0 if what == "mean" else rng.normal(size=on.shape)) + 0.05 * rng.normal(size=on.shape)
    before, after = times(record, w)
    assert before["kind"] == "change" and after["start"] == pytest.approx(9.3, abs=0.2)


def test_a_change_between_runs_is_told_by_run(record):
    w = np.where(record.run_of_row >= 2, 1.0, 0.05) * np.random.default_rng(9).normal(size=record.n_samples)
    assert [row["runs"] for row in times(record, w)] == ["1 to 2", "3 to 4"]


def test_a_controller_is_noticed_and_free_inputs_are_not(record):
    rng = np.random.default_rng(10)
    e = 0.1 * rng.normal(size=(1, record.n_samples))
    reference = np.repeat(rng.uniform(-1, 1, record.n_samples // 50), 50)
    driven = Record((reference - 2.0 * e[0])[None], e, record.t, record.starts, record.dt)
    assert closed_loop(driven, np.zeros_like(e), ["u"]) == "u"
    free = Record(record.u, e, record.t, record.starts, record.dt)
    assert closed_loop(free, np.zeros_like(e), ["u"]) is None


def test_a_stand_in_of_a_linear_simulator_answers_as_it_does(record):
    def simulate(u):
        x, y = np.zeros(2), []
        for k in range(record.n_samples):
            x = np.zeros(2) if k in record.starts else x
            y.append(x[1])
            x = np.array([0.9 * x[0] + 0.2 * u[0, k], 0.1 * x[0] + 0.8 * x[1]])
        return np.array(y)[None]

    stand_in = learn(record, simulate(record.u))
    du = np.repeat(np.random.default_rng(11).normal(size=(1, record.n_samples // 5)), 5, axis=1)
    want = simulate(record.u + du) - simulate(record.u)
    got = stand_in.respond(du[None])[0]
    assert np.sqrt(np.mean((got - want) ** 2)) < 0.02 * np.std(want)


def test_a_signal_that_noise_takes_below_zero_is_positive():
    z = np.abs(np.random.default_rng(12).normal(size=1000))
    for low, positive in ((0.1, True), (0.5, False)):
        terms = terms_of(Drivers(None, {"v": z - low * z.std()}, {}))
        assert ("saturating" in {factor[0] for term in terms for factor in term.factors}) == positive


def test_every_shape_of_a_driver_is_tried_but_those_with_a_meaning_of_their_own():
    """Pieces of a curve and what begins at a time are not shapes of a driver; a fourth power is a square of a square."""
    tried = [shape for family in FAMILIES for shape in family.shapes]
    assert len(tried) == len(set(tried))
    assert set(SHAPES) - set(tried) == {"spline", "after", "fourth"}


def test_a_family_is_tried_for_the_drivers_that_it_suits():
    shapes = {name: {f[0] for f in factors_of("v", z)} for name, z in
              {"both": np.linspace(-1, 1, 50), "above": np.linspace(2, 9, 50), "still": np.ones(50)}.items()}  # fmt: skip
    assert shapes["still"] == set()
    assert "drag" in shapes["both"] - shapes["above"] and "inverse" in shapes["above"] - shapes["both"]


def beam_of(c):
    drivers = Drivers(c, c.signals, {})
    return Beam(Regression(drivers, c.noise), Library.of(drivers))


def test_all_sums_of_two_terms_are_worth_what_their_regression_says(record):
    beam = beam_of(channel(record, lambda z: 0.8 * z[0] * z[1] - 0.6 * z[1] * np.abs(z[1])))
    some = list(range(0, len(beam.library.terms), 17))
    pairs = beam.pairs(some)
    judged = {pair: beam.draft_of(pair).worth for pair in combinations(some, 2)}
    for pair, worth in pairs.items():
        assert worth == pytest.approx(judged[pair], abs=1e-5)
    assert max(pairs.values()) == pytest.approx(max(judged.values()), abs=1e-5)


def test_two_terms_are_found_that_explain_little_alone(record):
    """A difference of two signals that are nearly one: each alone explains a twentieth of it."""
    c = channel(record, lambda z: z[0])
    near = c.signals["a"] + 0.1 * c.signals["b"]
    c.signals["b"] = near
    again = channel(record, lambda z: 10.0 * (near**3 - z[0] ** 3) / np.std(near) ** 2)
    again.signals["b"] = near
    beam = beam_of(again)
    k = {term.text: k for k, term in enumerate(beam.library.terms)}
    pair = k["a^3"], k["b^3"]
    alone = beam.grown((), None)
    assert beam.pairs([*k.values()])[pair] > 2.0 * max(alone[one,] for one in pair)
    best = drafts_at(Drivers(again, again.signals, {}))[0]
    assert {term.text for term in best.terms} == {"a^3", "b^3"}


@pytest.mark.parametrize(("centre", "power"), [(1.3, 3.0), (0.8, 2.5)])
def test_constants_are_found_that_are_not_in_the_library(record, centre, power):
    """A constant less a Hill curve, as a repressed rate: its half and its steepness are between the values tried."""
    c = channel(record, lambda z: np.zeros_like(z[0]))
    level = c.signals["a"] - c.signals["a"].min() + 0.1
    truth = 2.0 - 2.0 * level**power / (centre**power + level**power)
    again = channel(record, lambda z: truth)
    again.signals["a"] = level
    drivers = Drivers(again, again.signals, {})
    found = next(
        draft for draft in drafts_at(drivers)[:3] if {f[0] for term in draft.terms for f in term.factors} == {"hill"}
    )
    left = found.coefficients @ drivers.values(found.terms) - truth
    assert np.std(left) < 0.05 * np.std(truth)


def test_the_best_of_every_size_is_simplest():
    drafts = [Draft((Term(),) * n, np.zeros(n), None) for n in (3, 4, 2, 2, 1, 3)]
    assert simplest(drafts) == [drafts[0], drafts[2], drafts[4]]


def test_a_formula_that_repeats_a_shorter_one_is_left_out():
    v = np.linspace(-1.0, 1.0, 50)
    drafts = [Draft((Term(),) * n, np.zeros(n), None) for n in (2, 1, 2, 1)]
    assert without_repeats(drafts, [3e6 * np.sin(1e-6 * v), v, v + 0.1 * v**3, 2.0 * v]) == drafts[1:]


def test_a_proportional_term_is_no_sine_of_a_frequency_near_zero(record):
    c = channel(record, lambda z: 0.8 * z[0])
    found = drafts_at(Drivers(c, c.signals, {}))
    assert found[0].terms[-1].text == "a"
    assert max(float(np.max(np.abs(draft.coefficients))) for draft in found) < 1e4


def test_a_friction_may_grow_with_the_size_of_another_driver_or_of_a_difference():
    rng = np.random.default_rng(0)
    signals = {name: rng.normal(size=50) for name in ("q", "v", "u")}
    drivers = Drivers(None, {**signals, "load": rng.uniform(1.0, 2.0, 50)}, {})
    terms = {term.factors for term in terms_of(drivers)}
    pairs = {(a[1], b[1]) for a, b in (term for term in terms if len(term) == 2) if (a[0], b[0]) == ("sign", "size")}
    assert {("v", "u"), ("v", "q - u"), ("u", "v")} <= pairs
    assert not {("v", "v"), ("v", "q - v"), ("v", "load"), ("load", "v")} & pairs  # its own size; what has one sign


def test_signals_of_different_units_have_no_difference():
    """A temperature less a power means nothing; where a unit is not known the difference is tried."""
    rng = np.random.default_rng(0)
    signals = {name: rng.normal(size=50) for name in ("room", "wall", "power", "other")}
    units = {"room": "degC", "wall": "degC", "power": "kW"}
    names = {factor[1] for term in terms_of(Drivers(None, signals, {}, units=units)) for factor in term.factors}
    assert {"room - wall", "room - other", "power - other"} <= names
    assert not {"room - power", "wall - power"} & names
