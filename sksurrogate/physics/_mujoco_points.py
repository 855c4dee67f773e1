"""Points at which a MuJoCo model is asked, and those of them that are others again."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

#: Odd number (the golden ratio of 64 bits) that spreads the bits of a hash.
_ODD = np.uint64(0x9E3779B97F4A7C15)


@dataclass(frozen=True)
class Points:
    """Where a model is asked.

    Attributes
    ----------
    t : ndarray (n_points,)
    x : ndarray (n_states, n_points)
    controls : ndarray (n_controls, n_points)
    forces : ndarray (n_ports, n_points) or None
        Generalised forces at all degrees of freedom.
    p : dict of float or of ndarray (n_points,)
    """

    t: np.ndarray
    x: np.ndarray
    controls: np.ndarray
    forces: np.ndarray | None
    p: Mapping[str, Any]

    def some(self, rows: Any) -> Points:
        """Those of the points, by a slice or a mask."""
        p = {name: value[rows] if np.ndim(value) else value for name, value in self.p.items()}
        forces = None if self.forces is None else self.forces[:, rows]
        return Points(self.t[rows], self.x[:, rows], self.controls[:, rows], forces, p)

    def distinct(self) -> tuple[Points, np.ndarray]:
        """The points without those that are another again, and which of them each point is.

        Columns of a linearisation or of a line search differ at some samples only: within a window, after a jump.
        """
        varied = {name: value for name, value in self.p.items() if np.ndim(value)}
        rows = [self.t, self.x, self.controls, *([] if self.forces is None else [self.forces]), *varied.values()]
        first, which = first_of_equals(np.vstack(rows))
        if len(first) == len(which):
            return self, which
        return self.some(first), which


def first_of_equals(columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Places of the first of equal columns, in their order, and which of them each column is.

    Columns are looked up by a hash of their bits: none is sorted, as :func:`numpy.unique` sorts them along an axis.

    >>> first, which = first_of_equals(np.array([[2.0, 1.0, 2.0], [0.5, 0.5, 0.5]]))
    >>> first.tolist(), which.tolist()
    ([0, 1], [0, 1, 0])
    """
    bits = (np.ascontiguousarray(columns, dtype=float) + 0.0).view(np.uint64)  # -0 becomes 0
    key = np.zeros(bits.shape[1], np.uint64)
    for row in bits:
        key = (key ^ row) * _ODD
        key ^= key >> np.uint64(32)
    _, first, which = np.unique(key, return_index=True, return_inverse=True)
    if not np.array_equal(bits[:, first[which]], bits):  # different columns with one hash
        return np.arange(len(key)), np.arange(len(key))
    order = np.argsort(first)
    return first[order], np.argsort(order)[which]
