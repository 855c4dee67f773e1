"""Tied candidates in words: the experiment that parts them, and the sentence beside each name."""

import numpy as np

from sksurrogate.gap.decide._estimates import when_they_part
from sksurrogate.gap.decide._experiment import suggestion


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
    assert when_they_part("drag", ["friction"], False, found).endswith("; a faster run separates them.")
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
