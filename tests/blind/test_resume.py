"""Which stored rows answer what is asked now, and that none is lost where the file cannot be written."""

import json
from types import SimpleNamespace

import numpy as np
import pytest

from sksurrogate.blind import BlindResult, _campaign, run_blind_check
from sksurrogate.blind._solve import DEFAULT, predict
from sksurrogate.cli import main
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


def test_lines_that_are_no_rows_are_passed_over_and_another_kind_of_file_is_refused(asked, tmp_path):
    file = tmp_path / "rows.jsonl"
    check(file)
    rows = file.read_text()
    for before in ("\ufeff", "null\n", '{"arm": "none"}\n', "[" * 5000 + "\n", '{"seed": ' + "9" * 5000 + "}\n"):
        file.write_text(before + rows, encoding="utf-8")
        assert len(check(file).rows) == 2 and len(asked) == 2
    file.write_bytes(rows.encode("utf-16"))
    with pytest.raises(SurrogateError, match="is no file of rows"):
        check(file)
    for limit in (0, float("nan"), "5", True):
        with pytest.raises(SurrogateError, match=r"limit=.*: expected the seconds for a case, above 0"):
            run_blind_check(2, "none", seed=1, limit=limit)


def test_a_full_disk_does_not_cost_the_rows(asked, tmp_path, monkeypatch):
    def full(path, text):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(_campaign, "append_line", full)
    with pytest.warns(RuntimeWarning, match=r"resume=.* cannot be written \(No space left on device\)"):
        assert [json.dumps(row) for row in check(tmp_path / "rows.jsonl").rows] and len(asked) == 2
    with pytest.raises(SurrogateError, match="is a folder: name a file in it"):
        check(tmp_path)


def test_rows_of_the_built_in_plants_name_no_simulator(asked, tmp_path):
    assert not any("simulator" in row for row in check(tmp_path / "rows.jsonl").rows)
    assert all("simulator" in row for row in check(tmp_path / "rows.jsonl", gain=1.0).rows)


def test_a_page_that_could_not_be_written_is_told_by_the_status(asked, tmp_path, monkeypatch, capsys):
    def full(self, path):
        raise OSError(28, "No space left on device")

    words = ["blind", "--cases", "1", "--arms", "none", "--seed", "1", "--quiet"]
    page = ["--html", str(tmp_path / "page.html")]
    monkeypatch.setattr(BlindResult, "__str__", lambda self: "")
    monkeypatch.setattr(BlindResult, "to_html", lambda self, path: None)
    assert main([*words, *page]) == 0
    monkeypatch.setattr(BlindResult, "to_html", full)
    assert main(words) == 0 and main([*words, *page]) == 1
    assert "the page was not written to" in capsys.readouterr().err


def test_a_prediction_that_fails_is_none():
    def simulate(U, x0=None):
        if U[0, 0] > 1:
            raise FloatingPointError
        return np.ones((len(U), 2)) * x0[0]

    runs, starts = [np.zeros((3, 1)), np.full((4, 1), 2.0)], [[5.0], [6.0]]
    question = SimpleNamespace(X_test=runs, x0_test=starts, X_far=runs[1:], x0_far=starts[1:], y=np.zeros((9, 2)))
    near, none = predict(SimpleNamespace(simulate=simulate), question)
    np.testing.assert_array_equal(near, np.full((3, 2), 5.0))
    np.testing.assert_array_equal(none, np.full((4, 2), np.nan))
    np.testing.assert_array_equal(predict(SimpleNamespace(simulate=simulate), question, far=True), [none])
