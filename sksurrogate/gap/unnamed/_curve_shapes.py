"""Functions of a signal in a balance, an input or a sensor, and what they move the outputs by."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from sksurrogate.gap.fit._ode import OdeCandidate
from sksurrogate.gap.fit._pushes import STEP_OF_SLOPES
from sksurrogate.kernels.disturbance import Disturbance

#: Knots of a piecewise linear curve that may be a staircase: of an input in its place, of the time.
FINE_KNOTS = 40
#: Runs from which on what they share at one time since their starts is a law, and not the disturbance of one of them.
RUNS_THAT_SHARE = 3
#: A law without a name, beside names or in their place, is certain from this gain (twice nats) on.
CERTAIN = 10.0
#: What is this many nats below the best is out of the question, however rough the comparison.
OUT_OF_REACH = 200.0


class Curve(NamedTuple):
    """Place, signal, and what functions of the signal move the outputs by (n_outputs, n, n_samples).

    The last is computed when it is asked for: all curves at once would be large.
    """

    location: str
    variable: str
    moved: Callable[[], np.ndarray]


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


def channel(candidate: OdeCandidate, i: int, x: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    """What a unit of input i moves the next states (n_states, n_samples) and this sample's outputs (n_outputs, n_samples) by.

    Along a path of the states, the free run by default.
    """
    problem = candidate.problem
    record, u = problem.record, problem.record.u.copy()
    step = STEP_OF_SLOPES * max(float(np.std(u[i])), 1e-9)
    u[i] += step
    theta, x = candidate.fit.theta[:, None], (candidate.fit.x if x is None else x)[:, None]
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
