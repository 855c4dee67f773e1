"""The same case as plants record it: what was measured moves as the plant did, everything else stays."""

import json
from dataclasses import replace

import numpy as np
import pytest

from sksurrogate.blind import draw, run_blind_check
from sksurrogate.blind._campaign import _belongs, run_case
from sksurrogate.blind._march import march
from sksurrogate.blind._records import RECORDS, as_recorded
from sksurrogate.blind._seal import close_seal
from sksurrogate.blind._solve import Solver
from sksurrogate.blind._table import stored_rows
from sksurrogate.exceptions import SurrogateError


@pytest.fixture(scope="module")
def case():
    return draw("unequal", 3)


@pytest.mark.parametrize("record", ["missing", "two_rate"])
def test_readings_that_stay_are_the_same(case, record):
    y, full = as_recorded(case, record).question.y, case.question.y
    known = ~np.isnan(y)
    np.testing.assert_array_equal(y[known], full[known])
    if record == "missing":
        assert known.mean() == pytest.approx(0.8, abs=0.03)
    for r in np.unique(case.question.groups) if record == "two_rate" else ():
        rows = known[case.question.groups == r]
        assert rows[::5].all() and not rows[1:5, 0].any() and rows[:, 1::2].all()


@pytest.mark.slow
def test_readings_of_a_jittering_record_lie_on_the_path_of_the_plant():
    even = draw("none", 5)
    case = as_recorded(even, "jitter")
    X, stamps = case.question.X[:, :-1], case.question.X[:, case.question.time]
    np.testing.assert_array_equal(X, even.question.X)
    dt, first = case.plant.dt, case.question.groups == 0
    shift = stamps[first] / dt - np.arange(first.sum())
    assert set(np.round(shift, 6)) == {-0.2, 0.0, 0.2} and np.all(np.diff(stamps[first]) > 0.5 * dt)
    # the same path read at a tenth of a sample, by steps of another size
    quick = replace(case.plant, dt=dt / 10)
    u = X[first][np.searchsorted(stamps[first], np.arange(10 * first.sum()) * dt / 10 + 1e-9 * dt, side="right") - 1]
    if case.plant.hold == "foh":
        grid = np.arange(10 * first.sum()) * dt / 10
        u = np.column_stack([np.interp(grid, stamps[first], one) for one in X[first].T])
    path = march(quick, u[None], case.starts[:1], (), substeps=3).outputs[0]
    read = [case.plant.outputs.index(name) for name in case.question.simulator.outputs]
    left = case.question.y[first] - path[np.rint(10 * stamps[first] / dt).astype(int)][:, read]
    assert np.all(np.abs(left.std(axis=0) / case.noise - 1.0) < 0.15)


def test_what_cannot_be_recorded_so_is_refused(case):
    with pytest.raises(SurrogateError, match="record='dusty' is unknown; use one of"):
        run_blind_check(1, "none", record="dusty")
    with pytest.raises(SurrogateError, match="robots are recorded complete"):
        run_blind_check(1, "robot_none", record="missing")
    with pytest.raises(SurrogateError, match="held over even samples"):
        as_recorded(replace(case, arm="disturbed"), "jitter")


def answered(question):
    """What was asked, as a diagnosis that knows nothing."""
    n = question.X.shape[1] - len(question.simulator.inputs)
    return {"error": f"{np.isnan(question.y).any()} {n} {question.time is None}"}


@pytest.mark.slow
def test_rows_say_how_they_were_recorded_and_count_for_that_record_alone(tmp_path):
    where = f"{__name__}:answered"
    with Solver(where) as solver:
        rows = [run_case("none", 1, diagnosis=where, record=record, solver=solver) for record in RECORDS]
    assert [row["error"] for row in rows] == ["False 0 True", "True 0 True", "True 0 True", "False 1 False"]
    for row, record in zip(rows, RECORDS):
        assert row.get("record", "complete") == record
        assert [name for name in RECORDS if _belongs(row, where, None, name)] == [record]
    file = tmp_path / "rows.jsonl"
    file.write_text("".join(json.dumps(row) + "\n" for row in [*rows, *rows]))
    assert [row.get("record") for row in stored_rows(file)] == [None, "missing", "two_rate", "jitter"]


def test_rows_that_were_stored_earlier_have_the_keys_of_today(tmp_path):
    file = tmp_path / "rows.jsonl"
    file.write_text('{"arm": "effect", "seed": 1, "accused": "speed", "abreast": 2}\n', encoding="utf-8")
    assert stored_rows(file) == [{"arm": "effect", "seed": 1, "likely_place": "speed", "cases_at_once": 2}]


def test_the_length_of_a_seal_tells_nothing(tmp_path):
    seals = [close_seal({"name": "x" * size}, tmp_path) for size in (1, 300, 4000)]
    assert len({len(seal.path.read_bytes()) for seal in seals}) == 1
    assert [len(seal.open()["name"]) for seal in seals] == [1, 300, 4000]
