"""How much of a gap re-tuning cannot close: an effect that free parameters imitate is no question about effects."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from sksurrogate.blind._cases import Case, draw
from sksurrogate.blind._march import march

__all__ = ["beyond_retuning", "with_retuning"]

#: Gauss-Newton steps (shorter after one that does not help), and relative steps of the differences.
STEPS, PUSH = 12, 1e-4


def beyond_retuning(case: Case) -> float:
    """The gap over the noise that stays when all parameters and initial states of the simulator are fitted to the plant.

    Without noise, from the true parameters, with the check's own integrator.

    Parameters
    ----------
    case : Case

    Returns
    -------
    float

    Examples
    --------
    >>> from sksurrogate.blind import draw
    >>> case = draw("effect", 1)
    >>> bool(0 <= beyond_retuning(case) <= 1.01 * case.facts["gap_over_noise"])
    True
    """
    plant, question = case.plant, case.question
    n_runs = int(question.groups.max()) + 1
    U = question.X.reshape(n_runs, -1, question.X.shape[1])
    read = [plant.outputs.index(name) for name in question.simulator.outputs]
    target = march(plant, U, case.starts, case.truths, substeps=12).outputs[..., read]
    values, X0, best = np.array(list(plant.params.values()), dtype=float), case.starts.copy(), np.inf
    reach = np.where(values == 0, 1.0, np.abs(values))
    spread = np.std(case.states, axis=0) + 1e-9
    step, starts, share = np.zeros_like(values), np.zeros_like(X0), 1.0
    for _ in range(STEPS):
        tried, X0_tried = values + share * step * reach, X0 + share * starts * spread
        with np.errstate(all="ignore"):
            outputs = _pushed(plant, U, X0_tried, tried, PUSH * reach, PUSH * spread)[..., read]
        outputs = (outputs / case.noise).reshape(len(outputs), n_runs, -1)
        r = (target / case.noise).reshape(n_runs, -1) - outputs[0]
        left = float(np.sqrt(np.mean(r**2))) if np.abs(outputs).max() < 1e9 else np.inf
        if not left < best:
            share *= 0.3
            continue
        if best - left < 1e-3 * best:
            return left
        best, values, X0, share = left, tried, X0_tried, 1.0
        J = (outputs[1:] - outputs[0]) / PUSH
        step, starts = _step(r, J[: len(values)], J[len(values) :])
    return best


def with_retuning(row: dict[str, Any]) -> dict[str, Any]:
    """A row of the arm *detuned* with ``gap_beyond_retuning``; its case is drawn once more where that is not known."""
    if row["arm"] != "detuned" or "gap_beyond_retuning" in row or row.get("right") is None:
        return row
    return {**row, "gap_beyond_retuning": beyond_retuning(draw(row["arm"], row["seed"]))}


def _pushed(
    plant: Any, U: np.ndarray, X0: np.ndarray, values: np.ndarray, dp: np.ndarray, dx: np.ndarray
) -> np.ndarray:
    """Outputs (1 + n_params + n_states, n_runs, n_samples, n_outputs): as it is, each parameter moved, each state moved."""
    n_runs, n_p, n_x = len(U), len(values), X0.shape[1]
    times = 1 + n_p + n_x
    moved = np.tile(values[:, None], (1, times))
    moved[np.arange(n_p), 1 + np.arange(n_p)] += dp
    starts = np.tile(X0, (times, 1, 1))
    starts[1 + n_p + np.arange(n_x), :, np.arange(n_x)] += dx[:, None]
    params = {name: np.repeat(column, n_runs) for name, column in zip(plant.params, moved)}
    course = march(
        replace(plant, params=params), np.tile(U, (times, 1, 1)), starts.reshape(times * n_runs, n_x), substeps=8
    )
    return course.outputs.reshape(times, n_runs, U.shape[1], -1)


def _step(r: np.ndarray, J: np.ndarray, J_start: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Least squares in the shared parameters and in the initial state of each run: (n_params,), (n_runs, n_states)."""
    rest, columns, bases = [], [], []
    for k in range(len(r)):
        A, B = J_start[:, k].T, J[:, k].T
        both = np.column_stack([r[k], B])
        basis = np.linalg.lstsq(A, both, rcond=1e-10)[0]
        both = both - A @ basis
        rest.append(both[:, 0])
        columns.append(both[:, 1:])
        bases.append(basis)
    step = np.linalg.lstsq(np.concatenate(columns), np.concatenate(rest), rcond=1e-10)[0]
    return step, np.stack([basis[:, 0] - basis[:, 1:] @ step for basis in bases])
