"""Runs that were given as one: the readings begin elsewhere where one ends and the next begins."""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Sequence

import numpy as np

from sksurrogate.effects._lattice import lattice_steps
from sksurrogate.gap.faults._wrong_readings import EXPECTED, ONE_STEP
from sksurrogate.gap.results._data_faults import listed
from sksurrogate.kernels.linear_fit import linear_least_squares
from sksurrogate.kernels.readings import jumps_that_stay
from sksurrogate.kernels.smoother import noise_of_differences
from sksurrogate.physics._simulator import Plant
from sksurrogate.runs import Run

#: Said where runs seem to be joined.
JOINED = (
    "The readings of {names} jump at {rows}, further than the simulator moves in any sample, as where runs are joined. If a run begins "
    "there, give one label a row (groups; --run COLUMN); if rows are missing there, the time of every row (time; --time COLUMN)."
)
#: One output that jumps may be a sensor that is hit, or that recovers; from so many jumps on runs are likelier.
LEAST_JUMPS = 3
#: Noise, over the deviation of its output, against which a jump is judged at least: readings of a simulator have none.
NOISE_AT_LEAST = 1e-3
#: Rows of a run: fewer between two jumps are a part of the motion, as where inputs were written as outputs.
SHORTEST_RUN = 8
#: Rows in which inputs move that tell what they do at once: a few numbers, which the millions of a long run tell no better.
MOST_MOVES = 4096
#: Least squares, each weighted by what the last one leaves, that give the least sum of absolute deviations.
REWEIGHTED = 20
#: An input that a reading shows at once leaves less than this share of its moves.
MOVES_LEFT = 0.5


def say_joined_runs(runs: Sequence[Run], plant: Plant) -> None:
    """Warn where the readings of a run jump as where another begins."""
    for run in runs:
        assert run.y is not None
        own = run.y - shown_at_once(run.X, run.y)
        found = joined_at(own)
        if not any(len(rows) for rows in found):
            continue
        moves = _largest_steps(plant, run.X)
        beyond = [rows[EXPECTED * sizes_at(rows, z) > most] for rows, z, most in zip(found, own.T, moves)]
        starts = np.unique(np.concatenate(beyond))
        shortest = min(np.min(np.diff([0, *rows, len(run.y)])) for rows in beyond)
        if not len(starts) or shortest < SHORTEST_RUN:
            continue
        names = ", ".join(repr(name) for name, rows in zip(plant.outputs, beyond) if len(rows))
        rows = f"row{'s' if len(starts) > 1 else ''} {listed([str(run.start + row) for row in starts])}"
        warnings.warn(JOINED.format(names=names, rows=rows), UserWarning, stacklevel=2)


def shown_at_once(X: np.ndarray, y: np.ndarray) -> np.ndarray:
    """What inputs (n_rows, n_inputs) add to readings (n_rows, n_outputs) in the same row.

    Moves of the readings over those of the inputs, with the least sum of absolute deviations: a run that begins is an outlier. Nothing
    where most of the moves stay: a controller moves its input with the reading, and not the other way round.

    >>> moves = np.repeat([0.0, 3.0, 1.0], 4)[:, None]
    >>> float(np.ptp(5.0 * moves - shown_at_once(moves, 5.0 * moves)).round(9))
    0.0
    """
    du, dy, out = np.diff(X, axis=0), np.diff(y, axis=0), np.zeros(y.shape)
    moves = np.any(du != 0.0, axis=1)
    for j, moved in enumerate(dy.T):
        known = np.flatnonzero(~np.isnan(moved) & moves)
        known = known[:: len(known) // MOST_MOVES + 1]
        gain, weights = np.zeros(X.shape[1]), np.ones(len(known))
        for _ in range(REWEIGHTED if len(known) else 0):
            gain = linear_least_squares(weights[:, None] * du[known], weights * moved[known])
            left = np.abs(moved[known] - du[known] @ gain)
            weights = 1.0 / np.sqrt(np.maximum(left, max(1e-9 * float(np.max(left)), 1e-300)))
        left = np.abs(moved[known] - du[known] @ gain)
        if np.sum(left) < MOVES_LEFT * np.sum(np.abs(moved[known])):
            out[:, j] = X @ gain
    return out


def sizes_at(rows: np.ndarray, z: np.ndarray) -> np.ndarray:
    """How far readings (n_rows,) at some rows are from the last ones before."""
    known = np.flatnonzero(~np.isnan(z))
    return np.abs(z[rows] - z[known[np.searchsorted(known, rows) - 1]])


def joined_at(y: np.ndarray) -> list[np.ndarray]:
    """Rows to which every output jumps by more than a level of its grid; none unless two outputs jump at once or there are many jumps.

    ``y`` (n_rows, n_outputs): nan where nothing was measured.

    >>> fall = np.exp(-0.05 * np.arange(100.0))
    >>> [rows.tolist() for rows in joined_at(np.tile(np.c_[fall, 2.0 * fall], (2, 1)))]
    [[100], [100]]
    """
    found = [_jumps(column) for column in y.T]
    outputs = Counter(np.concatenate(found).tolist())  # that jump at a row
    several = max(outputs.values(), default=0) > 1 or len(outputs) >= LEAST_JUMPS
    return found if several else [rows[:0] for rows in found]


def _jumps(y: np.ndarray) -> np.ndarray:
    """Rows to which one output (n_rows,) jumps, nan where it was not measured."""
    rows = np.flatnonzero(~np.isnan(y))
    known = y[rows]
    sd = float(noise_of_differences(known[None], np.array([0]))[0]) if len(known) > 4 else np.inf
    at = jumps_that_stay(known, max(sd, NOISE_AT_LEAST * float(np.std(known))) if len(known) else np.inf)
    sizes = np.abs(known[at] - known[at - 1])
    grid = max(lattice_steps(known), default=0.0) if len(at) else 0.0
    return np.asarray(rows[at[sizes > ONE_STEP * grid]])


def _largest_steps(plant: Plant, X: np.ndarray) -> np.ndarray:
    """How far the simulator alone moves in one sample at most, (n_outputs,); inf where it cannot be run, 0 from where it runs away."""
    try:
        with np.errstate(all="ignore"):
            own = np.asarray(plant.simulator.simulate(X), dtype=float).reshape(len(X), -1)
    except Exception:  # the diagnosis says what is wrong with it
        return np.full(len(plant.outputs), np.inf)
    steps = np.abs(np.diff(own, axis=0))
    return np.max(np.where(np.isfinite(steps), steps, 0.0), axis=0)
