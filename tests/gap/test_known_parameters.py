"""What users know: bounds and priors of parameters, effects and places that are excluded or plausible, on both kinds of simulators."""

import numpy as np
import pytest

from sksurrogate.effects import build_effects
from sksurrogate.effects._allowed import allowed_effects, closed_places
from sksurrogate.exceptions import DataError
from sksurrogate.gap import GapDiagnoser
from sksurrogate.gap.fit._known_parameters import KnownParameters
from sksurrogate.physics import ODESimulator
from sksurrogate.physics._simulator import describe

SMALL = ["sensor_bias", "input_bias", "parameter_error"]


def level(t, x, u, p):
    return (u[0] - p["k"] * x[0] + p["leak"],)


def plant(**params):
    return ODESimulator(
        level, states=["level"], inputs=["flow"], outputs=["level"], params={"k": 1.0, "leak": 0.0, **params}, dt=0.1
    )


class Trajectories:
    """The same plant seen from outside."""

    states, inputs, outputs, dt = ("level",), ("flow",), ("level",), 0.1

    def __init__(self, params=None):
        self.params = params or {"k": 1.0, "leak": 0.0}

    def get_params(self, deep=True):
        return {"params": self.params, **{f"params__{name}": value for name, value in self.params.items()}}

    def set_params(self, **changes):
        self.params = {**self.params, **{name.removeprefix("params__"): value for name, value in changes.items()}}
        return self

    def simulate(self, U, x0=None, t=None):
        return plant(**self.params).simulate(U, x0=x0)


@pytest.fixture(scope="module")
def data():
    rng = np.random.default_rng(0)
    U = np.repeat(rng.uniform(0, 2, 40), 5)[:, None]
    runs = np.repeat([0, 1], 100)
    y = np.concatenate([plant(k=1.5).simulate(U[runs == run], x0=[0.0]) for run in (0, 1)])
    return U, y + 0.01 * rng.normal(size=y.shape), runs


def diagnosed(simulator, data, **settings):
    U, y, runs = data
    settings = {"effects": SMALL[:2], "free_params": ["k"], "n_jobs": 1, "random_state": 0, **settings}
    return GapDiagnoser(simulator, **settings).fit(U, y, groups=runs).report_


SIMULATORS = pytest.mark.parametrize("simulator", [plant(), Trajectories()], ids=["rhs", "simulate"])


@pytest.mark.slow
@SIMULATORS
def test_a_value_at_its_bound_stays_there_and_is_said_so(simulator, data):
    report = diagnosed(simulator, data, bounds={"k": (0.5, 1.2)})
    row = report.retuned[0]
    assert row["at_bound"] and row["value"] == pytest.approx(1.2) and row["high"] <= 1.2 + 1e-9
    assert any("Re-tuned to a bound: k = 1.2" in note for note in report.notes)


@pytest.mark.slow
@SIMULATORS
def test_inside_its_bounds_a_value_is_where_the_data_want_it(simulator, data):
    row = diagnosed(simulator, data, bounds={"k": (0.5, None)}).retuned[0]
    assert not row["at_bound"] and row["value"] == pytest.approx(1.5, rel=0.02)


@pytest.mark.slow
@SIMULATORS
def test_a_tight_prior_wins_and_a_wide_one_leaves_the_data_alone(simulator, data):
    tight = diagnosed(simulator, data, priors={"k": (1.3, 1e-5)}).retuned[0]["value"]
    wide = diagnosed(simulator, data, priors={"k": 0.5}).retuned[0]
    assert tight == pytest.approx(1.3, rel=1e-3)
    assert wide["value"] == pytest.approx(1.5, rel=0.01) and wide["low"] < 1.5 < wide["high"]


@pytest.mark.slow
def test_a_parameter_that_is_known_is_not_named_as_wrong(data):
    settings = {"free_params": (), "effects": ["parameter_error"], "exclude": ["leak"]}
    loose = diagnosed(plant(), data, **settings)
    assert [effect.location for effect in loose.effects] == ["k"]
    bounded = diagnosed(plant(), data, bounds={"k": (0.9, 1.1)}, **settings)
    assert all(abs(effect.params["relative_error"]) <= 0.1 + 1e-9 for effect in bounded.effects)


def test_bounds_and_priors_in_the_coordinates_of_a_fit():
    known = KnownParameters({"k": (-4.0, -1.0), "c": (-1.0, 2.0)}, {"k": (-2.0, 0.2)})
    known.check({"k": -2.0, "c": 0.0})
    assert known.free_bounds("k", -2.0) == pytest.approx((-np.log(2), np.log(2)))
    assert known.free_bounds("c", 0.0) == (-1.0, 2.0)
    assert known.free_prior("k", -1.0, 0.7) == pytest.approx((np.log(2), 0.1))
    low, high = known.free_bounds("q", 1.0)
    assert low == -high == -4.0
    far = KnownParameters({"k": (100.0, np.inf)})
    low, high = far.free_bounds("k", 1.0)
    assert low == pytest.approx(np.log(100.0)) and low < high < np.inf


@pytest.mark.parametrize(
    ("settings", "error", "message"),
    [
        (
            {"bounds": {"q": (0, 1)}},
            DataError,
            r"bounds names 'q', which is not a parameter of the simulator.*'k', 'leak'",
        ),
        ({"bounds": {"k": (3, 1)}}, DataError, r"bounds\['k'\]=\(3, 1\): expected \(low, high\)"),
        ({"bounds": {"k": (-3, -1)}}, DataError, r"bounds\['k'\]=\(-3, -1\) holds no value of the sign"),
        ({"bounds": 3}, DataError, "bounds=3: expected a dict by name"),
        ({"priors": {"k": 0.0}}, DataError, r"priors\['k'\]=0.0: expected a relative standard deviation above 0"),
        ({"priors": {"k": (1.0, 2.0, 3.0)}}, DataError, r"priors\['k'\].*\(mean, standard deviation\)"),
        ({"priors": {"leak": 0.1}}, DataError, r"priors\['leak'\]=0.1 is relative to the simulator's leak, which is 0"),
        ({"priors": {"q": 0.1}}, DataError, "priors names 'q'"),
        ({"priors": {"k": (-1.0, 0.1)}}, DataError, r"priors\['k'\]=\(-1, 0.1\) holds no value of the sign"),
        ({"exclude": ["sensor_bia"]}, DataError, "exclude holds 'sensor_bia'.*did you mean 'sensor_bias'"),
        ({"exclude": [("drift", "levl")]}, DataError, "'levl' is not a place of the simulator .did you mean 'level'"),
        ({"exclude": [3]}, DataError, "exclude holds 3: expected names of effects"),
        ({"exclude": 3}, DataError, "exclude=3: expected names"),
        ({"exclude": SMALL}, DataError, "leaves none of the 2 effects"),
        ({"exclude": [(None, None)]}, DataError, r"exclude holds \(None, None\): expected names"),
        ({"exclude": ["sensr_*"]}, DataError, r"'sensr_\*' is neither an effect nor a place"),
        (
            {"plausible": [("sensor_bias", "levl")]},
            DataError,
            r"plausible holds \('sensor_bias', 'levl'\): 'levl' is not a place of the simulator .did you mean 'level'.*plausible=\[",
        ),
        ({"plausible": 3}, DataError, "plausible=3: expected names"),
        ({"plausible": [3]}, DataError, "plausible holds 3: expected names"),
        (
            {"plausible": ["drift"]},
            DataError,
            r"plausible=\['drift'\] leaves none of the 2 effects: give more names or places",
        ),
    ],
)
def test_mistakes_are_named_as_typed(settings, error, message, data):
    with pytest.raises(error, match=message):
        diagnosed(plant(), data, **settings)


@pytest.mark.parametrize(
    ("exclude", "gone"),
    [
        ("sensor_bias", {("sensor_bias", "level", None)}),
        ([("parameter_error", "k")], {("parameter_error", "k", None)}),
        (["flow"], {("input_bias", "flow", None)}),
        ([(None, "flow")], {("input_bias", "flow", None)}),
        ([("linear_loss", "level", "flow")], {("linear_loss", "level", "flow")}),
        (["sensor_*", ("*_error", "leak")], {("sensor_bias", "level", None), ("parameter_error", "leak", None)}),
        ([(None, None, "flow")], {("linear_loss", "level", "flow")}),
        (None, set()),
    ],
)
def test_what_is_excluded_is_no_candidate(exclude, gone):
    described = describe(plant())
    effects = build_effects(described, ["level"], [*SMALL, "linear_loss"])
    kept = allowed_effects(effects, exclude, None, described)
    assert {e.key for e in effects} - {e.key for e in kept} == gone


@pytest.mark.slow
@SIMULATORS
def test_a_diagnosis_looks_only_at_what_is_not_excluded(simulator, data):
    report = diagnosed(simulator, data, free_params=(), effects=SMALL, exclude=["parameter_error", "level"])
    assert {row["location"] for row in report.ranking} == {"flow"}


def cart(t, x, u, p):
    q, v, w = x
    return v, u[0] - q - p["c"] * v, u[0] - w


CART = describe(ODESimulator(cart, states=["q", "v", "w"], inputs=["u"], outputs=["q", "v"], params={"c": 0.1}, dt=0.1))
CANDIDATES = build_effects(
    CART, ["v", "w"], ["coulomb_friction", "stribeck_friction", "drift", "sensor_bias", "input_bias"]
)


@pytest.mark.parametrize(
    ("plausible", "kept"),
    [
        (None, lambda name, place, by: True),
        ("drift", lambda name, place, by: name == "drift"),
        (["drift", "sensor_*"], lambda name, place, by: name in ("drift", "sensor_bias")),
        (["v"], lambda name, place, by: place == "v"),
        (["drift", "v"], lambda name, place, by: name == "drift" and place == "v"),
        ([("*friction", "v")], lambda name, place, by: "friction" not in name or place == "v"),
        ([("*friction", "v"), ("drift", "w")], lambda name, place, by: place == ("v" if "friction" in name else "w" if name == "drift" else place)),
        (["u", ("*friction", "v")], lambda name, place, by: place == ("v" if "friction" in name else "u")),
        ([("coulomb_friction", None, "w")], lambda name, place, by: name != "coulomb_friction" or by == "w"),
    ],
)  # fmt: skip
def test_effects_act_where_they_are_plausible(plausible, kept):
    found = [effect.key for effect in allowed_effects(CANDIDATES, (), plausible, CART)]
    assert found == [effect.key for effect in CANDIDATES if kept(*effect.key)]


def test_what_is_excluded_is_not_plausible():
    found = allowed_effects(CANDIDATES, ["v"], ["drift", "sensor_bias"], CART)
    assert {effect.key[:2] for effect in found} == {("drift", "w"), ("sensor_bias", "q")}


def test_no_law_is_looked_for_where_no_effect_may_act():
    assert closed_places(["v", "drift"], None, CART) == {"v"}
    assert closed_places((), ["v", ("drift", "w")], CART) == {"q", "u"}
    assert closed_places((), [("drift", "w")], CART) == closed_places((), ["drift"], CART) == set()


@pytest.mark.slow
def test_friction_that_acts_elsewhere_than_where_it_is_plausible_gets_no_name(data):
    U, _, runs = data
    true = ODESimulator(
        lambda t, x, u, p: (u[0] - 0.5 * x[0] - 0.3 * np.tanh(50 * x[0]), x[0] - x[1]),
        states=["a", "b"], inputs=["u"], outputs=["a", "b"], params={}, dt=0.1,
    )  # fmt: skip
    model = ODESimulator(
        lambda t, x, u, p: (u[0] - 0.5 * x[0], x[0] - x[1]),
        states=["a", "b"], inputs=["u"], outputs=["a", "b"], params={}, dt=0.1,
    )  # fmt: skip
    rng = np.random.default_rng(1)
    y = np.concatenate([true.simulate(U[runs == run] - 1.0) for run in (0, 1)]) + 0.005 * rng.normal(size=(200, 2))
    settings = {"effects": ["coulomb_friction", "sensor_bias"], "free_params": (), "exclude": [(None, None, "b")]}
    free = diagnosed(model, (U - 1.0, y, runs), **settings)
    assert [(e.name, e.location) for e in free.effects] == [("coulomb_friction", "a")]
    right = diagnosed(model, (U - 1.0, y, runs), plausible=[("*friction", "a")], **settings)
    assert [(e.name, e.location) for e in right.effects] == [("coulomb_friction", "a")]
    wrong = diagnosed(model, (U - 1.0, y, runs), plausible=[("*friction", "b")], **settings)
    assert not wrong.effects and wrong.verdict == "unknown"
    assert not any(row["name"] == "coulomb_friction" and row["location"] == "a" for row in wrong.ranking)


@pytest.mark.slow
def test_a_parameter_with_the_wrong_sign_is_named_and_said_to_be_one():
    def pendulum(k):
        def rhs(t, x, u, p):
            return x[1], u[0] - 2 * x[0] - p["b"] * x[1] - p["k"] * np.sin(x[0])

        return ODESimulator(rhs, states=["q", "v"], inputs=["u"], outputs=["q"], params={"b": 0.3, "k": k}, dt=0.05)

    rng = np.random.default_rng(0)
    U = np.repeat(rng.uniform(-2, 2, (2, 20)), 15, axis=1)[..., None]
    Y = pendulum(-0.8).simulate_batch(U) + 0.003 * rng.normal(size=U.shape)
    runs = np.repeat([0, 1], U.shape[1])
    report = GapDiagnoser(pendulum(0.8), n_jobs=1).fit(U.reshape(-1, 1), Y.reshape(-1, 1), runs).report_
    assert [(effect.name, effect.location) for effect in report.effects] == [("parameter_error", "k")]
    assert report.effects[0].params["relative_error"] == pytest.approx(-2.0, abs=0.01)
    assert any(note.startswith("k has the other sign (0.8 -> -0.8") for note in report.notes)
