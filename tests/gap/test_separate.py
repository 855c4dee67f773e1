"""The next experiment: which one parts tied rivals, and exact twins that none parts."""

import numpy as np

from sksurrogate.gap._separate import _suggestion


def test_an_exact_twin_does_not_hide_the_experiment_that_parts_another_rival():
    apart = {"a faster run": np.array([0.0, 40.0, 8.0]), "a larger run": np.array([0.1, 5.0, 90.0])}
    found = _suggestion(apart, ["drag", "twin", "friction", "loss"])
    assert [(row["experiment"], row["gain"], row["between"]) for row in found.options] == [
        ("a faster run", 8.0, "drag and loss"),
        ("a larger run", 5.0, "drag and friction"),
    ]
    assert "record a faster run" in found.sentence and "Nothing tried here tells twin from drag" in found.sentence


def test_where_nothing_parts_them_only_another_sensor_can():
    found = _suggestion({"the same run": np.array([0.2, np.nan])}, ["drag", "twin", "other"])
    assert found.options[0]["gain"] == 0.2
    assert "Only another sensor" in found.sentence
