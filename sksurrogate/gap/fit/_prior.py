"""How unlikely the values of a rival are before any data, in units of -2 log p: what no free value may buy for nothing."""

from __future__ import annotations

import numpy as np

from sksurrogate.gap.fit._known_parameters import PRIOR
from sksurrogate.gap.fit._ode import OdeCandidate
from sksurrogate.gap.fit._quantization import told_apart

__all__ = ["moved_far", "prior_cost", "retuning_cost"]

#: Initial states lie within so many times the size of a state about where the simulator's own run starts.
START = 10.0
#: Initial states that cost less than this are not looked at closer.
SMALL = 1.0
#: Sum of squares of the free parameters' moves, over :data:`PRIOR`, from which a re-tuning may imitate an effect.
FAR_RETUNED = 6.0


def prior_cost(rival: OdeCandidate) -> float:
    """Of the free parameters, of steps of quantisation and of the initial states."""
    return retuning_cost(rival) + step_cost(rival) + start_cost(rival)


def retuning_cost(rival: OdeCandidate) -> float:
    """``sum 3 log(1 + z^2 / 2)``, z = log ratio / :data:`PRIOR`, of the free parameters, less what the likelihood holds of it.

    Student's t of two degrees of freedom, as in the fits: a fit that is best under one prior must not be weighed by another.
    By the tails of a Gaussian a set of effects beside which a parameter rightly moves far would lose to a subset of it. Where
    the user gives a prior the likelihood holds it.
    """
    square = moves(rival) ** 2
    return float(np.sum(3.0 * np.log1p(0.5 * square) - square / (1.0 + 0.5 * square)))


def moves(rival: OdeCandidate) -> np.ndarray:
    """Log ratios of the free parameters to their nominal values, over :data:`PRIOR`, where the user gives no prior."""
    problem, ratios = rival.problem, rival.fit.theta[rival.n_parameters :]
    own = [problem.plant.params[name] != 0 and name not in problem.known.priors for name in problem.free]
    return ratios[np.array(own, dtype=bool)] / PRIOR


def moved_far(rival: OdeCandidate) -> bool:
    """Whether the free parameters moved so far that they may imitate an effect."""
    return float(np.sum(moves(rival) ** 2)) >= FAR_RETUNED


def step_cost(rival: OdeCandidate) -> float:
    """Of a step of quantisation how many can be told apart down to it, beyond what ``k ln N`` counts."""
    problem, counted = rival.problem, np.log(rival.problem.record.n_values)
    apart = [
        told_apart(problem.plant, problem.record, effect, rival.theta_of(i)) for i, effect in enumerate(rival.effects)
    ]
    return float(sum(max(0.0, 2.0 * np.log(count) - counted) for count in apart))


def start_cost(rival: OdeCandidate) -> float:
    """``min_x (x - x0)' H (x - x0) + sum (x / (START size))^2``: states that no output shows must be likely where they begin.

    One of them could make one effect of another by where it starts. What the data do not see of it (H, by the slopes of the
    outputs) costs nothing: behind a sensor at its limit a fit may leave it anywhere.
    """
    problem = rival.problem
    if problem.run is None:
        return 0.0
    starts, n = problem.record.starts, len(problem.plant.states)
    moved = (rival.fit.x[:n, starts] - problem.run[:, starts]) / (START * problem.scale[:, None])
    if np.nansum(np.square(moved)) < SMALL:
        return float(np.nansum(np.square(moved)))
    slopes = rival.linearised.J_x[:, :n] * (START * problem.scale[:, None] / problem.sd[:, None, None])
    ends = np.r_[starts[1:], problem.record.n_samples]
    cost = 0.0
    for k, (a, b) in enumerate(zip(starts, ends)):
        J, own = slopes[:, :, a:b].transpose(1, 0, 2).reshape(n, -1), moved[:, k]
        H = J @ J.T
        if np.isfinite(H).all() and np.isfinite(own).all():
            cost += shown(H, own)
    return cost


def shown(H: np.ndarray, x: np.ndarray) -> float:
    """``min_z (z - x)' H (z - x) + z' z``, which is ``x' H (H + 1)^-1 x``, for an H of any size and rank.

    Examples
    --------
    >>> float(shown(np.diag([3.0, 0.0]), np.array([2.0, 7.0])))
    3.0
    """
    size, axes = np.linalg.eigh(H)
    size = np.maximum(size, 0.0)
    return float(np.sum(size / (1.0 + size) * (axes.T @ x) ** 2))
