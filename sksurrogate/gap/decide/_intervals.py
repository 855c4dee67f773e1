"""Intervals of the parameters of what is named: noise, disturbance and numerics."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sksurrogate.effects._base_effect import BaseEffect
from sksurrogate.effects._onset import Starting
from sksurrogate.gap.fit._backend import BaseCandidate
from sksurrogate.gap.fit._coordinates import coordinates_of
from sksurrogate.gap.fit._evidence import Evidence
from sksurrogate.gap.fit._normal_equations import seen_inverse
from sksurrogate.gap.results._effect_estimate import BAND

#: All parameters.
ALL = slice(None)
#: Share of a parameter that integrators and the smoothing of kinks may always move.
NUMERICS = 5e-4


def covariance(found: Evidence, own: slice = ALL) -> np.ndarray:
    """Covariance of the output-error parameters when the residual has the candidate's own noise; of the ``own`` ones with the others held.

    The sandwich ``H^-1 J' W S W J H^-1`` with W the white weights of the fit and S the covariance of white noise, forces
    and coloured sensor noise; initial states are projected out. A prior that the user gives counts as one more measured value.
    """
    candidate = found.candidate
    k = len(candidate.fit.theta[own])
    if k == 0:
        return np.zeros((0, 0))
    J = candidate.without_starts(candidate.sensitivities[:, own].transpose(1, 0, 2))
    precision = candidate.step_prior[0][own]
    flat = J.reshape(k, -1)
    H, blind = seen_inverse(flat @ flat.T + np.diag(precision))
    white = 1.0 / candidate.problem.sd[:, None]
    spread = candidate.disturbance.spread((J * white).transpose(1, 0, 2), found.noise)
    out = H @ (spread + np.diag(np.where(candidate.prior_known[own], precision, 0.0))) @ H
    out[blind, blind] = np.inf
    return out


def intervals(found: Evidence) -> tuple[np.ndarray, np.ndarray]:
    """90 % intervals of all parameters: noise and disturbance, and what steps and kinks may have moved."""
    candidate, theta = found.candidate, found.fit.theta
    known = covariance(found)
    spread = np.sqrt(np.maximum(np.diag(known), 0.0))
    numerical = candidate.numerical_change()
    within_a_sample = np.zeros(len(theta))
    for i, effect in enumerate(candidate.effects):  # readings tell the sample in which a window begins or ends
        if isinstance(effect, Starting):
            within_a_sample[candidate.slice_of(i)][-len(effect.span) :] = candidate.problem.record.dt
    half = np.sqrt((BAND * spread) ** 2 + numerical**2 + (NUMERICS * theta) ** 2 + within_a_sample**2)
    low, high = theta - half, theta + half
    for own in _known_by_their_gain(candidate, known):
        share = np.exp(half[own] / abs(theta[own]))
        low[own], high[own] = sorted((theta[own] / share, theta[own] * share))
    least, most = candidate.problem.bounds(candidate.effects)
    return np.maximum(low, least), np.minimum(high, most)


def _known_by_their_gain(candidate: BaseCandidate, known: np.ndarray) -> list[int]:
    """Coefficients that are not zero, in the coordinates of the fit; ``known``: covariance of the parameters."""
    steps, theta = coordinates_of(candidate.effects, candidate.slice_of, candidate.signals), candidate.fit.theta
    slopes, z, sure = steps.slopes(theta), steps.of(theta), []
    for own, _, _ in steps.effects:
        slope = slopes[own.start, own]
        if abs(z[own.start]) > BAND * np.sqrt(max(float(slope @ known[own, own] @ slope), 0.0)):
            sure.append(own.start)
    return sure


def is_sized(effects: Sequence[BaseEffect], low: np.ndarray, high: np.ndarray) -> bool:
    """Whether the interval of each effect's magnitude leaves out the value at which it does nothing.

    ``low, high`` (n_theta,): of the effects' parameters, one effect behind the other, then of others.

    >>> from sksurrogate.effects import CATALOGUE
    >>> drag, lag = CATALOGUE["quadratic_drag"]("v", "v"), CATALOGUE["hidden_mode"]("v", "v")
    >>> is_sized([drag], np.array([0.1]), np.array([0.2])), is_sized([drag], np.array([-0.1]), np.array([0.2]))
    (True, False)
    >>> is_sized([CATALOGUE["sensor_rectification"]("v")], np.array([]), np.array([]))  # it has no magnitude
    True
    >>> is_sized([drag, lag], np.array([0.1, 0.0, 2.0, 0.1]), np.array([0.2, 5.0, 3.0, 0.2]))
    False
    """
    return not not_sized(effects, low, high)


def not_sized(effects: Sequence[BaseEffect], low: np.ndarray, high: np.ndarray) -> list[int]:
    """Positions of the effects whose magnitude may be that at which they do nothing; arguments as for :func:`is_sized`."""
    first = np.cumsum([0, *(len(effect.parameters) for effect in effects)])[:-1]
    sized = [(i, k, effect) for i, (k, effect) in enumerate(zip(first, effects)) if effect.parameters]
    return [i for i, k, effect in sized if low[k] <= effect.parameters[0].null <= high[k]]


def not_sized_beside_others(found: Evidence) -> tuple[list[int], list[int]]:
    """Positions of the effects whose magnitude the data show with the other effects as they are, and not beside them; of those whose
    magnitude they do not show at all.

    By the 90 % intervals of noise and disturbance alone.
    """

    def ends(own: slice) -> tuple[np.ndarray, np.ndarray]:
        half = BAND * np.sqrt(np.maximum(np.diag(covariance(found, own)), 0.0))
        return found.fit.theta[own] - half, found.fit.theta[own] + half

    alone = [ends(found.candidate.slice_of(i)) for i in range(len(found.effects))]
    beside: tuple[list[int], list[int]] = [], []
    for i in not_sized(found.effects, *ends(ALL)):
        beside[not is_sized([found.effects[i]], *alone[i])].append(i)
    return beside
