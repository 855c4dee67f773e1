"""Where along the data a simulator becomes infinite or nan, in words."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import numpy as np

from sksurrogate.exceptions import SimulatorError
from sksurrogate.kernels.record import Record
from sksurrogate.physics._fit_model import FitModel
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._prepare import first_guess

WAY_OUT = (
    "See that the unit and the offset of the outputs are those of the simulator, and where its function is defined: a root, a "
    "logarithm or a division may want np.maximum(x, 0) or a floor."
)


def not_finite_along(inner: PlantModel, record: Record, labels: Sequence[object] | None = None) -> str:
    """The first sample from which the simulator gives no finite step, or at which it gives no finite output.

    Measured states are as measured, others as at the simulator's start.

    ``labels``: what the user calls the runs, None the one of a single run; their numbers by default.
    Returns str: empty where every step is finite.
    """
    plant = inner.plant
    starts = np.repeat(plant.x0[None], len(record.starts), axis=0)
    x = first_guess(inner, record, starts, True)
    bound = FitModel(inner, [], record, 2, np.ones(len(x))).bind(np.zeros((0, 1)))
    with np.errstate(all="ignore"):
        after, y = bound(x[:, None])[:, 0], bound.outputs(x[:, None])[:, 0]
    names = [*(f"state {name!r}" for name in plant.states), *(f"output {name!r}" for name in plant.outputs)]
    bad = ~np.isfinite(np.concatenate([after, y]))
    if not bad.any():
        return ""
    rows = np.flatnonzero(bad.any(axis=0))
    k = int(rows[0])
    run = int(record.run_of_row[k])
    label = labels[run] if labels is not None else (run if len(record.starts) > 1 else None)
    where = "" if label is None else f"run {label!r}, " if labels is not None else f"run number {run}, "
    at = dict(zip((*plant.states, *plant.inputs), np.concatenate([x[:, k], record.u[:, k]]).tolist()))
    return (
        f"{names[int(np.argmax(bad[:, k]))]} is not finite in {len(rows)} of {record.n_samples} samples along the data, first in "
        f"{where}row {k - int(record.starts[run])}, t = {record.t[k]:g}, from "
        f"{', '.join(f'{name} = {value:.4g}' for name, value in at.items())}.{inner.refusal} {WAY_OUT}"
    )


@contextmanager
def finite_along(inner: PlantModel, record: Record, labels: Sequence[object]) -> Iterator[None]:
    """What fails within for numbers that are not finite raises :class:`SimulatorError`, with the place."""
    try:
        yield
    except FloatingPointError as error:
        place = not_finite_along(inner, record, labels)
        raise SimulatorError(
            f"the simulator gives no finite step along the data{f': {place}' if place else '.'}"
        ) from error
