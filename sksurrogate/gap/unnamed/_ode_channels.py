"""Channels of a simulator with a right-hand side: linearised about the path that a free signal at the place gives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sksurrogate.gap.fit._linear_set import linear_set
from sksurrogate.gap.fit._ode import OdeBackend, OdeCandidate
from sksurrogate.gap.fit._record_parts import blocked
from sksurrogate.gap.fit._unstable import largest_growth, piece_starts
from sksurrogate.gap.unnamed._channel import Channel, fit_signal
from sksurrogate.gap.unnamed._channels import Channels
from sksurrogate.gap.unnamed._drivers import Drivers, drivers_at
from sksurrogate.gap.unnamed._elements import elements_along
from sksurrogate.gap.unnamed._law_places import push_at, size_at
from sksurrogate.gap.unnamed._smoothed_path import paths
from sksurrogate.kernels.disturbance import Noise
from sksurrogate.kernels.integrate import state_jacobian
from sksurrogate.kernels.record import Record


def _along(null: OdeCandidate, x: np.ndarray, location: str, kind: str, soft: Sequence[str]) -> Channel:
    """The channel about a path, in pieces where the plant is unstable; about the path that it gives, where that is near."""
    problem = null.problem
    _, A = state_jacobian(null.model.bind(null.fit.theta[:, None]), x, null.model.scale)
    most = largest_growth(problem.sd, problem.record.spread)
    pieces = piece_starts(A, null.model.scale, problem.record.starts, most)
    if len(pieces) > len(problem.record.starts):
        null = on_record(null, replace(problem.record, starts=pieces))
        problem = null.problem
    channel, closed = _about(null, x, location, kind, soft)
    again = closed + channel.D.states(channel.r, channel.noise)[0]
    if np.all(np.isfinite(again)) and np.max(np.abs(again - x) / null.model.scale[:, None]) < 3.0:
        try:
            channel, _ = _about(null, again, location, kind, soft, channel.noise)
        except np.linalg.LinAlgError:  # along the first path it can be followed
            pass
    return channel


def on_record(null: OdeCandidate, record: Record) -> OdeCandidate:
    """The null over the same samples in other runs."""
    return replace(null.problem, record=record).candidate(null.effects, null.fit)


def _soft(problem: OdeBackend, null: OdeCandidate, location: str, kind: str) -> tuple[str, ...]:
    """Balances that the signal at a place moves."""
    if kind == "state" and location in problem.balances:
        return (location,)
    if kind in ("input", "parameter"):
        push = push_at(null, null.fit.x, location, kind)
        size = np.sqrt(np.mean(push[: len(problem.scale), 0] ** 2, axis=1)) / problem.scale
        moved = [s for s, v in zip(problem.plant.states, size) if v > 0.1 * size.max() and s in problem.balances]
        return tuple(moved) or problem.balances
    return problem.balances


def _about(
    null: OdeCandidate, x: np.ndarray, location: str, kind: str, soft: Sequence[str], near: Noise | None = None
) -> tuple[Channel, np.ndarray]:
    """The channel linearised about a path x, and the free run without the signal to first order.

    Its noise is fitted from one ``near`` to it, that of a path nearby, else from several starts.
    """
    problem, about = null.problem, null.along(x)
    record, plant, lin = problem.record, problem.plant, about.linearised
    whole = problem.disturbance_along(null.model, null.fit.theta, x, lin.A, soft)
    B = whole.B.transpose(1, 2, 0)[:, :1]
    unit = float(problem.rate[plant.states.index(soft[0])])
    if kind in ("input", "parameter"):
        B, unit = push_at(null, x, location, kind), size_at(problem, location, kind)
    D = whole.with_forces(B)
    linear = linear_set(about)
    sensor = sensor_at(null, location, kind)
    noise, value, held = fit_signal(D, linear.r, problem.sd, record.spread, unit, sensor, near=near)
    if not np.isfinite(value):
        raise np.linalg.LinAlgError("the noise model gives no likelihood along this path")
    push = B[:, 0] if sensor is None else None
    signals = problem.signals_along(x)
    wanted = [location] if kind == "parameter" else []
    elements = elements_along(problem.model, record, x[: len(plant.states)], wanted)  # without states of effects
    signals |= {f"flow of {one.parameter}": one.flow for one in elements}
    return (
        Channel(location, kind, record, D, noise, linear, push, sensor, unit, held, signals, value, x, len(soft)),
        lin.x,
    )


def sensor_at(null: OdeCandidate, location: str, kind: str) -> int | None:
    """The output at a place; None elsewhere."""
    outputs = null.problem.plant.outputs
    return outputs.index(location) if kind == "output" and location in outputs else None


class OdeChannels(Channels[OdeCandidate]):
    """Along a right-hand side: in every balance, at every input and sensor."""

    def made(self, location: str, kind: str) -> Channel:
        """Linearised about the first path near the data along which a noise can be followed."""
        null = on_record(self.null, blocked(self.null.problem.record))
        problem = null.problem
        if sensor_at(null, location, kind) is not None:
            return _about(null, null.fit.x, location, kind, problem.balances[:1])[0]
        soft = _soft(problem, null, location, kind)
        for x in paths(null, replace(problem, balances=soft), problem):
            try:
                return _along(null, x, location, kind, soft)
            except np.linalg.LinAlgError:
                continue
        raise np.linalg.LinAlgError(
            f"the noise model gives no likelihood along any path near the data with a signal at {location!r}"
        )

    def drivers(self, channel: Channel, changes: Sequence[float] = ()) -> Drivers:
        return drivers_at(self.null, channel, changes)
