"""From simulator to data: space-filling experiments over initial states and inputs."""

from __future__ import annotations

import hashlib
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from itertools import chain
from numbers import Integral
from pathlib import Path
from typing import Any

import joblib
import numpy as np
from joblib import delayed
from sklearn.base import clone
from sklearn.utils import check_random_state

from sksurrogate._files import beside
from sksurrogate._fingerprint import fingerprint
from sksurrogate._parallel._interrupts import workers
from sksurrogate._parallel._pickled import refuse_what_stays
from sksurrogate.datasets._designs import design_of
from sksurrogate.exceptions import DataError, SimulationDiverged
from sksurrogate.physics import ODESimulator
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._simulator import describe, simulated, simulated_batch


@dataclass(frozen=True, eq=False)
class Experiments:
    """Stacked runs of a simulator in the data convention.

    Attributes
    ----------
    X : ndarray (n_samples, n_inputs)
    y : ndarray (n_samples,) or (n_samples, n_outputs)
    groups : ndarray of int (n_samples,)
        Number of the run in the design; runs that failed are not there.
    dydt : ndarray, shape of y, or None
        The simulator's own derivatives where the outputs are states; None otherwise.
    states, dxdt : ndarray (n_samples, n_states) or None
        Where the simulator tells them.
    x0 : ndarray (n_runs, n_states)
        Initial states of the design.
    failed : tuple of int
        Runs that diverged and were left out.

    Examples
    --------
    >>> from sksurrogate.datasets import make_reactor, simulate_experiments
    >>> made = simulate_experiments(
    ...     make_reactor(), {"y": (0.5, 15)}, {"u": (0.05, 0.25)}, n_runs=4, n_samples=50, random_state=0
    ... )
    >>> made.X.shape, made.y.shape, made.x0.shape, made.failed
    ((200, 1), (200,), (4, 1), ())
    """

    X: np.ndarray
    y: np.ndarray
    groups: np.ndarray
    dydt: np.ndarray | None
    states: np.ndarray | None
    dxdt: np.ndarray | None
    x0: np.ndarray
    failed: tuple[int, ...]

    def __repr__(self) -> str:
        summary = "with" if self.dydt is not None else "without"
        return (
            f"Experiments: {len(np.unique(self.groups))} runs, {len(self.X)} rows, {self.X.shape[1]} inputs, {summary} "
            f"derivatives, {len(self.failed)} runs failed"
        )


def simulate_experiments(
    simulator: Any,
    x0_ranges: Any = None,
    input_ranges: Any = None,
    *,
    design: str | Callable[..., Any] | np.ndarray = "levels",
    n_runs: int = 64,
    n_samples: int = 200,
    hold: tuple[int, int] = (10, 40),
    sampling: str = "lhs",
    noise: Any = 0.0,
    cache: str | Path | None = None,
    batch_size: int = 128,
    n_jobs: int | None = None,
    random_state: Any = None,
) -> Experiments:
    """Run a simulator over a space-filling design of initial states and inputs (paper, abstract and section 4.2).

    A real plant cannot start at any state, so its data cover only a part of (y, u). A simulator can start anywhere.

    Parameters
    ----------
    simulator : simulator
        Anything with ``simulate``; ``simulate_batch`` and ``simulate_states`` are used where present.
    x0_ranges : dict of state -> (low, high), or sequence of pairs, optional
        Ranges of the initial states; a state without one starts at the simulator's ``x0``.
    input_ranges : dict of input -> (low, high), or sequence of pairs, optional
        Needed unless ``design`` is an array or a function.
    design : {"levels", "multisine", "prbs"}, callable or array, default="levels"
        "levels": random levels, each held for a while. "multisine": 8 sines with random phases that fill the range.
        "prbs": random switching between two levels, which differ from run to run. A callable
        ``design(rng, n_samples)`` returns the input of one run; an array (n_samples, n_inputs) is the input of every
        run, (n_runs, n_samples, n_inputs) that of each.
    n_runs, n_samples : int, default=64, 200
        Rows are samples of the simulator's ``dt``.
    hold : (int, int), default=(10, 40)
        Fewest and most rows that a level is held.
    sampling : {"lhs", "sobol", "random"}, default="lhs"
        Spreads initial states, levels and phases jointly over the runs.
    noise : float or array (n_outputs,), default=0
        Standard deviation of white noise on y, units of y.
    cache : path, optional
        Folder of finished batches: a call that was interrupted goes on where it stopped. Batches are identified by
        the design and the value of the simulator: its settings, the code of its functions, their closures and the globals
        that they read. Changes of files that it reads while it runs (except those of an FMU or a MuJoCo model), and of programs that it
        calls, are not seen: after such a change use another folder.
    batch_size : int, default=128
        Runs that are simulated at once, and kept together in the cache.
    n_jobs : int, optional
        Batches in parallel through joblib.
    random_state : int, RandomState or None

    Returns
    -------
    Experiments
        ``X, y, groups, dydt``, and the states where the simulator tells them.

    Raises
    ------
    DataError
        A range or the design does not fit the simulator, every run failed, or ``cache`` is given and the simulator holds
        something without a value, a connection for example.
    SimulatorError
        ``n_jobs`` asks for other processes, and the simulator holds something that cannot travel there.

    Examples
    --------
    >>> from sksurrogate.datasets import make_reactor, simulate_experiments
    >>> data = simulate_experiments(make_reactor(), {"y": (0.5, 15)}, {"u": (0.05, 0.25)}, n_runs=4, n_samples=50,
    ...                             random_state=0)
    >>> data
    Experiments: 4 runs, 200 rows, 1 inputs, with derivatives, 0 runs failed
    """
    _refuse_counts(n_runs, n_samples, batch_size, n_jobs)
    plant = describe(simulator)
    rng = check_random_state(random_state)
    X0, U = design_of(plant, x0_ranges, input_ranges, design, n_runs, n_samples, hold, sampling, rng)
    store = None if cache is None else (_made_folder(cache), fingerprint(simulator, "with cache=, simulator"))
    sigma = _deviations(noise, len(plant.outputs))
    batches = [slice(a, min(a + batch_size, n_runs)) for a in range(0, n_runs, batch_size)]
    refuse_what_stays(simulator, n_jobs)
    parts = workers(n_jobs)(delayed(_cached)(simulator, U[b], X0[b], store) for b in batches)
    runs = {r: run for r, run in enumerate(chain(*parts)) if run is not None and np.all(np.isfinite(run[0]))}
    failed = tuple(r for r in range(n_runs) if r not in runs)
    if failed:
        warnings.warn(
            f"{len(failed)} of {n_runs} runs diverged and were left out, the first is run {failed[0]} from "
            f"x0={X0[failed[0]].tolist()}: narrow x0_ranges or input_ranges, or give the simulator a smaller dt.",
            RuntimeWarning,
            stacklevel=2,
        )
    if not runs:
        raise DataError(
            "every run diverged: narrow x0_ranges or input_ranges, or give the simulator a smaller dt. The first one: "
            f"{_why_diverged(simulator, U[0], X0[0])}"
        )
    y, states, dxdt = (None if part[0] is None else np.concatenate(part) for part in zip(*runs.values()))
    assert y is not None
    positions = plant.output_states if dxdt is not None else None
    dydt = None if positions is None or dxdt is None else dxdt[:, list(positions)]
    if np.any(sigma > 0):
        sigma = np.broadcast_to(_deviations(noise, y.shape[1]), (y.shape[1],))
        y = y + sigma * rng.normal(size=y.shape)
    if y.shape[1] == 1:
        y, dydt = y[:, 0], None if dydt is None else dydt[:, 0]
    groups = np.repeat(list(runs), n_samples)
    return Experiments(np.concatenate([U[r] for r in runs]), y, groups, dydt, states, dxdt, X0, failed)


def _refuse_counts(n_runs: Any, n_samples: Any, batch_size: Any, n_jobs: Any) -> None:
    """Raise DataError where a count is none."""
    for name, count, least in (("n_runs", n_runs, 1), ("n_samples", n_samples, 2), ("batch_size", batch_size, 1)):
        if not isinstance(count, Integral) or isinstance(count, bool) or count < least:
            raise DataError(f"{name}={count!r}: expected a whole number of at least {least}.")
    if n_jobs is not None and (not isinstance(n_jobs, Integral) or n_jobs == 0):
        raise DataError(f"n_jobs={n_jobs!r}: expected None, -1 or a positive integer.")


def _made_folder(cache: str | Path) -> Path:
    """The folder of the cache; made where it is not there."""
    try:
        Path(cache).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise DataError(f"cache={str(cache)!r} is no folder and cannot be made one ({error.strerror}).") from error
    return Path(cache)


def _deviations(noise: Any, n_outputs: int) -> np.ndarray:
    """Standard deviations of the noise, one for all outputs or one each; known before anything is simulated."""
    try:
        sigma = np.asarray(noise, float)
    except (TypeError, ValueError):
        sigma = np.array([np.nan])
    many = (n_outputs,) if n_outputs else sigma.shape
    if sigma.shape not in ((), (1,), many) or not np.all((sigma >= 0) & np.isfinite(sigma)):
        raise DataError(
            f"noise={noise!r} must be a standard deviation, at least 0, or one for each of {n_outputs or 'the'} outputs."
        )
    return sigma


def _cached(simulator: Any, U: np.ndarray, X0: np.ndarray, store: tuple[Path, str] | None) -> list[Any]:
    """One batch, from the folder where it is there already; ``store``: folder and fingerprint of the simulator."""
    if store is None:
        return _simulate(simulator, U, X0)
    digest = hashlib.sha256(f"{store[1]} {U.shape} {X0.shape} ".encode())
    digest.update(np.ascontiguousarray(U).tobytes() + np.ascontiguousarray(X0).tobytes())
    path = store[0] / f"batch_{digest.hexdigest()[:24]}.joblib"
    if path.exists():
        try:
            found = joblib.load(path)
            if _are_runs(found, U):
                return found
            said = "other content"
        except Exception as error:  # a damaged pickle fails in whatever way its bytes say
            said = type(error).__name__
        warnings.warn(
            f"cache=: {path} is damaged ({said}): its runs are simulated again.",
            RuntimeWarning,
            stacklevel=2,
        )
    runs = _simulate(simulator, U, X0)
    try:
        with beside(
            path
        ) as part:  # neither an interrupt nor another process on the same folder leaves half a batch behind
            joblib.dump(runs, part)
    except OSError as error:  # the runs are there: a full disk must not cost them
        warnings.warn(
            f"cache=: {path} could not be written ({error.strerror or error}): its runs are not kept for the next call.",
            RuntimeWarning,
            stacklevel=2,
        )
    return runs


def _are_runs(found: Any, U: np.ndarray) -> bool:
    """Whether a file holds the runs of these inputs (n_runs, n_samples, n_inputs): three arrays each, None where one diverged."""
    if not isinstance(found, list) or len(found) != len(U):
        return False
    if not all(run is None or (isinstance(run, tuple) and len(run) == 3 and run[0] is not None) for run in found):
        return False
    parts = [part for run in found if run is not None for part in run]
    return all(part is None or (isinstance(part, np.ndarray) and len(part) == U.shape[1]) for part in parts)


def _simulate(simulator: Any, U: np.ndarray, X0: np.ndarray) -> list[Any]:
    """(y, states, dxdt) of every run; None where it diverged."""
    if isinstance(simulator, ODESimulator):
        try:
            return _abreast(simulator, U, X0)
        except SimulationDiverged:
            return [_alone(simulator, U[r], X0[r]) for r in range(len(U))]
    plain = not callable(getattr(simulator, "simulate_states", None))
    if plain and callable(getattr(simulator, "simulate_batch", None)):
        try:
            return [(y, None, None) for y in simulated_batch(simulator, U, X0 if X0.shape[1] else None)]
        except SimulationDiverged:
            return [_alone(simulator, U[r], X0[r]) for r in range(len(U))]
    return [_alone(simulator, U[r], X0[r]) for r in range(len(U))]


def _abreast(simulator: ODESimulator, U: np.ndarray, X0: np.ndarray) -> list[Any]:
    """All runs of a right-hand side at once; states, outputs and derivatives from one pass."""
    open_ = clone(simulator).set_params(outputs=list(describe(simulator).states), output=None)
    X = open_.simulate_batch(U, X0)
    model = PlantModel(describe(simulator))
    model.probe(U[0, 0])
    times = float(simulator.dt) * np.arange(U.shape[1])
    x, u = X.transpose(2, 0, 1), U.transpose(2, 0, 1)
    t = np.broadcast_to(times, x.shape[1:])
    Y = model.output(t, x, u).transpose(1, 2, 0)
    D = model.derivative(t, x, u).transpose(1, 2, 0)
    return list(zip(Y, X, D))


def _why_diverged(simulator: Any, U: np.ndarray, x0: np.ndarray) -> str:
    """What the simulator says of a run."""
    try:
        simulated(simulator, U, x0 if len(x0) else None)
    except SimulationDiverged as error:
        return str(error)
    return "its outputs are not finite."


def _alone(simulator: Any, U: np.ndarray, x0: np.ndarray) -> Any:
    """One run, its states and derivatives where the simulator tells them."""
    start = x0 if len(x0) else None
    summary = callable(getattr(simulator, "simulate_states", None))
    positions = describe(simulator).output_states if summary else None
    try:
        if positions is None or not summary:
            y = simulated(simulator, U, start).reshape(len(U), -1)
            if not summary:
                return y, None, None
        states, dxdt = (
            np.array(part, float)
            for part in simulator.simulate_states(U.copy(), None if start is None else start.copy())
        )
        # one call where the outputs are states: a simulator may be slow
        return (states[:, list(positions)] if positions is not None else y), states, dxdt
    except SimulationDiverged:
        return None
