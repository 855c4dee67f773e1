"""How large a gap is: what is left when the initial states, and on request the parameters, are fitted without noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from sksurrogate.blind._march import march
from sksurrogate.blind._plants import PlantSpec
from sksurrogate.blind._truths import Truth

#: Gauss-Newton steps (shorter after one that does not help), and relative steps of the differences.
GAUSS_NEWTON_STEPS, PUSH = 12, 1e-4
#: Relative gain that ends the search, and steps of the integrator in a sample.
GAIN_THAT_ENDS, INTEGRATOR_SUBSTEPS = 0.05, 4


def gap_beyond(
    plant: PlantSpec,
    U: np.ndarray,
    X0: np.ndarray,
    outputs: np.ndarray,
    unit: np.ndarray,
    *,
    truths: Sequence[Truth] = (),
    retune: bool = False,
) -> float:
    """Root mean square of outputs minus those of a model whose initial states, and parameters, follow them, in ``unit``.

    ``plant``: the model, with its parameters.
    ``U`` (n_runs, n_samples, n_inputs).
    ``X0`` (n_runs, n_states): where the search starts.
    ``outputs`` (n_runs, n_samples, n_outputs): all outputs of the plant, without noise.
    ``unit`` (n_outputs,): noise of each output; infinite for one that is not measured.
    ``truths``: effects that the model has too.
    ``retune``: whether the parameters are fitted as well.
    """
    n_runs = len(U)
    values, best = np.array(list(plant.params.values()), dtype=float), np.inf
    reach = np.where(values == 0, 1.0, np.abs(values))
    path = march(plant, U, X0, truths, substeps=1).states
    with np.errstate(all="ignore"):
        spread = path.reshape(-1, path.shape[-1]).std(axis=0) + 1e-9
    moves = len(values) if retune else 0
    step, starts, share, X0 = np.zeros_like(values), np.zeros_like(X0), 1.0, X0.copy()
    measured = float(np.mean(np.isfinite(unit)))
    for _ in range(GAUSS_NEWTON_STEPS):
        tried, X0_tried = values + share * step * reach, X0 + share * starts * spread
        with np.errstate(all="ignore"):
            followed = _pushed(plant, U, X0_tried, truths, tried, PUSH * reach[:moves], PUSH * spread)
        followed = (followed / unit).reshape(len(followed), n_runs, -1)
        r = (outputs / unit).reshape(n_runs, -1) - followed[0]
        left = float(np.sqrt(np.mean(r**2) / measured)) if np.isfinite(r).all() else np.inf
        if not left < best:
            if not np.isfinite(best):
                return float("inf")
            share *= 0.3
            continue
        if best - left < GAIN_THAT_ENDS * best:
            return left
        best, values, X0, share = left, tried, X0_tried, 1.0
        J = (followed[1:] - followed[0]) / PUSH
        if not np.isfinite(J).all():  # a neighbour diverges: no slopes, and no step
            return best
        step = np.zeros_like(values)
        step[:moves], starts, rest = _step(r, J[:moves], J[moves:])
        if best - np.sqrt(rest / measured) < GAIN_THAT_ENDS * best:
            return best
    return best


def _pushed(
    plant: PlantSpec, U: np.ndarray, X0: np.ndarray, truths: Sequence[Truth], values: np.ndarray, dp: np.ndarray, dx: np.ndarray
) -> np.ndarray:  # fmt: skip
    """Outputs (1 + n_moved + n_states, n_runs, n_samples, n_outputs): as it is, each parameter moved, each state moved."""
    n_runs, n_p, n_x = len(U), len(dp), X0.shape[1]
    times = 1 + n_p + n_x
    moved = np.tile(values[:, None], (1, times))
    moved[np.arange(n_p), 1 + np.arange(n_p)] += dp
    starts = np.tile(X0, (times, 1, 1))
    starts[1 + n_p + np.arange(n_x), :, np.arange(n_x)] += dx[:, None]
    params: Any = {name: np.repeat(column, n_runs) for name, column in zip(plant.params, moved)}
    course = march(
        replace(plant, params=params),
        np.tile(U, (times, 1, 1)),
        starts.reshape(times * n_runs, n_x),
        truths,
        substeps=INTEGRATOR_SUBSTEPS,
    )
    return course.outputs.reshape(times, n_runs, U.shape[1], -1)


def _step(r: np.ndarray, J: np.ndarray, J_start: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Least squares in the shared parameters and in the initial state of each run: (n_moved,), (n_runs, n_states).

    Also the mean square that they would leave.
    """
    rest, columns, bases = [], [], []
    for k in range(len(r)):
        A, B = J_start[:, k].T, J[:, k].T
        both = np.column_stack([r[k], B])
        basis = np.linalg.lstsq(A, both, rcond=1e-10)[0]
        both = both - A @ basis
        rest.append(both[:, 0])
        columns.append(both[:, 1:])
        bases.append(basis)
    A, b = np.concatenate(columns), np.concatenate(rest)
    step = np.linalg.lstsq(A, b, rcond=1e-10)[0] if len(J) else np.zeros(0)
    left = float(np.mean((b - A @ step) ** 2))
    return step, np.stack([basis[:, 0] - basis[:, 1:] @ step for basis in bases]), left
