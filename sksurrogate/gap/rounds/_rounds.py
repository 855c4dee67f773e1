"""A diagnosis in rounds: where the record itself has a fault, once more on the record without it; where it had none, on from there.

Once more, too, where only some of the runs have a gap, and where a disturbance hides what is missing.
"""

from __future__ import annotations

from typing import Any

from sksurrogate.gap._pipeline import DiagnosisPipeline
from sksurrogate.gap._progress import Progress
from sksurrogate.gap.faults._record_book import record_book
from sksurrogate.gap.rounds._some_runs import Answer, Begin, in_some_runs
from sksurrogate.gap.rounds._under_disturbance import under_disturbance
from sksurrogate.kernels.record import Record
from sksurrogate.physics._simulator import Plant
from sksurrogate.runs import Runs


def diagnosed_in_rounds(begin: Begin, plant: Plant, runs: Runs, whole: Record, progress: Progress) -> Answer:
    """Diagnose, again as long as a fault of the record is found; some of the runs alone where only they have a gap, or all under a disturbance.

    ``whole``: as it came.
    Returns the pipeline of the last round, and its report.
    """
    book, before = record_book(plant, runs, whole), list[DiagnosisPipeline[Any]]()
    while True:
        if book.closed:  # the last fault was none: the diagnosis before it goes on
            pipeline = before.pop()
        else:
            pipeline = begin(runs, book.record)
        pipeline.book = book
        report = pipeline.run(progress)
        if report is not None:
            answer = pipeline, report
            asked = begin, runs, book.record, answer, progress
            return in_some_runs(*asked) or under_disturbance(*asked) or answer
        book = pipeline.book
        before += [] if book.closed else [pipeline]
