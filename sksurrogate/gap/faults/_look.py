"""Whether what a model leaves is a fault of the record: faults compete with names and with each other by evidence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sksurrogate.gap.faults._correction import BaseFault
from sksurrogate.gap.faults._noisy_input import smoother_inputs
from sksurrogate.gap.faults._proposals import Proposal, proposals
from sksurrogate.gap.fit._backend import BaseCandidate
from sksurrogate.gap.fit._closeness import AT_THE_NOISE, CLOSED
from sksurrogate.gap.fit._evidence import Evidence
from sksurrogate.gap.fit._normal_equations import scaled
from sksurrogate.kernels.disturbance import Noise
from sksurrogate.kernels.noise_fit import fit_noise

__all__ = ["Found", "fault_left"]

#: Nats twice over, beyond the cost of its parameters and of the choice, that a fault of the record must gain.
CLEAR = 10.0
#: Share of the excess over the noise that a fault takes, to be the reason of what is left: faults of sensors are exact.
MOST_OF_IT = 0.8
#: The same of noise on an input: what was really given to the plant is only known smoothed.
MOST_OF_NOISE = 0.5
#: Proposals that are followed with a noise of their own.
FOLLOWED = 3


@dataclass(frozen=True, eq=False)
class Found:
    """A fault beside a model.

    Attributes
    ----------
    fault : BaseFault
    score : float
        Log likelihood less half of ``k ln N`` for the parameters of the model and of the fault.
    gain : float
        ``2 (L_with - L_without) - k ln N - 2 ln M`` for k parameters, N values and M faults.
    removed : float
        Share of the excess over the noise that it takes.
    """

    fault: BaseFault
    score: float
    gain: float
    removed: float


def fault_left(bases: Sequence[Evidence], run: np.ndarray) -> Found | None:
    """The likeliest fault of the record on top of one of several models, None where none is the reason of what they leave.

    Parameters
    ----------
    bases : sequence of Evidence
        What was named, and the simulator alone. Where one of them is at the noise nothing is wrong.
    run : ndarray of int (n_samples,)
        Number of the run of every row.
    """
    if any(base.left < AT_THE_NOISE for base in bases):
        return None
    found = [one for base in bases for one in (_best(base, run), _noisy_input(base)) if one is not None]
    return max(found, key=lambda one: one.score, default=None)


def _best(base: Evidence, run: np.ndarray) -> Found | None:
    """The likeliest fault of runs on top of one model."""
    model = base.candidate
    r, J, precision, pull = model.columns()
    if not (np.all(np.isfinite(J)) and np.all(np.isfinite(model.disturbance.A)) and np.all(np.isfinite(r))):
        return None
    fit = _Fit(model, base.noise, r, J, precision, pull)
    tried = list(proposals(model.problem.record, run, model.problem.record.y - r, r))
    order = sorted(tried, key=fit.first_sight, reverse=True)[:FOLLOWED]
    found = [one for one in (fit.followed(proposal, len(tried)) for proposal in order) if one is not None]
    good = [one for one in found if one.gain > CLEAR and one.removed > MOST_OF_IT]
    return max(good, key=lambda one: one.score, default=None)


def _excess(model: BaseCandidate, residual: np.ndarray) -> float:
    """Squares over the noise of a residual, initial states taken out, beyond those of noise alone."""
    return float(np.sum(model.without_starts(residual[None]) ** 2)) - residual.size


@dataclass(frozen=True, eq=False)
class _Fit:
    """A residual explained by the parameters of a model, and by the columns of a fault beside them."""

    model: BaseCandidate
    noise: Noise
    r: np.ndarray
    J: np.ndarray
    precision: np.ndarray
    pull: np.ndarray

    @property
    def noises(self) -> list[Noise]:
        """Where noise fits start: at that of the model, and at sensors as white as their differences are."""
        sd = self.model.problem.sd
        white = replace(self.noise, sigma=sd, coloured=0.05 * sd, force=1e-3 * self.model.problem.force_unit())
        return [self.noise, white]

    def first_sight(self, proposal: Proposal) -> float:
        """Twice the log likelihood under white noise, less the cost of the parameters."""
        columns = np.concatenate([self.r[:, None], self.J, proposal.columns], axis=1).transpose(1, 0, 2)
        flat = self.model.without_starts(columns).reshape(len(columns), -1)
        theta = self.solved(flat @ flat.T)
        rest = flat[0] - theta @ flat[1:]
        # The variance is unknown: what is left may be large.
        n = self.r.size
        return -n * float(np.log(max(float(rest @ rest), n))) - self.cost(proposal, 1)

    def cost(self, proposal: Proposal, tried: int) -> float:
        """``k ln N + 2 ln M``."""
        k = proposal.columns.shape[1] + proposal.extra
        return float(k * np.log(self.r.size) + 2.0 * np.log(tried))

    def solved(self, G: np.ndarray) -> np.ndarray:
        """Weights of all columns, from the Gram of residual and columns."""
        if len(G) == 1:
            return np.zeros(0)
        n = len(G) - 1 - len(self.precision)
        H, g = G[1:, 1:] + np.diag(np.r_[self.precision, np.zeros(n)]), G[1:, 0] + np.r_[self.pull, np.zeros(n)]
        normal, scale = scaled(H, 1e-150)
        return np.linalg.lstsq(normal, g / scale, rcond=1e-10)[0] / scale

    def fitted(self, columns: np.ndarray) -> tuple[float, np.ndarray]:
        """The largest log likelihood with the noise fitted, and the weights there."""
        n = columns.shape[1]
        J = np.concatenate([self.J, columns], axis=1)
        problem, D = self.model.problem, self.model.disturbance
        prior = np.r_[self.precision, np.zeros(n)], np.r_[self.pull, np.zeros(n)]
        fits = [
            fit_noise(D, self.r, start, problem.force_unit(), J, *prior, caps=problem.caps) for start in self.noises
        ]
        noise, value, _ = max(fits, key=lambda fit: fit[1])
        G, _ = D.gram(np.concatenate([self.r[:, None], J], axis=1), noise)
        return float(value), self.solved(G)

    def followed(self, proposal: Proposal, tried: int) -> Found | None:
        """A fault with a noise of its own; None where its weights are not possible."""
        try:
            alone, own = self.fitted(proposal.columns[:, :0])
            value, theta = self.fitted(proposal.columns)
        except np.linalg.LinAlgError:
            return None
        fault = proposal.fault(theta[self.J.shape[1] :])
        if fault is None:
            return None
        before = _excess(self.model, self.r - np.einsum("okt,k->ot", self.J, own))
        moved = np.einsum("okt,k->ot", np.concatenate([self.J, proposal.columns], axis=1), theta)
        after = _excess(self.model, self.r - moved)
        removed = 1.0 - max(after, 0.0) / before if before > 0 else 0.0
        if after < (CLOSED**2 - 1.0) * self.r.size and before > 2.0 * after:
            removed = 1.0  # at the noise
        n, cost = self.r.size, self.cost(proposal, tried)
        score = value - 0.5 * (self.model.n_parameters * np.log(n) + cost)
        return Found(fault, float(score), 2.0 * (value - alone) - cost, removed)


def _noisy_input(base: Evidence) -> Found | None:
    """The likeliest smoother input on top of one model."""
    model = base.candidate
    before = _excess(model, model.residual)
    found = []
    tried = list(smoother_inputs(model))
    for fault, other in tried:
        after = _excess(other, other.residual)
        removed = 1.0 - max(after, 0.0) / before if before > 0 else 0.0
        n = model.residual.size
        # Sizes, not noises: a noisy input is itself what the noise of the model calls a force.
        gain = n * float(np.log((before + n) / (max(after, 0.0) + n))) - np.log(n) - 2.0 * np.log(len(tried))
        score = base.log_likelihood + 0.5 * gain - 0.5 * model.n_parameters * np.log(n)
        found.append(Found(replace(fault, removed=removed), float(score), float(gain), removed))
    good = [one for one in found if one.gain > CLEAR and one.removed > MOST_OF_NOISE]
    return max(good, key=lambda one: one.removed, default=None)
