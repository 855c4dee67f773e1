"""Of a balance and an input that pushes it, the one is likely that tells the force."""

from dataclasses import replace

import pytest

from sksurrogate.gap.unnamed._channel import Place
from sksurrogate.gap.unnamed._law_evidence import LawBeside
from sksurrogate.gap.unnamed._likely_place import likely_place, place_of_law

#: Log likelihoods of the balance and the input; R2 of the force from the input alone and from everything; who did it.
CASES = [
    (0.0, 0.0, 0.95, 0.96, "input"),  # a dead zone: the same push, and the input tells it
    (0.0, 0.0, 0.40, 0.90, "state"),  # a spring: the same push, and the states tell it
    (0.0, 0.0, 0.10, 0.05, "state"),  # nothing tells a disturbance
    (-120.0, 0.0, -0.02, 0.92, "state"),  # likelier at the input, but a law of the states
    (-120.0, 0.0, 0.60, 0.61, "input"),
    (-900.0, 0.0, -0.02, 0.92, "input"),  # too unlikely
    (-2.0, 0.0, 0.40, 0.45, "state"),  # as likely
    (0.0, -100.0, 0.77, 0.74, "input"),  # a curved input of a bilinear plant
    (0.0, -100.0, 0.45, 0.44, "state"),
]


@pytest.mark.parametrize(("state", "channel", "alone", "everything", "kind"), CASES)
def test_the_place_that_tells_the_force_is_likely(state, channel, alone, everything, kind):
    found = [Place("x", "state", state), Place("u", "input", channel), Place("y", "output", -2000.0)]
    found.sort(key=lambda place: -place.log_likelihood)
    assert likely_place(found, lambda *_: (alone, everything)) == ({"state": "x", "input": "u"}[kind], kind)


def test_a_sensor_is_likely_where_nothing_else_is_likely():
    found = [Place("y", "output", 0.0), Place("x", "state", -50.0), Place("u", "input", -60.0)]
    assert likely_place(found, lambda *_: (0.9, 0.9)) == ("y", "output")


PLACES = [Place("x", "state", 0.0), Place("u", "input", 0.0), Place("v", "state", -40.0), Place("y", "output", -90.0)]


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
    law = LawBeside(0.0, 20.0, location, kind, variable, 1.0, 0.1, (0, 0, None), gain=50.0)
    assert place_of_law(law, PLACES, ["u"]) == place
    assert place_of_law(replace(law, gain=5.0), PLACES, ["u"]) is None
