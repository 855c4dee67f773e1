"""Columns with weights of their own in every run: they are taken out of Grams run by run.

Noise does not couple runs, so that the Gram of such columns is block diagonal: the cost grows with the number of runs, not with its
square.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

#: Directions below this share of the largest, in the scale of the diagonal, count as unseen: single precision squared.
UNSEEN = 1e-10


@dataclass(frozen=True, eq=False)
class RunColumns:
    """Columns whose weights differ from run to run."""

    columns: np.ndarray  #: (n_outputs, n_columns, n_samples): 0 in runs that have none
    of: np.ndarray  #: int (n_samples,): number of the run of every row, from 0 on

    def by_run(self, grams: np.ndarray, starts: np.ndarray) -> np.ndarray:
        """Grams of the pieces of a record that begin at ``starts``, added up run by run."""
        out = np.zeros((int(self.of.max()) + 1, *grams.shape[1:]))
        np.add.at(out, self.of[starts], grams)
        return out

    def sum(self, weights: np.ndarray) -> np.ndarray:
        """What weights (n_runs, n_columns) make of them: (n_outputs, n_samples)."""
        return np.einsum("okt,tk->ot", self.columns, weights[self.of])


def grams_of_pieces(columns: np.ndarray, starts: np.ndarray) -> np.ndarray:
    """Grams (n_pieces, n, n) of columns (n, n_outputs, n_samples) in the pieces of a record that begin at ``starts``.

    >>> grams_of_pieces(np.array([[[1.0, 2.0, 4.0]]]), np.array([0, 2])).ravel().tolist()
    [5.0, 16.0]
    """
    parts = (part.reshape(len(columns), -1) for part in np.split(columns, starts[1:], axis=-1))
    return np.stack([part @ part.T for part in parts])


def take_out(grams: np.ndarray, k: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Take the last k columns, with weights of their own in every run, out of Grams (n_runs, n, n).

    Returns ``left`` (n_runs, n - k, n - k): what is left of each Gram.
    Returns ``weights`` (n_runs, k, n - k): of these columns in every other column.
    Returns ``inverse`` (n_runs, k, k).

    >>> columns = np.array([[1.0, 2.0, 4.0], [1.0, 1.0, 1.0]])  # a residual and a constant, in one run
    >>> left, weights, _ = take_out((columns @ columns.T)[None], 1)
    >>> left.round(9).tolist(), weights.round(9).tolist()
    ([[[4.666666667]]], [[[2.333333333]]])
    """
    own, cross = grams[:, -k:, -k:], grams[:, -k:, :-k]
    scale = np.sqrt(np.maximum(np.einsum("rkk->rk", own), 1e-300))
    square = scale[:, :, None] * scale[:, None]
    inverse = np.linalg.pinv(own / square, rcond=UNSEEN, hermitian=True) / square
    weights = inverse @ cross
    return grams[:, :-k, :-k] - cross.transpose(0, 2, 1) @ weights, weights, inverse
