"""Closed-loop data: inputs that follow the noise of the outputs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sksurrogate.gap.fit._normal_equations import unexplained
from sksurrogate.kernels.linear_fit import linear_least_squares
from sksurrogate.kernels.record import Record, ages_of
from sksurrogate.kernels.run_columns import UNSEEN

#: Lags of an input that explain its next move without the outputs: at most so many, for a profile of twenty lines foretells
#: itself from forty, and one for so many moves; lags of the residual that must add nothing.
INPUT_LAGS, MOVES_A_LAG, RESIDUAL_LAGS = 40, 25, 3
#: Share of the moves of an input that residuals must explain beyond its own past, and its size against chance.
SHARE_FOLLOWED, FOLLOWED_AGAINST_CHANCE = 0.02, 40.0
#: A move beyond this many times the median one is a jump of the reference.
JUMP_OF_INPUT = 6.0
#: Pieces of the moves of which every other one makes a half.
LOOP_PIECES = 4
#: Moves of an input that are enough to judge by.
FEWEST_MOVES = 60

LOOP = (
    "Input {name!r} follows the noise of the outputs: the data look closed-loop. Noise reaches the inputs, and effects that the "
    "controller hides may be underestimated. Give the controller (ClosedLoopSimulator), or open the loop for a run."
)


def closed_loop(record: Record, y: np.ndarray, names: Sequence[str]) -> str | None:
    """The input that follows residuals of the outputs, if any.

    The next move of an input is regressed on what foretells it in an open loop, its own past, that of the model and the same
    profile in other runs, and on that with present and past residuals beside it: sensor noise can only get into an input
    through a controller.

    ``y`` (n_outputs, n_samples): outputs of the fitted free run.
    ``names``: of the inputs.
    """
    age = ages_of(record.starts, record.n_samples)
    r = record.y - y
    quick = np.diff(r, axis=1, prepend=r[:, :1])  # what is slow in a residual may come from the input itself
    for i, name in enumerate(names):
        u = record.u[i]
        moves = np.abs(np.diff(u, prepend=u[:1])) > 1e-9 * max(float(np.ptp(u)), 1e-300)
        moved = np.flatnonzero(moves & (age > 0))  # where an input stands still nothing drives it
        lags = max(min(INPUT_LAGS, len(moved) // MOVES_A_LAG, int(record.lengths.max()) // 4), RESIDUAL_LAGS)
        rows = moved[age[moved] >= lags + 1]
        if len(rows) < FEWEST_MOVES:
            continue
        move = u[rows] - u[rows - 1]
        foreign = np.stack([e[rows - lag] for e in quick for lag in range(RESIDUAL_LAGS)], axis=1)
        own = np.stack([np.ones(len(rows)), *_past(record, y, rows, lags), *_repeated(record, i, rows)], axis=1)
        left, calm = _foretold(own, move)
        foretells_itself = float(left[calm] @ left[calm]) <= 1e-10 * float(move[calm] @ move[calm])
        if foretells_itself or calm.sum() < FEWEST_MOVES:
            continue
        e = unexplained(own[calm], foreign[calm])
        z = left[calm] - left[calm].mean()
        share = _explained(z, unexplained(e, z))
        beyond_chance = share * (len(z) - own.shape[1]) > FOLLOWED_AGAINST_CHANCE + 2.0 * foreign.shape[1]
        if share > SHARE_FOLLOWED and beyond_chance and _in_every_part(e, z, share):
            return name
    return None


def _explained(z: np.ndarray, rest: np.ndarray) -> float:
    """Share of the squares of z of which a ``rest`` is left."""
    return 1.0 - float(rest @ rest) / max(float(z @ z), 1e-300)


def _in_every_part(e: np.ndarray, z: np.ndarray, share: float) -> bool:
    """Whether coefficients learned from one half of the moves explain the other half: a controller is the same all along.

    Halves alternate in pieces, and each explains the other at least half as well as the ``share`` that is explained of all.
    """
    half = (np.arange(len(z)) * 2 * LOOP_PIECES // len(z)) % 2 == 0
    for learnt in (half, ~half):
        w = linear_least_squares(e[learnt], z[learnt], rcond=UNSEEN)
        if _explained(z[~learnt], z[~learnt] - e[~learnt] @ w) < 0.5 * share:
            return False
    return True


def _past(record: Record, y: np.ndarray, rows: np.ndarray, lags: int) -> list[np.ndarray]:
    """What an operator or a fixed profile knows: the past of all inputs, and what the model makes of it, however long ago."""
    inputs = [v[rows - lag] for v in record.u for lag in range(1, lags + 1)]
    shown = [out[rows - lag] for out in y for lag in range(1, RESIDUAL_LAGS + 1)]
    return [*inputs, *shown, *(v * np.abs(v) for v in shown[::RESIDUAL_LAGS])]


def _repeated(record: Record, i: int, rows: np.ndarray) -> list[np.ndarray]:
    """The mean move of the input in the other runs at the same age: a profile that is run again follows no noise."""
    moves = np.diff(record.u[i], prepend=record.u[i, :1])
    moves[record.starts] = 0.0
    age = ages_of(record.starts, record.n_samples)
    total, count = np.bincount(age, moves), np.bincount(age)
    others = (total[age] - moves) / np.maximum(count[age] - 1, 1)
    return [others[rows]] if np.any(others[rows] != 0) else []


def _foretold(own: np.ndarray, move: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What the input's own past leaves of its moves, and the rows without the jumps of a reference, which would hide it."""
    left = move
    for _ in range(3):
        calm = np.abs(left) <= JUMP_OF_INPUT * float(np.median(np.abs(left)))
        left = move - own @ linear_least_squares(own[calm], move[calm], rcond=UNSEEN)
    return left, np.abs(left) <= JUMP_OF_INPUT * float(np.median(np.abs(left)))
