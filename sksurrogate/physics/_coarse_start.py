"""Coarse start of a calibration: a fit to thinned data first, which costs a fraction of one to all rows."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from sksurrogate.kernels.output_error import approached
from sksurrogate.kernels.record import Record
from sksurrogate.kernels.smoother import noise_of_differences
from sksurrogate.physics._fit_model import FitModel
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._prepare import fastest, first_guess, refined, smoothed_run

#: Rows that are kept at least, of all runs and of the shortest.
_LEAST_ROWS, _ROWS_OF_A_RUN = 400, 25
#: One row of at least and at most so many is kept: records that would be thinned less are faster fitted at once.
_LEAST_THINNING, _MOST_THINNING = 3, 10
#: Third differences of the rows that are kept stay below this share of their spread, or twice the noise: else they leave
#: out what happens between them.
_ROUGH = 0.03
#: As many substeps of such a row as the fastest state asks for; at most so many: else steps so long would not do.
_SUBSTEPS = 8
#: Open steps converge quadratically: what one leaves that moves by less than this share, the fit does in its first.
_START_SETTLED = 0.2


def thinned(record: Record, every: int, held: bool) -> Record:
    """One row of ``every`` of each run; inputs that are held are averaged over the rows that follow it."""
    rows, counts = _kept(record, every), record.lengths // every
    u = np.mean([record.u[:, rows + k] for k in range(every)], axis=0) if held else record.u[:, rows]
    few = record.rows(rows, np.cumsum(counts) - counts)
    return replace(few, u=u, dt=every * record.dt)


def _kept(record: Record, every: int) -> np.ndarray:
    """Rows that are kept."""
    return np.concatenate([a + every * np.arange(n // every) for a, n in zip(record.starts, record.lengths)])


def _telling_rows(record: Record, sd: np.ndarray, held: bool) -> tuple[Record, int] | None:
    """The record thinned to one row of how many: third differences stay small, so that these tell what the others do."""
    every = min(record.n_samples // _LEAST_ROWS, int(record.lengths.min()) // _ROWS_OF_A_RUN, _MOST_THINNING)
    small = np.maximum(2.0 * sd, _ROUGH * record.spread)
    while every >= _LEAST_THINNING:
        few = thinned(record, every, held)
        if np.all(noise_of_differences(few.y, few.starts, few.known, few.t) < small):
            return few, every
        every //= 2
    return None


def coarse_start(
    inner: PlantModel, record: Record, sd: np.ndarray, names: list[str], theta: np.ndarray, starts: np.ndarray, given: bool,
    options: Mapping[str, Any],
) -> tuple[FitModel, np.ndarray, np.ndarray] | None:  # fmt: skip
    """Model, parameters and trajectory (n_states, n_samples) that a fit to thinned data leads to.

    None where the record is short, where steps so long would not do, or where that fit does not settle.

    ``inner, record, sd, names, theta, starts, given``: as for :func:`~sksurrogate.physics._prepare.prepared`.
    ``options``: of the fit.
    """
    even = record.steps is None and inner.plant.access == "rhs"
    started = _telling_rows(record, sd, record.order_of_inputs(inner.plant.hold) == 0) if even else None
    if started is None:
        return None
    few, every = started
    inner.probe(record.u[:, 0])
    starts = starts.copy()
    near = first_guess(inner, few, starts, options["fit_start"] and not given)
    model = FitModel(inner, names, few, 1, np.ones(len(inner.plant.states)))
    n_sub = fastest(model, theta, near)
    if not n_sub <= _SUBSTEPS:
        return None
    model, x = smoothed_run(
        replace(model, n_sub=max(math.ceil(n_sub), 1)), theta, near, starts, sd, options["fit_start"]
    )
    wanted = {key: value for key, value in options.items() if key not in ("best", "max_steps", "settled")}
    found = approached(model, theta, x, sd, open_steps=6, **wanted, settled=_START_SETTLED)
    if found is None:
        return None
    theta, x = found
    fine = replace(model, record=record, n_sub=1)
    x = _filled(fine, theta, x, every)
    return refined(fine, theta, x), theta, x


def _filled(model: FitModel, theta: np.ndarray, x: np.ndarray, every: int) -> np.ndarray:
    """The rows between those that were kept, and those after the last: the model leads on from row to row."""
    bound, rows = model.bind(theta[:, None]), _kept(model.record, every)
    out = np.empty((model.n_states, model.record.n_samples))
    reach = np.diff(rows, append=model.record.n_samples)  # rows to the next that was kept, or to the next run
    out[:, rows] = x
    now = x[:, None]
    for k in range(1, int(reach.max())):
        now, rows = bound(now, rows), rows + 1
        if k >= every:
            alive = k < reach
            now, rows, reach = now[:, :, alive], rows[alive], reach[alive]
        out[:, rows] = now[:, 0]
    return out
