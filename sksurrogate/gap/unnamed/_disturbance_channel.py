"""One place of the plant at which a free signal enters: its path, its smoothed signal, its way to the outputs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sksurrogate.gap.fit._ode import OdeBackend, OdeCandidate
from sksurrogate.gap.fit._pushes import REMEMBERED
from sksurrogate.gap.fit._record_parts import SHORTEST_BLOCK, blocked
from sksurrogate.gap.results._missing_term import MissingTerm
from sksurrogate.gap.results._table import Table
from sksurrogate.gap.unnamed._channel import STARTS, Channel
from sksurrogate.gap.unnamed._drivers import drivers_at
from sksurrogate.gap.unnamed._formula_search import Draft, drafts_at
from sksurrogate.gap.unnamed._latent_force import LatentForce, Place, features, input_push, paths
from sksurrogate.gap.unnamed._shape import shape_of
from sksurrogate.gap.unnamed._where import regions, times
from sksurrogate.kernels.disturbance import Disturbance, Noise
from sksurrogate.kernels.integrate import state_jacobian
from sksurrogate.kernels.noise_fit import fit_noise
from sksurrogate.kernels.output_error import Linearised, linearise
from sksurrogate.kernels.record import Record

#: Places that are compared by the law that fits there.
COMPARED = 3


def channel_of(null: OdeCandidate, location: str, kind: str) -> Channel:
    """The null with one free signal at a place, linearised about the path that it gives.

    Parameters
    ----------
    null : OdeCandidate
        The simulator, free parameters re-tuned.
    location, kind : str
        State, input or output; a parameter stands for the largest force.

    Raises
    ------
    LinAlgError
        Where no noise can be followed along any path near the data.
    """
    null = on_record(null, blocked(null.problem.record))
    problem = null.problem
    if sensor_at(null, location, kind) is not None:
        return _about(null, null.fit.x, location, kind, problem.balances[:1])[0]
    soft = _soft(problem, null, location, kind)
    for x in paths(null, replace(problem, balances=soft), problem):
        try:
            return _along(null, x, location, kind, soft)
        except np.linalg.LinAlgError:
            continue
    raise np.linalg.LinAlgError(f"no noise can be followed along any path near the data with a signal at {location!r}")


def _along(null: OdeCandidate, x: np.ndarray, location: str, kind: str, soft: Sequence[str]) -> Channel:
    """The channel about a path, in pieces where the plant is unstable; about the path that it gives, where that is near."""
    problem = null.problem
    _, A = state_jacobian(null.model.bind(null.fit.theta[:, None]), x, null.model.scale)
    pieces = _pieces(problem.record, A, largest_growth(problem.sd, problem.record.spread))
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


def largest_growth(sd: np.ndarray, spread: np.ndarray) -> float:
    """Growth (log) of small differences over a piece of a run up to which a model that is linear about a measured path holds.

    A path of error e leaves ``e^2 / spread`` of second order in every step; grown by ``exp(g)`` that stays within the noise
    as long as ``exp(g) e^2 / spread < sd``, and e is at most the noise: ``g < log(spread / sd)``.

    Parameters
    ----------
    sd, spread : ndarray (n_outputs,)
        Noise and deviation of every output.

    Examples
    --------
    >>> round(largest_growth(np.array([0.01]), np.array([1.0])), 3)
    4.605
    """
    return max(float(-0.5 * np.log(np.mean((sd / spread) ** 2))), 0.0)


def _pieces(record: Record, A: np.ndarray, most: float) -> np.ndarray:
    """First rows of pieces over which small differences grow by at most so much (log), no shorter than a block of a fold."""
    radius = np.max(np.abs(np.linalg.eigvals(A.transpose(2, 0, 1))), axis=1)
    growth = np.log(np.maximum(np.where(np.isfinite(radius), radius, 1.0), 1.0))
    first = np.zeros(record.n_samples, bool)
    first[record.starts] = True
    total, since = 0.0, 0
    for k in range(record.n_samples):
        total, since = (0.0, 0) if first[k] else (total + float(growth[k]), since + 1)
        if total > most and since >= SHORTEST_BLOCK:
            first[k], total, since = True, 0.0, 0
    return np.flatnonzero(first)


def _soft(problem: OdeBackend, null: OdeCandidate, location: str, kind: str) -> tuple[str, ...]:
    """Balances that the signal at a place moves."""
    if kind == "state" and location in problem.balances:
        return (location,)
    if kind == "input" and location in problem.plant.inputs:
        push = input_push(null, null.fit.x, problem.plant.inputs.index(location))
        size = np.sqrt(np.mean(push[: len(problem.scale), 0] ** 2, axis=1)) / problem.scale
        moved = [s for s, v in zip(problem.plant.states, size) if v > 0.1 * size.max() and s in problem.balances]
        return tuple(moved) or problem.balances
    return problem.balances


def _about(
    null: OdeCandidate, x: np.ndarray, location: str, kind: str, soft: Sequence[str], known: Noise | None = None
) -> tuple[Channel, np.ndarray]:
    """The channel linearised about a path x, and the free run without the signal to first order.

    Its noise is fitted from one that is known, that of a path nearby, else from several starts; of a sensor it is what the
    sensor adds to its output.
    """
    problem, model, theta = null.problem, null.model, null.fit.theta
    record, plant = problem.record, problem.plant
    lin = linearise(model, theta, x, problem.units(null.effects, theta))
    whole = problem.disturbance_along(model, theta, x, lin.A, soft)
    B, C = whole.B.transpose(1, 2, 0)[:, :1], whole.C.transpose(1, 2, 0)
    unit = float(problem.rate[plant.states.index(soft[0])])
    if kind == "input" and location in plant.inputs:
        i = plant.inputs.index(location)
        B, unit = input_push(null, x, i), max(float(np.std(record.u[i])), 1e-12)
    D = Disturbance(lin.A, B, C, record.starts, whole.start_sd, whole.slack, record.known)
    r, sensor = record.residual(lin.y), sensor_at(null, location, kind)
    m, force, coloured = len(r), 0.1 * unit, 1e-2 * problem.sd
    held = np.zeros(2 * m + 3, bool)
    held[m + 2 :] = True
    if sensor is not None:
        held[m : m + 2], held[m + 2 + sensor], held[-1] = True, False, False
        force, coloured[sensor] = 1e-4 * unit, 0.1 * float(record.spread[sensor]) + 1e-12
    times = [(t, REMEMBERED) if sensor is None else (REMEMBERED, t) for t in STARTS]
    starts = [Noise(problem.sd.copy(), np.array([force]), a, coloured, b) for a, b in times]
    noise = _fitted(D, r, starts if known is None else [known], unit, held)
    Z, names = features(problem, x)
    push, after = (B[:, 0] if sensor is None else None), followers(null, lin)
    channel = Channel(record, D, noise, r, push, sensor, unit, held, Z, names, -np.inf, after, x, len(soft))
    return channel, lin.x


def sensor_at(null: OdeCandidate, location: str, kind: str) -> int | None:
    """The output at a place; None elsewhere."""
    outputs = null.problem.plant.outputs
    return outputs.index(location) if kind == "output" and location in outputs else None


def followers(null: OdeCandidate, lin: Linearised) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Sensitivities of the parameters along a path, and what holds them."""
    J = lin.J_theta.copy()
    for i, effect in enumerate(null.effects):
        if effect.scan(tuple(null.theta_of(i))):  # a prediction that jumps has no slope
            J[:, null.slice_of(i)] = 0.0
    return J, *held_by(null)


def held_by(null: OdeCandidate) -> tuple[np.ndarray, np.ndarray]:
    """Precision and pull of the parameters."""
    _, _, precision, pull = null.columns()
    return precision, pull


def _fitted(D: Disturbance, r: np.ndarray, starts: Sequence[Noise], unit: float, held: np.ndarray) -> Noise:
    """The likeliest noise of several starts."""
    best, value = None, -np.inf
    for start in starts:
        try:
            noise, found, _ = fit_noise(D, r, start, np.array([unit]), held=held, max_iterations=10)
        except np.linalg.LinAlgError:
            continue
        if found > value:
            best, value = noise, found
    if best is None:
        raise np.linalg.LinAlgError("no noise can be followed along this path")
    return best


def places_by_law(channels: Channels, found: Sequence[Place]) -> list[Place]:
    """The most likely places again, each with the law of states and inputs that fits there and a force for the rest.

    A free force follows the gap from many places; a law of states and inputs follows it from the right one.
    """
    if not found:
        return []
    distinct: list[Place] = []
    for place in found:
        if not any(abs(place.log_likelihood - other.log_likelihood) < 1e-9 for other in distinct):
            distinct.append(place)
    again = {}
    for place in distinct[:COMPARED]:
        drafts = channels.drafts(place.location, place.kind)
        if drafts and np.isfinite(drafts[0].level):
            again[place.log_likelihood] = drafts[0].level
    if len(again) < 2:
        return list(found)
    # The others stay as far below as they were.
    drop = max(again) - max(again.values())
    lowest = min(again.values())
    out = [
        replace(p, log_likelihood=again[p.log_likelihood])
        if p.log_likelihood in again
        else replace(p, log_likelihood=min(p.log_likelihood - drop, lowest))
        for p in found
    ]
    return sorted(out, key=lambda place: -place.log_likelihood)


def missing_term(channels: Channels, location: str, kind: str) -> MissingTerm:
    """The shape of what is missing at a place, on top of the null; no curves where no signal there can be followed."""
    channel = channels.at(location, kind)
    if channel is None:
        return MissingTerm(location, kind, (), (), ())
    record = channel.record
    first = record.t[record.starts]
    table = times(record, channel.force())
    changes = [row["start"] for row in table[1:] if row["kind"] == "change"] if np.ptp(first) == 0 else []
    moments = [float(first[0] + moment) for moment in changes]
    drivers = drivers_at(channels.null, channel, location, kind, moments)
    return shape_of(channel, drivers, drafts_at(channel, drivers) if moments else channels.drafts(location, kind))


def where_and_when(
    channels: Channels, latent: LatentForce, location: str | None, kind: str | None
) -> tuple[Table, Table]:
    """By region and by time: of the force at the likely place, of the largest that the null leaves where none is likely."""
    problem = channels.null.problem
    channel = None
    if location is not None and kind in ("state", "input", "output"):
        channel = channels.at(location, kind)
    if channel is None:
        Z, names = features(problem, latent.x)
        w = latent.force[int(np.argmax(latent.size))]
        return regions(problem.record, Z, names, w), times(problem.record, w)
    w = channel.force()
    Z = channel.Z
    return regions(channel.record, Z, channel.names, w), times(problem.record, w)


class Channels:
    """The channels of one null, each made once.

    Parameters
    ----------
    null : OdeCandidate
        The simulator, free parameters re-tuned.

    Attributes
    ----------
    known : dict
        Channels by location and kind; None for a place where no signal can be followed.
    """

    def __init__(self, null: OdeCandidate):
        self.null = null
        self.known: dict[tuple[str, str], Channel | None] = {}
        self._drafts: dict[tuple[str, str], list[Draft]] = {}

    def at(self, location: str, kind: str) -> Channel | None:
        """That of a place; None where no signal there can be followed."""
        if (location, kind) not in self.known:
            try:
                self.known[location, kind] = channel_of(self.null, location, kind)
            except (np.linalg.LinAlgError, FloatingPointError):  # this place is lost, not the diagnosis
                self.known[location, kind] = None
        return self.known[location, kind]

    def drafts(self, location: str, kind: str) -> list[Draft]:
        """The formulae of most worth at a place, the best first."""
        channel = self.at(location, kind)
        if channel is not None and (location, kind) not in self._drafts:
            self._drafts[location, kind] = drafts_at(channel, drivers_at(self.null, channel, location, kind))
        return self._drafts.get((location, kind), [])

    @property
    def lost(self) -> list[str]:
        """Locations where no signal can be followed."""
        return [location for (location, _), channel in self.known.items() if channel is None]
