"""Channels of a simulator that only gives trajectories: an equivalent disturbance at an input, an output, or anywhere."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sksurrogate.gap.fit._evidence import Evidence
from sksurrogate.gap.fit._trajectory import TrajectoryBackend, TrajectoryCandidate
from sksurrogate.gap.unnamed._channel import Channel, Place, fit_signal, nothing_follows
from sksurrogate.gap.unnamed._channels import Channels
from sksurrogate.gap.unnamed._drivers import Drivers
from sksurrogate.gap.unnamed._latent_force import LatentForce, repeatable


def variables(problem: TrajectoryBackend, y: np.ndarray) -> tuple[np.ndarray, list[str]]:
    """Outputs of the simulator and inputs as columns, with their names."""
    return np.concatenate([y, problem.record.u]).T, [*problem.plant.outputs, *problem.plant.inputs]


def channel_of(candidate: TrajectoryCandidate, location: str | None) -> Channel:
    """One latent signal at an input or output on top of a candidate; where no place is named, on every state of the surrogate.

    Signals at an input or output are in its units.
    """
    problem, record, r = candidate.problem, candidate.problem.record, candidate.residual
    surrogate, plant = problem.surrogate, problem.plant
    sensor = plant.outputs.index(location) if location in plant.outputs else None
    push, unit = np.diag(surrogate.scale), 1.0
    if sensor is not None:
        push = surrogate.scale[:, None]
    elif location in plant.inputs:
        i = plant.inputs.index(str(location))
        push, unit = surrogate.B[:, i : i + 1], max(float(np.std(record.u[i])), 1e-12)
        if not np.any(push):
            push = np.ones((len(surrogate.A), 1))
    D = surrogate.disturbance(problem.free_starts, push, record.known)
    noise, value, held = fit_signal(D, r, problem.sd, record.spread, unit, sensor)
    Z, names = variables(problem, candidate.fit.y)
    pushed = None if sensor is not None else np.repeat(push[:, :1], record.n_samples, axis=1)
    return Channel(record, D, noise, r, pushed, sensor, unit, held, Z, names, value, *nothing_follows(r))


class TrajectoryChannels(Channels[TrajectoryCandidate]):
    """Around a simulator with ``simulate`` alone: at its inputs and outputs, elsewhere on every state of its surrogate."""

    def made(self, location: str, kind: str) -> Channel:
        return channel_of(self.null, location)

    def drivers(self, channel: Channel, location: str, kind: str, changes: Sequence[float] = ()) -> Drivers:
        signals, along = dict(zip(channel.names, channel.Z.T)), self.null.problem.plant.inputs
        return Drivers(location, kind, signals, {}, along=along, changes=changes)


def equivalent_places(channels: Channels[TrajectoryCandidate]) -> list[Place]:
    """Likelihood of the null with a free signal at one input or output at a time, the likeliest first."""
    plant = channels.null.problem.plant
    kinds = [(name, "input") for name in plant.inputs] + [(name, "output") for name in plant.outputs]
    made = [(name, kind, channels.at(name, kind)) for name, kind in kinds]
    found = [Place(name, kind, channel.log_likelihood) for name, kind, channel in made if channel is not None]
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
    return LatentForce(y, w, found.noise, size, np.zeros(len(w))), law
