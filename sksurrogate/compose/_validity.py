"""Where in (y, u) a data set says nothing (paper 4.2)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.spatial import cKDTree
from scipy.stats import qmc

from sksurrogate.exceptions import DataError
from sksurrogate.runs import resolve_runs

#: Probes of the box, a power of two (Sobol).
PROBES = 4096
#: Width of a direction, over its largest number, that is rounding: a few units in the last place.
ROUNDING = 8 * np.finfo(float).eps


@dataclass(frozen=True, eq=False)
class CoverageReport:
    """The part of a box in (y, u) that a data set covers.

    Attributes
    ----------
    names : tuple of str
        Outputs, then inputs.
    box : ndarray (n_names, 2)
        Low and high end of each; distances are in units of these ranges.
    seen : ndarray (n_names, 2)
        Range of the data.
    radius : float
        A point further than this from every row counts as not covered.
    share : float
        Part of the box within ``radius`` of a row; a direction in which the box has no width takes no part.
    holes : ndarray (n_holes, n_names)
        Centres of the largest empty balls, largest first, no ball within another.
    hole_radius : ndarray (n_holes,)

    Examples
    --------
    >>> from sksurrogate.compose import coverage_report
    >>> from sksurrogate.datasets import make_reactor_runs
    >>> X, y, runs = make_reactor_runs(4, 60, random_state=0)
    >>> report = coverage_report(X, y, runs)
    >>> 0 < report.share < 1, report.holes.shape[1]
    (True, 2)
    """

    names: tuple[str, ...]
    box: np.ndarray
    seen: np.ndarray
    radius: float
    share: float
    holes: np.ndarray
    hole_radius: np.ndarray
    _tree: Any = field(repr=False)

    def distance(self, X: Any, y: Any) -> np.ndarray:
        """Distance of each row to the nearest row of the data, in units of the box.

        Parameters
        ----------
        X : array-like (n_samples, n_inputs)
        y : array-like (n_samples,) or (n_samples, n_outputs)

        Returns
        -------
        ndarray (n_samples,)
        """
        return self._tree.query(_scaled(_points(X, y), self.box))[0]

    def covers(self, X: Any, y: Any) -> np.ndarray:
        """Whether each row is within ``radius`` of the data.

        Parameters
        ----------
        X : array-like (n_samples, n_inputs)
        y : array-like (n_samples,) or (n_samples, n_outputs)

        Returns
        -------
        ndarray of bool (n_samples,)
        """
        return self.distance(X, y) <= self.radius

    def __str__(self) -> str:
        lines = [f"The data speak about {100 * self.share:.0f} % of the box (within {self.radius:g} of its ranges)."]
        for name, (low, high), (a, b) in zip(self.names, self.box, self.seen):
            lines.append(f"  {name}: box {low:.4g} to {high:.4g}, data {a:.4g} to {b:.4g}")
        for centre, size in zip(self.holes, self.hole_radius):
            at = ", ".join(f"{name} = {value:.4g}" for name, value in zip(self.names, centre))
            lines.append(f"  nothing within {size:.2f} of {at}")
        return "\n".join(lines)

    def plot(self, ax: Any = None) -> Any:
        """Draw the data, the covered part and the holes over the first two variables; see ``CoverageDisplay``."""
        from sksurrogate.displays import CoverageDisplay

        return CoverageDisplay(self).plot(ax=ax)


def coverage_report(
    X: Any,
    y: Any,
    groups: Any = None,
    *,
    run: Any = None,
    box: Sequence[tuple[float, float]] | None = None,
    radius: float = 0.05,
    n_holes: int = 5,
) -> CoverageReport:
    """Which part of (y, u) does a data set not cover? (paper section 4.2)

    A free run that leaves the covered part is extrapolation, whatever its score elsewhere.

    Parameters
    ----------
    X : array-like (n_samples, n_inputs)
    y : array-like (n_samples,) or (n_samples, n_outputs)
    groups : array-like (n_samples,), optional
    run : None, column name, int or "index"
        Where X says which run a row belongs to.
    box : sequence of (low, high), optional
        Ranges of the outputs, then of the inputs, in which the model shall be used; by default those of the data. A range
        of no width (a constant column) is one place: distances from it are in the column's own unit.
    radius : float, default=0.05
        In units of the box' ranges.
    n_holes : int, default=5
        Empty balls reported at most.

    Returns
    -------
    CoverageReport

    Raises
    ------
    DataError
        The box does not fit the data.

    Examples
    --------
    >>> from sksurrogate.compose import coverage_report
    >>> from sksurrogate.datasets import make_reactor_experiments
    >>> X, y, groups, _ = make_reactor_experiments()
    >>> report = coverage_report(X, y, groups)
    >>> print(report)  # doctest: +ELLIPSIS
    The data speak about ... % of the box (within 0.05 of its ranges).
      y0: box 0.5 to 15, data 0.5 to 15
      u0: box 0.05 to 0.25, data 0.05 to 0.25
      nothing within ... of y0 = ..., u0 = ...
    """
    runs = resolve_runs(X, y, groups=groups, run=run)
    points = np.concatenate([_points(r.X, r.y) for r in runs])
    n_outputs = runs[0].y.shape[1]
    names = tuple(runs.output_names or [f"y{k}" for k in range(n_outputs)]) + tuple(
        runs.input_names or [f"u{k}" for k in range(points.shape[1] - n_outputs)]
    )
    seen = np.column_stack([points.min(axis=0), points.max(axis=0)])
    ranges = seen if box is None else np.asarray(box, dtype=float)
    if ranges.shape != seen.shape or not np.all(ranges[:, 0] <= ranges[:, 1]):
        raise DataError(f"box has shape {ranges.shape}, expected {seen.shape}: (low, high) for each of {list(names)}.")
    if not radius > 0:
        raise DataError(f"radius={radius!r} must be positive, in units of the box' ranges.")
    tree = cKDTree(_scaled(points, ranges))
    width = _widths(ranges)
    probes = np.zeros((PROBES, len(names)))  # a direction without width has one place in the box
    if width.any():
        probes[:, width > 0] = qmc.Sobol(int(np.count_nonzero(width)), seed=0).random(PROBES)
    distance = tree.query(probes)[0]
    holes: list[int] = []
    for i in np.argsort(-distance):
        if len(holes) == n_holes or distance[i] <= radius:
            break
        if all(np.linalg.norm(probes[i] - probes[j]) >= distance[j] for j in holes):
            holes.append(int(i))
    centres = ranges[:, 0] + width * probes[holes]
    return CoverageReport(
        names, ranges, seen, float(radius), float(np.mean(distance <= radius)), centres, distance[holes], tree
    )


def _points(X: Any, y: Any) -> np.ndarray:
    inputs, outputs = np.asarray(X, dtype=float), np.asarray(y, dtype=float)
    return np.concatenate([outputs.reshape(len(outputs), -1), inputs.reshape(len(inputs), -1)], axis=1)


def _widths(box: np.ndarray) -> np.ndarray:
    """Width of every direction of the box, 0 where it is rounding, (n_names,)."""
    width = box[:, 1] - box[:, 0]
    return np.where(width > ROUNDING * np.abs(box).max(axis=1), width, 0.0)


def _scaled(points: np.ndarray, box: np.ndarray) -> np.ndarray:
    width = _widths(box)
    return (points - box[:, 0]) / np.where(width > 0, width, 1.0)
