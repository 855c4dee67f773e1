"""Closed-loop data: inputs that follow the noise of the outputs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sksurrogate.gap.fit._ode import OdeCandidate
from sksurrogate.kernels.record import Record

__all__ = ["LOOP", "closed_loop", "may_follow_noise"]

#: Lags of an input that explain its next move without the outputs; lags of the residual that must add nothing.
OWN, FOREIGN = 6, 3
#: Share of the moves of an input that residuals must explain beyond its own past, and its size against chance.
SHARE_FOLLOWED, CHANCE = 0.02, 40.0
#: A move beyond this many times the median one is a jump of the reference.
JUMP_OF_INPUT = 6.0
#: Moves of an input that are enough to judge by.
FEWEST_MOVES = 60

LOOP = (
    "Input {name!r} follows the noise of the outputs: the data look closed-loop. Effects that the controller hides are "
    "underestimated and noise reaches the inputs; add a reference signal or open the loop for a run."
)


def closed_loop(record: Record, y: np.ndarray, names: Sequence[str]) -> str | None:
    """The input that follows residuals of the outputs, if any.

    The next move of an input is regressed on its own past, and on that with present and past residuals beside it: sensor
    noise can only get into an input through a controller.

    Parameters
    ----------
    record : Record
    y : ndarray (n_outputs, n_samples)
        Outputs of the fitted free run.
    names : sequence of str
        Of the inputs.
    """
    age = np.arange(record.n_samples) - record.starts[record.run_of_row]
    inside = np.flatnonzero(age >= OWN + 1)
    r = record.residual(y)
    quick = np.diff(r, axis=1, prepend=r[:, :1])  # what is slow in a residual may come from the input itself
    if record.known is not None:  # a value that was not measured says nothing of a move
        quick[:, 1:] *= record.known[:, 1:] & record.known[:, :-1]
    for u, name in zip(record.u, names):
        moved = np.abs(u[inside] - u[inside - 1]) > 1e-9 * max(float(np.ptp(u)), 1e-300)
        rows = inside[moved]  # where an input stands still nothing drives it
        if len(rows) < FEWEST_MOVES:
            continue
        move = u[rows] - u[rows - 1]
        foreign = np.stack([e[rows - lag] for e in quick for lag in range(FOREIGN)], axis=1)
        own = np.stack([np.ones(len(rows)), *(v[rows - lag] for v in record.u for lag in range(1, OWN + 1))], axis=1)
        left, calm = _foretold(own, move)
        if float(left[calm] @ left[calm]) <= 1e-10 * float(move[calm] @ move[calm]):
            continue  # the input foretells itself
        if calm.sum() < FEWEST_MOVES or np.std(left[calm]) == 0:
            continue
        e = foreign[calm] - foreign[calm].mean(axis=0)
        z = left[calm] - left[calm].mean()
        rest = z - e @ np.linalg.lstsq(e, z, rcond=1e-10)[0]
        share = 1.0 - float(rest @ rest) / float(z @ z)
        if share > SHARE_FOLLOWED and share * len(z) > CHANCE + 2.0 * foreign.shape[1]:
            return name
    return None


def _foretold(own: np.ndarray, move: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What the input's own past leaves of its moves, and the rows without the jumps of a reference, which would hide it."""
    left = move
    for _ in range(3):
        calm = np.abs(left) <= JUMP_OF_INPUT * float(np.median(np.abs(left)))
        left = move - own @ np.linalg.lstsq(own[calm], move[calm], rcond=1e-10)[0]
    return left, np.abs(left) <= JUMP_OF_INPUT * float(np.median(np.abs(left)))


def may_follow_noise(rival: OdeCandidate, base: OdeCandidate) -> bool:
    """Whether what a rival adds to ``base`` at an input may only follow the noise that a controller puts into it.

    Where an output shows an input at once and the input answers the output's noise at once, an effect on the input can
    follow that noise, but it can remove no more than all of it.
    """
    added = {e.location for e in rival.effects if e.kind == "input" and e.key not in base.keys}
    problem = rival.problem
    if not added or base.fit.cost - rival.fit.cost > problem.record.n_values:
        return False
    looped = closed_loop(problem.record, rival.fit.y, problem.plant.inputs)
    return looped in added and shown_at_once(rival, str(looped))


def shown_at_once(rival: OdeCandidate, name: str) -> bool:
    """Whether an output of the simulator depends on an input in the same sample."""
    problem = rival.problem
    record, i = problem.record, problem.plant.inputs.index(name)
    u = record.u.copy()
    u[i] += 1e-3 * max(float(np.std(u[i])), 1e-9)
    x, nothing = rival.fit.x[: len(problem.plant.states), None], np.zeros((len(problem.free), 1))
    moved = replace(problem, record=replace(record, u=u)).augmented(()).bind(nothing).outputs(x)
    return not np.allclose(moved, problem.augmented(()).bind(nothing).outputs(x), rtol=1e-12, atol=0.0)
