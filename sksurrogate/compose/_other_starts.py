"""Free runs of a lag model from other initial rows than those it was fitted from: the fit alone does not show where they lead."""

from __future__ import annotations

from typing import Any

import numpy as np

from sksurrogate.kernels.rollout import free_run

#: Runs whose inputs are taken.
RUNS_TAKEN = 16
#: Share of the outputs' range beyond which the extreme starts lie, and disturbance of a rough start in standard
#: deviations.
BEYOND, ROUGH = 0.05, 0.1
#: A fit must not leave more than this multiple of what the reference leaves of a start, and this many standard
#: deviations.
TIMES_REFERENCE, AT_LEAST = 3.0, 0.1
#: Share of the training range by which a fit may leave it further than the reference; in diverging fits it was 0.4 and more.
LEAVES_RANGE = 0.3
#: Standard deviations from the mean at which a run counts as lost.
LOST_SPREADS = 1e6


class OtherStarts:
    """Free runs over the training inputs from other runs' rows, from the ends of the outputs' range and from rough rows.

    A strongly penalised model is the reference. A fit must forget its initial rows about as fast as the reference does, and
    must not leave the training range much further. A reference that does not forget demands nothing of the fit.

    ``model``: the reference, in scaled numbers.
    ``U`` (n_runs, n_steps, n_inputs).
    ``target`` (n_runs, n_steps, n_outputs): nan after the end of a shorter run.
    """

    def __init__(self, model: Any, U: np.ndarray, target: np.ndarray, n_first: int, rng: np.random.RandomState):
        some = np.linspace(0, len(U) - 1, min(RUNS_TAKEN, len(U))).round().astype(int)
        U, target = U[some], target[some]
        self.low, self.high = np.nanmin(target, axis=(0, 1)), np.nanmax(target, axis=(0, 1))
        room = BEYOND * (self.high - self.low)
        n, own = len(U), target[:, :n_first]
        rough = ROUGH * rng.choice([-1.0, 1.0], size=own.shape)
        far = [np.broadcast_to(level, own.shape) for level in (self.low - room, self.high + room)]
        first = [own, own + rough, own - rough, *far]
        if n > 1:
            first.append(np.roll(own, 1, axis=0))
        else:  # one run: its rows half a run later
            half = np.flatnonzero(np.isfinite(target[0]).all(axis=1))[-1] // 2
            first.append(target[:, half - n_first + 1 : half + 1] if half >= n_first - 1 else own)
        self.U, self.first, self.n = np.concatenate([U] * len(first)), np.concatenate(first), n
        self.limits = self.most(self.reach(model))

    def reach(self, model: Any) -> np.ndarray:
        """Largest distance outside the training range, share of a start that is left at the end, growth of a rough start."""
        with np.errstate(all="ignore"):
            y = free_run(model, self.U, self.first)
        y = np.where(np.isfinite(y), np.clip(y, -LOST_SPREADS, LOST_SPREADS), LOST_SPREADS).reshape(
            -1, self.n, *y.shape[1:]
        )
        size = np.where(self.high > self.low, self.high - self.low, 1.0)
        outside = float((np.maximum(self.low - y, y - self.high) / size).max())
        away = np.abs(y[1:] - y[0])
        left = float(np.sqrt(np.mean(away[:, :, 3 * y.shape[2] // 4 :] ** 2, axis=(2, 3))).max())
        return np.array([outside, left, float(away[:2].max()) / ROUGH])

    @staticmethod
    def most(reference: np.ndarray) -> np.ndarray:
        """Limits on :meth:`reach` of a fit, from that of the reference."""
        return np.array([max(reference[0], 0.0) + LEAVES_RANGE, *(TIMES_REFERENCE * reference[1:] + AT_LEAST)])

    def accepts(self, model: Any) -> bool:
        """Whether a fit is accepted."""
        return bool(np.all(self.reach(model) <= self.limits))
