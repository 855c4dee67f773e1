"""The likely place: that of a certain law, else the one with most evidence."""

from dataclasses import replace

import pytest

from sksurrogate.gap.unnamed._channel import Place
from sksurrogate.gap.unnamed._law_left import LawLeft
from sksurrogate.gap.unnamed._likely_place import likely_place, place_of_law

#: Log likelihoods of the balance and the input; which of them is likely.
CASES = [
    (0.0, 0.0, "state"),  # the same push
    (-2.0, 0.0, "state"),  # as likely
    (-120.0, 0.0, "input"),
    (0.0, -100.0, "state"),
]


@pytest.mark.parametrize(("state", "channel", "kind"), CASES)
def test_the_place_with_most_evidence_is_likely_and_a_balance_before_an_input_that_explains_as_much(
    state, channel, kind
):
    found = [Place("x", "state", state), Place("u", "input", channel), Place("y", "output", -2000.0)]
    found.sort(key=lambda place: -place.log_likelihood)
    assert likely_place(found) == ({"state": "x", "input": "u"}[kind], kind)


def test_a_sensor_is_likely_where_nothing_else_is_likely():
    found = [Place("y", "output", 0.0), Place("x", "state", -50.0), Place("u", "input", -60.0)]
    assert likely_place(found) == ("y", "output")


PLACES = [
    Place("x", "state", 0.0),
    Place("u", "input", 0.0, balance="x"),
    Place("v", "state", -40.0),
    Place("y", "output", -90.0),
]


@pytest.mark.parametrize(
    ("location", "kind", "variable", "place"),
    [
        ("v", "state", "x", ("v", "state")),
        ("y", "output", "y", ("y", "output")),
        ("u", "input", "u", ("u", "input")),
        ("x", "state", "u and its past", ("u", "input")),  # the input pushes this balance and no other
        ("v", "state", "u", ("v", "state")),
    ],
)
def test_a_law_that_tells_the_gap_tells_its_place(location, kind, variable, place):
    law = LawLeft(location, kind, variable, 1.0, 0.1, gain=50.0)
    assert place_of_law(law, PLACES, ["u"]) == place
    assert place_of_law(replace(law, gain=5.0), PLACES, ["u"]) is None
