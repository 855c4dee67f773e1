"""Parameters that act alike are one factor of the simulator, as the capacity and the conductance of a heat exchanger may be."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from sksurrogate.effects._families import ParameterEffect
from sksurrogate.effects._parameter import constant_in_time
from sksurrogate.gap.fit._backend import BaseCandidate
from sksurrogate.gap.search._nested import driven_alike


def are_alike(one: np.ndarray, other: np.ndarray, tolerance: float) -> bool:
    """Whether two changes of the outputs have one direction, up to a share of their size.

    >>> step, ramp = np.array([1.0, 1.0, 1.0]), np.array([1.0, 1.05, 1.1])
    >>> are_alike(step, -ramp, 0.1), are_alike(step, ramp, 0.01)
    (True, False)
    """
    squares = float(np.sum(one**2) * np.sum(other**2))
    return squares > 0.0 and 1.0 - float(np.sum(one * other)) ** 2 / squares < tolerance**2


def parts_of_one_factor(candidate: BaseCandidate, tolerance: float) -> list[int]:
    """Positions of the parameters that follow one signal, or time, and act alike: together they give the factor a curve that neither has."""
    effects = candidate.effects
    varied = [i for i, e in enumerate(effects) if isinstance(e, ParameterEffect) and not constant_in_time(e)]
    moved = {i: _moved(candidate, i) for i in varied} if len(varied) > 1 else {}
    pairs = [pair for pair in combinations(moved, 2) if driven_alike(*(effects[i] for i in pair))]
    return sorted({i for a, b in pairs if are_alike(moved[a], moved[b], tolerance) for i in (a, b)})


def is_same_factor(candidate: BaseCandidate, named: BaseCandidate, i: int, tolerance: float) -> bool:
    """Whether the last effect of a candidate is effect i of another, at a parameter that acts alike."""
    one, own = candidate.effects[-1], named.effects[i]
    same = isinstance(one, ParameterEffect) and (one.name, one.variable) == (own.name, own.variable)
    return same and are_alike(_moved(candidate, len(candidate.effects) - 1), _moved(named, i), tolerance)


def _moved(candidate: BaseCandidate, i: int) -> np.ndarray:
    """What the magnitude of effect i moves the outputs by, initial states free."""
    first = candidate.slice_of(i).start
    return np.asarray(candidate.without_starts(candidate.sensitivities[:, [first]].transpose(1, 0, 2)))
