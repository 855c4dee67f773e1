"""Channels of a simulator that only gives trajectories: an equivalent disturbance at an input, an output, or anywhere, and the law in it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.special import expit, ndtr

from sksurrogate.gap.fit._linear_model import LinearModel
from sksurrogate.gap.fit._trajectory import TrajectoryCandidate
from sksurrogate.gap.unnamed._channel import Channel, Place, fit_signal
from sksurrogate.gap.unnamed._channels import Channels
from sksurrogate.gap.unnamed._drivers import Drivers
from sksurrogate.gap.unnamed._law_left import LawLeft
from sksurrogate.physics._simulator import units_of


class TrajectoryChannels(Channels[TrajectoryCandidate]):
    """Around a simulator with ``simulate`` alone: at its inputs and outputs, elsewhere on every state of its surrogate.

    Signals at an input or output are in its units.
    """

    def made(self, location: str, kind: str) -> Channel:
        problem, record, r = self.null.problem, self.null.problem.record, self.null.residual
        surrogate, plant = problem.surrogate, problem.plant
        sensor = plant.outputs.index(location) if location in plant.outputs else None
        push, unit = np.diag(surrogate.scale), 1.0
        if sensor is not None:
            push = surrogate.scale[:, None]
        elif location in plant.inputs:
            i = plant.inputs.index(location)
            push, unit = surrogate.B[:, i : i + 1], max(float(np.std(record.u[i])), 1e-12)
            if not np.any(push):
                push = np.ones((len(surrogate.A), 1))
        D = surrogate.disturbance(problem.free_starts, push, record.known)
        noise, value, held = fit_signal(D, r, problem.sd, record.spread, unit, sensor)
        signals = {**dict(zip(plant.outputs, self.null.fit.y)), **dict(zip(plant.inputs, record.u))}
        pushed = None if sensor is not None else np.repeat(push[:, :1], record.n_samples, axis=1)
        return Channel(location, kind, record, D, noise, LinearModel.of(r), pushed, sensor, unit, held, signals, value)

    def drivers(self, channel: Channel, changes: Sequence[float] = ()) -> Drivers:
        plant = self.null.problem.plant
        return Drivers(
            channel, channel.signals, {}, along=plant.inputs, changes=changes, units=units_of(plant.simulator)
        )


def equivalent_places(channels: Channels[TrajectoryCandidate]) -> list[Place]:
    """Likelihood of the null with a free signal at one input or output at a time, the likeliest first."""
    plant = channels.null.problem.plant
    kinds = [(name, "input") for name in plant.inputs] + [(name, "output") for name in plant.outputs]
    made = [(name, kind, channels.at(name, kind)) for name, kind in kinds]
    found = [Place(name, kind, channel.log_likelihood) for name, kind, channel in made if channel is not None]
    return sorted(found, key=lambda place: -place.log_likelihood)


def law_left(channels: Channels[TrajectoryCandidate], place: Place, unit: float, tolerance: float) -> LawLeft:
    """The likeliest formula at a place on top of what the channels lead from.

    ``unit``: RMS of the gap over the noise: the size that counts as one.
    ``tolerance``: size of a law that is small.
    """
    channel, drafts = channels.at(place.location, place.kind), channels.drafts(place.location, place.kind)
    if channel is None or not drafts:
        return LawLeft(place.location, place.kind, "")
    best, candidate = drafts[0], channels.null
    problem, drivers = candidate.problem, channels.drivers(channel)
    signal = best.coefficients @ drivers.values(best.terms)
    over_noise = candidate.without_starts(channel.respond(signal[None]).transpose(1, 0, 2))[0]
    chance = float(expit(best.worth))
    size = chance * float(np.sqrt(np.sum(over_noise**2) / problem.record.n_values)) / unit
    spread = size / np.sqrt(2.0 * max(best.nats, 0.5))  # nats are half the square of a weight over its deviation
    deviation = float(np.max(problem.record.rms(over_noise) * problem.sd / problem.record.spread))
    probability = chance * float(ndtr((size - tolerance) / max(spread, 1e-300)))
    variable = "*".join(dict.fromkeys(name for term in best.terms for name in term.variables))
    return LawLeft(place.location, place.kind, variable, size, spread, 2.0 * best.worth, deviation, probability)
