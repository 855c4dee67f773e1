"""Withheld on real recordings: the nominal simulators are those of the literature; one recording goes end to end."""

import os
import sys
from pathlib import Path

import numpy as np
import pytest

from sksurrogate.blind._truths import KINDS, twins_of
from sksurrogate.exceptions import SurrogateError

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))
from withheld_recordings import HEAVY, _errors, recorded, run_recorded

SHARED = Path(os.environ.get("SKSURROGATE_DATA") or Path(__file__).parents[2].parent / "shared" / "data")
here = pytest.mark.skipif(not SHARED.exists(), reason="the real recordings are not on this machine")


@here
@pytest.mark.parametrize("name", ["silverbox", "cascaded_tanks", "heat_exchanger", "Golf Ball", "Tennis Ball"])
def test_recordings_fit_their_simulators(name):
    recording = recorded(name, SHARED)
    assert set(recording.documented) <= set(KINDS)
    assert len(recording.X) == len(recording.y) == len(recording.groups)
    U, y, x0, _ = recording.tests[0]
    predicted = recording.simulator.simulate(U[:200], x0=None if x0 is None or isinstance(x0, str) else x0)
    assert predicted.shape == y[:200].shape and np.isfinite(predicted).all()


@here
def test_free_fall_misses_the_air_on_light_balls_only():
    start = np.zeros(2)
    errors = {}
    for name in ("Golf Ball", "Orange Whiffle Ball"):
        recording = recorded(name, SHARED)
        errors[name] = _errors(recording, recording.simulator, start)[0]
    assert errors["Golf Ball"] < 0.3 and errors["Orange Whiffle Ball"] > 2.0
    assert recorded(HEAVY[0], SHARED).documented == ()


@pytest.mark.slow
@here
def test_a_light_ball_end_to_end():
    """With and without the effect's class in the catalogue."""
    row = run_recorded(["Orange Whiffle Ball"], SHARED)[0]
    assert row["verdict"] == "explained" and row["place"] == "velocity"
    assert row["after"][0] < 0.2 * row["before"][0]
    held = run_recorded(["Orange Whiffle Ball"], SHARED, withhold=True)[0]
    assert held["recording"].endswith("(withheld)")
    gone = {"quadratic_drag", *twins_of("quadratic_drag")}
    assert not any(part.split(" at ")[0] in gone for part in held["named"].split(", "))


def test_a_recording_that_is_not_there_is_a_row_that_says_so(tmp_path):
    row = run_recorded(["Golf Ball"], tmp_path)[0]
    assert "is not there" in row["error"]
    with pytest.raises(SurrogateError, match="is not there"):
        recorded("Golf Ball", tmp_path)
