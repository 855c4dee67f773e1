"""A case as plants record it: readings that are missing, sensors at two rates, stamps that jitter; the same case beside it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from sksurrogate.blind._cases import Case
from sksurrogate.blind._choose import fine
from sksurrogate.blind._march import march
from sksurrogate.exceptions import SurrogateError

#: Share of the readings that are lost, samples from one reading of a slow sensor to the next.
LOST_SHARE, SLOW = 0.2, 5
#: Moments of a sample at which it may be taken: stamps jitter by one of them, a fifth of a sample.
MOMENTS = 5


def as_recorded(case: Case, record: str) -> Case:
    """A case with its record as a plant gives it; truths, plant and tests stay.

    ``record``: one of :data:`RECORDS`.
    Raises SurrogateError where the record is unknown, or the case has a disturbance that is held over even samples.

    >>> from sksurrogate.blind import draw
    >>> case = as_recorded(draw("none", 1), "missing")
    >>> bool(0.15 < np.isnan(case.question.y).mean() < 0.25)
    True
    """
    if record not in RECORDS:
        raise SurrogateError(f"record={record!r} is unknown; use one of {list(RECORDS)}.")
    return RECORDS[record](case, np.random.default_rng([case.facts["seed"], 34]))


def _complete(case: Case, rng: np.random.Generator) -> Case:
    """As it was drawn."""
    return case


def _missing(case: Case, rng: np.random.Generator) -> Case:
    """One reading in five is lost."""
    y = case.question.y
    return replace(case, question=replace(case.question, y=np.where(rng.random(y.shape) < LOST_SHARE, np.nan, y)))


def _two_rates(case: Case, rng: np.random.Generator) -> Case:
    """Every other output, the first and a single one too, is read at every fifth sample of a run."""
    y, (_, ages) = case.question.y.copy(), _places(case.question.groups)
    y[np.ix_(ages % SLOW != 0, np.arange(y.shape[1]) % 2 == 0)] = np.nan
    return replace(case, question=replace(case.question, y=y))


def _jitter(case: Case, rng: np.random.Generator) -> Case:
    """Samples a fifth early, in time or a fifth late, inputs held from stamp to stamp; a last column of X holds the stamps."""
    if case.arm.endswith("disturbed"):
        raise SurrogateError(f"arms: {case.arm!r} has a disturbance held over even samples, record='jitter' has none.")
    question, plant = case.question, case.plant
    runs, ages = _places(question.groups)
    n_runs, n = int(runs.max()) + 1, int(ages.max()) + 1
    U = np.zeros((n_runs, n, question.X.shape[1]))
    U[runs, ages] = question.X
    for r, last in enumerate(np.bincount(runs)):
        U[r, last:] = U[r, last - 1]
    at = MOMENTS * np.arange(n) + rng.integers(-1, 2, (n_runs, n))
    at[:, 0] = 0
    quick = replace(plant, dt=plant.dt / MOMENTS)
    quick_U = np.stack([_held(at[r], U[r], MOMENTS * n, plant.hold) for r in range(n_runs)])
    read = [plant.outputs.index(name) for name in question.simulator.outputs]
    even = march(plant, U, case.starts, case.truths, substeps=fine(case.truths)).outputs[..., read]
    late = march(quick, quick_U, case.starts, case.truths, substeps=MOMENTS).outputs[..., read]
    moved = late[np.arange(n_runs)[:, None], at] - even
    stamps = (at * quick.dt)[runs, ages]
    return replace(case, question=replace(
        question, X=np.column_stack([question.X, stamps]), y=question.y + moved[runs, ages], time=question.X.shape[1]
    ))  # fmt: skip


def _places(groups: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Run of every row, and how many rows of it came before."""
    _, first, runs = np.unique(groups, return_index=True, return_inverse=True)
    return runs, np.arange(len(groups)) - first[runs]


def _held(at: np.ndarray, u: np.ndarray, n: int, hold: str) -> np.ndarray:
    """Inputs (n, n_inputs) of one run at all moments, given at some of them: held, or joined by lines."""
    moments = np.arange(n)
    if hold == "zoh":
        return u[np.searchsorted(at, moments, side="right") - 1]
    return np.column_stack([np.interp(moments, at, column) for column in u.T])


#: Way a case is recorded -> how.
RECORDS: dict[str, Callable[[Case, np.random.Generator], Case]] = {
    "complete": _complete,
    "missing": _missing,
    "two_rate": _two_rates,
    "jitter": _jitter,
}
