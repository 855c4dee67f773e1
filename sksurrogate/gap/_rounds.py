"""A diagnosis in rounds: where the record itself has a fault, once more on the record without it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from sksurrogate.gap._begin import Prepared
from sksurrogate.gap._pipeline import DiagnosisPipeline
from sksurrogate.gap._progress import Progress
from sksurrogate.gap.faults._book import first_look
from sksurrogate.gap.render._report import GapReport
from sksurrogate.kernels.record import Record
from sksurrogate.physics._simulator import Plant
from sksurrogate.runs import Runs

__all__ = ["diagnosed_in_rounds"]


def diagnosed_in_rounds(
    begin: Callable[[Record], Prepared], plant: Plant, runs: Runs, whole: Record, progress: Progress
) -> tuple[DiagnosisPipeline[Any], np.ndarray, GapReport]:
    """Diagnose, and again as long as a fault of the record is found.

    Parameters
    ----------
    begin : callable (record) -> Prepared
        The diagnosis of a record.
    plant : Plant
    runs : Runs
    whole : Record
        As it came.
    progress : Progress

    Returns
    -------
    pipeline : DiagnosisPipeline
        Of the last round.
    rows : ndarray of int
        Rows of the record that it saw.
    report : GapReport
    """
    book = first_look(plant, runs, whole)
    while True:
        pipeline, rows, (second, later) = begin(book.record)
        pipeline.book, pipeline.rows = book, rows
        with second, later:
            report = pipeline.run(progress)
        if report is not None:
            return pipeline, rows, report
        book = pipeline.book
