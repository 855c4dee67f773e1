"""Rounds of a diagnosis: a fault begins a new one on another record; one that was none lets the last one go on where it was."""

from types import SimpleNamespace

import numpy as np
import pytest

from sksurrogate.gap._pipeline import STAGES, DiagnosisPipeline
from sksurrogate.gap._progress import Progress
from sksurrogate.gap.rounds import _rounds


def book(name, closed=False):
    return SimpleNamespace(record=name, closed=closed)


class Planned(DiagnosisPipeline):
    """A pipeline that only notes its stages; ``after``: the book that it leaves after the third stage, where it has its own."""

    def __init__(self, record, after, log):
        self.record, self.after, self.log, self.asked, self.time_limit = record, after, log, 0, None
        self.search = SimpleNamespace(second=_Nothing(), later=_Nothing())

    def ask(self, stage):
        self.log.append((self.record, stage.name))
        if stage.name == "record" and self.after is not None:
            self.book = self.after

    def answer(self):
        return self.record


class _Nothing:
    def __enter__(self):
        return self

    def __exit__(self, *raised):
        return None


@pytest.mark.parametrize("plan", ["refused", "kept", "second_refused"])
def test_a_round_goes_on_where_the_next_one_refused_its_fault(monkeypatch, plan):
    first, second, third = book("as it came"), book("one fault"), book("two faults")
    after = {
        "refused": {"as it came": second, "one fault": book("as it came", closed=True)},
        "kept": {"as it came": second},
        "second_refused": {"as it came": second, "one fault": third, "two faults": book("one fault", closed=True)},
    }[plan]
    log = []
    monkeypatch.setattr(_rounds, "record_book", lambda plant, runs, whole: first)
    monkeypatch.setattr(_rounds, "in_some_runs", lambda *given: None)
    monkeypatch.setattr(_rounds, "under_disturbance", lambda *given: None)
    begun = []

    def begin(runs, record):
        begun.append(record)
        return Planned(record, after.get(record), log)

    pipeline, report = _rounds.diagnosed_in_rounds(begin, None, None, np.zeros(1), Progress(None, None))
    assert report == {"refused": "as it came", "kept": "one fault", "second_refused": "one fault"}[plan]
    assert pipeline.record == report
    assert len(begun) == len(set(begun))  # no search is made twice
    assert [name for record, name in log if record == report] == [stage.name for stage in STAGES]
