"""Second moments of spline features, cell by cell.

At any x only ``degree + 1`` splines of an input differ from zero, and which ones depends on the interval alone. Rows are
therefore sorted by the intervals of the first inputs: within such a cell the splines of these inputs are a few full
columns, and their products with everything else are one small dense product. The splines of the remaining inputs are
written out and multiplied as they are.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import prod

import numpy as np

from sksurrogate.kernels.bases import Spline
from sksurrogate.kernels.gram import Moments

#: Rows that are sorted at a time.
_SORTED = 2**16
#: Rows that are multiplied at a time, and numbers in them: they stay in the cache.
_MOMENT_ROWS, _MOMENT_NUMBERS = 4096, 2**19
#: Numbers in the products of all cells.
_PRODUCTS = 2**20
#: Rows that a cell must hold on average: below, the calls cost more than the products.
_FEWEST_IN_CELL = 48


def add_spline_moments(
    moments: Moments, X: np.ndarray, splines: Sequence[Spline], targets: np.ndarray, weights: np.ndarray | None = None
) -> bool:
    """Take in the splines of some rows, side by side, and their targets.

    ``moments``: of the splines of all inputs and the targets, in this order.
    ``X`` (n_samples, n_inputs).
    ``splines``: one for each input, none of them periodic.
    ``targets`` (n_samples, n_outputs), ``weights`` (n_samples,).
    Returns False where nothing was taken in: too few rows for cells, or a spline that is all but constant. The features
        themselves are needed then.

    >>> import numpy as np
    >>> from sksurrogate.kernels.bases import spline_csr, spline_on
    >>> from sksurrogate.kernels.gram import Moments
    >>> splines = [spline_on(np.linspace(0.0, 1.0, 4), 3)]
    >>> X = np.linspace(0.0, 1.0, 2000)[:, None]
    >>> m = Moments.zeros(7)
    >>> add_spline_moments(m, X, splines, X**2)
    True
    >>> bool(np.allclose(m.scatter, Moments.zeros(7).add(spline_csr(X, splines), X**2).scatter))
    True
    """
    if any(spline.extrapolation == "periodic" for spline in splines):
        return False
    total = float(len(X)) if weights is None else float(weights.sum())
    leading = _leading(splines, targets.shape[1] + 1, len(X))
    if leading == 0 or total <= 0:
        return False
    cells = _Cells(splines, leading, targets.shape[1])
    shift = np.zeros(len(moments.mean))
    shift[cells.n_features :] = targets.mean(axis=0) if weights is None else weights @ targets / total
    for x, y, root in _sorted(X, splines[:leading], targets - shift[cells.n_features :], weights, len(cells.table)):
        cells.add(x, y, root)
    scatter, sums = cells.result()
    count = len(X) if weights is None else int(np.count_nonzero(weights))
    return moments.add_sums(count, total, shift, sums, scatter)


def _leading(splines: Sequence[Spline], n_more: int, n_rows: int) -> int:
    """How many of the inputs are taken cell by cell."""
    cells, local, width, leading = 1, 0, sum(spline.n_splines for spline in splines) + n_more, 0
    for spline in splines:
        cells, local, width = cells * spline.n_intervals, local + spline.degree + 1, width - spline.n_splines
        if cells * _FEWEST_IN_CELL > min(n_rows, _SORTED) or cells * local * (local + width) > _PRODUCTS:
            break
        leading += 1
    return leading


def _sorted(
    X: np.ndarray, splines: Sequence[Spline], targets: np.ndarray, weights: np.ndarray | None, n_rows: int
) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray | None]]:
    """Inputs (n_inputs, n), targets (n, n_outputs) and roots of the weights, in pieces of rows of like cells."""
    size = max(n_rows, min(_SORTED, 2**20 // X.shape[1]))
    for a in range(0, len(X), size):
        x = X[a : a + size]
        key = np.zeros(len(x), dtype=np.uint16)
        for j, spline in enumerate(splines):
            key *= np.uint16(spline.n_intervals)
            key += spline.interval(x[:, j]).astype(np.uint16)
        order = np.argsort(key, kind="stable")
        x, y = x[order], targets[a : a + size][order]
        root = None if weights is None else np.sqrt(weights[a : a + size][order])
        for b in range(0, len(x), n_rows):
            rows = slice(b, b + n_rows)
            yield np.ascontiguousarray(x[rows].T), y[rows], None if root is None else root[rows]


class _Cells:
    """Products of the leading splines with all others, of each cell; products of the others with each other."""

    def __init__(self, splines: Sequence[Spline], leading: int, n_outputs: int):
        self.splines, self.leading = splines, leading
        self.offsets = np.r_[0, np.cumsum([spline.n_splines for spline in splines])]
        self.n_features = int(self.offsets[-1])
        self.local = sum(spline.degree + 1 for spline in splines[:leading])
        # behind the features the targets and a constant, which gives the sums
        self.width = self.n_features - int(self.offsets[leading]) + n_outputs + 1
        self.shape = tuple(spline.n_intervals for spline in splines[:leading])
        self.own = np.zeros((prod(self.shape), self.local, self.local))
        self.cross = np.zeros((prod(self.shape), self.local, self.width))
        self.rest = np.zeros((self.width, self.width))
        n_rows = int(np.clip(_MOMENT_NUMBERS // self.width, 256, _MOMENT_ROWS))
        self.table, self.weights = np.empty((n_rows, self.width)), np.empty((self.local, n_rows))

    def add(self, x: np.ndarray, targets: np.ndarray, root: np.ndarray | None) -> None:
        """Take in a piece of rows."""
        n = len(targets)
        key = self._fill_leading(x, n)
        Z, P = self.table[:n], self.weights[:, :n]
        self._fill_rest(x, Z)
        Z[:, self.width - 1 - targets.shape[1] : -1] = targets
        Z[:, -1] = 1.0
        if root is not None:
            Z *= root[:, None]
            P *= root
        self.rest += Z.T @ Z
        cuts = np.flatnonzero(key[1:] != key[:-1]) + 1
        starts, ends = [0, *cuts.tolist()], [*cuts.tolist(), n]
        for cell, a, b in zip(key[starts].tolist(), starts, ends):
            piece = P[:, a:b]
            self.own[cell] += piece @ piece.T
            self.cross[cell] += piece @ Z[a:b]

    def _fill_leading(self, x: np.ndarray, n: int) -> np.ndarray:
        """Write the local weights of the leading inputs; the cell of each row."""
        key = np.zeros(n, dtype=np.int64)
        row = 0
        for column, spline in zip(x, self.splines[: self.leading]):
            first, weights = spline.local(column)
            key = key * spline.n_intervals + first
            self.weights[row : row + spline.degree + 1, :n] = weights.T
            row += spline.degree + 1
        return key

    def _fill_rest(self, x: np.ndarray, out: np.ndarray) -> None:
        """Write the splines of the other inputs into the leading columns."""
        out[:] = 0.0
        flat = self.table.reshape(-1)
        rows = np.arange(len(out)) * self.width
        for j in range(self.leading, len(self.splines)):
            first, weights = self.splines[j].local(x[j])
            place = rows + (first + (self.offsets[j] - self.offsets[self.leading]))
            for weight in weights.T:
                flat[place] = weight
                place += 1

    def result(self) -> tuple[np.ndarray, np.ndarray]:
        """Products of all columns, and their sums."""
        start, total = self.offsets[self.leading], self.n_features + self.width
        total -= self.n_features - start
        out = np.zeros((total, total))
        out[start:, start:] = self.rest
        for cell, place in enumerate(np.ndindex(*self.shape)):
            columns = np.concatenate(
                [
                    offset + first + np.arange(spline.degree + 1)
                    for offset, first, spline in zip(self.offsets, place, self.splines)
                ]
            )
            out[columns[:, None], columns] += self.own[cell]
            out[columns, start:] += self.cross[cell]
        out[start:, :start] = out[:start, start:].T
        return out[:-1, :-1], out[-1, :-1].copy()
