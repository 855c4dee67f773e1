"""Samples in which a simulator's own step jumps: an impact falls into one of its steps, or by chance into the next."""

from __future__ import annotations

import numpy as np

from sksurrogate.gap.fit._ode import OdeBackend

JUMPS_NOTE = (
    "The simulator jumps along the data, as impacts do: in which of its own steps one falls moves what follows by more than the noise. "
    "Free runs therefore start again behind {n} such samples, with initial states of their own."
)


def rows_that_jump(problem: OdeBackend, x: np.ndarray) -> np.ndarray:
    """Whether where a simulator's own steps fall moves the next states of a path by more than their noise, (n_samples,) of bool.

    States half a step of the simulator apart lead to next states that are as far apart as those before and behind them, or, where
    a force sets in, to something between these. Where an impact falls into another step they lead further: by as much as a free
    run is off behind it. Samples that an impact misses by a step of the simulator count too.

    ``x`` (n_states, n_samples).
    """
    model, step = problem.nominal_model, getattr(problem.plant.simulator, "timestep", None)
    if not (model.may_jump and step):
        return np.zeros(x.shape[1], bool)
    bound, noise, now = model.bind(np.zeros((0, 1))), model.closing_weight(problem.sd), x[:, None]
    own = problem.model.step(problem.record.t, now, bound.acting(0), float(step)) - now
    apart = np.diff(bound(now + 0.5 * np.arange(-3, 4)[:, None] * own), axis=1)
    sides = apart[:, :-2], apart[:, 2:]
    beyond = np.abs(apart[:, 1:-1] - np.clip(apart[:, 1:-1], np.minimum(*sides), np.maximum(*sides)))
    return np.asarray(np.max(beyond / noise[:, None, None], axis=(0, 1)) > 1.0)


def starts_behind(jumps: np.ndarray, starts: np.ndarray) -> np.ndarray:
    """First rows of the runs, and rows behind a step that jumps.

    >>> starts_behind(np.array([False, True, False, False, True]), np.array([0, 3]))
    array([0, 2, 3])
    """
    behind = 1 + np.flatnonzero(jumps[:-1])
    return np.union1d(starts, behind)
