"""Effects around a simulator that only gives trajectories: before it, behind it, in its parameters."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from sklearn.base import clone

from sksurrogate.effects._base_effect import BaseEffect
from sksurrogate.effects._families import InputEffect, ParameterEffect, SensorEffect
from sksurrogate.effects._onset import timed
from sksurrogate.effects._parts import SensorPath
from sksurrogate.exceptions import SimulatorError
from sksurrogate.kernels.clock import check_time
from sksurrogate.kernels.signals import hold
from sksurrogate.physics._simulator import Plant, simulated, simulated_batch

#: Substeps in which inputs are computed.
INPUT_SUBSTEPS = 16


def retuned_simulator(simulator: Any, retuned: Mapping[str, float] | None) -> Any:
    """The simulator, or one like it with other parameters."""
    if not retuned:
        return simulator
    known = sorted(getattr(simulator, "params", None) or {})
    unknown = sorted(set(retuned) - set(known))
    if unknown:
        raise SimulatorError(f"retuned: the simulator has no parameter {unknown[0]!r}; it has {known}.")
    try:
        return clone(simulator).set_params(**{f"params__{name}": value for name, value in retuned.items()})
    except (AttributeError, TypeError, ValueError):  # no estimator: one like it with another dict
        other = copy.copy(simulator)
        other.params = {**simulator.params, **retuned}
        return other


def even_times(t: Any, n_samples: int, dt: float) -> tuple[np.ndarray, float, float]:
    """Times from the first row on, their even step, and the time of the first row.

    Even as far as numbers of their size hold it: seconds since 1970 are rounded to 2e-7.
    """
    if t is None:
        return dt * np.arange(n_samples), dt, 0.0
    times = np.asarray(t, dtype=float)
    if times.shape != (n_samples,):
        raise SimulatorError(f"t has shape {times.shape}, expected ({n_samples},): one time for each row of U.")
    steps = np.diff(times)
    rounding = 4.0 * float(np.spacing(np.max(np.abs(times), initial=0.0)))
    if len(steps) and not np.allclose(steps, steps[0], rtol=1e-6, atol=rounding):
        row = int(np.argmax(np.abs(steps - steps[0]))) + 1
        raise SimulatorError(
            f"t is not evenly spaced (row {row}), expected one step for all rows of a simulator with effects; resample the run."
        )
    first = float(times[0])
    return times - first, float(np.mean(steps)) if len(steps) else dt, first


def plain_runs(simulator: Any, U: np.ndarray, X0: Any, t: Any) -> np.ndarray:
    """Runs of a simulator as it is."""
    check_time()
    if callable(getattr(simulator, "simulate_batch", None)):
        return simulated_batch(simulator, U, X0, t)
    starts = [None] * len(U) if X0 is None else np.broadcast_to(X0, (len(U), np.shape(X0)[-1]))
    out = []
    for u, x0 in zip(U, starts):
        check_time()
        out.append(_two_columns(simulated(simulator, u, x0, t)))
    return np.stack(out)


def _two_columns(Y: Any) -> np.ndarray:
    """(n_samples, n_outputs)."""
    values = np.asarray(Y, dtype=float)
    return values[:, None] if values.ndim == 1 else values


def trajectory_runs(
    plant: Plant, effects: list[BaseEffect], theta: np.ndarray, U: np.ndarray, X0: Any, t: Any
) -> np.ndarray:
    """Effects around a simulator that only gives trajectories: before it, behind it, in its parameters."""
    parts = np.split(theta, np.cumsum([len(effect.parameters) for effect in effects])[:-1])
    changed: dict[str, float] = {}
    for effect, values in zip(effects, parts):
        if effect.access != "trajectory":
            raise SimulatorError(
                f"{effect!r} needs rhs or step; {type(plant.simulator).__name__} only gives trajectories."
            )
        if isinstance(effect, ParameterEffect):
            name = str(effect.location)
            changed[name] = float(effect.value(changed.get(name, plant.params[name]), 0.0, list(values), 0.0))
    times, dt, _ = even_times(t, U.shape[1], plant.dt)
    acting = U if plant.inputs == () else acting_inputs(plant, effects, parts, U, dt)
    Y = plain_runs(retuned_simulator(plant.simulator, changed), acting, X0, t)
    outputs = plant.outputs or tuple(f"y{k}" for k in range(Y.shape[2]))
    seen = replace(plant, outputs=tuple(outputs))
    return np.stack([readings(seen, effects, parts, y, u, times, dt) for y, u in zip(Y, acting)])


def acting_inputs(
    plant: Plant, effects: list[BaseEffect], parts: list[np.ndarray], U: np.ndarray, dt: float
) -> np.ndarray:
    """Inputs behind the actuators, (n_runs, n_samples, n_inputs): means over a sample where inputs are held, values at the
    samples otherwise."""
    n_runs, n_samples, n_inputs = U.shape
    u = U.reshape(n_runs * n_samples, n_inputs).T
    out = acting_rows(plant, effects, parts, u, dt, n_samples * np.arange(n_runs))
    return out.T.reshape(U.shape)


def acting_rows(
    plant: Plant, effects: list[BaseEffect], parts: list[np.ndarray], u: np.ndarray, dt: float, starts: np.ndarray
) -> np.ndarray:
    """The same of runs one behind the other, (n_inputs, n_samples), that begin at rows ``starts``."""
    acting = sorted(
        ((e, p) for e, p in zip(effects, parts) if isinstance(e, InputEffect)), key=lambda item: item[0].order
    )
    held = plant.hold == "zoh"
    given = [hold(row, INPUT_SUBSTEPS, 0 if held else 1, starts) for row in u]
    signals = list(given)
    for effect, values in acting:
        i = plant.inputs.index(str(effect.location))
        other = given[plant.inputs.index(effect.variable)] if effect.variable else None
        columns = [np.array([[value]]) for value in values]
        signals[i] = effect.transform(signals[i], other, columns, dt / INPUT_SUBSTEPS, starts)
    out = u.copy()
    for i, signal in enumerate(signals):
        out[i] = np.mean(signal.mean, axis=0)[0] if held else signal.start()[0, 0]
    return out


def readings(
    plant: Plant,
    effects: list[BaseEffect],
    parts: list[np.ndarray],
    Y: np.ndarray,
    U: np.ndarray,
    t: np.ndarray,
    dt: float,
) -> np.ndarray:
    """Readings of the sensors (n_samples, n_outputs); between the samples the output runs along cubics.

    ``U`` (n_samples, n_inputs): inputs behind the actuators.
    """
    outputs, raw, y = plant.outputs, Y.T, Y.T.copy()
    one, paths = np.array([0]), {}
    acting = sorted(
        ((e, p) for e, p in zip(effects, parts) if isinstance(e, SensorEffect)), key=lambda item: item[0].order
    )
    for effect, values in acting:
        i = outputs.index(str(effect.location))
        if effect.memory:
            if i not in paths:
                slope = np.gradient(y[i], dt)[None] if len(t) > 1 else np.zeros((1, 1))
                paths[i] = SensorPath(y[i][None], slope, slope)
            own = timed(effect, t)
            follow = getattr(own, "follow_sharp", own.follow)
            paths[i] = follow(paths[i], [np.array([[value]]) for value in values], dt, one)
            y[i] = paths[i].y[0]
        else:
            y[i] = effect.read(y[i], effect.beside(outputs, raw, plant.inputs, U.T), t, list(values))
    return y.T
