"""A set of effects to first order about a path of the plant's states."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sksurrogate.gap.fit._linear_set import LinearSet
from sksurrogate.gap.fit._ode import OdeCandidate
from sksurrogate.gap.fit._pushes import STEP_OF_SLOPES
from sksurrogate.kernels.free_runs import settle_hidden


def as_regressors(candidate: OdeCandidate, x: np.ndarray) -> LinearSet[OdeCandidate]:
    """A set of effects, none of which has states, as the simulator without effects carries what they do along a path."""
    problem, n, theta = candidate.problem, candidate.n_parameters, candidate.fit.theta
    none = linear_along(without(candidate, *range(len(candidate.effects))), x)
    _, J, precision, pull = none.columns()
    steps = STEP_OF_SLOPES * problem.units(candidate.effects, theta)[:n]
    values = np.repeat(theta[:, None], 1 + n, axis=1)
    values[np.arange(n), 1 + np.arange(n)] += steps
    found = carried(candidate, none, none, x, values)
    own = (found[:, 1:] - found[:, :1]) / steps[:, None]
    held = np.r_[np.where(theta[:n] != 0, np.abs(theta[:n]), np.inf) ** -2.0, precision]
    r = problem.record.seen(problem.record.y - none.fit.y - found[:, 0])
    J, pull = np.concatenate([own, J], axis=1), np.r_[np.zeros(n), pull]
    return LinearSet(r, J, held, pull, none)


def without(candidate: OdeCandidate, *out: int) -> OdeCandidate:
    """A set without some of its effects, everything else as it is."""
    effects, theta = candidate.without_effect(*out)
    return candidate.problem.candidate(effects, replace(candidate.fit, theta=theta, linearised=None))


def linear_along(candidate: OdeCandidate, x: np.ndarray) -> OdeCandidate:
    """A candidate about a path of the plant's states (n_states, n_samples); hidden ones settle along it."""
    return candidate.along(settle_hidden(candidate.model, candidate.fit.theta, x))


def carried(
    whole: OdeCandidate, rest: OdeCandidate, by: OdeCandidate, x: np.ndarray, values: np.ndarray | None = None
) -> np.ndarray:
    """What the effects that a set has beyond the ``rest`` of it move the outputs by, as another model carries it.

    ``x`` (n_states, n_samples): path of the plant's states.
    ``values`` (n_theta, n_columns): of the parameters of the set; its own by default.
    Returns (n_outputs, n_columns, n_samples).
    """
    n, now, shown = rest.model.n_nominal, [], []
    values = whole.fit.theta[:, None] if values is None else values
    for one, theta in ((whole, values), (rest, rest.fit.theta[:, None])):
        path = np.repeat(settle_hidden(one.model, one.fit.theta, x)[:, None], theta.shape[1], axis=1)
        bound = one.model.bind(theta)
        now.append(bound(path)[:n])
        shown.append(bound.outputs(path))
    push = np.zeros((by.model.n_states, values.shape[1], x.shape[1]))
    push[:n] = now[0] - now[1]
    return np.asarray(by.disturbance.moved(push) + shown[0] - shown[1])
