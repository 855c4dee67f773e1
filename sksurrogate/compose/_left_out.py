"""Errors of a correction on runs, or blocks of runs, that it was not fitted to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

#: Fits beside the one of all runs: folds of runs; blocks where there are fewer than three runs, fewer in short ones. A fit
#: keeps seven eighths of one run: without a quarter of it most free runs leave what the fit knows.
RUN_FOLDS, FEWEST_BLOCK_FOLDS, BLOCK_FOLDS = 3, 4, 8
#: Longest block that starts anew: longer ones are cut, and all run in one batch.
LONGEST_LEFT_OUT = 2000


@dataclass(frozen=True)
class Piece:
    """A free run over rows ``start`` to ``stop`` of a run, judged from row ``judged`` on."""

    run: int
    start: int
    stop: int
    judged: int


@dataclass(frozen=True)
class Fold:
    """What a correction is fitted to, as (run, start, stop), and the free runs that it is judged by."""

    taught: tuple[tuple[int, int, int], ...]
    judged: tuple[Piece, ...]


def folds_of(lengths: Sequence[int], n_lags: int) -> list[Fold]:
    """Every third run in turn; of one or two runs, one of eight blocks in turn. Empty where blocks would be too short.

    A block is judged twice: started anew from its own first rows, as ``predict`` does, and in a free run from the start
    of its run on, as a long prediction does.

    ``lengths``: rows of every run.
    ``n_lags``: rows that a free run starts from; a block has at least twice as many and two.
    """
    n, shortest = len(lengths), 2 * n_lags + 2
    if n >= RUN_FOLDS:
        blocks = [[(r, 0, lengths[r]) for r in range(k, n, RUN_FOLDS)] for k in range(RUN_FOLDS)]
    else:
        per_run = int(np.clip(min(lengths) // shortest, FEWEST_BLOCK_FOLDS // n, BLOCK_FOLDS // n))
        edges = [np.linspace(0, length, per_run + 1).astype(int) for length in lengths]
        blocks = [[(r, int(a), int(b))] for r, edge in enumerate(edges) for a, b in zip(edge, edge[1:])]
    if min(stop - start for group in blocks for _, start, stop in group) < shortest:
        return []
    folds = []
    for k, group in enumerate(blocks):
        taught = _joined([block for j, others in enumerate(blocks) if j != k for block in others])
        judged = [piece for block in group for piece in _pieces(block, n_lags)]
        folds.append(Fold(tuple(taught), tuple(judged)))
    return folds


def _joined(blocks: list[tuple[int, int, int]]) -> list[tuple[int, int, int]]:
    """Blocks that follow each other in a run are one."""
    out: list[tuple[int, int, int]] = []
    for run, start, stop in sorted(blocks):
        if out and out[-1][0] == run and out[-1][2] == start:
            out[-1] = (run, out[-1][1], stop)
        else:
            out.append((run, start, stop))
    return out


def _pieces(block: tuple[int, int, int], n_lags: int) -> list[Piece]:
    """Free runs that judge a block: from its own start, in parts where it is long, and from the start of its run."""
    run, start, stop = block
    count = max(1, -(-(stop - start) // LONGEST_LEFT_OUT))
    edges = np.linspace(start, stop, count + 1).astype(int)
    pieces = [Piece(run, int(a), int(b), int(a) + n_lags) for a, b in zip(edges, edges[1:])]
    return pieces if start == 0 or count > 1 else [*pieces, Piece(run, 0, stop, start)]


class LeftOut:
    """A correction fitted to the runs of each fold, judged on the others.

    ``correction``: with ``taught_on(inputs, measured, pieces)`` and ``errors_at(factors, inputs, measured, pieces)``. A
        fold with too few rows for the residual says nothing.
    ``inputs, measured`` sequence of (n_samples, n_inputs | n_outputs): one per run.
    """

    def __init__(self, correction: Any, inputs: Sequence[np.ndarray], measured: Sequence[np.ndarray]):
        self.inputs, self.measured = inputs, measured
        self.fitted: list[tuple[Any, tuple[Piece, ...]]] = []
        for fold in folds_of([len(U) for U in inputs], correction.n_lags):
            try:
                self.fitted.append((correction.taught_on(inputs, measured, fold.taught), fold.judged))
            except (ValueError, np.linalg.LinAlgError):
                continue

    @property
    def ends(self) -> list[tuple[int, int]]:
        """Run of every piece, and the row behind its last."""
        return [(piece.run, piece.stop) for _, judged in self.fitted for piece in judged]

    def departures(self, correction: Any) -> np.ndarray:
        """How far the measured rows of every left-out block leave what its fold was fitted to, (n_blocks,).

        ``correction`` is the one of all rows. Shares of the range of the feature that lies farthest.
        """
        far: dict[tuple[int, int], float] = {}
        for fold, judged in self.fitted:
            for piece in judged:
                rows = correction.along(piece.run, piece.judged, piece.stop)
                block = piece.run, piece.stop
                far[block] = max(far.get(block, 0.0), float(np.max(fold.domain.distance(rows), initial=0.0)))
        return np.array(list(far.values()))

    def errors(self, factors: np.ndarray, fade: float | None = None) -> list[np.ndarray]:
        """Errors (n_factors, n_rows, n_outputs) of every piece at these shares of the correction, behind its first rows.

        ``factors`` (n_factors,).
        ``fade``: reach of the correction beyond its data in place of its own.
        """
        errors: list[np.ndarray] = []
        for correction, judged in self.fitted:
            if fade is not None:
                correction.domain = replace(correction.domain, fade=fade)
            errors += correction.errors_at(factors, self.inputs, self.measured, judged)
        return errors
