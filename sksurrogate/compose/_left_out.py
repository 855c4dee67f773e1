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

    A single run is fitted without its last third, and judged there. None where it is too short, or no free run stayed finite.

    Parameters
    ----------
    make : callable
        Gives an unfitted correction with ``fit`` and ``run``.
    inputs, measured : sequence of ndarray (n_samples, n_inputs | n_outputs)
        One a run.
    """
    n = len(inputs)
    if n == 1:
        cut, correction = 2 * len(inputs[0]) // 3, make()
        if len(inputs[0]) - cut < 2 * correction.n_lags + 2:
            return None
        correction.fit([inputs[0][:cut]], [measured[0][:cut]])
        errors = [_errors(correction, inputs[0], measured[0])[cut - correction.n_lags :]]
    else:
        errors = []
        for k in range(min(n, _FOLDS)):
            others = [r for r in range(n) if r % _FOLDS != k]
            correction = make().fit([inputs[r] for r in others], [measured[r] for r in others])
            errors += [_errors(correction, inputs[r], measured[r]) for r in range(k, n, _FOLDS)]
    every = np.concatenate(errors)
    every = every[np.isfinite(every).all(axis=1)]
    return np.sqrt(np.mean(every**2, axis=0)) if len(every) else None


def _errors(correction: Any, U: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Free run less measurement behind the rows that it starts from."""
    return (correction.run([U], [y[: correction.n_lags]], False).y[0] - y)[correction.n_lags :]
