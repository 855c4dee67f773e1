"""The simulator with what a diagnosis found."""

from __future__ import annotations

import numpy as np

from sksurrogate.effects._simulator import AugmentedSimulator
from sksurrogate.gap.fit._backend import BaseCandidate
from sksurrogate.gap.fit._retuned import value_of

__all__ = ["augmented_simulator"]


def augmented_simulator(named: BaseCandidate, scale: np.ndarray | None) -> AugmentedSimulator:
    """Effects at their fitted values and free parameters at their re-tuned ones; ``scale``: sizes of the states."""
    problem, plant = named.problem, named.problem.plant
    values = [
        {p.name: float(v) for p, v in zip(effect.parameters, named.theta_of(i))}
        for i, effect in enumerate(named.effects)
    ]
    phi = named.fit.theta[named.n_parameters :]
    tuned = {name: value_of(plant.params[name], v) for name, v in zip(problem.free, phi)}
    return AugmentedSimulator(plant.simulator, list(named.effects), values, tuned or None, scale=scale)
