"""A calibration begins on thinned data: most of the way is gone at a fraction of the work."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from sksurrogate.kernels.output_error import output_error
from sksurrogate.kernels.record import Record
from sksurrogate.physics._fit_model import FitModel
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._prepare import prepared, refined

__all__ = ["coarse_start", "thinned"]

#: Rows that are kept at least, of all runs and of the shortest.
_ROWS, _ROWS_OF_A_RUN = 800, 25
#: One row of at least and at most so many is kept: records that would be thinned less are faster fitted at once.
_LEAST, _MOST = 8, 10
#: Local error that is asked of the long steps: the fit goes on from there anyway.
_LOCAL_ERROR = 1e-3


def thinned(record: Record, every: int, held: bool) -> Record:
    """One row of ``every`` of each run; inputs that are held are averaged over the rows that follow it."""
    last = record.lengths // every
    rows = np.concatenate([a + every * np.arange(n) for a, n in zip(record.starts, last)])
    u = np.mean([record.u[:, rows + k] for k in range(every)], axis=0) if held else record.u[:, rows]
    starts = np.r_[0, np.cumsum(last[:-1])].astype(int)
    return Record(u, record.y[:, rows], record.t[rows], starts, every * record.dt)


def coarse_start(
    inner: PlantModel, record: Record, sd: np.ndarray, names: list[str], theta: np.ndarray, starts: np.ndarray, given: bool,
    options: Mapping[str, Any],
) -> tuple[FitModel, np.ndarray, np.ndarray] | None:  # fmt: skip
    """Model, parameters and trajectory (n_states, n_samples) that a fit to thinned data leads to.

    None where the record is short, where steps so long would not do, or where that fit does not succeed.

    Parameters
    ----------
    inner, record, sd, names, theta, starts, given
        As for :func:`~sksurrogate.physics._prepare.prepared`.
    options : mapping
        Of the fit.
    """
    every = min(record.n_samples // _ROWS, int(record.lengths.min()) // _ROWS_OF_A_RUN, _MOST)
    if every < _LEAST or inner.plant.access != "rhs":
        return None
    few = thinned(record, every, inner.plant.hold == "zoh")
    model, x = prepared(
        inner, few, sd, names, theta, starts.copy(), given, options["fit_start"], local_error=_LOCAL_ERROR
    )
    if model.stiff:
        return None
    fit = output_error(model, theta, x, sd, open_steps=6, **options)
    if fit is None or not fit.converged:
        return None
    fine = replace(model, record=record, n_sub=1)
    x = _filled(fine, fit.theta, fit.x, few, every)
    return refined(fine, fit.theta, x), fit.theta, x


def _filled(model: FitModel, theta: np.ndarray, x: np.ndarray, few: Record, every: int) -> np.ndarray:
    """The rows between those that were kept, and those after the last: the model leads on from row to row."""
    record = model.record
    bound = model.bind(theta[:, None])
    out = np.empty((model.n_states, record.n_samples))
    rows = np.concatenate([a + every * np.arange(n) for a, n in zip(record.starts, few.lengths)])
    ends = np.r_[record.starts[1:], record.n_samples]
    room = np.repeat(ends, few.lengths) - rows  # rows that are left in the run
    reach = np.minimum(np.r_[np.diff(rows), room[-1:]], room)
    out[:, rows] = x
    now = x[:, None]
    for k in range(1, int(reach.max())):
        now, rows = bound(now, rows), rows + 1
        alive = k < reach
        now, rows, reach = now[:, :, alive], rows[alive], reach[alive]
        out[:, rows] = now[:, 0]
    return out
