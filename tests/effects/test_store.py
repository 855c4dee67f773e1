"""Effects with arguments of their own go through a file: laws that were found, and a user's own."""

import json

import numpy as np
import pytest

from sksurrogate.datasets import make_reactor
from sksurrogate.effects import (
    CATALOGUE,
    AugmentedSimulator,
    BalanceEffect,
    LawEffect,
    Parameter,
    load_augmented,
    save_augmented,
    starting,
)
from sksurrogate.effects._formula import Term
from sksurrogate.exceptions import DataError, SimulatorError

U = np.linspace(0.1, 0.2, 30)[:, None]


class Power(BalanceEffect):
    """``- c v abs(v)^n`` with n, and more, given."""

    name, parameters, equation = "power", (Parameter("coefficient"),), "- c v abs(v)^n"

    def __init__(self, location=None, variable=None, exponent=0.25, more=None):
        super().__init__(location, variable)
        self.exponent = exponent
        self.more = more

    def term(self, t, x, v, theta, width):
        return -theta[0] * v * np.abs(v) ** self.exponent


class NamedByItself(Power):
    """Its name is made of its argument."""

    @property
    def name(self):
        return f"power {self.exponent}"


def through(effect, values, tmp_path, known=()):
    """The simulator with an effect, saved and loaded."""
    first = AugmentedSimulator(make_reactor(), [effect], [values])
    save_augmented(first, tmp_path / "f.json")
    again = load_augmented(make_reactor(), tmp_path / "f.json", effects=known)
    np.testing.assert_array_equal(again.simulate(U), first.simulate(U))
    return again.effects[0]


def test_the_relaxation_of_an_input_has_either_sign_and_that_of_a_state_has_one(tmp_path):
    values = {"coefficient": -0.3, "time_constant": 2.0}
    through(CATALOGUE["hidden_relaxation"]("y", "u"), values, tmp_path)
    with pytest.raises(DataError, match=r"coefficient=-0\.3, expected a finite number from 0"):
        through(CATALOGUE["hidden_relaxation"]("y", "y"), values, tmp_path)


def test_a_law_comes_back_without_being_given(tmp_path):
    terms = (Term((("drag", "y", 0.0, 0.0),)), Term((("above", "u", 0.15, 1e-3), ("v", "y", 0.0, 0.0))), Term())
    law = LawEffect("y", "u*y", terms, (-0.3, np.float64(0.2), 0.1))
    again = through(law, (-0.3, 0.2, 0.1), tmp_path)
    assert type(again) is LawEffect and again.get_params() == law.get_params()


@pytest.mark.parametrize("more", [None, True, 3, "text", [1, (2.0, "a")], {"a": {"tuple": [1]}}, (np.inf,)])
def test_arguments_of_ones_own_come_back(more, tmp_path):
    effect = Power("y", "y", 0.5, more)
    again = through(effect, (0.1,), tmp_path, known=[Power])
    assert again.exponent == 0.5 and repr(again.more) == repr(more)


def test_an_instance_is_as_good_as_its_class(tmp_path):
    again = through(Power("y", "y", np.float64(0.5)), (0.1,), tmp_path, known=[Power(exponent=0.9, more="lent")])
    assert again.exponent == 0.5 and again.more is None
    entry = {"name": "power", "location": "y", "variable": "y", "params": {"coefficient": 1.0}}
    (tmp_path / "old.json").write_text(json.dumps({"effects": [entry], "params": {}}))
    old = load_augmented(make_reactor(), tmp_path / "old.json", effects=Power(exponent=0.9, more="lent"))
    assert old.effects[0].get_params() == {"location": "y", "variable": "y", "exponent": 0.9, "more": "lent"}


def test_a_name_made_by_the_instance_is_found_by_its_class(tmp_path):
    assert type(through(NamedByItself("y", "y", 0.5), (0.1,), tmp_path, known=[Power, NamedByItself])) is NamedByItself


def test_ones_own_effect_of_a_catalogue_name_is_not_taken_for_the_catalogue(tmp_path):
    class Slower(CATALOGUE["input_lag"]):
        pass

    save_augmented(AugmentedSimulator(make_reactor(), [Slower("u")], [(0.05,)]), tmp_path / "f.json")
    with pytest.raises(DataError, match=r"^f\.json: effect 'input_lag' is not in the catalogue; pass its class"):
        load_augmented(make_reactor(), tmp_path / "f.json")
    assert type(load_augmented(make_reactor(), tmp_path / "f.json", effects=[Slower]).effects[0]) is Slower


@pytest.mark.parametrize(
    "more", [np.sin, [{1: 2}], np.zeros(2), {"a": object()}], ids=["callable", "key", "array", "object"]
)
def test_what_cannot_be_written_is_refused_when_saving(more, tmp_path):
    simulator = AugmentedSimulator(make_reactor(), [Power("y", "y", 0.5, more)], [(0.1,)])
    with pytest.raises(
        DataError, match=r"effects: more=.* of Power at 'y' .* cannot be written as text.*skops or joblib"
    ):
        save_augmented(simulator, tmp_path / "f.json")
    assert not (tmp_path / "f.json").exists()


def test_what_could_not_be_read_again_is_refused_when_saving(tmp_path):
    simulator = AugmentedSimulator(make_reactor(), [Power("y", "y", 0.5, "x" * 2**20)], [(0.1,)])
    with pytest.raises(DataError, match="load_augmented reads at most 1048576"):
        save_augmented(simulator, tmp_path / "f.json")
    with pytest.raises(DataError, match=r"note=.*cannot be written as JSON"):
        save_augmented(AugmentedSimulator(make_reactor()), tmp_path / "f.json", note=object())


def test_a_class_that_does_not_take_the_arguments_is_named(tmp_path):
    save_augmented(AugmentedSimulator(make_reactor(), [Power("y", "y")], [(0.1,)]), tmp_path / "f.json")

    class Plain(CATALOGUE["linear_loss"]):
        name = "power"

    with pytest.raises(DataError, match=r"saved with exponent=0.25, which Plain does not take .*'Power', in effects="):
        load_augmented(make_reactor(), tmp_path / "f.json", effects=[Plain])


def test_an_argument_that_is_needed_and_not_there_is_named(tmp_path):
    class Needs(Power):
        def __init__(self, exponent, location=None, variable=None):
            super().__init__(location, variable, exponent)

    entry = {"name": "power", "location": "y", "variable": "y", "params": {"coefficient": 1.0}}
    (tmp_path / "f.json").write_text(json.dumps({"effects": [entry], "params": {}}))
    with pytest.raises(DataError, match="saved without exponent, which Needs needs; pass an instance"):
        load_augmented(make_reactor(), tmp_path / "f.json", effects=[Needs])


def test_the_packages_own_error_is_not_wrapped(tmp_path):
    entry = {"name": "power", "location": "y", "variable": "y", "params": {}}
    (tmp_path / "f.json").write_text(json.dumps({"effects": [entry], "params": {}}))
    with pytest.raises(DataError) as caught:
        load_augmented(make_reactor(), tmp_path / "f.json")
    assert str(caught.value) == "f.json: effect 'power' is not in the catalogue; pass its class in effects=[...]."
    with pytest.raises(DataError, match=r"effects: 'power' is neither a subclass of BaseEffect"):
        load_augmented(make_reactor(), tmp_path / "f.json", effects=["power"])


@pytest.mark.parametrize(
    "arguments", [{"terms": {"term": [["shell", "y", 0, 0]]}}, {"terms": {"eval": "1"}}, {"terms": {}}, ["terms"]]
)
def test_arguments_that_were_tampered_with_are_refused(arguments, tmp_path):
    entry = {"name": "law: y", "class": "LawEffect", "location": "y", "variable": "y", "params": {}}
    text = {"effects": [{**entry, "arguments": arguments}], "params": {}}
    (tmp_path / "f.json").write_text(json.dumps(text))
    with pytest.raises(DataError, match=r"not a file of save_augmented"):
        load_augmented(make_reactor(), tmp_path / "f.json")


def lag(params):
    entry = {"name": "input_lag", "class": "InputLag", "location": "u", "variable": None, "arguments": {}}
    return json.dumps([{**entry, "params": params}])


def stored(effects="[]", params="{}", more=""):
    return f'{{"effects": {effects}, "params": {params}{more}}}'


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (stored(lag({"time_constant": -0.05})), "'input_lag' at 'u': time_constant=-0.05, expected .* from 0 to inf"),
        (stored(lag({"time_constant": float("nan")})), "time_constant=nan, expected a finite number"),
        (stored(lag({"time_constant": float("inf")})), "time_constant=inf, expected a finite number"),
        (stored(lag({"time_constant": True})), "time_constant=True, expected a number"),
        (stored(lag({"time_constant": "0.05"})), "time_constant='0.05', expected a number"),
        (stored(lag({"time_constant": "x" * 38})), "time_constant='x{38}', expected a number"),
        (stored(lag({"time_constant": "x" * 39})), r"time_constant='x{36}\.\.\., expected a number"),
        (stored(lag({"time_constant": 10**400})), "not a file of save_augmented"),
        (stored(lag({"time_constant": 0.05, "delay": 0.1})), r"has the params \['delay', 'time_constant'\], expected"),
        (stored(lag({"time_constant": 1.0}).replace("1.0", '1.0, "time_constant": 2.0')), "is listed twice"),
        (stored(params='{"feed": 4.5, "feed": 5.5}'), "'feed' is listed twice"),
        (stored(params='{"feed": true}'), "params: feed=True, expected a finite number"),
        (stored(params='{"feed": NaN}'), "params: feed=nan, expected a finite number"),
        (stored(params='{"feed": "4.5"}'), "params: feed='4.5', expected a finite number"),
        (stored(params='{"feed": ' + 400 * "1" + "}"), "not a file of save_augmented"),
        (stored(params='{"feed": ' + 5000 * "1" + "}"), "not a file of save_augmented"),
        (stored(lag({"time_constant": 0.05}).replace("{}", '{"before": ' + 400 * "1" + "}")), "beyond 1e308"),
        (stored(more=', "sharpness": 0'), "sharpness=0, expected a number above 0"),
        (stored(more=', "sharpness": -Infinity'), "sharpness=-inf, expected a finite number"),
        (stored(more=', "scale": [1.0, 0.0]'), "scale=0, expected a number above 0"),
        (stored(more=', "scale": [true]'), "scale=True, expected a finite number"),
    ],
)
def test_what_no_diagnosis_writes_is_refused(text, message, tmp_path):
    (tmp_path / "f.json").write_text(text)
    with pytest.raises(DataError, match=message) as caught:
        load_augmented(make_reactor(), tmp_path / "f.json")
    assert str(caught.value).startswith("f.json: ")


def test_a_limit_that_is_never_reached_comes_back(tmp_path):
    again = AugmentedSimulator(make_reactor(), [CATALOGUE["input_saturation"]("u")], [(np.inf,)])
    save_augmented(again, tmp_path / "f.json")
    assert load_augmented(make_reactor(), tmp_path / "f.json").values == [{"limit": np.inf}]


@pytest.mark.parametrize("value", [-0.05, np.nan, np.inf])
def test_a_value_that_could_not_be_read_again_is_refused_when_saving(value, tmp_path):
    slow = AugmentedSimulator(make_reactor(), [CATALOGUE["input_lag"]("u")], [(value,)])
    with pytest.raises(DataError, match="effect 'input_lag' at 'u': time_constant="):
        save_augmented(slow, tmp_path / "f.json")


def _law_in_a_file(tmp_path):
    law = LawEffect("y", "u*y", (Term((("drag", "y", 0.0, 0.0),)),), (-0.3,))
    late = starting(CATALOGUE["input_lag"]("u"), ("onset", "end"))
    first = AugmentedSimulator(make_reactor(), [law, late], [(-0.3,), (0.05, 0.1, 0.2)], scale=[1.0])
    save_augmented(first, tmp_path / "f.json")
    return json.loads((tmp_path / "f.json").read_text())


@pytest.mark.parametrize(
    ("place", "value"),
    [
        (("effects",), {}),
        (("effects",), ""),
        (("scale",), ""),
        (("effects", 0, "location"), ["y"]),
        (("effects", 0, "variable"), 7),
        (("effects", 1, "window"), [["onset"]]),
        (("effects", 1, "window"), ["onset", "onset"]),
        (("effects", 0, "arguments", "values", "tuple"), "x"),
        (("effects", 0, "arguments", "values", "tuple", 0), float("nan")),
        (("effects", 0, "arguments", "terms", "tuple", 0, "term"), {}),
        (("effects", 0, "arguments", "terms", "tuple", 0, "term", 0, 1), None),
        (("effects", 0, "arguments", "terms", "tuple", 0, "term", 0, 2), True),
        (("effects", 0, "arguments", "terms", "tuple", 0, "term", 0, 3), float("inf")),
    ],
)
def test_parts_of_another_kind_are_refused(place, value, tmp_path):
    text = _law_in_a_file(tmp_path)
    assert len(load_augmented(make_reactor(), tmp_path / "f.json").effects) == 2
    entry = text
    for key in place[:-1]:
        entry = entry[key]
    entry[place[-1]] = value
    (tmp_path / "f.json").write_text(json.dumps(text))
    with pytest.raises(DataError, match=r"f\.json|span"):
        load_augmented(make_reactor(), tmp_path / "f.json")


LAG = CATALOGUE["input_lag"]("u")


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (([LAG],), "effects has 1 entries, values 0"),
        (([LAG], [(0.1,), (0.2,)]), "effects has 1 entries, values 2"),
        (([(LAG, (0.1,))], [(0.1,)]), "effects holds"),
        ((["input_lag"], [(0.1,)]), "effects holds 'input_lag', expected effects"),
        (([CATALOGUE["input_lag"]], [(0.1,)]), "effects holds <class"),
        (([LAG], [(0.1, 0.2)]), "got 2 numbers, expected"),
        (([LAG], [(np.nan,)]), "got .nan"),
        (([LAG], [(0.1,)], None, None, [1.0, 2.0]), r"scale has shape \(2,\), expected one size for each of"),
    ],
)
def test_effects_that_do_not_fit_their_values_are_neither_simulated_nor_saved(given, message, tmp_path):
    # What was left out without a word came back as the simulator alone.
    *first, scale = (*given, None) if len(given) < 5 else given
    wrong = AugmentedSimulator(make_reactor(), *first, scale=scale)
    with pytest.raises(SimulatorError, match=message):
        wrong.simulate(np.ones((3, 1)))
    if scale is None:
        with pytest.raises((SimulatorError, DataError)):
            save_augmented(wrong, tmp_path / "f.json")
        assert not (tmp_path / "f.json").exists()


def test_a_right_hand_side_leaves_no_effect_out_without_a_word():
    wrong = AugmentedSimulator(make_reactor(), [CATALOGUE["linear_loss"]("y", "y")])
    with pytest.raises(SimulatorError, match="values 0"):
        wrong.rhs(0.0, np.ones((1, 1)), np.ones((1, 1)), dict(make_reactor().params))


def test_runs_of_other_effects_are_not_saved(tmp_path):
    with pytest.raises(SimulatorError, match="runs has 2 entries, effects 1"):
        save_augmented(AugmentedSimulator(make_reactor(), [LAG], [(0.1,)], runs=[["a"], ["b"]]), tmp_path / "f.json")


def windowed(onset, end, runs=None):
    entry = {"name": "linear_loss", "class": "LinearLoss", "location": "y", "variable": "y", "arguments": {}}
    more = {} if runs is None else {"runs": runs}
    times = {"coefficient": 0.1, "onset": onset, "end": end}
    return {**entry, "window": ["onset", "end"], "params": times, **more}


def read(entries, tmp_path):
    (tmp_path / "f.json").write_text(json.dumps({"effects": entries, "params": {}}))
    return load_augmented(make_reactor(), tmp_path / "f.json")


def test_an_effect_that_is_listed_twice_or_ends_before_it_begins_is_refused(tmp_path):
    assert read([windowed(0.1, 0.2)], tmp_path).values[0]["end"] == 0.2
    for end in (0.1, 0.05):
        with pytest.raises(DataError, match=rf"'linear_loss' at 'y': end={end}, expected a time after its onset=0.1"):
            read([windowed(0.1, end)], tmp_path)
    for runs in ((None, None), (["a"], None), (["a", "b"], ["b"])):
        with pytest.raises(DataError, match="effect 'linear_loss' at 'y' is listed twice"):
            read([windowed(0.1, 0.2, one) for one in runs], tmp_path)
    assert len(read([windowed(0.1, 0.2, ["a"]), windowed(0.1, 0.3, ["b"])], tmp_path).effects) == 2


def test_a_name_that_the_simulator_does_not_have_is_refused_when_saving(tmp_path):
    elsewhere = AugmentedSimulator(make_reactor(), [CATALOGUE["sensor_bias"]("zz")], [(0.1,)])
    retuned = AugmentedSimulator(make_reactor(), retuned={"zz": 3.0})
    for one, words in ((elsewhere, "location='zz' is not an output"), (retuned, "retuned: .* no parameter 'zz'")):
        with pytest.raises((DataError, SimulatorError), match=words):
            save_augmented(one, tmp_path / "f.json")
    assert not (tmp_path / "f.json").exists()


def test_labels_and_values_of_another_kind_are_refused_in_words():
    bias = [CATALOGUE["sensor_bias"]("y")], [(0.1,)]
    for runs, words in (
        (["run1"], r"runs holds 'run1', .* write \['run1'\]"),
        ("a", "runs='a': expected a list"),
        (5, "runs=5"),
    ):
        with pytest.raises(SimulatorError, match=words):
            AugmentedSimulator(make_reactor(), *bias, runs=runs).in_run("run1")
    for value in ("a", None):
        with pytest.raises(SimulatorError, match=r"values of SensorBias.*expected numbers"):
            AugmentedSimulator(make_reactor(), bias[0], [(value,)]).simulate([[0.1]] * 3)
