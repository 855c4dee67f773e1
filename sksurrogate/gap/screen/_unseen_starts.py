"""Initial states that no output shows until an effect is there: where a shaft stands whose speed alone is measured.

The path that an effect is screened along starts such a state anywhere. What another start would do through the effect is
taken out of its column, as what the other initial states do is.
"""

from __future__ import annotations

import numpy as np

from sksurrogate.effects._effect import BalanceEffect, BaseEffect, HiddenEffect
from sksurrogate.gap.fit._normal_equations import eliminate, project_starts, scores
from sksurrogate.gap.fit._pushes import STEP_OF_SLOPES
from sksurrogate.gap.screen._responses import Responses
from sksurrogate.kernels.banded import solve_recursion

#: A state is not seen whose range at the start moves the outputs by less than this (root mean square over the noise).
START_SEEN = 0.01


class Unseen:
    """The initial states that a base does not show.

    ``reach`` (n_states,): range of the plant's states along the path.
    ``free`` (n_unseen, n_states, n_samples): what becomes of each of them, started one range higher.
    """

    def __init__(self, responses: Responses):
        self.responses = responses
        problem, x, lin = responses.problem, responses.smoothed.x, responses.lin
        plant = problem.plant
        self.reach = np.ptp(x[: len(plant.states)], axis=1)
        shown = lin.J_x[:, : len(plant.states)] * self.reach[:, None] / problem.sd[:, None, None]
        places = np.flatnonzero(np.sqrt(np.mean(shown**2, axis=(0, 2))) < START_SEEN)
        b = np.zeros((len(x), len(places), x.shape[1]))
        for k, place in enumerate(places):
            b[place, k, problem.record.starts] = self.reach[place]
        self.free = solve_recursion(lin.band, b).transpose(1, 0, 2) if len(places) else np.zeros((0, *x.shape))

    def through(self, effect: BaseEffect, start: np.ndarray) -> np.ndarray:
        """What each does to the outputs through an effect, per its range: (n_unseen, n_outputs, n_samples)."""
        s = self.responses
        factors = effect.variable.split("*") if effect.variable else []
        if not len(self.free) or not isinstance(effect, BalanceEffect) or isinstance(effect, HiddenEffect):
            return np.zeros((0, *s.problem.record.y.shape))
        states = s.problem.plant.states
        places = [states.index(name) for name in factors if name in states]
        model = s.problem.augmented((*s.base.effects, effect))
        found = []
        for free in self.free:
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
