"""How far a correction is off on runs that it was not fitted to."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

__all__ = ["left_out_rmse"]

#: Fits beside the one of all runs.
_FOLDS = 3


def left_out_rmse(
    make: Callable[[], Any], inputs: Sequence[np.ndarray], measured: Sequence[np.ndarray]
) -> np.ndarray | None:
    """RMS error (n_outputs,) of the free runs of corrections that were fitted without these runs.

    A single run is fitted without its last third, and judged there. None where it is too short, where
    no free run stayed finite, or where fewer runs are too few for the residual.

    Parameters
    ----------
    make : callable
        Gives an unfitted correction with ``fit`` and ``run``.
    inputs, measured : sequence of ndarray (n_samples, n_inputs | n_outputs)
        One a run.
    """
    n = len(inputs)
    if n == 1:
        cut = 2 * len(inputs[0]) // 3
        if len(inputs[0]) - cut < 2 * make().n_lags + 2:
            return None
        folds = [([inputs[0][:cut]], [measured[0][:cut]], [0], cut)]
    else:
        folds = []
        for k in range(min(n, _FOLDS)):
            others = [r for r in range(n) if r % _FOLDS != k]
            folds.append(([inputs[r] for r in others], [measured[r] for r in others], list(range(k, n, _FOLDS)), 0))
    errors = []
    for U, y, judged, first in folds:
        try:
            correction = make().fit(U, y)
            errors += [_errors(correction, inputs[r], measured[r], first) for r in judged]
        except (ValueError, np.linalg.LinAlgError):  # some residuals want more rows than a fold has
            continue
    every = np.concatenate(errors) if errors else np.empty((0, 1))
    every = every[np.isfinite(every).all(axis=1)]
    return np.sqrt(np.mean(every**2, axis=0)) if len(every) else None


def _errors(correction: Any, U: np.ndarray, y: np.ndarray, first: int) -> np.ndarray:
    """Free run less measurement from row ``first`` on, behind the rows that it starts from."""
    n = correction.n_lags
    return (correction.run([U], [y[:n]], False).y[0] - y)[max(n, first) :]
