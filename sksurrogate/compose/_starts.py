"""Initial states of a simulator from the first measured rows of a run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sksurrogate.compose._plant_path import plant_path
from sksurrogate.compose._support import block_powers, supported
from sksurrogate.exceptions import SurrogateError
from sksurrogate.physics._simulator import describe, simulated, simulated_batch

#: Gauss-Newton steps: a few rows are nearly linear in the initial states.
HIDDEN_START_STEPS = 3
#: Share of the squared error that initial states must explain: where they explain less, they rather make up for what the
#: simulator misses, which is the correction's part.
MOST_OF_ERROR = 0.5
#: Places along the runs where the error of a few rows is measured.
MOST_START_ROWS = 64


@dataclass(frozen=True, eq=False)
class Starts:
    """What is known of initial states before a run begins."""

    #: (n_states,): standard deviation around the simulator's own initial state; for states that are outputs around
    #: their first measurement
    prior: np.ndarray
    #: (n_outputs,): of a few rows around a run of the simulator that starts right: noise, and what the simulator
    #: misses meanwhile
    sd: np.ndarray

    def __call__(self, simulator: Any, inputs: Sequence[np.ndarray], first: Sequence[np.ndarray]) -> list[np.ndarray]:
        """The most probable initial states (n_states,), one per run, given its first rows (n_rows, n_outputs)."""
        means = [np.asarray(x0) for x0 in plain_starts(simulator, first)]
        out = list(means)
        lengths = [len(y) for y in first]
        for length in set(lengths) - {0}:
            runs = [r for r, n in enumerate(lengths) if n == length]
            U = np.stack([inputs[r][:length] for r in runs])
            found = self._likeliest(
                simulator, U, np.stack([first[r] for r in runs]), np.stack([means[r] for r in runs])
            )
            for r, x0 in zip(runs, found):
                out[r] = x0
        return out

    def _likeliest(self, simulator: Any, U: np.ndarray, y: np.ndarray, mean: np.ndarray) -> np.ndarray:
        """Gauss-Newton, all runs and all states in one batch: (n_runs, n_states)."""
        n_runs, n = mean.shape
        precision = np.diag(1.0 / self.prior**2)
        step = 1e-2 * self.prior
        x = mean.copy()
        for _ in range(HIDDEN_START_STEPS):
            moved = x[:, None] + np.concatenate([np.zeros((1, n)), np.diag(step)])
            Y = runs_from(simulator, np.repeat(U, n + 1, axis=0), moved.reshape(-1, n)).reshape(
                n_runs, n + 1, *y.shape[1:]
            )
            for r in range(n_runs):
                J = ((Y[r, 1:] - Y[r, 0]) / step[:, None, None] / self.sd).reshape(n, -1).T
                error = ((y[r] - Y[r, 0]) / self.sd).ravel()
                if np.all(np.isfinite(J)) and np.all(np.isfinite(error)):
                    x[r] += np.linalg.solve(J.T @ J + precision, J.T @ error - precision @ (x[r] - mean[r]))
        return x


def plain_starts(simulator: Any, first: Sequence[np.ndarray | None]) -> list[np.ndarray | None]:
    """The simulator's own initial state, states that are outputs at the first measurement; None where nothing is given."""
    plant = describe(simulator)
    places = plant.output_states if plant.states else None
    starts: list[np.ndarray | None] = []
    for y in first:
        x0 = None
        if y is not None and len(y) and plant.states:
            x0 = plant.x0.copy()
            if places is not None:
                x0[list(places)] = y[0]
        starts.append(x0)
    return starts


def runs_from(simulator: Any, U: np.ndarray, X0: np.ndarray) -> np.ndarray:
    """Free runs (n_runs, n_samples, n_outputs) of equal length from initial states; nan where one breaks off."""
    if callable(getattr(simulator, "simulate_batch", None)):
        return np.asarray(simulated_batch(simulator, U, X0))
    return np.stack([np.asarray(simulated(simulator, u, x0)).reshape(len(u), -1) for u, x0 in zip(U, X0)])


def _runs_from_each(simulator: Any, inputs: Sequence[np.ndarray], begins: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Free runs (n_starts, n_samples, n_outputs) along each input from some initial states (n_starts, n_states); those of one length at
    once."""
    lengths, out = [len(U) for U in inputs], [np.zeros(0)] * len(inputs)
    for length in dict.fromkeys(lengths):
        alike = [r for r, n in enumerate(lengths) if n == length]
        n = len(begins[alike[0]])
        U = np.stack([inputs[r] for r in alike for _ in range(n)])
        Y = runs_from(simulator, U, np.concatenate([begins[r] for r in alike]))
        for r, some in zip(alike, Y.reshape(len(alike), n, *Y.shape[1:])):
            out[r] = some
    return out


def fitted_starts(
    simulator: Any, inputs: list[np.ndarray], measured: list[np.ndarray], n_rows: int
) -> tuple[Starts, list[np.ndarray]] | None:
    """Prior of the initial states and the smoothed ones of the runs; None where the simulator's own are no worse.

    Judged by the simulator's own free runs: from its own initial states, and from those that the first ``n_rows`` rows
    show. One or two runs are judged in four blocks and in two, since they tell of no other starts.
    """
    plant = describe(simulator, n_inputs=inputs[0].shape[1], n_outputs=measured[0].shape[1])
    hidden = [k for k in range(len(plant.states)) if k not in set(plant.output_states or ())]
    few = max(4 // len(inputs), 1)
    if plant.access == "trajectory" or not hidden or min(len(y) for y in measured) < few * (2 * n_rows + 2):
        return None
    try:
        model, path, noise = plant_path(plant, inputs, measured)
    except (SurrogateError, np.linalg.LinAlgError):
        return None
    if not np.all(np.isfinite(path)):
        return None
    record = model.record
    own = np.repeat(plant.x0[:, None], path.shape[1], axis=1)
    rows = np.arange(path.shape[1]) if few > 1 else record.starts
    prior = np.sqrt(np.mean((path - own)[:, rows] ** 2, axis=1))
    size = np.maximum(np.std(record.y, axis=1), 1e-300)
    if plant.output_states is not None:
        prior[list(plant.output_states)] = np.maximum(noise, 1e-3 * size)[: len(plant.output_states)]
    prior = np.maximum(prior, 1e-6 * np.maximum(np.std(path, axis=1), 1e-6))
    starts = Starts(prior, _error_of_rows(simulator, inputs, measured, record.starts, path, n_rows, noise, size))
    parts = {few, max(few // 2, 1)}
    blocks = [(r, a, b) for r, y in enumerate(measured) for count in parts for a, b in _blocks(len(y), count)]
    U, y = [inputs[r][a:b] for r, a, b in blocks], [measured[r][a:b] for r, a, b in blocks]
    first = [part[:n_rows] for part in y]
    begins = [
        np.stack(both) for both in zip(map(np.asarray, plain_starts(simulator, first)), starts(simulator, U, first))
    ]
    errors = [(both - part)[:, n_rows:] / size for both, part in zip(_runs_from_each(simulator, U, begins), y)]
    power = block_powers(errors, [(r, b) for r, _, b in blocks], [len(part) for part in measured]).sum(axis=2)
    if supported(power, np.array([0.0, 1.0])).sure < MOST_OF_ERROR:
        return None
    return starts, list(path[:, record.starts].T)


def _blocks(n: int, count: int) -> list[tuple[int, int]]:
    """(start, stop) of ``count`` parts of n rows."""
    edges = np.linspace(0, n, count + 1).astype(int)
    return [(int(a), int(b)) for a, b in zip(edges, edges[1:])]


def _error_of_rows(
    simulator: Any,
    inputs: list,
    measured: list,
    starts: np.ndarray,
    path: np.ndarray,
    n_rows: int,
    noise: Any,
    size: Any,
) -> np.ndarray:
    """RMS error (n_outputs,) of ``n_rows`` rows simulated from states along the path."""
    every = [(r, k) for r, y in enumerate(measured) for k in range(len(y) - n_rows)]
    chosen = [every[i] for i in np.unique(np.linspace(0, len(every) - 1, MOST_START_ROWS).astype(int))]
    U = np.stack([inputs[r][k : k + n_rows] for r, k in chosen])
    X0 = np.stack([path[:, starts[r] + k] for r, k in chosen])
    error = runs_from(simulator, U, X0) - np.stack([measured[r][k : k + n_rows] for r, k in chosen])
    error = error[np.isfinite(error).all(axis=(1, 2))]
    found = np.sqrt(np.mean(error**2, axis=(0, 1))) if len(error) else size
    return np.maximum(found, np.maximum(noise, 1e-6 * size))
