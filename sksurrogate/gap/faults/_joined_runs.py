"""Runs that were given as one: the readings begin elsewhere where one ends and the next begins."""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from sksurrogate.effects._lattice import lattice_steps
from sksurrogate.gap.faults._wrong_readings import EXPECTED, ONE_STEP
from sksurrogate.gap.results._data_faults import listed
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


class Jumps(NamedTuple):
    """Of one output: rows to which it jumps, and how far."""

    rows: np.ndarray
    sizes: np.ndarray


def say_joined_runs(runs: Sequence[Run], plant: Plant) -> None:
    """Warn where the readings of a run jump as where another begins."""
    for run in runs:
        assert run.y is not None
        found = joined_at(run.y)
        if not any(len(jumps.rows) for jumps in found):
            continue
        moves = _largest_steps(plant, run.X)
        beyond = [jumps.rows[EXPECTED * jumps.sizes > most] for jumps, most in zip(found, moves)]
        starts = np.unique(np.concatenate(beyond))
        shortest = min(np.min(np.diff([0, *rows, len(run.y)])) for rows in beyond)
        if not len(starts) or shortest < SHORTEST_RUN:
            continue
        names = ", ".join(repr(name) for name, rows in zip(plant.outputs, beyond) if len(rows))
        rows = f"row{'s' if len(starts) > 1 else ''} {listed([str(run.start + row) for row in starts])}"
        warnings.warn(JOINED.format(names=names, rows=rows), UserWarning, stacklevel=2)


def joined_at(y: np.ndarray) -> list[Jumps]:
    """Jumps of every output by more than a level of its grid; none unless two outputs jump at once or there are many jumps.

    ``y`` (n_rows, n_outputs): nan where nothing was measured.

    >>> fall = np.exp(-0.05 * np.arange(100.0))
    >>> [jumps.rows.tolist() for jumps in joined_at(np.tile(np.c_[fall, 2.0 * fall], (2, 1)))]
    [[100], [100]]
    """
    found = [_jumps(column) for column in y.T]
    outputs = Counter(np.concatenate([jumps.rows for jumps in found]).tolist())  # that jump at a row
    several = max(outputs.values(), default=0) > 1 or len(outputs) >= LEAST_JUMPS
    return found if several else [Jumps(jumps.rows[:0], jumps.sizes[:0]) for jumps in found]


def _jumps(y: np.ndarray) -> Jumps:
    """Of one output (n_rows,), nan where it was not measured."""
    rows = np.flatnonzero(~np.isnan(y))
    known = y[rows]
    sd = float(noise_of_differences(known[None], np.array([0]))[0]) if len(known) > 4 else np.inf
    at = jumps_that_stay(known, max(sd, NOISE_AT_LEAST * float(np.std(known))) if len(known) else np.inf)
    sizes = np.abs(known[at] - known[at - 1])
    grid = max(lattice_steps(known), default=0.0) if len(at) else 0.0
    return Jumps(rows[at[sizes > ONE_STEP * grid]], sizes[sizes > ONE_STEP * grid])


def _largest_steps(plant: Plant, X: np.ndarray) -> np.ndarray:
    """How far the simulator alone moves in one sample at most, (n_outputs,); inf where it cannot be run, 0 from where it runs away."""
    try:
        with np.errstate(all="ignore"):
            own = np.asarray(plant.simulator.simulate(X), dtype=float).reshape(len(X), -1)
    except Exception:  # the diagnosis says what is wrong with it
        return np.full(len(plant.outputs), np.inf)
    steps = np.abs(np.diff(own, axis=0))
    return np.max(np.where(np.isfinite(steps), steps, 0.0), axis=0)
