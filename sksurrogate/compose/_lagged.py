"""What estimators with past outputs among their features share: names, first rows, divergence."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from math import prod
from typing import Any

import numpy as np
from sklearn.base import clone
from sklearn.exceptions import ConvergenceWarning
from sklearn.multioutput import MultiOutputRegressor
from sklearn.utils import get_tags

from sksurrogate._dynamic import DIVERGED_RUN
from sksurrogate._lags import lag_terms
from sksurrogate.exceptions import SimulationDiverged
from sksurrogate.kernels.rows import LagRows
from sksurrogate.linear._base import BaseBlockedRegressor
from sksurrogate.neural._fnn import FNNRegressor
from sksurrogate.runs import Run, Runs

#: Training rows that are run freely after a fit.
REPORTED = 65_536
#: What keeps free runs of lag models from leaving.
STAYS = 'Fit with loss="shooting" (and stability above 0), give more lags or training runs, or a larger penalty.'
#: Numbers up to which a lag matrix is made whole.
WHOLE_LAG_MATRIX = 2_000_000


def name_features(runs: Runs, output_lags: Sequence[int], input_lags: Any) -> tuple[list[tuple[int, int]], list[str]]:
    """Column and lag of every input feature, and the names of all features."""
    m, o = runs[0].X.shape[1], runs[0].y.shape[1]
    names = list(runs.input_names or (f"u{j}" if m > 1 else "u" for j in range(m)))
    outputs = list(runs.output_names or (f"y{i}" if o > 1 else "y" for i in range(o)))
    terms = lag_terms(input_lags, names, "input_lags")
    return terms, [f"{name}_lag{k}" for k in output_lags for name in outputs] + [f"{names[j]}_lag{k}" for j, k in terms]


def diverged(
    found: np.ndarray, lengths: Sequence[int], n: int, mean: np.ndarray, spread: np.ndarray
) -> list[tuple[int, int]]:
    """(run, step) of the free runs (n_runs, n_steps, n_outputs) that became infinite or nan or went far beyond."""
    limit = DIVERGED_RUN * (spread + np.abs(mean))
    if all(
        mean[i] - limit[i] <= found[:, :, i].min() and found[:, :, i].max() <= mean[i] + limit[i]
        for i in range(len(mean))
    ):  # false where there is a nan
        return []
    with np.errstate(invalid="ignore", over="ignore"):
        far = ~(np.abs(found - mean) <= limit).all(axis=2)
    rows = [np.flatnonzero(far[r, n:length]) for r, length in enumerate(lengths)]
    return [(r, n + int(steps[0])) for r, steps in enumerate(rows) if len(steps)]


def divergence(runs: Runs, bad: Sequence[tuple[int, int]]) -> SimulationDiverged:
    """The error that names the first of the (run, step) that diverged and the way out."""
    which, row = bad[0]
    label = runs[which].label
    return SimulationDiverged(
        f"the free run diverged: run {which if label is None else label!r}, step {row}; {len(bad)} of {len(runs)} runs in "
        f"all. {STAYS}",
        run=label,
        row=row,
        time=float(runs[which].t[row]),
    )


def stacked(parts: Sequence[np.ndarray]) -> np.ndarray:
    """Arrays of one shape as (n_parts, n_rows, n_columns); no copy where they lie side by side in one array."""
    whole, shape = parts[0].base, (len(parts), *parts[0].shape)
    if isinstance(whole, np.ndarray) and whole.flags.c_contiguous and whole.size == np.prod(shape):
        places = np.array([part.__array_interface__["data"][0] for part in parts])
        if np.array_equal(places, whole.__array_interface__["data"][0] + parts[0].nbytes * np.arange(len(parts))):
            return whole.reshape(shape)
    return np.stack(parts)


def fitted(estimator: Any, Phi: np.ndarray | LagRows, target: np.ndarray) -> Any:
    """A fitted clone; a regressor of one output is fitted to each of several."""
    try:
        return clone(estimator).fit(Phi, target)
    except ValueError:
        if target.ndim == 1 or get_tags(estimator).target_tags.multi_output:
            raise
    return MultiOutputRegressor(clone(estimator)).fit(Phi, target)


def lag_rows(
    runs: Sequence[Run], output_lags: Sequence[int], input_terms: Sequence[tuple[int, int]], n: int
) -> tuple[LagRows, np.ndarray]:
    """Features (past outputs lag by lag, then inputs) and outputs of rows with whole history; outputs 1-D where there is one."""
    tables = [(np.asarray(run.y), run.X) for run in runs]
    past = [(0, i, k) for k in output_lags for i in range(tables[0][0].shape[1])]
    parts = [y[n:] for y, _ in tables]
    target = parts[0] if len(parts) == 1 else np.concatenate(parts)  # of one run no copy
    return LagRows(tables, [*past, *((1, j, k) for j, k in input_terms)], n), (
        target[:, 0] if target.shape[1] == 1 else target
    )


def takes_rows(estimator: Any, rows: LagRows) -> bool:
    """Whether the lag matrix need not be made: it is large, and the estimator goes over it block by block."""
    return isinstance(estimator, (FNNRegressor, BaseBlockedRegressor)) and prod(rows.shape) > WHOLE_LAG_MATRIX


def barely_fitted(estimator: Any, Phi: np.ndarray, target: np.ndarray) -> Any:
    """The estimator with its scalers fitted and its network of the right shape; iterations are cut to one."""
    given = estimator.get_params()
    wanted = {name: given[name] for name in given if name.split("__")[-1] in ("max_iter", "max_epochs")}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        fitted = estimator.set_params(**dict.fromkeys(wanted, 1)).fit(Phi, target)
    return fitted.set_params(**wanted)
