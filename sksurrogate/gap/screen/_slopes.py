"""What a change of an input or of a reading, sample by sample, would do to the log likelihood: one adjoint recursion."""

from __future__ import annotations

import numpy as np

from sksurrogate.effects._input import InputBias
from sksurrogate.gap.fit._normal_equations import unexplained
from sksurrogate.gap.fit._pushes import COARSE_STEP
from sksurrogate.gap.screen._responses import Responses
from sksurrogate.kernels.banded import solve_adjoint


class Slopes:
    """Slopes of the log likelihood of white noise in the signals about one linearisation.

    Initial states and the fitted parameters of the base follow: what they can make of the residual has no slope.
    """

    def __init__(self, responses: Responses):
        self.responses = responses
        s, problem = responses, responses.problem
        with np.errstate(all="ignore"):
            self.finite = bool(np.isfinite(s.known).all() and np.isfinite(s.J_x).all())
        if self.finite:
            flat = s.white.reshape(len(s.white), s.white[0].size).T
            r, W = flat[:, 0], flat[:, 1:] / np.maximum(np.linalg.norm(flat[:, 1:], axis=0), 1e-300)
            self.residual = unexplained(W, r).reshape(s.white[0].shape) / problem.sd[:, None]

    def of(self, kind: str, place: str) -> tuple[np.ndarray, np.ndarray] | None:
        """An ``"input"`` or a predicted ``"output"`` and the slope in it (n_samples,); None elsewhere, or where none is finite."""
        if not self.finite or kind not in ("input", "output"):
            return None
        s, plant = self.responses, self.responses.problem.plant
        if kind == "output":
            row = plant.outputs.index(place)
            found = s.y[row, 0], self.residual[row]
        else:
            found = s.problem.record.u[plant.inputs.index(place)], self.of_input(place)
        return found if np.isfinite(found).all() else None

    def of_input(self, name: str) -> np.ndarray:
        """Through the states of the next samples, and through the outputs that show the input at once."""
        s, problem, base = self.responses, self.responses.problem, self.responses.base
        bias = InputBias(name)
        push = COARSE_STEP * (float(np.ptp(problem.record.u[problem.plant.inputs.index(name)])) or 1.0)
        theta = base.theta_with(np.array([push]))
        with np.errstate(all="ignore"):
            bound = problem.augmented((*base.effects, bias)).bind(theta[:, None])
            moved = (bound(s.smoothed.x[:, None]) - s.after)[:, 0]
            shown = (bound.outputs(s.lin.x[:, None]) - s.y)[:, 0]
            later = solve_adjoint(s.lin.band, np.einsum("oit,ot->it", s.C, self.residual))
        slope = np.einsum("ot,ot->t", shown, self.residual)
        slope[:-1] += np.einsum("it,it->t", moved[:, :-1], later[:, 1:])
        ends = problem.record.starts[1:] - 1  # the last input of a run moves no state of it
        slope[ends] = np.einsum("ot,ot->t", shown[:, ends], self.residual[:, ends])
        return slope / push
