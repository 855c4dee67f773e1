"""The learned correction of the waterfall: what a hybrid that knows no effect closes on runs left out."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable
from functools import partial
from typing import Any

import numpy as np

from sksurrogate.effects._model import AugmentedModel
from sksurrogate.exceptions import SurrogateError
from sksurrogate.gap.fit._ode import OdeBackend
from sksurrogate.kernels.clock import check_time
from sksurrogate.kernels.record import Record

__all__ = ["Correction", "generic_correction", "known_runs"]

#: Free runs (n_outputs, n_samples) over a record whose runs are in folds, each learned from the others.
Correction = Callable[[Record, np.ndarray], np.ndarray]
#: Inputs, initial states, outputs.
Run = tuple[np.ndarray, np.ndarray, np.ndarray]

#: The correction is learned on this many parts only, by one small map: a bar beside the diagnosis, not its aim.
FOLDS, MAPS, UNITS, ITERATIONS = 2, 1, 3, 8


class SimulatedOnce:
    """A simulator that runs each run once: the parts that teach and that judge are the same ones in turn.

    Parameters
    ----------
    simulator : simulator
    runs : iterable of (U, x0, y)
        Runs that are known already: inputs (n_samples, n_inputs), initial states, outputs (n_samples, n_outputs).
    """

    def __init__(self, simulator: Any, runs: Iterable[Run] = ()):
        self._simulator = simulator
        self._known: dict[bytes, np.ndarray] = {_key(U, x0): y for U, x0, y in runs}

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_") or name == "get_params":  # for clone it is one object, not an estimator
            raise AttributeError(name)
        value = getattr(self._simulator, name)
        return partial(self._once, value) if name in ("simulate", "simulate_batch") else value

    def __deepcopy__(self, memo: dict) -> SimulatedOnce:
        return self

    def _once(self, simulate: Callable, U: Any, x0: Any = None) -> np.ndarray:
        """What ``simulate`` gave for these inputs and initial states."""
        batch = np.ndim(U) == 3
        keys = [_key(*run) for run in zip(U, [None] * len(U) if x0 is None else x0)] if batch else [_key(U, x0)]
        check_time()
        if not all(key in self._known for key in keys):
            found = simulate(U, x0)
            self._known.update(zip(keys, found if batch else [found]))
        return np.stack([self._known[key] for key in keys]) if batch else self._known[keys[0]]


def _key(U: Any, x0: Any) -> bytes:
    """Inputs and initial states of a run."""
    start = b"" if x0 is None else np.ascontiguousarray(x0, dtype=float).tobytes()
    return np.ascontiguousarray(U, dtype=float).tobytes() + b"|" + start


def known_runs(problem: OdeBackend) -> list[Run]:
    """The runs of the simulator alone that a problem holds; none where they did not stay finite."""
    record, run = problem.record, problem.run
    if run is None or not np.isfinite(run).all() or run.shape[1] != record.n_samples:
        return []
    model = AugmentedModel(problem.model, (), (), record, n_sub=2, scale=problem.scale)
    y = model.bind(np.zeros((0, 1))).outputs(run[:, None])[:, 0]
    ends = record.starts + record.lengths
    return [(record.u[:, a:b].T, run[:, a], y[:, a:b].T) for a, b in zip(record.starts, ends)]


def generic_correction(simulator: Any, correction: Any, runs: Iterable[Run] = ()) -> Correction:
    """The waterfall's learned correction: fitted on the training runs, free run on the others.

    ``runs`` of the simulator that are known already (inputs, initial states, outputs) are not simulated again.
    """
    from sklearn.base import clone

    from sksurrogate.compose import HybridRegressor
    from sksurrogate.compose._residual import FreeRunResidual

    def run(record: Record, fold: np.ndarray) -> np.ndarray:
        model = correction
        if correction is None:
            model = HybridRegressor(
                SimulatedOnce(simulator, runs), FreeRunResidual(hidden=UNITS, n_starts=MAPS, max_iter=ITERATIONS)
            )
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
