"""Before a calibration: substeps that the plant asks for, and a trajectory to start from."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sksurrogate.kernels.free_runs import free_run
from sksurrogate.kernels.integrate import DIFFERENCE, close, moved_one_by_one
from sksurrogate.kernels.record import Record
from sksurrogate.kernels.smoother import drawn
from sksurrogate.physics._fit_model import FitModel
from sksurrogate.physics._model import PlantModel

#: Substeps are doubled until one sample differs by less than this share of the size of a state.
SIMULATOR_LOCAL_ERROR = 1e-6
#: Runge-Kutta with more substeps than this, and the plant counts as stiff.
_MOST_SUBSTEPS = 32
#: Samples at which that is tried.
_PREPARE_PROBES = 250
#: Graded steps of a stiff plant are cut into at most as many.
_MOST_CUTS = 4
#: Largest correction, in sizes of a state, at which the first free run counts as one: the smoother goes on from there.
_CLOSED = 1e-1


def prepared(
    inner: PlantModel, record: Record, sd: np.ndarray, names: list[str], theta: np.ndarray, starts: np.ndarray, given: bool,
    fit_x0: bool,
) -> tuple[FitModel, np.ndarray]:  # fmt: skip
    """The model with substeps that its error asks for, and a trajectory (n_states, n_samples) to start from.

    ``inner, record, names, theta``: what is fitted to what, and from where.
    ``sd`` (n_outputs,): size of the noise.
    ``starts`` (n_runs, n_states): initial states; written where measured states are known better.
    ``given``: whether ``starts`` are the user's.
    """
    inner.probe(record.u[:, 0])
    near = first_guess(inner, record, starts, fit_x0 and not given)
    model = FitModel(inner, names, record, 1, np.ones(len(inner.plant.states)))
    if inner.plant.access == "rhs" and fastest(model, theta, near) > 1.0 and _is_stiff(model, theta, near):
        return _stiff(model, theta, near, starts)
    model, guess = smoothed_run(model, theta, near, starts, sd, fit_x0)
    return refined(model, theta, guess), guess


def first_guess(inner: PlantModel, record: Record, starts: np.ndarray, measured: bool) -> np.ndarray:
    """Measured states as measured, others as at the start, (n_states, n_samples).

    With ``measured``, those of ``starts`` (n_runs, n_states) are written too.
    """
    places = list(inner.plant.output_states or ())
    if measured:
        starts[:, places] = record.y[: len(places), record.starts].T
    near = np.repeat(starts.T, record.lengths, axis=1)
    if places:
        near[places] = record.y
        near[:, record.starts] = starts.T
    return near


def smoothed_run(
    model: FitModel, theta: np.ndarray, near: np.ndarray, starts: np.ndarray, sd: np.ndarray, fit_x0: bool
) -> tuple[FitModel, np.ndarray]:
    """The model with sizes of its states, and its free run drawn to the measurements, (n_states, n_samples)."""
    record, places = model.record, list(model.plain_outputs or ())
    run = _settled_run(model, theta, near, starts)
    guess = np.where(np.isfinite(run), run, np.repeat(starts.T, record.lengths, axis=1))
    if places:
        guess[places] = record.y
    size = np.maximum(np.std(guess, axis=1), 0.02 * np.sqrt(np.mean(guess**2, axis=1)))
    model = replace(model, scale=np.where(size > 0, size, 1.0))
    closer = drawn(model.bind(theta[:, None]), record.y, record.starts, sd, guess, model.scale, record.known)
    guess = np.where(np.isfinite(run), run, guess) if closer is None else closer
    if not fit_x0:
        guess[:, record.starts] = starts.T
    return model, guess


def fastest(model: FitModel, theta: np.ndarray, x: np.ndarray) -> float:
    """How fast the plant is at most along a trajectory: a bound of the eigenvalues of its right-hand side times a sample.

    None of them is larger than that of the matrix of the largest entries ``|df_i/dx_j|`` (Perron and Frobenius), whatever
    the units of the states.
    """
    rows, n = _probes(x), len(x)
    at = x[:, rows]
    size = np.max(np.abs(at), axis=1)
    step = DIFFERENCE * np.where(size > 0, size, 1.0)
    columns = moved_one_by_one(at, step)
    t, mean, _ = model.points_at(rows, n + 1)
    params = model.bind(theta[:, None]).params(0)
    slopes = model.inner.derivative_points(t, columns.reshape(n, -1), mean[0], params).reshape(n, n + 1, -1)
    largest = np.max(np.abs(slopes[:, 1:] - slopes[:, :1]), axis=2) / step
    if not np.all(np.isfinite(largest)):
        return np.inf
    return model.record.dt * float(np.max(np.abs(np.linalg.eigvals(largest))))


def _error(model: FitModel, theta: np.ndarray, x: np.ndarray) -> float:
    """How far one sample differs from the same in half the substeps, in sizes of a state; all but the worst 2 %."""
    finer = replace(model, n_sub=2 * model.n_sub)
    rows = _probes(x)
    once, twice = (m.bind(theta[:, None])(x[:, None, rows], rows)[:, 0] for m in (model, finer))
    return _all_but_worst(np.max(np.abs(once - twice) / model.scale[:, None], axis=0))


def _probes(x: np.ndarray) -> np.ndarray:
    """Some samples along a trajectory, evenly."""
    return np.arange(0, x.shape[1], -(-x.shape[1] // _PREPARE_PROBES))


def _all_but_worst(errors: np.ndarray) -> float:
    """The largest error but for the worst 2 %."""
    errors = np.where(np.isfinite(errors), errors, np.inf)
    last = -(-98 * len(errors) // 100) - 1
    return float(np.partition(errors, last)[last])


def refined(model: FitModel, theta: np.ndarray, x: np.ndarray, *, most: int = _MOST_SUBSTEPS) -> FitModel:
    """Substeps doubled until their error along a trajectory is small."""
    while (
        model.inner.plant.access == "rhs" and model.n_sub < most and not _error(model, theta, x) < SIMULATOR_LOCAL_ERROR
    ):
        model = replace(model, n_sub=2 * model.n_sub)
    return model


def _stiff(model: FitModel, theta: np.ndarray, near: np.ndarray, starts: np.ndarray) -> tuple[FitModel, np.ndarray]:
    """The model in steps for stiff plants, and its free run.

    Off its slow manifold a stiff plant leads anywhere: measured values stay out of the trajectory.
    """
    model = replace(model, stiff=True)
    run = free_run(model, theta, starts.T)
    size = np.maximum(np.max(np.abs(np.where(np.isfinite(run), run, 0.0)), axis=1), 1e-12)
    model = refined(replace(model, scale=size), theta, np.where(np.isfinite(run), run, near), most=_MOST_CUTS)
    return replace(model, scale=np.maximum(np.max(np.abs(run), axis=1), 1e-12)), run


def _settled_run(model: FitModel, theta: np.ndarray, near: np.ndarray, starts: np.ndarray) -> np.ndarray:
    """Free run of a plant that is not stiff where ``near`` is; nan where it leaves the measurements far behind.

    It may come to places where long steps are unstable: then they are cut.
    """
    record = model.record
    size = np.maximum(np.std(near, axis=1), 1.0)
    room = 10.0 * np.maximum(np.ptp(record.y, axis=1), 1e-12)
    last = np.full_like(record.y, np.inf)
    for cut in (1, 4, 16):
        finer = replace(model, n_sub=cut * model.n_sub)
        bound = finer.bind(theta[:, None])
        # Newton over the time axis is many times faster than a loop over time, and settles for most plants.
        run, closed, _ = close(bound, near, record.starts, size, _CLOSED)
        if not closed:
            run = free_run(finer, theta, starts.T)
        y = bound.outputs(run[:, None])[:, 0]
        if np.all(np.max(np.abs(y - record.y), axis=1) < room):
            return run
        if np.all(np.max(np.abs(y - last), axis=1) < 0.1 * room):  # it is not a matter of the steps
            break
        last = y
    return np.full_like(run, np.nan)


def _is_stiff(model: FitModel, theta: np.ndarray, x: np.ndarray) -> bool:
    """Whether Runge-Kutta with many substeps is far off along a trajectory: some of its samples, coarse steps first."""
    rows = _probes(x)
    at = x[:, rows]
    for n_sub in (1, 4, _MOST_SUBSTEPS):
        once, twice = (
            replace(model, n_sub=n).bind(theta[:, None])(at[:, None], rows)[:, 0] for n in (n_sub, 2 * n_sub)
        )
        after = np.where(np.isfinite(once), np.abs(once), 0.0)
        size = np.maximum(np.maximum(np.max(np.abs(at), axis=1), np.max(after, axis=1)), 1e-12)
        worst = np.max(np.abs(once - twice) / size[:, None], axis=0)
        if _all_but_worst(worst) < 1e-2:
            return False
    return True
