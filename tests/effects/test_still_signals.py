"""Signals that never move drive nothing."""

import numpy as np

from sksurrogate.effects import build_effects
from sksurrogate.effects._still import driven_effects, still_signals
from sksurrogate.kernels.record import Record
from sksurrogate.physics import ODESimulator
from sksurrogate.physics._simulator import describe

ROOM = describe(
    ODESimulator(
        lambda t, x, u, p: [u[0] - p["loss"] * (x[0] - u[1])],
        states=["temperature"], inputs=["heater", "outdoors"], outputs=["temperature"], params={"loss": 0.2}, dt=0.1,
    )
)  # fmt: skip


def recorded(heater, outdoors):
    n = len(heater)
    return Record.from_runs(
        [np.column_stack([heater, outdoors])], [np.arange(n)[:, None] / n], [0.1 * np.arange(n)], 0.1
    )


def test_an_input_of_one_value_is_still_and_one_that_switches_is_not():
    switched, level = np.repeat([0.0, 1.0], 10), np.full(20, 5.0)
    assert still_signals(ROOM, recorded(switched, level)) == {"outdoors"}
    assert still_signals(ROOM, recorded(level, switched)) == {"heater"}
    assert still_signals(ROOM, recorded(switched, switched)) == set()


def test_no_candidate_acts_on_or_is_driven_by_what_is_still():
    effects = build_effects(ROOM, ["temperature"], None)
    left = driven_effects(effects, None, ROOM, recorded(np.repeat([0.0, 1.0], 10), np.full(20, 5.0)))
    assert {e.key for e in effects} - {e.key for e in left} == {
        e.key for e in effects if "outdoors" in f"{e.variable} {e.location if e.kind == 'input' else ''}"
    }
    assert any(e.variable == "heater" for e in left)
