"""Splits that keep runs whole and leave no hole that a lag could reach over."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from sklearn.model_selection import BaseCrossValidator
from sklearn.utils import check_random_state

from sksurrogate._tables import as_labels
from sksurrogate.exceptions import DataError, RunError
from sksurrogate.runs import cut_runs, resolve_runs


class BlockedSplit(BaseCrossValidator):
    """Cross-validation over blocks of time.

    With ``groups`` every fold holds whole runs, neighbours together. With one long record, give
    ``groups=BlockedSplit(...).labels(len(X))`` to the search. Without ``groups`` the blocks of the record are the test sets in
    turn, and the longer side next to the block is the training set: with both sides, lags would reach over the gap.

    Parameters
    ----------
    n_splits : int, default=5
    gap : int, default=0
        Rows left out between blocks, or between training rows and block; at least the longest lag.
    blocks_per_split : int, default=1
        Blocks of a run in each fold that :meth:`labels` makes; more of them see more of a plant that drifts.

    Examples
    --------
    >>> import numpy as np
    >>> from sksurrogate.model_selection import BlockedSplit
    >>> split = BlockedSplit(3, gap=2)
    >>> split.labels(10)
    array([ 0,  0, -1, -1,  1,  1, -1, -1,  2,  2])
    >>> [test.tolist() for _, test in split.split(np.zeros(10), groups=split.labels(10))]
    [[0, 1], [4, 5], [8, 9]]
    >>> [(train.tolist(), test.tolist()) for train, test in BlockedSplit(3, gap=1).split(np.zeros(9))]
    [([4, 5, 6, 7, 8], [0, 1, 2]), ([7, 8], [3, 4, 5]), ([0, 1, 2, 3, 4], [6, 7, 8])]
    """

    def __init__(self, n_splits: int = 5, *, gap: int = 0, blocks_per_split: int = 1):
        self.n_splits = n_splits
        self.gap = gap
        self.blocks_per_split = blocks_per_split

    def labels(self, groups: Any) -> np.ndarray:
        """Labels that cut every run into blocks, -1 in the gaps, to be handed over as ``groups``.

        Parameters
        ----------
        groups : array-like (n_samples,) or int
            Labels of the runs, or the number of rows of a single run.

        Returns
        -------
        ndarray of int (n_samples,)
        """
        return cut_runs(groups, self.n_splits * self.blocks_per_split, self.gap)

    def get_n_splits(self, X: Any = None, y: Any = None, groups: Any = None) -> int:
        """Number of folds."""
        return self.n_splits

    def split(self, X: Any, y: Any = None, groups: Any = None) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Rows of training and test, fold by fold.

        Parameters
        ----------
        X : array-like (n_samples, n_inputs)
        y : ignored
        groups : array-like (n_samples,), optional
            Runs, or the blocks of :meth:`labels`.

        Yields
        ------
        train, test : ndarray of int
        """
        if self.n_splits < 2 or self.gap < 0 or self.blocks_per_split < 1:
            raise ValueError(
                f"n_splits={self.n_splits!r}, gap={self.gap!r}, blocks_per_split={self.blocks_per_split!r}: "
                "at least 2 folds, no negative gap, at least 1 block."
            )
        n = len(X)
        if groups is None:
            yield from self._record(n)
            return
        pieces = [(run.start, run.stop) for run in resolve_runs(np.zeros((n, 1)), groups=groups)]
        if len(pieces) < self.n_splits:
            raise RunError(
                f"groups holds {len(pieces)} runs, n_splits={self.n_splits} folds need at least as many: cut them first, "
                f"groups=BlockedSplit({self.n_splits}, gap=...).labels(groups)."
            )
        fold = np.arange(len(pieces)) % self.n_splits if self.blocks_per_split > 1 else _even(pieces, self.n_splits)
        rows = [np.arange(a, b) for a, b in pieces]
        for k in range(self.n_splits):
            test = [part for part, of in zip(rows, fold) if of == k]
            train = [part for part, of in zip(rows, fold) if of != k]
            yield np.concatenate(train), np.concatenate(test)

    def _record(self, n: int) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """One record without labels."""
        edges = np.round(np.linspace(0, n, self.n_splits + 1)).astype(int)
        for a, b in zip(edges[:-1], edges[1:]):
            before, after = np.arange(0, max(a - self.gap, 0)), np.arange(min(b + self.gap, n), n)
            train = before if len(before) > len(after) else after
            if not len(train) or a == b:
                raise RunError(f"{n} rows do not fit n_splits={self.n_splits} with gap={self.gap}: lower one of them.")
            yield train, np.arange(a, b)

    def _iter_test_indices(self, X: Any = None, y: Any = None, groups: Any = None) -> Iterator[np.ndarray]:
        """Test rows alone."""
        for _, test in self.split(X, y, groups):
            yield test


def _even(pieces: list[tuple[int, int]], n_splits: int) -> np.ndarray:
    """Neighbouring runs together, folds of about equal rows, at least one run each."""
    middle = np.cumsum([b - a for a, b in pieces]) - np.array([(b - a) / 2 for a, b in pieces])
    fold = np.minimum((middle / sum(b - a for a, b in pieces) * n_splits).astype(int), n_splits - 1)
    return fold if len(np.unique(fold)) == n_splits else np.arange(len(pieces)) * n_splits // len(pieces)


def split_runs(
    groups: Any, *, validation: float = 0.2, grading: float = 0.2, random_state: Any = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rows for training, validation and grading (paper section 2.4); runs stay whole.

    Validation data choose orders and penalties. Grading data are used once, at the end.

    Parameters
    ----------
    groups : array-like (n_samples,)
        Runs; -1 is left out of all three.
    validation, grading : float, default=0.2
        Share of the rows, about; at least one run each, unless 0.
    random_state : int, RandomState or None

    Returns
    -------
    train, validation, grading : ndarray of int
        Row numbers, in order.

    Examples
    --------
    >>> from sksurrogate.model_selection import split_runs
    >>> train, validation, grading = split_runs([0, 0, 1, 1, 2, 2, 3, 3, 4, 4], random_state=0)
    >>> len(train), len(validation), len(grading)
    (6, 2, 2)
    """
    shares = (validation, grading)
    if min(shares) < 0 or sum(shares) >= 1:
        raise DataError(
            f"validation={validation}, grading={grading}: expected shares of the rows of at least 0, together below 1."
        )
    labels = as_labels(groups)
    runs = [np.arange(run.start, run.stop) for run in resolve_runs(np.zeros((len(labels), 1)), groups=labels)]
    needed = 1 + sum(share > 0 for share in shares)
    if len(runs) < needed:
        raise RunError(
            f"groups holds {len(runs)} runs, {needed} are needed to keep runs whole: cut a long record first, "
            "groups=cut_runs(groups, n_blocks, gap)."
        )
    order = check_random_state(random_state).permutation(len(runs)).tolist()
    total, parts = sum(map(len, runs)), []
    for k, share in enumerate(shares):
        taken: list[int] = []
        still = 1 + sum(later > 0 for later in shares[k + 1 :])  # runs that the sets after this one need
        while share > 0 and len(order) > still:
            rows = sum(len(runs[r]) for r in taken)
            if taken and rows + len(runs[order[-1]]) / 2 > share * total:
                break
            taken.append(order.pop())
        parts.append(taken)
    sets = [order, *parts]
    train, second, third = (np.sort(np.concatenate([runs[r] for r in s])) if s else np.empty(0, int) for s in sets)
    return train, second, third
