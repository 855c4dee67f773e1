"""Which stored rows answer what is asked now, and that none is lost where the file cannot be written."""

import json

import pytest

from sksurrogate.blind import BlindResult, _campaign, run_blind_check
from sksurrogate.blind._solve import DEFAULT
from sksurrogate.exceptions import SurrogateError
from sksurrogate.physics import ODESimulator


@pytest.fixture
def asked(monkeypatch):
    """Seeds that are asked, answered at once."""
    seeds = []

    def answered(jobs, n_jobs):
        for arm, seed, _, _, diagnosis, *_ in jobs:
            seeds.append(seed)
            yield {"arm": arm, "seed": seed, "diagnosis": diagnosis}

    monkeypatch.setattr(_campaign, "_answered", answered)
    return seeds


def plant(gain):
    def rhs(t, x, u, p):
        return [u[0] - gain * x[0]]

    return ODESimulator(rhs, states=["x"], inputs=["u"], outputs=["x"], params={}, dt=0.1)


def check(file, gain=None, diagnosis=DEFAULT):
    own = {} if gain is None else {"simulator": plant(gain), "input_ranges": {"u": (0, 1)}}
    return run_blind_check(2, "none", seed=1, resume=file, diagnosis=diagnosis, **own)


def test_rows_of_another_simulator_or_diagnosis_do_not_count(asked, tmp_path):
    file = tmp_path / "rows.jsonl"
    for count, how in enumerate([{}, {"gain": 1.0}, {"gain": 2.0}, {"diagnosis": "a:b"}], start=1):
        for _ in range(2):  # the second time all rows are there
            result = check(file, **how)
            assert len(result.rows) == 2 and len(asked) == 2 * count
    assert len(BlindResult.load(file).rows) == 8


def test_a_case_that_two_processes_have_answered_counts_once(asked, tmp_path):
    file = tmp_path / "rows.jsonl"
    check(file)
    file.write_text(2 * file.read_text())
    assert len(check(file).rows) == 2 and len(asked) == 2


def test_a_full_disk_does_not_cost_the_rows(asked, tmp_path, monkeypatch):
    def full(path, text):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(_campaign, "append_line", full)
    with pytest.warns(RuntimeWarning, match=r"resume=.* cannot be written \(No space left on device\)"):
        assert [json.dumps(row) for row in check(tmp_path / "rows.jsonl").rows] and len(asked) == 2
    with pytest.raises(SurrogateError, match="is a folder: name a file in it"):
        check(tmp_path)
