"""The learned correction of the waterfall: what a hybrid that knows no effect closes on runs left out."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import Any

import numpy as np

from sksurrogate.effects._model import AugmentedModel
from sksurrogate.exceptions import SurrogateError
from sksurrogate.gap.fit._ode import OdeBackend
from sksurrogate.kernels.clock import check_time
from sksurrogate.kernels.record import Record

#: Free runs (n_outputs, n_samples) over a record whose runs are in folds, each learned from the others.
Correction = Callable[[Record, np.ndarray], np.ndarray]
#: Inputs, initial states, outputs.
Run = tuple[np.ndarray, np.ndarray, np.ndarray]
_Runs = Sequence[np.ndarray]

#: The correction is learned on this many parts only, by a few small maps: a bar beside the diagnosis, not its aim.
FOLDS, MAPS, UNITS, ITERATIONS, LAGS = 2, 3, 3, 8, 5
#: Features of the correction at most: of plants with many signals it sees fewer lags.
MOST_FEATURES = 30


class SimulatedOnce:
    """A simulator that runs each run once: the parts that teach and that judge are the same ones in turn.

    ``runs``: those known already: inputs (n_samples, n_inputs), initial states, outputs (n_samples, n_outputs).
    """

    def __init__(self, simulator: Any, runs: Iterable[Run]):
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
            found = simulate(U) if x0 is None else simulate(U, x0)
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
    return [(record.u[:, a:b].T, run[:, a], y[:, a:b].T) for a, b in record.spans]


def generic_correction(simulator: Any, correction: Any, runs: Iterable[Run] = ()) -> Correction:
    """The waterfall's learned correction: fitted on the training runs, free run on the others.

    The default one keeps the share that left-out runs support: the share for one fold is that which the other folds,
    predicted from the rest, support. ``runs`` of the simulator that are known already (inputs, initial states, outputs)
    are not simulated again.
    """

    def run(record: Record, fold: np.ndarray) -> np.ndarray:
        out = np.full(record.y.shape, np.nan)
        if not len(record.u):  # regressors want a column
            return out
        parts, long = np.asarray(fold) % FOLDS, record.lengths > LAGS
        predict = _Supported(SimulatedOnce(simulator, runs)) if correction is None else _Own(correction)
        predicted: list[int] = []
        for k in np.unique(parts[long]):
            taught, test = np.flatnonzero(long & (parts != k)), np.flatnonzero(long & (parts == k))
            if not len(taught):  # one short run: nothing is left to learn from
                continue
            try:
                predict.learn(*_rows(record, taught), *_rows(record, test))
                predicted += test.tolist()
            except (SurrogateError, ValueError, RuntimeError, ArithmeticError, np.linalg.LinAlgError) as error:
                # The answers so far are worth more than the bar of the learned correction.
                warnings.warn(
                    f"correction: {predict.name} failed on runs left out ({error}); its bar is left out.",
                    UserWarning,
                    stacklevel=2,
                )
        for r, y in zip(predicted, predict.outputs()):
            out[:, slice(*record.spans[r])] = y.T
        given = bool(predicted) & ~long[record.run_of_row]  # the first rows of a run are given: all of a short piece
        out[:, given] = record.y[:, given]
        return out

    return run


def _rows(record: Record, runs: Iterable[int]) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Inputs and outputs of some runs, each (n_samples, n_inputs | n_outputs)."""
    spans = [slice(*record.spans[r]) for r in runs]
    return [record.u[:, rows].T for rows in spans], [record.y[:, rows].T for rows in spans]


class _Own:
    """A user's correction: what it predicts is taken as it is."""

    def __init__(self, model: Any):
        self.model, self.name = model, type(model).__name__
        self._found: list[np.ndarray] = []

    def learn(self, U: _Runs, y: _Runs, V: _Runs, z: _Runs) -> None:
        """Fit on inputs and outputs of some runs, run on the others."""
        from sklearn.base import clone

        fitted = clone(self.model).fit(np.concatenate(U), np.concatenate(y), groups=_labels(U))
        n_lags = int(getattr(fitted, "n_initial_", 0) or getattr(fitted, "n_lags_", 0) or LAGS)
        first = np.stack([part[:n_lags] for part in z])
        found = np.asarray(fitted.predict(np.concatenate(V), y0=first, groups=_labels(V))).reshape(-1, z[0].shape[1])
        self._found += np.split(found, np.cumsum([len(part) for part in V])[:-1])

    def outputs(self) -> list[np.ndarray]:
        """Of the other runs, in turn."""
        return self._found


def _labels(parts: Sequence[np.ndarray]) -> np.ndarray:
    """Which part a row belongs to."""
    return np.repeat(np.arange(len(parts)), [len(part) for part in parts])


class _Supported:
    """The default: small nets on past deviations, as far as left-out runs support them."""

    name = "HybridRegressor"

    def __init__(self, simulator: Any):
        self.simulator = simulator
        self._folds: list[list[tuple[np.ndarray, np.ndarray, np.ndarray]]] = []

    def learn(self, U: _Runs, y: _Runs, V: _Runs, z: _Runs) -> None:
        """Fit on inputs and outputs of some runs; simulator, hybrid and measurement of the others."""
        from sksurrogate.compose._hybrid_output import OutputCorrection
        from sksurrogate.compose._residual import FreeRunResidual

        signals = U[0].shape[1] + y[0].shape[1]
        n_lags = int(np.clip(MOST_FEATURES // signals - 1, 1, LAGS))
        residual = FreeRunResidual(hidden=UNITS, n_starts=MAPS, max_iter=ITERATIONS)
        correction = OutputCorrection(self.simulator, residual, "output", "shooting", n_lags, 1.0, 1e-2, 0)
        correction.finds_starts = False  # as the simulator of the bar above starts
        correction.fit(list(U), list(y))
        first = [part[:LAGS] for part in z]
        whole = correction.run(V, first, spread=False).y
        correction.keep(np.zeros(z[0].shape[1]), 1.0)
        self._folds.append(list(zip(correction.run(V, first, spread=False).y, whole, z)))

    def outputs(self) -> list[np.ndarray]:
        """Of the other runs, in turn; the share of a fold is that of the others."""
        found = []
        for k, fold in enumerate(self._folds):
            share = self._share([run for j, other in enumerate(self._folds) if j != k for run in other])
            found += [alone + share * (whole - alone) for alone, whole, _ in fold]
        return found

    @staticmethod
    def _share(runs: list[tuple[np.ndarray, np.ndarray, np.ndarray]]) -> np.ndarray | float:
        """The share of each output that these runs support; none without runs."""
        from sksurrogate.compose._support import SHARES, block_powers, supported

        if not runs:
            return 0.0
        errors = [(alone - y) + SHARES[:, None, None] * (whole - alone) for alone, whole, y in runs]
        lengths = [len(y) for *_, y in runs]
        power = block_powers([error[:, LAGS:] for error in errors], list(enumerate(lengths)), lengths)
        return np.array([supported(power[:, :, j], SHARES).factor for j in range(power.shape[2])])
