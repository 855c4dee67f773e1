"""Faults of the record beside faults of the simulator."""

import json
import pickle
import sys
from pathlib import Path

import numpy as np
import pytest

from sksurrogate.gap import GapDiagnoser

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))
from record_cases import make_case

SOME = ["coulomb_friction", "linear_loss", "sensor_bias", "sensor_gain", "input_gain", "sensor_delay"]


def diagnosed(case, **other):
    return GapDiagnoser(case.simulator, effects=SOME, n_jobs=1, random_state=0, **other).fit(
        case.U, case.Y, case.groups
    )


@pytest.fixture(scope="module")
def spiky():
    return diagnosed(make_case("cart", "spikes", True)).report_


def test_a_clean_record_has_no_faults():
    report = diagnosed(make_case("cart", "nothing", True)).report_
    assert len(report.data) == 0 and not report.data and report.data.sentence == ""
    assert [effect.name for effect in report.effects] == ["coulomb_friction"]


def test_spikes_and_friction_are_both_found(spiky):
    assert spiky.data.kinds == ("spikes",)
    assert [effect.name for effect in spiky.effects] == ["coulomb_friction"]
    assert spiky.verdict == "explained"


def test_spikes_alone_leave_no_gap():
    case = make_case("cart", "spikes", False)
    report = diagnosed(case).report_
    fault = report.data[0]
    clean = make_case("cart", "nothing", False)
    assert report.verdict == "none" and report.effects == []
    assert fault.kind == "spikes" and fault.location == "position" and fault.side == "output"
    assert fault.share > 0.5
    assert len(fault.rows) >= 10
    spread = np.std(clean.Y[:, 0])
    jumps = np.abs(np.diff(case.Y[:, 0], prepend=case.Y[0, 0]))
    assert np.all(np.maximum(jumps[list(fault.rows)], np.roll(jumps, -1)[list(fault.rows)]) > 0.04 * spread)


def test_rows_are_those_of_the_user():
    case = make_case("cart", "spikes", False)
    keep = np.r_[np.full(7, -1), np.asarray(case.groups)]
    U, Y = np.vstack([np.zeros((7, 1)), case.U]), np.vstack([np.zeros((7, 1)), case.Y])
    rows = diagnosed(case).report_.data[0].rows
    shifted = GapDiagnoser(case.simulator, effects=SOME, n_jobs=1, random_state=0).fit(U, Y, keep).report_.data[0].rows
    assert shifted == tuple(row + 7 for row in rows)


def test_the_pages_tell_the_record(spiky):
    assert "spikes" in spiky.sentence
    assert "The record" in str(spiky) and "OutlierFilter" in str(spiky)
    assert "<h2>The record</h2>" in spiky.to_html()
    entry = json.loads(spiky.to_json())["data"]["entries"][0]
    assert entry["kind"] == "spikes" and entry["rows"] == list(spiky.data[0].rows)
    assert pickle.loads(pickle.dumps(spiky)).data == spiky.data
    assert spiky.data.table()[0]["readings"] == len(spiky.data[0].rows)
