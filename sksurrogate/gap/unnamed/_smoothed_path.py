"""Paths near the data, and the sensor noise of a model along one of them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from sksurrogate.gap.fit._build import measured_guess
from sksurrogate.gap.fit._closeness import FAR
from sksurrogate.gap.fit._evidence import Evidence
from sksurrogate.gap.fit._ode import OdeBackend, OdeCandidate
from sksurrogate.gap.fit._pushes import REMEMBERED
from sksurrogate.kernels.disturbance import Noise
from sksurrogate.kernels.free_runs import settle_hidden
from sksurrogate.kernels.noise_fit import fit_noise

#: A free run that misses an output by more than this share of its deviation is further from the data than the readings are; the
#: steps of a smoother need not bring it back.
RUN_AWAY = 1.0 / 3.0


def sensor_noise(found: Evidence) -> np.ndarray:
    """White noise of the sensors (n_outputs,) where every balance may have a force, along a path near the data.

    Far from the data coloured sensor noise may not take what a force can explain.
    """
    with np.errstate(all="ignore"):
        for x in paths(found.candidate, found.candidate.problem):
            try:
                return _noise_along(found, x).sigma
            except np.linalg.LinAlgError:  # no likelihood along this path: the free run is smoother
                continue
    return found.noise.sigma


def paths(candidate: OdeCandidate, *problems: OdeBackend) -> Iterator[np.ndarray]:
    """Paths near the data: smoothed with the balances that each problem lets give way, as far as one is found; the free run.

    In place of a free run that has left the data, measured states are smoothed as they were measured.
    """
    fit, problem = candidate.fit, candidate.problem
    record, start = problem.record, fit.x
    away = record.rms(record.residual(fit.y)) / record.spread
    if not np.max(away) < RUN_AWAY and problem.run is not None:
        guess = measured_guess(problem.plant, record, problem.run)
        start = settle_hidden(candidate.model, fit.theta, np.concatenate([guess, fit.x[len(guess) :]]))
    for giving_way in problems:
        try:
            yield giving_way.smooth(candidate.model, fit.theta, start).x
        except (FloatingPointError, np.linalg.LinAlgError):
            continue
    yield fit.x


def _noise_along(found: Evidence, x: np.ndarray) -> Noise:
    """The noise about one path; LinAlgError where the linearisation cannot be followed."""
    about, start, held = found.candidate.along(x), found.noise, None
    problem, unit = about.problem, about.problem.force_unit()
    if found.left > FAR:
        start = replace(problem.white_sensors(start), force=0.1 * unit, tau_sensor=REMEMBERED)
        held = start.held(coloured=True)
    return fit_noise(about.disturbance, about.residual, start, unit, held=held, max_iterations=10)[0]
