"""Free curves: piecewise linear functions of a signal, of its recent past or of time, in a balance, an input or a sensor."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from sksurrogate.gap.fit._ode import OdeCandidate
from sksurrogate.gap.unnamed._latent_force import past_of
from sksurrogate.kernels.disturbance import Disturbance
from sksurrogate.kernels.record import Record

__all__ = ["CERTAIN", "Curve", "hats_at", "in_balances", "in_inputs", "in_sensors", "shapes"]

#: Knots of a piecewise linear curve, at equal shares of the samples; of one of time, which may step; of one of an input in its
#: place, which may be a staircase.
KNOTS_OF_CURVE, KNOTS_OF_TIME, KNOTS_OF_INPUT = 8, 13, 40
#: Runs from which on what they share at one time since their starts is a law, and not the disturbance of one of them.
RUNS_THAT_SHARE = 3
#: A free curve on top of the names, or one law in their place, is certain from this gain (twice nats) on.
CERTAIN = 10.0


class Curve(NamedTuple):
    """Place, signal, number of functions of the signal, and what these move the outputs by (n_outputs, n, n_samples).

    The last is computed when it is asked for: all curves at once would be large.
    """

    location: str
    variable: str
    n: int
    moved: Callable[[], np.ndarray]


def in_balances(candidate: OdeCandidate) -> Iterator[Curve]:
    """Curves of states, inputs and time in every balance."""
    problem, D = candidate.problem, candidate.disturbance
    signals = np.concatenate([candidate.fit.x[: len(problem.plant.states)], problem.record.u])
    forms = list(shapes(problem.record, signals, [*problem.plant.states, *problem.plant.inputs]))
    for b, name in enumerate(problem.balances):
        for variable, f in forms:
            yield Curve(name, variable, len(f), partial(response, D, D.B[:, :, b].T, f))


def in_inputs(candidate: OdeCandidate) -> Iterator[Curve]:
    """A fine curve of every input in its place, through the balances that it pushes and the outputs that show it.

    None where a named effect lets the input jump: that input has no slope to follow.
    """
    problem, D = candidate.problem, candidate.disturbance
    jumps = {e.location for i, e in enumerate(candidate.effects) if e.scan(tuple(candidate.theta_of(i)))}
    for i, name in enumerate(problem.plant.inputs):
        f = hats(problem.record.u[i], KNOTS_OF_INPUT)
        if len(f) > 1 and name not in jumps:
            push, shown = channel(candidate, i)
            yield Curve(name, name, len(f), partial(response, D, push, f, shown))


def in_sensors(candidate: OdeCandidate) -> Iterator[Curve]:
    """Curves of outputs and time in every sensor; of other outputs without their past."""
    problem = candidate.problem
    names = problem.plant.outputs
    for o, name in enumerate(names):
        for variable, f in shapes(problem.record, candidate.fit.y, names):
            if variable not in (f"{other} and its past" for other in names if other != name):
                yield Curve(name, variable, len(f), partial(reading, len(names), o, f))


def shapes(record: Record, signals: np.ndarray, names: Sequence[str]) -> Iterator[tuple[str, np.ndarray]]:
    """Functions whose sums are curves of a signal, (n_functions, n_samples): hats, then the signal with its past; of the time hats."""
    past = past_of(record, signals)
    for i, (name, z) in enumerate(zip(names, signals)):
        curve = hats(z, KNOTS_OF_CURVE)
        if len(curve) > 1:
            yield name, curve
            yield f"{name} and its past", np.concatenate([z[None], past[:, i]])
    if len(record.starts) >= RUNS_THAT_SHARE:
        yield "time", hats(record.t - record.t[record.starts][record.run_of_row], KNOTS_OF_TIME)


def hats(z: np.ndarray, n_knots: int) -> np.ndarray:
    """Piecewise linear functions of a signal that add up to one, (n_knots, n_samples); one where it stands still."""
    knots = np.unique(np.quantile(z, np.linspace(0.0, 1.0, n_knots)))
    if np.ptp(z) <= 1e-9 * max(float(np.max(np.abs(z))), 1e-300):
        knots = knots[:1]
    return hats_at(z, knots)


def hats_at(z: np.ndarray, knots: np.ndarray) -> np.ndarray:
    """Hat functions on knots (n_knots, n_samples), constant beyond the ends."""
    return np.stack([np.interp(z, knots, hat) for hat in np.eye(len(knots))])


def reading(n_outputs: int, o: int, f: np.ndarray) -> np.ndarray:
    """What functions (k, n_samples) in sensor o move the outputs by: (n_outputs, k, n_samples)."""
    out = np.zeros((n_outputs, *f.shape))
    out[o] = f
    return out


def channel(candidate: OdeCandidate, i: int) -> tuple[np.ndarray, np.ndarray]:
    """What a unit of input i moves the next states (n_states, n_samples) and this sample's outputs (n_outputs, n_samples) by."""
    problem = candidate.problem
    record, u = problem.record, problem.record.u.copy()
    step = 1e-4 * max(float(np.std(u[i])), 1e-9)
    u[i] += step
    theta, x = candidate.fit.theta[:, None], candidate.fit.x[:, None]
    given = candidate.model.bind(theta)
    shifted = replace(problem, record=replace(record, u=u)).augmented(candidate.effects).bind(theta)
    with np.errstate(all="ignore"):
        return (shifted(x) - given(x))[:, 0] / step, (shifted.outputs(x) - given.outputs(x))[:, 0] / step


def response(
    D: Disturbance, push: np.ndarray, f: np.ndarray, shown: np.ndarray | None = None, now: np.ndarray | None = None
) -> np.ndarray:
    """What functions f (k, n_samples) move the outputs by, to first order: (n_outputs, k, n_samples).

    They act on the next states through ``push`` (n_states, n_samples), and on this sample's outputs through ``shown``, there by their
    values ``now`` where f are means over the samples.
    """
    with np.errstate(all="ignore"):
        moved = D.moved(push[:, None] * f)
    return moved if shown is None else moved + shown[:, None] * (f if now is None else now)
