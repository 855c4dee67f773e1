"""The learned correction of the waterfall: what a hybrid that knows no effect closes on runs left out."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from sksurrogate.exceptions import SurrogateError
from sksurrogate.kernels.record import Record

__all__ = ["generic_correction"]

#: The correction is learned on this many parts only, by one small map: a bar beside the diagnosis, not its aim.
FOLDS, MAPS, UNITS = 2, 1, 3


class Remembered:
    """A simulator that runs each batch of runs once: the parts that teach and that judge are the same ones in turn."""

    def __init__(self, simulator: Any):
        self._simulator = simulator
        self._known: dict[tuple, Any] = {}

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_") or name == "get_params":  # for clone it is one object, not an estimator
            raise AttributeError(name)
        value = getattr(self._simulator, name)
        return partial(self._once, value) if name in ("simulate", "simulate_batch") else value

    def __deepcopy__(self, memo: dict) -> Remembered:
        return self

    def _once(self, simulate: Callable, U: Any, x0: Any = None) -> np.ndarray:
        """What ``simulate`` gave for these inputs and initial states."""
        key = tuple(None if a is None else (np.shape(a), np.asarray(a, dtype=float).tobytes()) for a in (U, x0))
        if key not in self._known:
            self._known[key] = simulate(U, x0)
        return self._known[key]


def generic_correction(
    simulator: Any, correction: Any, labels: tuple[str, ...]
) -> Callable[[Record, np.ndarray], np.ndarray]:
    """The waterfall's learned correction: fitted on the training runs, free run on the others."""

    def run(record: Record, fold: np.ndarray) -> np.ndarray:
        from sklearn.base import clone

        from sksurrogate.compose import HybridRegressor
        from sksurrogate.compose._residual import FreeRunResidual

        model = correction
        if correction is None:
            model = HybridRegressor(Remembered(simulator), FreeRunResidual(hidden=UNITS, n_starts=MAPS, max_iter=0))
        if not len(record.u):  # regressors want a column
            return np.full(record.y.shape, np.nan)
        row_of = record.run_of_row
        out = np.full(record.y.shape, np.nan)
        fold = np.asarray(fold) % FOLDS
        for k in np.unique(fold):
            test = np.isin(row_of, np.flatnonzero(fold == k))
            if test.all():  # one short run: nothing is left to learn from
                continue
            try:
                fitted = clone(model).fit(record.u[:, ~test].T, record.y[:, ~test].T, groups=row_of[~test])
                n_lags = int(getattr(fitted, "n_initial_", 0) or getattr(fitted, "n_lags_", 0) or 5)
                labels_test = row_of[test]
                firsts = np.stack(
                    [record.y[:, record.starts[r] : record.starts[r] + n_lags].T for r in np.unique(labels_test)]
                )
                out[:, test] = (
                    np.asarray(fitted.predict(record.u[:, test].T, y0=firsts, groups=labels_test))
                    .reshape(test.sum(), -1)
                    .T
                )
            except (SurrogateError, ValueError, RuntimeError, ArithmeticError, np.linalg.LinAlgError) as error:
                # The answers so far are worth more than the bar of the learned correction.
                warnings.warn(
                    f"correction: {type(model).__name__} failed on runs left out ({error}); its bar is left out.",
                    UserWarning,
                    stacklevel=2,
                )
                continue
        return out

    return run
