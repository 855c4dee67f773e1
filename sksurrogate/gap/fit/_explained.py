"""How much of a record the simulator alone explains: its variance along the free run."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sksurrogate.effects._model import AugmentedModel
from sksurrogate.kernels.free_runs import free_run
from sksurrogate.kernels.record import Record
from sksurrogate.physics._model import PlantModel

#: In the right unit the simulator alone explains at least this share of every output's variance more: half of what there is.
MORE_EXPLAINED = 0.5
#: Share of the variance that a unit may leave which is in no doubt.
MOST_UNEXPLAINED = 0.05
#: Steps of the integrator in a sample, enough where a sample resolves the plant.
SUBSTEPS_OF_A_LOOK = 8


class OtherWriting(NamedTuple):
    """A record written otherwise than the simulator expects."""

    share: float  #: Share of the variance of each output that the simulator alone explains then, at least
    sentence: str  #: Empty where nothing helps


#: Where no other way of writing explains more.
NOTHING_HELPS = OtherWriting(-np.inf, "")


def explained(model: PlantModel, record: Record) -> float:
    """Share of the variance of each output that the free run explains at least; -inf without a run."""
    start = np.repeat(model.plant.x0[:, None], len(record.starts), axis=1)
    for j, i in enumerate(model.plant.output_states or ()):
        start[i] = record.y[j, record.starts]
    return share_explained(record, nominal_run(model, record, start))


def share_explained(record: Record, y: np.ndarray) -> float:
    """The same of predicted outputs (n_outputs, n_samples)."""
    left = record.residual(y)
    left = left - left.mean(axis=1, keepdims=True)
    with np.errstate(all="ignore"):  # in a unit far off the run may leave the numbers
        share = 1.0 - np.mean(left**2, axis=1) / record.spread**2
    return float(np.min(share)) if np.isfinite(share).all() else -np.inf


def nominal_run(model: PlantModel, record: Record, start: np.ndarray) -> np.ndarray:
    """Outputs (n_outputs, n_samples) of the free run."""
    nominal = AugmentedModel(model, (), (), record, n_sub=SUBSTEPS_OF_A_LOOK, scale=np.ones(len(model.plant.states)))
    with np.errstate(all="ignore"):
        x = free_run(nominal, np.zeros(0), start)
        return nominal.bind(np.zeros((0, 1))).outputs(x[:, None])[:, 0]
