"""How unlikely the values of a candidate are before any data, in units of -2 log p: what no free value may buy for nothing."""

from __future__ import annotations

import numpy as np

from sksurrogate.effects._base_effect import BaseEffect
from sksurrogate.gap.fit._backend import Backend, BaseCandidate
from sksurrogate.gap.fit._known_parameters import PRIOR
from sksurrogate.gap.fit._ode import OdeCandidate
from sksurrogate.gap.fit._rounding import distinct_steps

#: Initial states lie within so many times the size of a state about where the simulator's own run starts.
START = 10.0
#: Initial states that cost less than this are not looked at closer.
CHEAP_START = 1.0
#: Sum of squares of the free parameters' moves, over :data:`PRIOR`, from which a re-tuning may imitate an effect.
FAR_RETUNED = 6.0


def prior_cost(candidate: OdeCandidate) -> float:
    """Of the free parameters, of steps of quantisation, of a width of kinks that is fitted, and of the initial states."""
    problem = candidate.problem
    width = float(np.log(problem.record.n_values)) if problem.numerics.rounded else 0.0
    return retuning_cost(candidate) + step_cost(candidate) + width + start_cost(candidate)


def retuning_cost(candidate: BaseCandidate) -> float:
    """``sum 3 log(1 + z^2 / 2)``, z = log ratio / :data:`PRIOR`, of the free parameters, less what the likelihood holds of it.

    Student's t of two degrees of freedom, as in the fits: a fit that is best under one prior must not be weighed by another.
    By the tails of a Gaussian a set of effects beside which a parameter rightly moves far would lose to a subset of it. Where
    the user gives a prior the likelihood holds it.
    """
    square = retuning_moves(candidate) ** 2
    return float(np.sum(3.0 * np.log1p(0.5 * square) - square / (1.0 + 0.5 * square)))


def retuning_moves(candidate: BaseCandidate) -> np.ndarray:
    """Log ratios of the free parameters to their nominal values, over :data:`PRIOR`, where the user gives no prior."""
    problem, ratios = candidate.problem, candidate.fit.theta[candidate.n_parameters :]
    own = [problem.plant.params[name] != 0 and name not in problem.known.priors for name in problem.free]
    return ratios[np.array(own, dtype=bool)] / PRIOR


def moved_far(candidate: BaseCandidate) -> bool:
    """Whether the free parameters moved so far that they may imitate an effect."""
    return float(np.sum(retuning_moves(candidate) ** 2)) >= FAR_RETUNED


def step_cost(candidate: BaseCandidate) -> float:
    """Of the steps of quantisation of its effects."""
    return sum(price_of_step(candidate.problem, e, candidate.theta_of(i)) for i, e in enumerate(candidate.effects))


def price_of_step(problem: Backend, effect: BaseEffect, theta: np.ndarray) -> float:
    """Of a step of quantisation: how many can be distinguished down to it, beyond what ``k ln N`` counts; 0 of other effects."""
    count = distinct_steps(problem.plant, problem.record, effect, theta)
    return max(0.0, 2.0 * float(np.log(count)) - float(np.log(problem.record.n_values)))


def start_cost(candidate: OdeCandidate) -> float:
    """``min_x (x - x0)' H (x - x0) + sum (x / (START size))^2``: states that no output shows must be likely where they begin.

    One of them could make one effect of another by where it starts. What the data do not see of it (H, by the slopes of the
    outputs) costs nothing: behind a sensor at its limit a fit may leave it anywhere.
    """
    problem = candidate.problem
    if problem.run is None:
        return 0.0
    starts, n = problem.record.starts, len(problem.plant.states)
    moved = (candidate.fit.x[:n, starts] - problem.run[:, starts]) / (START * problem.scale[:, None])
    if np.nansum(np.square(moved)) < CHEAP_START:
        return float(np.nansum(np.square(moved)))
    slopes = candidate.linearised.J_x[:, :n] * (START * problem.scale[:, None] / problem.sd[:, None, None])
    cost = 0.0
    for k, (a, b) in enumerate(problem.record.spans):
        J, own = slopes[:, :, a:b].transpose(1, 0, 2).reshape(n, -1), moved[:, k]
        H = J @ J.T
        if np.isfinite(H).all() and np.isfinite(own).all():
            cost += seen_square(H, own)
    return cost


def seen_square(H: np.ndarray, x: np.ndarray) -> float:
    """``min_z (z - x)' H (z - x) + z' z``, which is ``x' H (H + 1)^-1 x``, for an H of any size and rank.

    >>> float(seen_square(np.diag([3.0, 0.0]), np.array([2.0, 7.0])))
    3.0
    """
    size, axes = np.linalg.eigh(H)
    size = np.maximum(size, 0.0)
    return float(np.sum(size / (1.0 + size) * (axes.T @ x) ** 2))
