"""A set of effects to first order about a path of the plant's states."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sksurrogate.gap.fit._linear_set import LinearSet
from sksurrogate.gap.fit._ode import OdeCandidate
from sksurrogate.gap.fit._pushes import STEP_OF_SLOPES
from sksurrogate.kernels.output_error import settle_hidden


def as_regressors(candidate: OdeCandidate, x: np.ndarray) -> LinearSet[OdeCandidate]:
    """A set of effects as the simulator without effects carries what they do along a path."""
    problem, n = candidate.problem, candidate.n_parameters
    theta = candidate.fit.theta
    none = problem.candidate((), replace(candidate.fit, theta=theta[n:], linearised=None), problem.augmented(()))
    none = linear_along(none, x)
    now, alone = x[:, None], none.model.bind(theta[n:, None])
    after, shown = alone(now), alone.outputs(now)

    def moved(values: np.ndarray) -> np.ndarray:
        """What the effects move the outputs by, for every column of parameters: (n_outputs, n_columns, n_samples)."""
        path = np.repeat(now, values.shape[1], axis=1)
        bound = candidate.model.bind(values)
        return none.disturbance.moved(bound(path) - after) + bound.outputs(path) - shown

    _, J, precision, pull = none.columns()
    steps = STEP_OF_SLOPES * problem.units(candidate.effects, theta)[:n]
    values = np.repeat(theta[:, None], 1 + n, axis=1)
    values[np.arange(n), 1 + np.arange(n)] += steps
    found = moved(values) if n else np.zeros((len(problem.record.y), 1, problem.record.n_samples))
    own = (found[:, 1:] - found[:, :1]) / steps[:, None] if n else found[:, :0]
    held = np.r_[np.where(theta[:n] != 0, np.abs(theta[:n]), np.inf) ** -2.0, precision]
    r = problem.record.seen(problem.record.y - none.fit.y - found[:, 0])
    J, pull = np.concatenate([own, J], axis=1), np.r_[np.zeros(n), pull]
    return LinearSet(r, J, held, pull, none)


def linear_along(candidate: OdeCandidate, x: np.ndarray) -> OdeCandidate:
    """A candidate about a path of the plant's states (n_states, n_samples); hidden ones settle along it."""
    return candidate.along(settle_hidden(candidate.model, candidate.fit.theta, x))


def carried(whole: OdeCandidate, rest: OdeCandidate, by: OdeCandidate, x: np.ndarray) -> np.ndarray:
    """What the effects that a set has beyond the ``rest`` of it move the outputs by, as another model carries it, (n_outputs, n_samples).

    Along a path x of the plant's states.
    """
    n, now, shown = rest.model.n_nominal, [], []
    for one in (whole, rest):
        path, bound = settle_hidden(one.model, one.fit.theta, x)[:, None], one.model.bind(one.fit.theta[:, None])
        now.append(bound(path)[:n])
        shown.append(bound.outputs(path))
    push = np.zeros((by.model.n_states, 1, x.shape[1]))
    push[:n] = now[0] - now[1]
    return np.asarray((by.disturbance.moved(push) + shown[0] - shown[1])[:, 0])
