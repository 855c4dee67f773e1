"""Whether what a model leaves is a fault of the record: faults compete with names and with each other by evidence."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from sksurrogate.gap.faults._corrections import BaseFault, Hum, NoisyInput, SlowNoise, smoother_inputs
from sksurrogate.gap.faults._proposals import Proposal, proposals, there_whole, tones
from sksurrogate.gap.fit._backend import BaseCandidate
from sksurrogate.gap.fit._closeness import SETTLED
from sksurrogate.gap.fit._evidence import CERTAIN, FEW_STEPS, Evidence, estimate_noise, evidence_threshold
from sksurrogate.gap.fit._linear_set import LinearSet, linear_set
from sksurrogate.gap.fit._normal_equations import inverse
from sksurrogate.gap.search._base import BaseSearch
from sksurrogate.kernels.disturbance import Noise
from sksurrogate.kernels.run_columns import RunColumns, grams_of_pieces, take_out

#: A tone that is less than four fifths of the noise gains under the noise as it is at least this share of what it gains with one
#: fitted beside it: ``s`` for ``-log(1 - s)``.
MOST_REFIT = 0.5
#: Share of the excess over the noise that a fault takes, to be the reason of what is left: faults of sensors are exact.
MOST_OF_IT = 0.8
#: The same of noise on an input: what was really given to the plant is only known smoothed.
MOST_OF_NOISE = 0.5
#: Draws of the noise on an input, of which mean and spread of what it moves are known to a quarter.
DRAWS = 8
#: Faults beside a model that are followed with a noise of their own.
FOLLOWED = 4


class Alternative(NamedTuple):
    """What stands, with the likeliest law beside it."""

    score: float  #: As that of a fault
    left: float  #: RMS over the noise that it leaves


@dataclass(frozen=True, eq=False)
class Found:
    """A fault beside a model."""

    fault: BaseFault
    model: BaseCandidate
    score: float  #: Log likelihood less half of ``k ln N`` for the parameters of the model and of the fault
    gain: float  #: ``2 (L_with - L_without) - k ln N - 2 ln M`` for k parameters, N values and M faults
    removed: float  #: Share of the excess over the noise that it takes
    left: float  #: RMS over the noise of the model that is fitted without it

    @property
    def enough(self) -> bool:
        """Whether it is the reason of what is left."""
        return self.removed > (MOST_OF_NOISE if isinstance(self.fault, NoisyInput) else MOST_OF_IT)

    def beats(self, alternative: Alternative) -> bool:
        """Whether it is the better reason: by size where it alone comes to the noise, else by likelihood.

        A law far from the data is linear along the measured path, and a free force makes up for what it leaves: its likelihood is
        that of no model that was simulated.
        """
        return self.left < SETTLED < alternative.left or self.score >= alternative.score


def fault_left(
    bases: Sequence[Evidence], run: np.ndarray, search: BaseSearch[Any], alternative: Callable[[], Alternative]
) -> BaseFault | None:
    """The likeliest fault of the record on top of one of several models, None where none is the reason of what they leave.

    ``bases``: what was named, the simulator alone, and other sets of effects that the search has fitted: what is named
        beside a fault that nothing stands for may be a stack of wrong names.
    ``run`` (n_samples,): number of the run of every row.
    ``search``: for scores.
    ``alternative()``: what a fault must beat to be taken out; asked for only where one is the reason of what is left.
    """
    null = next(base.candidate for base in bases if not base.effects)
    smoother = [Proposal(moved[:, None], there_whole(fault)) for fault, moved in smoother_inputs(null)]
    seen = _seen(bases, run, smoother)
    followed = [one.fit.followed(one.proposal, one.tried, search) for one in _first(seen, bases, null, smoother)]
    clear = [one for one in followed if one is not None and one.gain > CERTAIN and one.fault.differs]
    good = max((one for one in clear if one.enough), key=lambda one: one.score, default=None)
    if good is not None and good.beats(alternative()):
        return good.fault
    return _noise_of_an_input(clear)


class _Seen(NamedTuple):
    """A fault beside a model at first sight."""

    worth: float
    fit: _Fit
    proposal: Proposal
    tried: int  #: Faults that were tried beside this model


def _seen(bases: Sequence[Evidence], run: np.ndarray, smoother: Sequence[Proposal]) -> list[_Seen]:
    """Every fault beside every model, the likeliest at first sight first."""
    seen: list[_Seen] = []
    for base in bases:
        fit = fit_beside(base)
        if fit is None:
            continue
        record = base.candidate.problem.record
        tried = [*proposals(record, run, record.y - fit.linear.r, fit.linear.r), *smoother]
        seen += [_Seen(fit.first_sight(proposal), fit, proposal, len(tried)) for proposal in tried]
    return sorted(seen, key=lambda one: -one.worth)


def _first(
    seen: Sequence[_Seen], bases: Sequence[Evidence], null: BaseCandidate, smoother: Sequence[Proposal]
) -> list[_Seen]:
    """Those that are followed: the likeliest; on top of what stands, and of nothing, the likeliest and every smoother input.

    Order at first sight is by white noise. What noise on an input leaves is slow: which smoother input is likelier is not seen then.
    """
    first = list(seen[:FOLLOWED])
    for base in (bases[0].candidate, null):
        own = [one for one in seen if one.fit.model is base]
        likeliest = own[:1] + [one for one in own[1:] if one.proposal in smoother]
        first += [one for one in likeliest if one not in first]
    return first


def _noise_of_an_input(clear: Sequence[Found]) -> BaseFault | None:
    """The likeliest noise on an input, where the smoother input leaves most of the gap; None where there is none of its size.

    If it moved the outputs by more than there is, the plant got what was measured.
    """
    for one in sorted(clear, key=lambda one: -one.score):
        if isinstance(one.fault, NoisyInput):
            slow = slow_noise(one.model, one.fault)
            if slow is not None and slow.is_possible:
                return replace(one.fault, slow=slow)
    return None


def slow_noise(model: BaseCandidate, fault: NoisyInput) -> SlowNoise | None:
    """What as much noise on the input once more moves the outputs of a model by; None where it cannot be simulated."""
    record, gap = model.problem.record, _excess(model, model.residual)
    noisier = (model.refitted(fault.noisier(record, draw)) for draw in range(DRAWS))
    moved = [model.without_starts((one.fit.y - model.fit.y)[None])[0] for one in noisier if one is not None]
    if len(moved) < 2 or gap <= 0:
        return None
    power = np.sum(np.square(moved), axis=2)  # (n_draws, n_outputs)
    shares = power.sum(axis=1) / gap
    rms = model.problem.sd * np.sqrt(power.mean(axis=0) / record.counts.sum(axis=0))
    return SlowNoise(float(shares.mean()), float(shares.std(ddof=1)), rms)


def tone_left(base: Evidence, run: np.ndarray) -> Hum | None:
    """A tone within what passes for noise: fast tones are part of what differences of the readings show as noise."""
    fit = fit_beside(base)
    if fit is None:
        return None
    record, found = base.candidate.problem.record, []
    for proposal in tones(record, run, fit.linear.r):
        needed = fit.cost(proposal, len(record.y)) + CERTAIN
        try:
            if fit.gain_under(base.noise, proposal) < MOST_REFIT * needed:
                continue
            value, theta, _ = fit.fitted(proposal)
            gain = 2.0 * (value - fit.alone)
        except np.linalg.LinAlgError:
            continue
        fault = proposal.fault(theta[fit.linear.J.shape[1] :])
        if gain > needed and isinstance(fault, Hum) and not is_harmonic(fault, base.candidate):
            found.append((gain, fault))
    return max(found, key=lambda one: one[0])[1] if found else None


def is_harmonic(fault: Hum, named: BaseCandidate) -> bool:
    """Whether a tone has a multiple of the frequency of a named disturbance, as far as the record tells: it is the shape of that one."""
    record, theta = named.problem.record, [named.theta_of(i) for i in range(len(named.effects))]
    told_apart = 2.0 * np.pi / float(record.dt * np.max(record.lengths))
    lines = [float(w[1]) for effect, w in zip(named.effects, theta) if effect.name == Hum.effect]
    return any(
        abs(fault.angular_frequency - max(round(fault.angular_frequency / w), 1) * w) < told_apart for w in lines
    )


def fit_beside(base: Evidence) -> _Fit | None:
    """A model to which faults can be added; None where it cannot be linearised."""
    linear = linear_set(base.candidate)
    return _Fit(linear, base.noise) if linear.finite else None


def _excess(model: BaseCandidate, residual: np.ndarray) -> float:
    """Squares over the noise of a residual, initial states taken out, beyond those of noise alone."""
    return float(np.sum(model.without_starts(residual[None]) ** 2)) - model.problem.record.n_values


@dataclass(frozen=True, eq=False)
class _Fit:
    """A residual explained by the parameters of a model, and by the columns of a fault beside them."""

    linear: LinearSet[BaseCandidate]
    noise: Noise
    #: By the identity of a fault's columns: these, which keeps them alive, and what they take of the Gram in every run
    by_run: dict[int, tuple[np.ndarray, np.ndarray, np.ndarray]] = field(default_factory=dict)

    @property
    def model(self) -> BaseCandidate:
        """Whose residual it is."""
        return self.linear.base

    @property
    def n(self) -> int:
        """Measured values."""
        return self.model.problem.record.n_values

    @property
    def noises(self) -> list[Noise]:
        """Where noise fits start: at that of the model, and at sensors as white as their differences are."""
        sd = self.model.problem.sd
        white = replace(self.noise, sigma=sd, coloured=0.05 * sd, force=1e-3 * self.model.problem.force_unit())
        return [self.noise, white]

    def first_sight(self, proposal: Proposal) -> float:
        """Twice the log likelihood under white noise, less the cost of the parameters."""
        if proposal.of is None:
            linear = self.linear.beside(proposal.columns)
            flat = self.projected(proposal.columns).reshape(-1, linear.r.size)
            G = flat @ flat.T
        else:
            linear, (whole, taken) = self.linear, self.seen_by_run(proposal)
            G = whole - taken[proposal.acts].sum(axis=0)
        left = np.r_[1.0, -linear.weights(G)]
        # The variance is unknown: what is left may be large.
        return -self.n * float(np.log(max(float(left @ G @ left), self.n))) - self.cost(proposal, 1)

    def projected(self, columns: np.ndarray) -> np.ndarray:
        """Residual, sensitivities and columns of a fault over the noise, initial states taken out, (n_columns, n_outputs, n_samples)."""
        return self.model.without_starts(self.linear.beside(columns).known.transpose(1, 0, 2))

    def seen_by_run(self, proposal: Proposal) -> tuple[np.ndarray, np.ndarray]:
        """Gram of residual and sensitivities, and what a fault takes of it in every run; computed once for all runs."""
        columns = proposal.columns
        if id(columns) not in self.by_run:
            assert proposal.of is not None
            stack, k = self.projected(columns), columns.shape[1]
            grams = grams_of_pieces(stack, np.flatnonzero(np.diff(proposal.of, prepend=-1)))
            known = grams[:, :-k, :-k]
            self.by_run[id(columns)] = columns, known.sum(axis=0), known - take_out(grams, k)[0]
        return self.by_run[id(columns)][1:]

    def cost(self, proposal: Proposal, tried: int) -> float:
        """``k ln N + 2 ln M``, and what the choice of its runs costs."""
        k = proposal.n_weights + proposal.extra
        return float(evidence_threshold(k, tried, self.n)) + proposal.chosen

    def fitted(self, proposal: Proposal) -> tuple[float, np.ndarray, np.ndarray]:
        """The largest log likelihood with the noise fitted, the weights there, and the squares of these over their variances."""
        own = proposal.own
        linear = self.linear.beside(proposal.acting) if own is None else self.linear
        noise, value, _ = max((linear.noise_from(start, own=own) for start in self.noises), key=lambda fit: fit[1])
        if own is None:
            theta, covariance = _weights(linear, linear.gram(noise)[0])
            variance = np.diag(covariance)
        else:
            theta, variance = _weights_by_run(linear, noise, own, proposal.acts)
        return float(value), theta, theta**2 / np.maximum(variance, 1e-300)

    def gain_under(self, noise: Noise, proposal: Proposal) -> float:
        """Twice the log likelihood that a fault with values of its own gains under a noise that stays."""
        known, own = self.linear, proposal.own
        if own is None:
            beside = known.beside(proposal.acting)
            return 2.0 * (beside.log_likelihood(noise) - known.log_likelihood(noise))
        grams, logdet = known.D.gram_by_run(np.concatenate([known.known, own.columns], axis=1), noise)
        left = take_out(own.by_run(grams, known.D.starts), own.columns.shape[1])[0]
        return 2.0 * (known.at_best(left.sum(axis=0), float(np.sum(logdet))) - known.log_likelihood(noise))

    @cached_property
    def alone(self) -> float:
        """The largest log likelihood beside no fault."""
        return max(float(self.linear.noise_from(start)[1]) for start in self.noises)

    def in_runs(self, proposal: Proposal, nats: np.ndarray) -> Proposal:
        """The fault in those runs whose value is worth its ``ln N``, itself where all are or none is."""
        kept = nats[self.linear.J.shape[1] :] > np.log(self.n)
        return proposal.some(kept) if proposal.some is not None and 0 < kept.sum() < len(kept) else proposal

    def followed(self, proposal: Proposal, tried: int, search: BaseSearch[Any]) -> Found | None:
        """A fault with a noise of its own, and the model fitted again without it; None where its weights are not possible."""
        try:
            alone, (value, theta, nats) = self.alone, self.fitted(proposal)
            whole, proposal = proposal, self.in_runs(proposal, nats)
            if proposal is not whole:
                value, theta, _ = self.fitted(proposal)
        except np.linalg.LinAlgError:
            return None
        fault, model = proposal.fault(theta[self.linear.J.shape[1] :]), self.model
        again = None if fault is None else model.refitted(fault.corrected(model.problem.record))
        if fault is None or again is None:
            return None
        before, after = _excess(model, model.residual), _excess(again, again.residual)
        removed = 1.0 - max(after, 0.0) / before if before > 0 else 0.0
        left = float(np.sqrt(1.0 + max(after, 0.0) / self.n))
        if left < SETTLED and before > 2.0 * after:
            removed = 1.0  # at the noise
        cost = self.cost(proposal, tried)
        corrected = estimate_noise(again, self.noises[1], max_iterations=FEW_STEPS).log_likelihood
        score = max(value, corrected + fault.log_stretch(model.problem.record))
        score -= 0.5 * (search.prior_cost(again) + model.n_parameters * np.log(self.n) + cost)
        if isinstance(fault, NoisyInput):
            fault = replace(fault, removed=removed)
        return Found(fault, model, float(score), 2.0 * (value - alone) - cost, removed, left)


def _weights(linear: LinearSet[Any], G: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Of the columns of a model, and their covariance, from its Gram."""
    return linear.weights(G), inverse(G[1:, 1:] + np.diag(linear.precision))


def _weights_by_run(
    linear: LinearSet[Any], noise: Noise, own: RunColumns, acts: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The same with variances, and then those of further columns in every run that ``acts`` names, run by run."""
    grams = linear.D.gram_by_run(np.concatenate([linear.known, own.columns], axis=1), noise)[0]
    left, weights, inverses = take_out(own.by_run(grams, linear.D.starts), own.columns.shape[1])
    theta, covariance = _weights(linear, left.sum(axis=0))
    by_others = weights[acts, :, 1:]
    further = np.einsum("rkk->rk", inverses[acts]) + np.einsum("rki,ij,rkj->rk", by_others, covariance, by_others)
    return np.r_[theta, (weights[acts, :, 0] - by_others @ theta).ravel()], np.r_[np.diag(covariance), further.ravel()]
