"""Rows of a table that are made when they are asked for, so that a large one never stands in memory."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence

import numpy as np

#: Rows that the runs of a block must have on average to be copied run by run; below, single rows are fetched.
_FEWEST_ROWS_IN_RUN = 32


class RowSource(ABC):
    """A table of floats (n_rows, n_columns) whose rows are made when they are asked for."""

    shape: tuple[int, int]

    def __len__(self) -> int:
        return self.shape[0]

    def __getitem__(self, which: slice | np.ndarray) -> np.ndarray:
        """Some rows, (n, n_columns)."""
        if isinstance(which, slice):
            first, last, step = which.indices(len(self))
            if step == 1:
                return self.between(first, max(first, last))
            which = np.arange(first, last, step)
        return self.at(np.asarray(which))

    @abstractmethod
    def between(self, first: int, last: int) -> np.ndarray:
        """Rows first..last - 1."""

    @abstractmethod
    def at(self, rows: np.ndarray) -> np.ndarray:
        """Rows of these numbers."""


class LagRows(RowSource):
    """The lag matrix of runs: ``values[t - lag, column]`` of every row t with whole history, run after run.

    ``tables`` sequence of sequence of (n_samples_of_the_run, n_columns): for each run its tables, for example past
        outputs and inputs.
    ``terms`` sequence of (table, column, lag): what the columns of the lag matrix are.
    ``n_first``: rows of each run that lack history: at least the longest lag.

    >>> import numpy as np
    >>> y = np.arange(5.0)[:, None]
    >>> rows = LagRows([(y,), (y + 10,)], [(0, 0, 1), (0, 0, 2)], n_first=2)
    >>> rows.shape
    (6, 2)
    >>> rows[2:4]
    array([[ 3.,  2.],
           [11., 10.]])
    """

    def __init__(
        self, tables: Sequence[Sequence[np.ndarray]], terms: Sequence[tuple[int, int, int]], n_first: int
    ) -> None:
        self.tables, self.terms, self.n_first = tables, terms, n_first
        self.begins = np.cumsum([0, *(len(run[0]) - n_first for run in tables)])
        self.shape = (int(self.begins[-1]), len(terms))

    def between(self, first: int, last: int) -> np.ndarray:
        """Rows first..last - 1, column by column in memory."""
        r = int(np.searchsorted(self.begins, first, side="right")) - 1
        end = int(np.searchsorted(self.begins, last, side="left"))
        if (end - r - 2) * _FEWEST_ROWS_IN_RUN > last - first:
            return self.at(np.arange(first, last))
        out = np.empty((len(self.terms), last - first))
        for run in range(r, end):
            a, b = max(first, int(self.begins[run])), min(last, int(self.begins[run + 1]))
            start = self.n_first + a - int(self.begins[run])
            tables, n = self.tables[run], b - a
            for row, (table, column, lag) in zip(out, self.terms):
                row[a - first : b - first] = tables[table][start - lag : start - lag + n, column]
        return out.T

    def at(self, rows: np.ndarray) -> np.ndarray:
        """Rows of these numbers."""
        rows = np.where(rows < 0, rows + len(self), rows)
        out = np.empty((len(self.terms), len(rows)))
        runs = np.searchsorted(self.begins, rows, side="right") - 1
        places = rows - self.begins[runs] + self.n_first
        order = np.argsort(runs, kind="stable")
        for part in np.split(order, np.flatnonzero(np.diff(runs[order])) + 1):
            if len(part):
                tables = self.tables[int(runs[part[0]])]
                for row, (table, column, lag) in zip(out, self.terms):
                    row[part] = tables[table][places[part] - lag, column]
        return out.T
