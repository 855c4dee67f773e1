"""The gap that re-tuning cannot close is computed once, for answers of the arm *detuned*."""

import pytest

from sksurrogate.blind import _retune
from sksurrogate.blind._retune import with_retuning


@pytest.mark.parametrize(
    "row",
    [
        {"arm": "effect", "seed": 1, "right": True},
        {"arm": "detuned", "seed": 1, "right": True, "gap_beyond_retuning": 3.0},
        {"arm": "detuned", "seed": 1, "right": None, "error": "not drawn: ..."},
    ],
    ids=["another arm", "known", "not drawn"],
)
def test_rows_that_need_no_case_are_handed_back(row, monkeypatch):
    monkeypatch.setattr(_retune, "draw", lambda arm, seed: pytest.fail("a case was drawn"))
    assert with_retuning(row) is row


@pytest.mark.parametrize("right", [True, False])
def test_the_gap_of_the_case_is_added(right, monkeypatch):
    row = {"arm": "detuned", "seed": 7, "right": right}
    monkeypatch.setattr(_retune, "draw", lambda *case: case)
    monkeypatch.setattr(_retune, "beyond_retuning", lambda case: {("detuned", 7): 3.5}[case])
    assert with_retuning(row) == {**row, "gap_beyond_retuning": 3.5}
