"""What the kernels of free-run fits ask of a model: shapes, what is known of the start, and a map from sample to sample.

A plant with free parameters (:mod:`sksurrogate.physics`), the same with effects (:mod:`sksurrogate.effects`) and one with a
learned term (:mod:`sksurrogate.compose`) are such models; the kernels know none of them.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from sksurrogate.kernels.record import Record


class Stepper(Protocol):
    """A map from sample to sample, inputs and parameters filled in."""

    def __call__(self, x: np.ndarray) -> np.ndarray:
        """States (n_states, n_columns, n_samples) -> the states one sample later."""


class ObservedStepper(Stepper, Protocol):
    """The same with what is measured along the way."""

    def outputs(self, x: np.ndarray) -> np.ndarray:
        """Measured outputs (n_outputs, n_columns, n_samples) along states (n_states, n_columns, n_samples)."""


class BoundFreeRunModel(ObservedStepper, Protocol):
    """A model with its parameters filled in, one vector for each column."""

    def __call__(self, x: np.ndarray, rows: np.ndarray | None = None) -> np.ndarray:
        """The states one sample later; with ``rows`` (n_some,), x and the answer hold these samples only."""

    def run(self, x0: np.ndarray) -> np.ndarray | None:
        """Free run (n_states, n_samples) from initial states (n_states, n_runs) by the simulator itself; None where it offers none."""

    def start(self, x0: np.ndarray) -> np.ndarray:
        """All initial states (n_states, n_columns, n_runs) from the nominal ones (n_nominal, n_columns, n_runs)."""


class FreeRunModel(Protocol):
    """A model over a record, with unknown parameters ``theta`` (n_theta,) and unknown initial states."""

    @property
    def record(self) -> Record:
        """The data."""

    @property
    def n_states(self) -> int:
        """Rows of a trajectory (n_states, n_samples): nominal states first, hidden ones behind them."""

    @property
    def n_nominal(self) -> int:
        """Nominal states."""

    @property
    def n_theta(self) -> int:
        """Parameters."""

    @property
    def scale(self) -> np.ndarray:
        """Size of every state, (n_states,), > 0: differences and corrections are measured in it."""

    @property
    def free_states(self) -> np.ndarray:
        """Whether the initial value of a state is unknown, bool (n_states,); the others follow by ``start``."""

    @property
    def plain_outputs(self) -> tuple[int, ...] | None:
        """Positions of the states that the outputs are; None where ``outputs`` has to be asked."""

    @property
    def may_jump(self) -> bool:
        """Whether the map is a simulator's own step, which may jump, so that a free run need not be the limit of corrections."""

    @property
    def steps_many(self) -> bool:
        """Whether this step takes many samples in one call: walking through them one by one costs a call for each."""

    def closing_weight(self, sd: np.ndarray) -> np.ndarray:
        """Size (n_states,) to which a free run is closed, with sensors of noise ``sd`` (n_outputs,)."""

    def bind(self, theta: np.ndarray) -> BoundFreeRunModel:
        """The model at parameter vectors ``theta`` (n_theta, n_columns)."""
