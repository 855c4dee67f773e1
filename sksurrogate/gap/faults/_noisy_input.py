"""Inputs without the noise of their measurement, and the free run along them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.ndimage import median_filter, uniform_filter1d

from sksurrogate.gap.faults._correction import BaseFault, Names
from sksurrogate.gap.fit._backend import BaseCandidate
from sksurrogate.gap.results._data_faults import DataFault
from sksurrogate.kernels.record import Record

__all__ = ["NoisyInput", "smoother_inputs", "smoothings"]

#: Rows of the running medians (inputs held for some samples) and means (inputs that move smoothly) that are tried.
MEDIANS, MEANS = (5, 9, 15), (3, 5, 9)


@dataclass(frozen=True, eq=False)
class NoisyInput(BaseFault):
    """The measurement of an input is noisy; the plant got a smoother one."""

    input: int
    way: int  #: Of :func:`smoothings`
    removed: float = 0.0  #: Share of the gap that it removes
    #: Whether the record is corrected: noise that is slow beside the plant cannot be distinguished from the input
    taken_out: bool = True

    @property
    def key(self) -> tuple[Any, ...]:
        return ("input_noise", self.input)

    def and_also(self, other: NoisyInput) -> NoisyInput:
        """The latest."""
        return other

    def corrected(self, record: Record) -> Record:
        """With the smoother input."""
        return self.smoother(record) if self.taken_out else record

    def smoother(self, record: Record) -> Record:
        """The record with the smoother input."""
        u = record.u.copy()
        for a, b in record.spans:
            u[self.input, a:b] = smoothings(record.u[self.input, a:b])[self.way]
        return replace(record, u=u)

    def described(self, record: Record, names: Names, share: float) -> DataFault:
        """With the deviation of the noise."""
        size = float(np.std(record.u[self.input] - self.smoother(record).u[self.input]))
        remedy = "Record the input that the actuator is given, or filter its measurement forwards and backwards."
        share = self.removed if self.taken_out else np.nan
        where = (names.inputs[self.input], "input", tuple(names.labels), ())
        return DataFault("input_noise", *where, size, share, remedy=remedy, taken_out=self.taken_out)


def smoothings(u: np.ndarray) -> list[np.ndarray]:
    """An input (n_samples,) of one run without its noise, in several ways.

    Examples
    --------
    >>> smoothings(np.array([0.0, 0.0, 0.0, 9.0, 0.0, 0.0, 0.0]))[0]
    array([0., 0., 0., 0., 0., 0., 0.])
    """
    medians = [median_filter(u, rows, mode="nearest") for rows in MEDIANS]
    means = [uniform_filter1d(u, rows, mode="nearest") for rows in MEANS]
    # A median keeps the edges; a mean between them is the quieter estimate.
    return [*medians, *(_between_edges(u, median) for median in medians[1:]), *means]


def _between_edges(u: np.ndarray, median: np.ndarray) -> np.ndarray:
    """Means over the stretches between the edges of a running median."""
    noise = 1.4826 * float(np.median(np.abs(u - median)))
    edges = np.flatnonzero(np.abs(np.diff(median)) > 1.5 * noise) + 1
    out = np.empty_like(u)
    for part in np.split(np.arange(len(u)), edges):
        if len(part):
            out[part] = u[part].mean()
    return out


def smoother_inputs(model: BaseCandidate) -> list[tuple[NoisyInput, np.ndarray]]:
    """Every input smoothed in several ways, and what that moves the readings of a model by (n_outputs, n_samples)."""
    record, found = model.problem.record, []
    for i, u in enumerate(record.u):
        for way in range(len(smoothings(u[:9])) if np.ptp(u) > 0 else 0):
            fault = NoisyInput(i, way)
            other = model.refitted(fault.corrected(record))
            if other is not None:
                found.append((fault, other.fit.y - model.fit.y))
    return found
