"""Initial states that no output shows until an effect is there: where a shaft stands whose speed alone is measured.

The path that an effect is screened along starts such a state anywhere. What another start would do through the effect is
taken out of its column, as what the other initial states do is.
"""

from __future__ import annotations

import numpy as np

from sksurrogate.effects._base_effect import BaseEffect
from sksurrogate.effects._families import BalanceEffect, HiddenEffect
from sksurrogate.gap.fit._normal_equations import eliminate, project_starts, scores
from sksurrogate.gap.fit._pushes import STEP_OF_SLOPES
from sksurrogate.gap.screen._responses import Responses
from sksurrogate.kernels.banded import solve_recursion

#: A state is not seen whose range at the start moves the outputs by less than this (root mean square over the noise).
START_SEEN = 0.01


def unseen_starts(s: Responses) -> np.ndarray:
    """What becomes of each initial state that a base does not show, started one range of the state higher: (n_unseen, n_states, n_samples)."""
    problem, x, n = s.problem, s.smoothed.x, len(s.problem.plant.states)
    reach = np.ptp(x[:n], axis=1)
    shown = s.lin.J_x[:, :n] * reach[:, None] / problem.sd[:, None, None]
    places = np.flatnonzero(np.sqrt(np.mean(shown**2, axis=(0, 2))) < START_SEEN)
    b = np.zeros((len(x), len(places), x.shape[1]))
    for k, place in enumerate(places):
        b[place, k, problem.record.starts] = reach[place]
    return solve_recursion(s.lin.band, b).transpose(1, 0, 2) if len(places) else np.zeros((0, *x.shape))


def moved_through(s: Responses, unseen: np.ndarray, effect: BaseEffect, start: np.ndarray) -> np.ndarray:
    """What unseen initial states do to the outputs through an effect, per range: (n_unseen, n_outputs, n_samples)."""
    if not len(unseen) or not isinstance(effect, BalanceEffect) or isinstance(effect, HiddenEffect):
        return np.zeros((0, *s.problem.record.y.shape))
    states = s.problem.plant.states
    places = [states.index(name) for name in effect.signals if name in states]
    model = s.problem.augmented((*s.base.effects, effect))
    found = []
    for free in unseen:
        if not np.any(free[places]):
            continue
        ends = [
            s.acted(s.pushed(model, start[:, None], (s.smoothed.x + offset)[:, None], offset))
            for offset in (STEP_OF_SLOPES * free, -STEP_OF_SLOPES * free)
        ]
        found.append((ends[0] - ends[1])[:, 0] / (2.0 * STEP_OF_SLOPES))
    return np.array(found).reshape(-1, *s.problem.record.y.shape)


def score_beside(s: Responses, column: np.ndarray, through: np.ndarray, low: float, high: float) -> tuple[float, float]:
    """Drop and amplitude within ``low`` and ``high`` of one column (n_outputs, n_samples) beside what unseen initial states do
    through its effect (n_unseen, n_outputs, n_samples), both over the noise."""
    starts, (precision, pull) = s.problem.record.starts, s.base.step_prior
    stack = np.concatenate([s.known, column[None]])
    both = np.concatenate([s.J_x, through.transpose(1, 0, 2)], axis=1)
    flat, before = (part.reshape(len(part), -1) for part in (project_starts(stack, both, starts), s.white))
    rest, whole = (eliminate(part @ part.T, len(precision), precision, pull) for part in (flat, before))
    drop, amplitude = scores(rest[:1, 1], rest[1:, 1], np.array([low]), np.array([high]))
    return float(whole[0, 0] - rest[0, 0] + drop[0]), float(amplitude[0])
