"""The latent force that is left in every balance on top of a model, along a path near the data."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from sksurrogate.gap.fit._build import measured_guess
from sksurrogate.gap.fit._evidence import Evidence
from sksurrogate.gap.fit._ode import OdeBackend, OdeCandidate
from sksurrogate.gap.fit._pushes import REMEMBERED
from sksurrogate.kernels.disturbance import Noise
from sksurrogate.kernels.noise_fit import fit_noise
from sksurrogate.kernels.output_error import settle_hidden

#: A free run that misses an output by more than so many of its deviations has left the data; the steps of a smoother, which
#: are no longer, do not bring it back.
RUN_AWAY = 10.0


@dataclass(frozen=True, eq=False)
class LatentForce:
    """The force that a model leaves, along the smoothed path."""

    x: np.ndarray  #: (n_states, n_samples): smoothed states
    force: np.ndarray  #: (n_balances, n_samples)
    noise: Noise
    size: np.ndarray  #: (n_balances,): standard deviation of each force over the RMS of its dx/dt


def latent_force(found: Evidence, quiet_sensors: bool = False) -> LatentForce:
    """Smooth the force in every balance on top of a model, linearised about the smoothed path (not the free run).

    With ``quiet_sensors`` coloured sensor noise may not take what a force can explain.
    """
    candidate = found.candidate
    problem = candidate.problem
    with np.errstate(all="ignore"):
        for x in paths(candidate, problem):
            try:
                return _force_along(found, x, quiet_sensors)
            except np.linalg.LinAlgError:  # no likelihood along this path: the free run is smoother
                continue
    nothing = np.zeros(len(problem.balances))
    force = np.zeros((len(nothing), problem.record.n_samples))
    return LatentForce(candidate.fit.x, force, found.noise, nothing)


def paths(candidate: OdeCandidate, *problems: OdeBackend) -> Iterator[np.ndarray]:
    """Paths near the data: smoothed with the balances that each problem lets give way, as far as one is found; the free run.

    A free run that has left the data is smoothed from the measured states instead.
    """
    fit, problem = candidate.fit, candidate.problem
    record, start = problem.record, fit.x
    away = record.rms(record.residual(fit.y)) / record.spread
    if not np.max(away) < RUN_AWAY and problem.run is not None:
        guess = measured_guess(problem.plant, record, problem.run)
        start = settle_hidden(candidate.model, fit.theta, np.concatenate([guess, fit.x[len(guess) :]]))
    for problem in problems:
        try:
            yield problem.smooth(candidate.model, fit.theta, start).x
        except (FloatingPointError, np.linalg.LinAlgError):
            continue
    yield fit.x


def _force_along(found: Evidence, x: np.ndarray, quiet_sensors: bool) -> LatentForce:
    """The force about one path; LinAlgError where the linearisation cannot be followed."""
    about, start = found.candidate.along(x), found.noise
    problem, D, r, held = about.problem, about.disturbance, about.residual, None
    if quiet_sensors:
        m = len(r)
        start = replace(
            start, sigma=problem.sd, force=0.1 * problem.force_unit(), coloured=1e-2 * problem.sd, tau_sensor=REMEMBERED
        )
        held = np.zeros(2 * m + len(problem.balances) + 2, bool)
        held[m + len(problem.balances) + 1 :] = True
    noise, _, _ = fit_noise(D, r, start, problem.force_unit(), curvature=None, held=held, max_iterations=10)
    _, force, _ = D.states(r, noise)
    return LatentForce(x, force, noise, noise.force / problem.force_unit())


def signals_along(problem: OdeBackend, x: np.ndarray) -> dict[str, np.ndarray]:
    """States along a path (n_states, n_samples), and inputs, by name."""
    plant = problem.plant
    return {**dict(zip(plant.states, x)), **dict(zip(plant.inputs, problem.record.u))}
