"""The table of places: what named effects hold where effects are named, what a free signal tells where none is."""

import numpy as np
import pytest

from sksurrogate.gap.results._effect_estimate import EffectEstimate
from sksurrogate.gap.unnamed._channel import Place
from sksurrogate.gap.unnamed._where import by_location, named_places

#: A force in the velocity is likeliest at the input, which pushes it.
FOUND = [Place("force", "input", 120.0), Place("velocity", "state", 118.0), Place("position", "output", 20.0)]


def estimate(name, location, share):
    return EffectEstimate(name, location, None, share, {}, {}, 1.0, [], "")


def test_named_effects_hold_the_shares_of_their_places():
    effects = [estimate("constant_bias", "velocity", 0.5), estimate("parameter_error", "mass", 0.3)]
    effects.append(estimate("linear_loss", "velocity", 0.2))
    kinds = {("constant_bias", "velocity", None): "state", ("linear_loss", "velocity", None): "state"}
    named = named_places(effects, kinds)
    assert named[0] == ("velocity", "state", 0.5) and named[1] == ("mass", "parameter", 0.3)
    table = list(by_location(FOUND, named))
    assert [(row["location"], row["share"]) for row in table] == [
        ("velocity", pytest.approx(0.7)),
        ("mass", 0.3),
        ("force", 0.0),
        ("position", 0.0),
    ]
    assert table[0]["evidence"] == pytest.approx(98.0) and np.isnan(table[1]["evidence"])


def test_without_a_name_shares_are_probabilities_of_a_free_signal():
    share = {row["location"]: row["share"] for row in by_location(FOUND)}
    assert sum(share.values()) == pytest.approx(1.0)
    assert share["force"] / share["velocity"] == pytest.approx(np.exp(2.0))


def test_a_share_that_is_not_known_is_none():
    table = list(by_location(FOUND, named_places([estimate("constant_bias", "velocity", float("nan"))], {})))
    assert {row["share"] for row in table} == {0.0}
