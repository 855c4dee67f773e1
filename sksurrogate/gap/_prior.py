"""How unlikely the values of a rival are before any data, in units of -2 log p: what no free value may buy for nothing."""

from __future__ import annotations

import numpy as np

from sksurrogate.gap._problem import PRIOR, Problem, Rival
from sksurrogate.gap._steps import told_apart

__all__ = ["prior_cost", "retuning_cost"]

#: Initial states lie within so many times the size of a state about where the simulator's own run starts.
START = 10.0


def prior_cost(problem: Problem, rival: Rival) -> float:
    """Of the free parameters, of steps of quantisation and of the initial states."""
    return retuning_cost(problem, rival) + step_cost(problem, rival) + start_cost(problem, rival)


def retuning_cost(problem: Problem, rival: Rival) -> float:
    """``sum (log ratio / PRIOR)^2`` of the free parameters.

    Gaussian, unlike the prior of the fits: these must not pull at a parameter that is far off.
    """
    ratios = rival.fit.theta[rival.n_parameters :]
    moved = [v for name, v in zip(problem.free, ratios) if problem.plant.params[name] != 0]
    return float(np.sum(np.square(moved))) / PRIOR**2


def step_cost(problem: Problem, rival: Rival) -> float:
    """Of a step of quantisation how many can be told apart down to it, beyond what ``k ln N`` counts."""
    counted = np.log(rival.fit.y.size)
    apart = [
        told_apart(problem.plant, problem.record, effect, rival.theta_of(i)) for i, effect in enumerate(rival.effects)
    ]
    return float(sum(max(0.0, 2.0 * np.log(count) - counted) for count in apart))


def start_cost(problem: Problem, rival: Rival) -> float:
    """``sum (x0 / (START size))^2``: a state that no output shows could make one effect of another by where it starts."""
    if problem.run is None:
        return 0.0
    starts, n = problem.record.starts, len(problem.plant.states)
    moved = (rival.fit.x[:n, starts] - problem.run[:, starts]) / (START * problem.scale[:, None])
    return float(np.sum(np.square(moved[np.isfinite(moved)])))
