"""Soft-dynamics smoother: the states that agree best with measurements and a model that may be wrong.

``min sum |(y - g(x)) / sd|^2 + sum |d_k / q|^2`` over all states at once, d_k = F(x_k) - x_{k+1}; Gauss-Newton with one
banded Cholesky factor an iteration, its step halved while the sum would grow. The allowance q of every balance is set to its own defects, so that kinematic rows
become hard and faulty balances soft by themselves; unmeasured states are found on the way.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sksurrogate.kernels.banded import BlockTridiagonal
from sksurrogate.kernels.free_run_model import ObservedStepper
from sksurrogate.kernels.integrate import DIFFERENCE, moved_one_by_one, state_jacobian

#: Differences of readings below this share of their range are rounding of the computer; readings this near to a step are on its grid.
ROUNDED, ON_THE_GRID = 1e-9, 1e-3


def noise_of_differences(
    y: np.ndarray, starts: np.ndarray, known: np.ndarray | None = None, t: np.ndarray | None = None
) -> np.ndarray:
    """Standard deviation of white sensor noise: MAD of third differences / 0.6745 / sqrt(20), (n_outputs,).

    Where most readings repeat the one before, at least that of a reading rounded to its resolution (Widrow and Kollar 2008): most
    differences are zero there.

    ``y`` (n_outputs, n_samples), ``starts`` int (n_runs,).
    ``known`` bool (n_outputs, n_samples): which values were measured: differences are then divided ones, of four
        measured values in a row.
    ``t`` (n_samples,): time of every sample, for these.
    """
    if known is not None:
        t = np.arange(y.shape[1], dtype=float) if t is None else t
        run = np.searchsorted(starts, np.arange(y.shape[1]), side="right")
        return np.array([_noise_of_measured(row[seen], t[seen], run[seen]) for row, seen in zip(y, known)])
    spread = np.std(y, axis=1)
    floor = np.array([_least_noise(row) for row in y])
    within = np.ones(y.shape[1], bool)  # whether the row and the three that follow it are of one run
    within[-3:] = False
    for start in starts[1:]:
        within[max(start - 3, 0) : start] = False
    rows = np.flatnonzero(within)
    if not len(rows):
        return np.maximum(0.01 * spread, floor)
    third = np.diff(y, n=3, axis=1)
    if len(rows) < third.shape[1]:
        third = third[:, rows]
    return np.maximum(np.median(np.abs(third), axis=1) / 0.6745 / np.sqrt(20.0), floor)


def resolution(y: np.ndarray) -> float:
    """Step of the grid that all readings (n,) stand on, their smallest difference; 0 where they stand on none.

    >>> resolution(np.array([0.5, 0.25, 0.5, 1.0])), resolution(np.array([0.5, 0.25, 0.31, 1.0])), resolution(np.ones(3))
    (0.25, 0.0, 0.0)
    """
    apart = np.diff(np.sort(y))
    apart = apart[apart > ROUNDED * np.sum(apart)]
    if not len(apart):
        return 0.0
    step = float(np.min(apart))
    steps = (y - np.min(y)) / step
    return step if bool(np.all(np.abs(steps - np.round(steps)) < ON_THE_GRID)) else 0.0


def _least_noise(y: np.ndarray) -> float:
    """The least standard deviation that the noise of readings (n,) counts as."""
    if len(y) < 2:
        return 1e-12
    step = resolution(y) if np.median(np.abs(np.diff(y))) == 0.0 else 0.0
    return max(1e-4 * float(np.std(y)), step / np.sqrt(12.0), 1e-12)


def _noise_of_measured(y: np.ndarray, t: np.ndarray, run: np.ndarray) -> float:
    """The same of readings (n,) at uneven times: third divided differences over the root of the squares of their weights."""
    spread = float(np.std(y)) if len(y) else 0.0
    floor = _least_noise(y)
    first = np.flatnonzero(run[3:] == run[:-3])
    if not len(first):
        return max(0.01 * spread, floor)
    four = first[:, None] + np.arange(4)
    apart = t[four][:, :, None] - t[four][:, None]
    apart[:, np.arange(4), np.arange(4)] = 1.0
    weights = 1.0 / np.prod(apart, axis=2)
    third = np.sum(weights * y[four], axis=1) / np.sqrt(np.sum(weights**2, axis=1))
    return max(float(np.median(np.abs(third))) / 0.6745, floor)


#: What ties a trajectory to its guess where nothing else does, over the squared sizes of the states: in all samples, and in the
#: first of a run, where an integral that nobody measures is known best.
EASY, FIRM = 1e-8, 1e-4
#: Defects of a balance that the first step allows, in sizes of its state.
_ALLOWANCE = 0.1
#: Halvings of a step (ten sizes of a state become a hundredth); growth of a sum of squares that may be rounding.
_HALVINGS, _ROUNDING = 10, 1e-9


@dataclass(frozen=True, eq=False)
class Smoothed:
    """A smoothed trajectory."""

    x: np.ndarray  #: (n_states, n_samples)
    allowance: np.ndarray  #: (n_states,): RMS defect of every state
    A: np.ndarray  #: (n_states, n_states, n_samples): state Jacobians of the step map


def output_jacobian(bound: ObservedStepper, x: np.ndarray, scale: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Outputs (n_outputs, n_samples) and their derivative (n_outputs, n_states, n_samples), differences at each sample."""
    steps = DIFFERENCE * scale
    y = bound.outputs(moved_one_by_one(x, steps))
    return y[:, 0], (y[:, 1:] - y[:, :1]) / steps[:, None]


def _defects(after: np.ndarray, x: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """``F(x_k) - x_{k+1}`` in row k, 0 in the last row of a run."""
    d = np.zeros_like(x)
    d[:, :-1] = after[:, :-1] - x[:, 1:]
    d[:, ends] = 0.0
    return d


def smooth(
    bound: ObservedStepper,
    y: np.ndarray,
    starts: np.ndarray,
    sd: np.ndarray,
    x: np.ndarray,
    scale: np.ndarray,
    *,
    rigid: np.ndarray | None = None,
    share: np.ndarray | None = None,
    known: np.ndarray | None = None,
    max_iterations: int = 12,
    floor: float = 1e-4,
) -> Smoothed:
    """Smooth.

    ``bound``: the model at one parameter vector.
    ``y`` (n_outputs, n_samples), ``starts`` int (n_runs,).
    ``sd`` (n_outputs,): standard deviation of the sensor noise.
    ``x`` (n_states, n_samples): start: measured states as measured, others a guess.
    ``scale`` (n_states,).
    ``rigid`` bool (n_states,): rows that are known to hold (dq/dt = v): their allowance stays at the floor.
    ``share`` (n_states, n_samples): what the allowance of a balance is multiplied by in a sample; 1 by default.
    ``known`` bool (n_outputs, n_samples): which values of y were measured.
    ``floor``: smallest allowance, in units of ``scale``.
    """
    n, n_samples = x.shape
    ends = np.r_[starts[1:], n_samples] - 1
    n_inner = max(n_samples - len(starts), 1)
    stiff = np.zeros(n, bool) if rigid is None else rigid
    part = np.ones((n, 1)) if share is None else share
    q = np.where(stiff, floor, _ALLOWANCE) * scale
    anchor = x.copy()
    tie = _tie(x.shape, scale, ends)
    best: Smoothed | None = None
    for iteration in range(max_iterations):
        after, A = state_jacobian(bound, x, scale)
        g, C = output_jacobian(bound, x, scale)
        if not (np.all(np.isfinite(after)) and np.all(np.isfinite(A)) and np.all(np.isfinite(g))):
            break
        d = _defects(after, x, ends)
        best = Smoothed(x, np.sqrt(np.sum((d / part) ** 2, axis=1) / n_inner), A)
        if iteration == max_iterations - 1:
            break
        allowed = 1.0 / (q[:, None] * part) ** 2
        step = _step(A, *_misses(C, y - g, sd, known), d, allowed, anchor - x, tie, ends)
        if step is None or not np.isfinite(step).all():
            break

        def total(x: np.ndarray, after: np.ndarray, g: np.ndarray, allowed: np.ndarray = allowed) -> float:
            missed = _seen((y - g) / sd[:, None], known)
            return float(
                np.sum(missed**2) + np.sum(allowed * _defects(after, x, ends) ** 2) + np.sum(tie * (x - anchor) ** 2)
            )

        step = _downhill(bound, x, np.clip(step, -10 * scale[:, None], 10 * scale[:, None]), total, total(x, after, g))
        x = x + step
        size = float(np.max(np.abs(step) / scale[:, None]))
        new_q = np.maximum(best.allowance, floor * scale)
        steady = np.all(stiff | (np.abs(np.log(new_q / q)) < 0.3))
        q = np.where(stiff, q, np.clip(new_q, q / 10, q * 3))
        if size < 1e-3 and steady:
            break
    if best is None:
        raise FloatingPointError("the model gives no finite step along the measured trajectory")
    return best


def _misses(C: np.ndarray, r: np.ndarray, sd: np.ndarray, known: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
    """Output Jacobians and misses over the noise; 0 where nothing was measured."""
    C, r = C / sd[:, None, None], r / sd[:, None]
    return (C if known is None else np.where(known[:, None], C, 0.0)), _seen(r, known)


def _seen(r: np.ndarray, known: np.ndarray | None) -> np.ndarray:
    """Misses (n_outputs, n_samples), 0 where nothing was measured."""
    return r if known is None else np.where(known, r, 0.0)


def _tie(shape: tuple[int, ...], scale: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """What ties a trajectory to its guess (n_states, n_samples)."""
    tie = np.full(shape, EASY) / scale[:, None] ** 2
    tie[:, np.r_[0, ends[:-1] + 1]] *= FIRM / EASY
    return tie


def _downhill(
    bound: ObservedStepper, x: np.ndarray, step: np.ndarray, total: Callable[..., float], before: float
) -> np.ndarray:
    """A step, halved until the sum does not grow along it; none where it always grows."""
    for _ in range(_HALVINGS):
        there = (x + step)[:, None]
        if total(there[:, 0], bound(there)[:, 0], bound.outputs(there)[:, 0]) <= before * (1.0 + _ROUNDING):
            return step
        step = 0.5 * step
    return np.zeros_like(step)


def drawn(
    bound: ObservedStepper, y: np.ndarray, starts: np.ndarray, sd: np.ndarray, x: np.ndarray, scale: np.ndarray,
    known: np.ndarray | None = None,
) -> np.ndarray | None:  # fmt: skip
    """A trajectory (n_states, n_samples) drawn to the measurements by the first step of :func:`smooth`; None where it is not finite."""
    after, A = state_jacobian(bound, x, scale)
    g, C = output_jacobian(bound, x, scale)
    ends = np.r_[starts[1:], x.shape[1]] - 1
    d = _defects(after, x, ends)
    if not (np.all(np.isfinite(d)) and np.all(np.isfinite(A)) and np.all(np.isfinite(g))):
        return None
    allowed = np.broadcast_to(1.0 / (_ALLOWANCE * scale[:, None]) ** 2, x.shape)
    step = _step(A, *_misses(C, y - g, sd, known), d, allowed, np.zeros_like(x), _tie(x.shape, scale, ends), ends)
    if step is None or not np.all(np.isfinite(step)):
        return None
    return x + np.clip(step, -10 * scale[:, None], 10 * scale[:, None])


def _step(
    A: np.ndarray, C: np.ndarray, r: np.ndarray, d: np.ndarray, Q: np.ndarray, back: np.ndarray, tie: np.ndarray,
    ends: np.ndarray,
) -> np.ndarray | None:  # fmt: skip
    """One Gauss-Newton step (n_states, n_samples), None where its matrix is not positive definite.

    Time stays last throughout: products of many small matrices are tens of times faster so than as a stack.
    """
    n = len(d)
    leaving = np.broadcast_to(Q, d.shape).copy()  # of the step that leaves a sample
    leaving[:, ends] = 0.0
    weighted = A * leaving[:, None]
    diagonal = np.einsum("ijt,ilt->jlt", weighted, A) + np.einsum("ijt,ilt->jlt", C, C)
    index = np.arange(n)
    diagonal[index, index] += tie
    diagonal[index, index, 1:] += leaving[:, :-1]
    right = np.einsum("ijt,it->jt", C, r) + tie * back - np.einsum("ijt,it->jt", weighted, d)
    right[:, 1:] += (leaving * d)[:, :-1]
    try:
        factor = BlockTridiagonal(diagonal.transpose(2, 0, 1), -weighted.transpose(2, 0, 1))
    except np.linalg.LinAlgError:
        return None
    return factor.solve(right.T[None])[0].T
