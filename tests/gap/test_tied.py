"""Tied candidates in words: the experiment that parts them, and the sentence beside each name."""

import numpy as np

from sksurrogate.gap.decide._estimates import when_they_part
from sksurrogate.gap.decide._experiment import leaves_the_range, suggestion, variations
from sksurrogate.kernels.record import Record


def test_an_exact_twin_does_not_hide_the_experiment_that_parts_another_candidate():
    apart = {"a faster run": np.array([0.0, 40.0, 8.0]), "a larger run": np.array([0.1, 5.0, 90.0])}
    found = suggestion(apart, ["drag", "twin", "friction", "loss"])
    assert [(row["experiment"], row["gain"], row["between"]) for row in found.options] == [
        ("a faster run", 8.0, "drag and loss"),
        ("a larger run", 5.0, "drag and friction"),
    ]
    assert (
        "record a faster run" in found.sentence
        and "None of the simulated experiments separates twin from drag" in found.sentence
    )
    assert (found.named, found.parted) == ("drag", ("friction", "loss"))


def test_where_nothing_parts_them_only_another_sensor_can():
    found = suggestion({"the same run": np.array([0.2, np.nan])}, ["drag", "twin", "other"])
    assert found.options[0]["gain"] == 0.2
    assert "Only another sensor" in found.sentence
    assert found.parted == ()
    assert "none of the experiments tried here separates them" in when_they_part("drag", ["twin", "other"], True, found)


def test_a_sentence_says_only_what_was_computed_for_its_name():
    found = suggestion({"a faster run": np.array([0.0, 40.0])}, ["drag", "twin", "friction"])
    both = when_they_part("drag", ["twin", "friction"], False, found)
    assert "separates it from friction; no experiment is known for the rest" in both
    assert when_they_part("drag", ["friction"], False, found).endswith(
        '; the experiment "a faster run" separates them.'
    )
    assert "no experiment was computed for this pair (the suggested one concerns drag)" in when_they_part(
        "bias", ["gain"], True, found
    )


def test_without_ties_it_says_so():
    assert when_they_part("drag", [], True, None) == "No other effect of the catalogue explains these data as well."
    assert "Only richer forms (power_law)" in when_they_part("drag", [], True, None, ["power_law"])


def test_an_experiment_within_the_recorded_inputs_comes_first_where_it_settles_the_question():
    apart = {"a larger run": np.array([90.0]), "a faster run": np.array([8.0]), "the same run": np.array([0.1])}
    found = suggestion(apart, ["drag", "friction"], beyond={"a larger run"})
    assert [(row["experiment"], row["within"]) for row in found.options] == [
        ("a faster run", True),
        ("a larger run", False),
        ("the same run", True),
    ]
    assert "recorded range" not in found.sentence
    apart["a faster run"] = np.array([1.0])
    assert "make sure that the plant allows" in suggestion(apart, ["drag", "friction"], {"a larger run"}).sentence


def test_inputs_that_could_be_applied_are_what_their_names_say():
    t = np.arange(40)
    u = np.stack([3.0 + np.sin(0.3 * t), np.where(t < 20, -1.0, 1.0)])
    record = Record.from_runs([u.T, u.T + 9], [np.zeros((40, 1))] * 2, [t, t], 1.0)
    varied = variations(record, ["force", "valve"])
    mean, away = u.mean(axis=1), u - u.mean(axis=1, keepdims=True)
    spread = np.abs(away).max(axis=1)
    np.testing.assert_array_equal(varied.pop("the same run again"), u)
    for words, factor in [("twice as far from their mean", 2.0), ("half as far from their mean", 0.5)]:
        np.testing.assert_allclose(varied.pop(f"a run with inputs {words}"), mean[:, None] + factor * away)
    shifted = varied.pop("a run with inputs shifted up by their amplitude")
    np.testing.assert_allclose(shifted - u, np.tile(spread[:, None], 40))
    np.testing.assert_array_equal(varied.pop("a run with inputs twice as fast")[:, :20], u[:, ::2])
    np.testing.assert_array_equal(varied.pop("a run with inputs half as fast")[:, ::2], u[:, :20])
    step = varied.pop("a run with a step in every input")
    np.testing.assert_allclose(step, np.where(t < 10, (mean - 0.5 * spread)[:, None], (mean + spread)[:, None]))
    for i, name in enumerate(("force", "valve")):
        only = varied.pop(f"a run in which only {name} moves")
        np.testing.assert_array_equal(only[i], u[i])
        np.testing.assert_allclose(only[1 - i], mean[1 - i])
    assert not varied and len(variations(record, ["force"])) == 7


def test_rounding_at_either_end_does_not_leave_the_range_and_a_thousandth_does():
    recorded = np.array([[-2.0, 1.0, 3.0]])
    for low, high in ((-2.0, 3.0), (-2.0 - 1e-12, 3.0), (-2.0, 3.0 + 1e-12)):
        assert not leaves_the_range(np.array([[low, high]]), recorded)
    for low, high in ((-2.005, 3.0), (-2.0, 3.005)):
        assert leaves_the_range(np.array([[low, high]]), recorded)
