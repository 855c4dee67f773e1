"""A law that no name carries: a free curve of one signal in one balance, input or sensor, judged along the free run.

The smoothed force of a disturbance follows the states that it pushes, and a law of the states is easily seen in it. The free
run knows nothing of the disturbance: a curve of its states, of the inputs, of their recent past or of the time since the start
is a regressor like any other, and its likelihood under coloured noise is compared with that of no curve.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from sksurrogate.gap.fit._closeness import CLOSED
from sksurrogate.gap.fit._evidence import Evidence
from sksurrogate.gap.fit._normal_equations import project_starts, scaled
from sksurrogate.gap.fit._ode import OdeBackend, OdeCandidate
from sksurrogate.gap.unnamed._curve_shapes import Curve, in_balances, in_inputs, in_sensors
from sksurrogate.kernels.disturbance import Disturbance, Noise
from sksurrogate.kernels.noise_fit import fit_noise

__all__ = ["SUSPICIOUS", "FreeCurve", "free_curve"]

#: Gain under the noise of the candidate, which takes a law for a force, from which the noise is fitted anew beside the curve.
SUSPICIOUS = -15.0


@dataclass(frozen=True)
class FreeCurve:
    """The likeliest free curve.

    Attributes
    ----------
    location, variable : str
        Balance, input or sensor, and the signal of which it is a curve ("q and its past" where a memory is likelier).
    gain : float
        ``2 (L_with - L_without) - k ln N - 2 ln M`` for k knots, N values and M curves tried.
    moved : float
        RMS of what it moves the free run by, over the noise, initial states and parameters having followed.
    deviation : float
        The same over the deviation of the output (the worst output).
    """

    location: str
    variable: str
    gain: float
    moved: float
    deviation: float


def free_curve(found: Evidence) -> FreeCurve | None:
    """The likeliest curve of one signal in one balance, input or sensor on top of a candidate; None where none can be judged.

    A curve that suits a noise model but brings the free run no nearer to the data is none.
    """
    candidate = found.candidate
    problem, D = candidate.problem, candidate.disturbance
    r, J, precision, pull = candidate.columns()
    if not (np.isfinite(J).all() and np.isfinite(D.A).all() and np.isfinite(D.C).all()):
        return None
    curves = [*in_balances(candidate), *in_inputs(candidate), *in_sensors(candidate)]
    fit = _CurveFit(problem, candidate, D, r, J, precision, pull, curves)
    try:
        tried = fit.likeliest(found.noise) if curves else []
    except np.linalg.LinAlgError:  # a path along which no noise can be followed
        return None
    near = [one for one in tried if fit.nearer(one)]
    return fit.result(max(near, key=lambda one: one.gain)) if near else None


class _Tried(NamedTuple):
    """A curve, what it gains, and how far the parameters of the candidate and its own move."""

    k: int
    gain: float
    theta: np.ndarray


@dataclass(frozen=True, eq=False)
class _CurveFit:
    """A residual explained by the parameters of a candidate, and by each of several curves beside them."""

    problem: OdeBackend
    candidate: OdeCandidate
    D: Disturbance
    r: np.ndarray
    J: np.ndarray
    precision: np.ndarray
    pull: np.ndarray
    curves: list[Curve]

    def likeliest(self, noise: Noise) -> list[_Tried]:
        """The likeliest curve under a candidate's own noise; and with the noise fitted anew, for it may have taken a law for a force.

        Where more is left than noise, the curve that is likeliest under quiet forces is looked at too.
        """
        quiet = self.problem.quiet(noise)
        own = self.best(noise)
        again = [own.k] if own.gain > SUSPICIOUS else []
        if np.max(self.problem.record.rms(self.r) / self.problem.sd) > CLOSED:
            again.append(self.best(quiet).k)
        if not again:
            return [own]
        none, alone = self.fitted((noise, quiet))
        out = [own]
        for k in dict.fromkeys(again):
            value, theta = self.fitted((noise, quiet), self.curves[k].moved())
            out.append(self.tried(k, 2.0 * (value - none), theta, alone, self.curves[k].n))
        return out

    def best(self, noise: Noise) -> _Tried:
        """The curve that gains most under a noise."""
        known = np.concatenate([self.r[:, None], self.J], axis=1)
        none, alone, rank = _explained(self.D.gram(known, noise)[0], self.precision, self.pull)
        found = [_Tried(0, -np.inf, np.zeros(len(alone) + self.curves[0].n))]
        for k, G in enumerate(self.D.gram_each(known, (curve.moved() for curve in self.curves), noise)):
            if np.isfinite(G).all():
                drop, theta, more = _explained(G, *self.prior(self.curves[k].n))
                found.append(self.tried(k, drop - none, theta, alone, more - rank))
        return max(found, key=lambda one: one.gain)

    def tried(self, k: int, drop: float, theta: np.ndarray, alone: np.ndarray, n: int) -> _Tried:
        """A curve of n parameters that explains so much, among all that were tried."""
        gain = drop - n * np.log(self.D.n_values) - 2.0 * np.log(len(self.curves))
        return _Tried(k, float(gain), theta - np.r_[alone, np.zeros(len(theta) - len(alone))])

    def fitted(self, starts: Sequence[Noise], F: np.ndarray | None = None) -> tuple[float, np.ndarray]:
        """The largest log likelihood with the noise fitted, beside a curve or none, and the parameters there."""
        J = self.J if F is None else np.concatenate([self.J, F], axis=1)
        prior = self.prior(0 if F is None else F.shape[1])
        unit, caps = self.problem.force_unit(), self.problem.caps
        same: dict[str, Any] = {"caps": caps, "sigma_unit": self.problem.sd}
        fits = [fit_noise(self.D, self.r, start, unit, J, *prior, **same) for start in starts]
        noise, value, _ = max(fits, key=lambda fit: fit[1])
        G, _ = self.D.gram(np.concatenate([self.r[:, None], J], axis=1), noise)
        return value, _explained(G, *prior)[1]

    def prior(self, n: int) -> tuple[np.ndarray, np.ndarray]:
        """The prior of the candidate's parameters, and none on n more."""
        return np.r_[self.precision, np.zeros(n)], np.r_[self.pull, np.zeros(n)]

    def moved(self, one: _Tried) -> np.ndarray:
        """Residual without and with a curve, and their difference, initial states having followed; over the noise."""
        sd, F = self.problem.sd[:, None], self.curves[one.k].moved()
        moved = np.einsum("okt,k->ot", np.concatenate([self.J, F], axis=1), one.theta) / sd
        moved = self.problem.record.seen(moved)
        J_x = self.candidate.linearised.J_x[:, self.candidate.model.free_states] / sd[:, None]
        return project_starts(np.stack([self.r / sd, self.r / sd - moved, moved]), J_x, self.problem.record.starts)

    def nearer(self, one: _Tried) -> bool:
        """Whether a curve brings the free run nearer to the data."""
        before, after, _ = self.moved(one)
        return bool(np.sum(after**2) <= np.sum(before**2))

    def result(self, one: _Tried) -> FreeCurve:
        """A curve with its name, and what it moves."""
        record = self.problem.record
        rms, spread = record.rms(self.moved(one)[2]), record.spread / self.problem.sd
        location, variable, *_ = self.curves[one.k]
        return FreeCurve(location, variable, one.gain, float(np.sqrt(np.mean(rms**2))), float(np.max(rms / spread)))


def _explained(G: np.ndarray, precision: np.ndarray, pull: np.ndarray) -> tuple[float, np.ndarray, int]:
    """From the Gram of residual and columns: what the columns explain (twice the log likelihood), their weights, the rank."""
    if len(G) == 1:
        return 0.0, np.zeros(0), 0
    H, g = G[1:, 1:] + np.diag(precision), G[1:, 0] + pull
    normal, scale = scaled(H, 1e-150)
    theta, _, rank, _ = np.linalg.lstsq(normal, g / scale, rcond=1e-8)
    return float(g / scale @ theta), theta / scale, int(rank)
