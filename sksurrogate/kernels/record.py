"""The data of a fit: all runs one behind the other on one time axis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

__all__ = ["Record"]


@dataclass(frozen=True, eq=False)
class Record:
    """Stacked runs, time last and contiguous.

    Attributes
    ----------
    u : ndarray (n_inputs, n_samples)
    y : ndarray (n_outputs, n_samples)
    t : ndarray (n_samples,)
    starts : ndarray of int (n_runs,)
        First row of every run.
    dt : float
    """

    u: np.ndarray
    y: np.ndarray
    t: np.ndarray
    starts: np.ndarray
    dt: float

    @classmethod
    def from_runs(cls, U: Sequence[np.ndarray], Y: Sequence[np.ndarray], t: Sequence[np.ndarray], dt: float) -> Record:
        """From one array (n_samples, n) a run."""
        starts = np.cumsum([0] + [len(part) for part in U[:-1]])
        return cls(
            np.ascontiguousarray(np.concatenate(U).T),
            np.ascontiguousarray(np.concatenate(Y).T),
            np.concatenate(t),
            starts.astype(int),
            float(dt),
        )

    @property
    def n_samples(self) -> int:
        """Rows of all runs together."""
        return len(self.t)

    @property
    def lengths(self) -> np.ndarray:
        """Rows of every run."""
        return np.diff(np.r_[self.starts, self.n_samples])

    @property
    def run_of_row(self) -> np.ndarray:
        """Number of the run of every row."""
        return np.repeat(np.arange(len(self.starts)), self.lengths)

    def back(self, k: int) -> np.ndarray:
        """Row k samples before each, or the first of its run."""
        return np.maximum(np.arange(self.n_samples) - k, self.starts[self.run_of_row])

    def select(self, runs: Sequence[int]) -> Record:
        """Some of the runs."""
        bounds = np.r_[self.starts, self.n_samples]
        rows = np.concatenate([np.arange(bounds[r], bounds[r + 1]) for r in runs])
        lengths = self.lengths[list(runs)]
        return Record(
            self.u[:, rows], self.y[:, rows], self.t[rows], np.r_[0, np.cumsum(lengths[:-1])].astype(int), self.dt
        )
