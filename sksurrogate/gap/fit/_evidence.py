"""Evidence: the likelihood of a candidate's own output-error fit under a noise, and the threshold it has to pass."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Generic

import numpy as np

from sksurrogate._parallel._parallel_map import side_by_side
from sksurrogate._parallel._worker_process import WorkerProcess
from sksurrogate.effects._base_effect import BaseEffect
from sksurrogate.gap.fit._backend import BaseCandidate, C, Fitted
from sksurrogate.gap.fit._closeness import AT_THE_NOISE
from sksurrogate.gap.fit._linear_set import linear_set
from sksurrogate.gap.fit._pushes import REMEMBERED
from sksurrogate.kernels.disturbance import Noise

#: A second start is followed where it is likelier than the first by this much: in less, both led to one top.
LIKELIER = 5.0
#: Gain (twice nats) from which a law without a name is certain, beside names or in their place; further effects, windows of
#: time and faults of the record must beat their threshold by it, which a mismatch of numerics can pass alone.
CERTAIN = 10.0
#: Steps of a noise fit that begins at the noise of a candidate nearby.
FEW_STEPS = 8
#: What is this many nats below the best is out of the question, however rough the comparison.
OUT_OF_REACH = 200.0


@dataclass(frozen=True, eq=False)
class Evidence(Generic[C]):
    """A candidate judged under a noise."""

    candidate: C
    noise: Noise
    log_likelihood: float
    curvature: np.ndarray | None = None  #: Of the likelihood in the noise, where a noise fit ended
    quick: bool = False  #: Whether the noise is that of others, and was only looked at

    @property
    def effects(self) -> tuple[BaseEffect, ...]:
        """Of the candidate."""
        return self.candidate.effects

    @property
    def fit(self) -> Fitted:
        """Of the candidate."""
        return self.candidate.fit

    @property
    def judgement(self) -> tuple[Noise, float, np.ndarray | None]:
        """Everything but the candidate, whose model cannot travel between processes."""
        return self.noise, self.log_likelihood, self.curvature

    @cached_property
    def left(self) -> float:
        """RMS of the free-run residual in units of the noise (the worst output): of the sensor, and of inputs that are measured."""
        return self.left_within()

    def left_within(self, most: np.ndarray | float = np.inf, least: np.ndarray | float = 0.0) -> float:
        """The same with the sensor noise within limits."""
        record = self.candidate.problem.record
        sigma = np.maximum(np.minimum(self.noise.sigma, most), least)
        return float(np.max(record.rms(self.candidate.residual) / np.hypot(sigma, record.disturbance)))


def evidence_threshold(n_parameters: int, n_candidates: int, n_values: int) -> float:
    """What 2 (L_candidate - L_null) must exceed: ``k ln N + 2 ln M``."""
    return n_parameters * np.log(n_values) + 2.0 * np.log(max(n_candidates, 1))


def gain_under_estimated_noise(gain: float, n_fitted: int, n_values: int) -> float:
    """What counts of a gain in log likelihood whose noise level is estimated from the same values: ``(N - p)/N`` of it, p being fitted.

    Under its likeliest noise a fit of p numbers leaves ``N - p`` free values, as in Student's law; of long records all counts.

    >>> gain_under_estimated_noise(10.0, 5, 20), round(gain_under_estimated_noise(10.0, 5, 5000), 2)
    (7.5, 9.99)
    """
    return gain * max(1.0 - n_fitted / n_values, 0.0)


def gain_by_size(n_values: int, ratio: float) -> float:
    """Log likelihood that white errors gain whose squares fall by a ratio, one in :data:`REMEMBERED` values being independent."""
    return 0.5 * n_values / REMEMBERED * float(np.log(ratio))


def judged_under(candidate: C, noises: Sequence[Noise]) -> Evidence[C]:
    """A candidate under the first of the likeliest of some noises."""
    linear = linear_set(candidate)
    values = [linear.likelihood_within_bounds(noise) for noise in noises]
    k = int(np.argmax(values))
    return Evidence(candidate, noises[k], values[k], quick=True)


def estimate_noise(
    candidate: C, start: Noise, curvature: np.ndarray | None = None, max_iterations: int = 15
) -> Evidence[C]:
    """A candidate under its own noise.

    The noise of another candidate is a start; forces beside quiet sensors are others, followed too where they are likelier:
    the likelihood has a top for coloured sensors and one for forces. Near the data white noise of the size of the residual
    takes the start's place where it is likelier: a fit that explains what was coloured before must not start from that
    colour.
    """
    forces, white = candidate.other_noises(start)
    noises = [start, *forces, *white]
    linear = linear_set(candidate)
    value = [linear.likelihood_within_bounds(noise) for noise in noises]
    k = int(np.argmax(value)) if max(value) > value[0] + LIKELIER else 0
    if k > len(forces) and candidate.white_alone:
        return follow_noise(candidate, noises[k], max_iterations=max_iterations)
    first = follow_noise(candidate, start, curvature, max_iterations=max_iterations)
    other = follow_noise(candidate, noises[k], max_iterations=max_iterations) if k else first
    # a noise is followed without the parameters' bounds: within them a start may be likelier than where it led
    return max((first, other, Evidence(candidate, noises[k], value[k])), key=lambda one: one.log_likelihood)


def follow_noise(
    candidate: C, start: Noise, curvature: np.ndarray | None = None, *, max_iterations: int
) -> Evidence[C]:
    """The top of the likelihood that is reached from one start."""
    linear = linear_set(candidate)
    if not linear.finite:
        return Evidence(candidate, start, -np.inf)
    options = {"curvature": curvature, "max_iterations": max_iterations, "sigma_unit": candidate.problem.sd}
    noise, _, curved = linear.noise_from(start, **options)
    return Evidence(candidate, noise, linear.likelihood_within_bounds(noise), curved)


def follow_null(
    null: C, start: Noise, known: Evidence[C] | None = None, second: WorkerProcess | None = None
) -> Evidence[C]:
    """The null under its own noise: what it misses there would count for every candidate.

    The likelihood has a top for coloured sensors and one for forces: the likeliest start of each kind is followed, side by
    side where a second process is wanted. What is ``known`` stays where neither is likelier.
    """
    sensors = [start, replace(start, coloured=1.0 * start.sigma, force=0.01 * start.force)]
    force = replace(start, coloured=0.05 * start.sigma, force=10.0 * start.force)
    forces, white = null.other_noises(start)
    kinds = sensors, [force, *forces, *white]
    starts = [judged_under(null, noises).noise for noises in kinds]
    found = side_by_side(lambda first: follow_noise(null, first, max_iterations=25).judgement, starts, second)
    tops = [Evidence(null, *judgement) for judgement in found]
    return max([*([] if known is None else [known]), *tops], key=lambda top: top.log_likelihood)


def arrived(candidate: Evidence | None, before: BaseCandidate) -> bool:
    """Whether a candidate is at the noise and another one is not: by its noise, for the other's own may hold what it misses."""
    return (
        candidate is not None
        and candidate.left < AT_THE_NOISE
        and before.fit.cost > AT_THE_NOISE**2 * candidate.fit.cost
    )
