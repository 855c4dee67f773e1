"""A simulator with states along measured runs: its model on the record, a smoothed path of all states, substeps."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from sksurrogate.exceptions import SimulatorError
from sksurrogate.kernels.record import Record
from sksurrogate.kernels.smoother import noise_of_differences
from sksurrogate.physics._fit_model import FitModel
from sksurrogate.physics._free_run import substeps
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._not_finite import not_finite_along
from sksurrogate.physics._prepare import prepared
from sksurrogate.physics._simulator import Plant


def plant_path(
    plant: Plant, inputs: list[np.ndarray], measured: list[np.ndarray]
) -> tuple[FitModel, np.ndarray, np.ndarray]:
    """Model over the record, states (n_states, n_rows) that follow the outputs, and sensor noise (n_outputs,).

    Raises SimulatorError where no step along the data is finite.
    """
    times = [plant.dt * np.arange(len(U)) for U in inputs]
    record = Record.from_runs(inputs, measured, times, plant.dt)
    with np.errstate(all="ignore"):
        starts = np.repeat(plant.x0[None], len(inputs), axis=0)
        noise = noise_of_differences(record.y, record.starts)
        model, guess = prepared(PlantModel(plant), record, noise, [], np.zeros(0), starts, False, True)
        steps = model.bind(np.zeros((0, 1)))(guess[:, None])
    if not np.isfinite(steps).all(axis=0).any():
        place = not_finite_along(model.inner, record)
        raise SimulatorError(f"the simulator gives no finite step along the data: {place}")
    return model, guess, noise


def training_substeps(plant: Plant, rate: Any, inputs: Sequence[np.ndarray], starts: Sequence[Any]) -> int | None:
    """Substeps per sample that a right-hand side asks for along runs; None where it is stiff, or no right-hand side."""
    if plant.access != "rhs" or not plant.states:
        return None
    model = PlantModel(plant)
    model.probe(inputs[0][0])
    x0 = [plant.x0 if start is None else np.asarray(start) for start in starts]
    lengths, wanted = np.array([len(U) for U in inputs]), 0
    for length in np.unique(lengths):  # runs of one length at once
        chosen = [int(r) for r in np.flatnonzero(lengths == length)]
        U, X0 = np.stack([inputs[r] for r in chosen]), np.stack([x0[r] for r in chosen])
        found = substeps(
            rate, U, X0, plant.dt * np.arange(length), 0 if plant.hold == "zoh" else 1, many=model.takes_many
        )
        if found is None:
            return None
        wanted = max(wanted, found)
    return wanted or None
