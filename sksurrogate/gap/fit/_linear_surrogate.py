"""A linear surrogate for a simulator that only gives trajectories: how inputs, forces and initial states spread in it.

Learned from the simulator's own outputs. It never decides how well an effect fits (the simulator does), but it orders the
candidates, carries a coloured disturbance to the outputs, and says where a disturbance would have to enter.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from sksurrogate.gap.fit._normal_equations import project_starts
from sksurrogate.gap.fit._pushes import gain_of_forces
from sksurrogate.kernels.banded import a_sample_later, recursion_band, solve_recursion
from sksurrogate.kernels.disturbance import Disturbance
from sksurrogate.kernels.record import Record
from sksurrogate.kernels.state_space import subspace

#: Orders that are tried; the smallest whose error is within WORSE of the best is taken.
ORDERS, WORSE = (1, 2, 3, 4), 1.3
#: Rows of the past that the projection sees.
ROWS_OF_PAST = 12


@dataclass(frozen=True, eq=False)
class LinearSurrogate:
    """``x' = A x + B u``, ``y = C x + D u`` about the simulator's own outputs."""

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    scale: np.ndarray  #: (n_states,): size of the states over the record
    starts: np.ndarray  #: int (n_runs,)
    n_samples: int

    @property
    def band(self) -> np.ndarray:
        """Band of the recursion over all rows."""
        return recursion_band(np.repeat(self.A[:, :, None], self.n_samples, axis=2), self.starts)

    def respond(self, du: np.ndarray) -> np.ndarray:
        """Change of the outputs (n_columns, n_outputs, n_samples) for changes of the inputs (n_columns, n_inputs, n_samples)."""
        x = solve_recursion(self.band, a_sample_later(np.einsum("ij,kjt->ikt", self.B, du), self.starts))
        return np.einsum("oi,ikt->kot", self.C, x) + np.einsum("oj,kjt->kot", self.D, du)

    def transients(self) -> np.ndarray:
        """Outputs after a unit of every initial state (n_outputs, n_states, n_samples)."""
        b = np.zeros((*self.A.shape, self.n_samples))
        b[:, :, self.starts] = np.diag(self.scale)[:, :, None]
        return np.einsum("oi,ikt->okt", self.C, solve_recursion(self.band, b))

    def disturbance(
        self, free_starts: bool, push: np.ndarray | None = None, known: np.ndarray | None = None
    ) -> Disturbance:
        """Noise model with a force on every state, or on the columns of ``push`` (n_states, n_forces)."""
        N = self.n_samples
        push = np.diag(self.scale) if push is None else push
        return Disturbance(
            np.repeat(self.A[:, :, None], N, axis=2),
            np.repeat(push[:, :, None], N, axis=2),
            np.repeat(self.C[:, :, None], N, axis=2),
            self.starts,
            (3.0 if free_starts else 1e-3) * self.scale,
            1e-5 * self.scale,
            known,
        )

    def caps(self, spread: np.ndarray, largest: float) -> tuple[np.ndarray, np.ndarray]:
        """Forces on every state and coloured sensor noise that move outputs of a ``spread`` (n_outputs,) by its ``largest`` share."""
        C = np.broadcast_to(self.C[:, :, None], (*self.C.shape, self.n_samples))
        gain = gain_of_forces(self.band, np.diag(self.scale), C, self.starts, spread)
        return largest / np.maximum(gain, 1e-9), largest * spread


def learn(record: Record, y: np.ndarray) -> LinearSurrogate:
    """From the simulator's outputs y (n_outputs, n_samples) under the record's inputs.

    A model of one state that forgets at once stands in where nothing can be learned (inputs that never move).
    """
    pieces = [slice(a, b) for a, b in record.spans]
    spread = np.maximum(np.std(y, axis=1, keepdims=True), 1e-12)
    middle = y.mean(axis=1, keepdims=True)
    level = record.u.mean(axis=1, keepdims=True)
    size = np.maximum(np.std(record.u, axis=1, keepdims=True), 1e-12)
    z, u = (y - middle) / spread, (record.u - level) / size
    trials: list[tuple[float, int, LinearSurrogate]] = []
    past = int(min(ROWS_OF_PAST, max((record.lengths.max() - 1) // 3, 1)))
    for n, through in product(ORDERS, (False, True)):
        try:
            found = subspace([u[:, s].T for s in pieces], [z[:, s].T for s in pieces], n, past, through)
        except np.linalg.LinAlgError:
            continue
        if found is None:
            continue
        A, B, C, D, b, c = found
        model = LinearSurrogate(A, B, C, D, np.ones(n), record.starts, record.n_samples)
        error = _free_error(model, u, z, b, c)
        if np.isfinite(error):
            trials.append((error, n + through, model))
    if not trials:
        A, none = np.eye(len(y)), np.zeros((len(y), len(record.u)))
        return LinearSurrogate(0.5 * A, none, A, none, spread[:, 0], record.starts, record.n_samples)
    best = min(error for error, _, _ in trials)
    _, _, model = min((item for item in trials if item[0] <= WORSE * best + 1e-4), key=lambda item: item[1:2])
    return replace(model, B=model.B / size.T, C=spread * model.C, D=spread * model.D / size.T)


def _free_error(model: LinearSurrogate, u: np.ndarray, z: np.ndarray, b: np.ndarray, c: np.ndarray) -> float:
    """RMS error of the free run, initial states fitted."""
    n = len(model.A)
    load = np.zeros((n, 1 + n, model.n_samples))
    load[:, 0, 1:] = (model.B @ u + b[:, None])[:, :-1]
    load[:, :, model.starts] = np.eye(n, 1 + n, 1)[:, :, None]
    x = solve_recursion(model.band, load)
    seen = np.einsum("oi,ikt->kot", model.C, x)
    r = z - seen[0] - model.D @ u - c[:, None]
    if not (np.isfinite(seen).all() and np.isfinite(r).all()):
        return np.inf
    left = project_starts(r[None], seen[1:].transpose(1, 0, 2), model.starts)
    return float(np.sqrt(np.sum(left**2) / r.size))
