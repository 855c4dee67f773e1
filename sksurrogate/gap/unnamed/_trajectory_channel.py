"""Where a gap lies around a simulator that only gives trajectories: the place of an equivalent disturbance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sksurrogate.gap.fit._evidence import Evidence
from sksurrogate.gap.fit._pushes import REMEMBERED
from sksurrogate.gap.fit._trajectory import TrajectoryBackend, TrajectoryCandidate
from sksurrogate.gap.results._missing_term import MissingTerm
from sksurrogate.gap.unnamed._channel import STARTS, Channel
from sksurrogate.gap.unnamed._drivers import Drivers
from sksurrogate.gap.unnamed._formula_search import drafts_at
from sksurrogate.gap.unnamed._latent_force import LatentForce, Place, repeatable
from sksurrogate.gap.unnamed._shape import shape_of
from sksurrogate.kernels.disturbance import Noise
from sksurrogate.kernels.noise_fit import fit_noise


def variables(problem: TrajectoryBackend, y: np.ndarray) -> tuple[np.ndarray, list[str]]:
    """Outputs of the simulator and inputs as columns, with their names."""
    return np.concatenate([y, problem.record.u]).T, [*problem.plant.outputs, *problem.plant.inputs]


def channel_of(candidate: TrajectoryCandidate, location: str | None) -> Channel:
    """One latent signal at an input or output on top of a candidate; where no place is named, on every state of the surrogate.

    Signals at an input or output are in its units.
    """
    problem, record, r = candidate.problem, candidate.problem.record, candidate.residual
    surrogate, plant, m = problem.surrogate, problem.plant, len(problem.sd)
    sensor = plant.outputs.index(location) if location in plant.outputs else None
    push, unit = np.diag(surrogate.scale), 1.0
    if sensor is not None:
        push = surrogate.scale[:, None]
    elif location in plant.inputs:
        i = plant.inputs.index(str(location))
        push, unit = surrogate.B[:, i : i + 1], max(float(np.std(record.u[i])), 1e-12)
        if not np.any(push):
            push = np.ones((len(surrogate.A), 1))
    b = push.shape[1]
    D = surrogate.disturbance(problem.free_starts, push, record.known)
    held = np.zeros(2 * m + b + 2, bool)
    held[m + b + 1 :] = True
    coloured, force = 1e-2 * problem.sd, np.full(b, 0.1 * unit)
    if sensor is not None:
        held[m + b + 1 + sensor] = held[-1] = False
        held[m : m + b + 1] = True
        force = np.full(b, 1e-4)
        coloured = coloured.copy()
        coloured[sensor] = max(0.1 * float(record.spread[sensor]), 1e-12)
    noise, best = Noise(problem.sd.copy(), force, REMEMBERED, coloured, REMEMBERED), -np.inf
    for tau in STARTS:
        start = replace(noise, tau=tau, tau_sensor=tau if sensor is not None else REMEMBERED)
        try:
            found, value, _ = fit_noise(D, r, start, np.full(b, unit), held=held, max_iterations=10)
        except np.linalg.LinAlgError:
            continue
        if value > best:
            noise, best = found, value
    Z, names = variables(problem, candidate.fit.y)
    pushed = None if sensor is not None else np.repeat(push[:, :1], record.n_samples, axis=1)
    return Channel(record, D, noise, r, pushed, sensor, unit, held, Z, names, best)


def equivalent_places(null: TrajectoryCandidate) -> list[Place]:
    """Likelihood of the null with a free latent signal at one input or output at a time."""
    plant = null.problem.plant
    kinds = [(name, "input") for name in plant.inputs] + [(name, "output") for name in plant.outputs]
    found = [Place(name, kind, channel_of(null, name).log_likelihood) for name, kind in kinds]
    return sorted(found, key=lambda place: -place.log_likelihood)


def force_left(found: Evidence[TrajectoryCandidate], seed: int) -> tuple[LatentForce, np.ndarray]:
    """Latent forces on the states of the surrogate on top of a candidate, and whether inputs and outputs repeat each (R2)."""
    problem, y = found.candidate.problem, found.fit.y
    channel = channel_of(found.candidate, None)
    w = channel.D.states(channel.r, channel.noise)[1]
    size = np.std(w, axis=1)
    Z, _ = variables(problem, y)
    law = repeatable(problem.record, w, size, Z, y, seed)
    rate = np.std(np.diff(problem.nominal, axis=1), axis=1) / np.maximum(np.std(problem.nominal, axis=1), 1e-300)
    size = size / max(float(np.max(rate)), 1e-3)
    return LatentForce(y, w, found.noise, size, problem.surrogate.A, channel.r), law


def missing_term(candidate: TrajectoryCandidate, location: str, kind: str) -> MissingTerm:
    """The shape of what is missing at an input or output, on top of a candidate."""
    channel = channel_of(candidate, location)
    drivers = Drivers(location, kind, dict(zip(channel.names, channel.Z.T)), {}, along=candidate.problem.plant.inputs)
    return shape_of(channel, drivers, drafts_at(channel, drivers))
