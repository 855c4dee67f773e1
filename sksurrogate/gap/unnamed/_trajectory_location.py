"""Where a gap lies around a simulator that only gives trajectories: the place of an equivalent disturbance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sksurrogate.gap.fit._trajectory import Around, Trial
from sksurrogate.gap.unnamed._latent_force import Place
from sksurrogate.gap.unnamed._shape import Channel
from sksurrogate.kernels.disturbance import Noise
from sksurrogate.kernels.noise_fit import fit_noise

__all__ = ["channel_of", "equivalent_places", "forces_on_states", "left_of", "variables"]


def left_of(around: Around, trial: Trial) -> float:
    """RMS of the residual in units of the sensor noise of the fit (the worst output)."""
    sigma = trial.noise.sigma if trial.noise is not None else around.sd
    y = around.settled(trial.y) if around.free_starts else trial.y
    return float(np.max(np.sqrt(np.mean((around.record.y - y) ** 2, axis=1)) / sigma))


def variables(around: Around, y: np.ndarray) -> tuple[np.ndarray, list[str]]:
    """Outputs of the simulator and inputs as columns, with their names."""
    return np.concatenate([y, around.record.u]).T, [*around.plant.outputs, *around.plant.inputs]


def channel_of(around: Around, trial: Trial, location: str | None) -> Channel:
    """One latent signal at an input or output on top of a trial; where no place is named, on every state of the stand-in.

    Signals at an input or output are in its units.
    """
    stand, plant, record, m = around.stand_in, around.plant, around.record, len(around.sd)
    r = record.y - (around.settled(trial.y) if around.free_starts else trial.y)
    sensor = plant.outputs.index(location) if location in plant.outputs else None
    push, unit = np.diag(stand.scale), 1.0
    if sensor is not None:
        push = stand.scale[:, None]
    elif location in plant.inputs:
        i = plant.inputs.index(str(location))
        push, unit = stand.B[:, i : i + 1], max(float(np.std(record.u[i])), 1e-12)
        if not np.any(push):
            push = np.ones((len(stand.A), 1))
    b = push.shape[1]
    D = stand.disturbance(around.free_starts, push)
    held = np.zeros(2 * m + b + 2, bool)
    held[m + b + 1 :] = True
    coloured, force = 1e-2 * around.sd, np.full(b, 0.1 * unit)
    if sensor is not None:
        held[m + b + 1 + sensor] = held[-1] = False
        held[m : m + b + 1] = True
        force = np.full(b, 1e-4)
        coloured = coloured.copy()
        coloured[sensor] = max(0.1 * float(np.std(record.y[sensor])), 1e-12)
    noise, best = Noise(around.sd.copy(), force, 10.0, coloured, 10.0), -np.inf
    for tau in (5.0, 25.0):
        start = replace(noise, tau=tau, tau_sensor=tau if sensor is not None else 10.0)
        try:
            found, value, _ = fit_noise(D, r, start, np.full(b, unit), held=held, max_iterations=10)
        except np.linalg.LinAlgError:
            continue
        if value > best:
            noise, best = found, value
    Z, names = variables(around, trial.y)
    return Channel(
        record, D, noise, r, np.repeat(push[:, :1], record.n_samples, axis=1) if sensor is None else None, sensor, unit,
        held, Z, names, best,
    )  # fmt: skip


def equivalent_places(around: Around, null: Trial) -> list[Place]:
    """Likelihood of the null with a free latent signal at one input or output at a time."""
    kinds = [(name, "input") for name in around.plant.inputs] + [(name, "output") for name in around.plant.outputs]
    found = [Place(name, kind, channel_of(around, null, name).log_likelihood) for name, kind in kinds]
    return sorted(found, key=lambda place: -place.log_likelihood)


def forces_on_states(around: Around, trial: Trial) -> np.ndarray:
    """Latent forces on every state of the stand-in on top of a trial, (n_states, n_samples)."""
    channel = channel_of(around, trial, None)
    return channel.D.states(channel.r, channel.noise)[1]
