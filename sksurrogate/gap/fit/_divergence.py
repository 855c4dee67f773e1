"""Where a simulator that only gives trajectories leaves the finite numbers: the run, the row, the output."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sksurrogate.effects._trajectory import plain_runs
from sksurrogate.exceptions import SimulationDiverged
from sksurrogate.kernels.record import Record
from sksurrogate.physics._foreign import LARGEST_OFFERED
from sksurrogate.physics._simulator import Plant

__all__ = ["divergence"]

_BOUND = "Bound what the simulator computes (np.clip) or check x0 and the units of X."
_LEAVE = "Give smaller inputs, or leave the run out."


def divergence(plant: Plant, record: Record, nominal: np.ndarray, labels: Sequence[object]) -> SimulationDiverged:
    """The error for the first run whose outputs are not finite, with what the simulator itself says of it.

    Runs of one length are simulated at once, and one that raises takes the others with it: each is tried alone.

    Parameters
    ----------
    plant : Plant
    record : Record
    nominal : ndarray (n_outputs, n_samples)
        Outputs of the simulator, not all finite.
    labels : sequence
        One for each run.

    Returns
    -------
    SimulationDiverged
    """
    for run, (a, b) in enumerate(record.spans):
        Y = nominal[:, a:b]
        if np.all(np.isfinite(Y)):
            continue
        label = labels[run] if len(labels) > 1 else None
        name = "" if label is None else f"run {label!r}, "
        try:
            Y = plain_runs(plant.simulator, record.u[None, :, a:b].transpose(0, 2, 1), None, None)[0].T
        except SimulationDiverged as error:
            return SimulationDiverged(
                f"simulate diverges for the inputs in X: {name}{str(error).rstrip('. ')}. {_LEAVE}",
                run=label,
                row=error.row,
                time=error.time,
                state=error.state,
            )
        bad = ~(np.abs(Y) <= LARGEST_OFFERED)
        if bad.any():
            row = int(np.flatnonzero(bad.any(axis=0))[0])
            output = plant.outputs[int(np.flatnonzero(bad[:, row])[0])]
            time, value = float(record.t[a + row]), Y[bad[:, row], row][0]
            return SimulationDiverged(
                f"simulate gives {value} for the inputs in X: {name}row {row}, t = {time:g}, output {output!r}, expected finite "
                f"numbers. {_BOUND} {_LEAVE}",
                run=label,
                row=row,
                time=time,
                state=output,
            )
    return SimulationDiverged(
        "simulate_batch gives values that are not finite for runs that are finite one by one, expected the same of both. "
        "Correct simulate_batch, or leave it out."
    )
