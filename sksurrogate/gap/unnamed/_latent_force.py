"""What no named effect explains: the latent force that is left, and whether it is a law."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from sklearn.ensemble import ExtraTreesRegressor

from sksurrogate.gap.fit._build import measured_guess
from sksurrogate.gap.fit._closeness import FAR
from sksurrogate.gap.fit._evidence import Evidence
from sksurrogate.gap.fit._ode import OdeBackend, OdeCandidate
from sksurrogate.gap.fit._pushes import REMEMBERED
from sksurrogate.gap.fit._record_parts import row_folds
from sksurrogate.gap.unnamed._channel import Place
from sksurrogate.kernels.banded import first_order_scan
from sksurrogate.kernels.disturbance import Disturbance, Noise
from sksurrogate.kernels.noise_fit import fit_noise
from sksurrogate.kernels.output_error import settle_hidden
from sksurrogate.kernels.record import Record

#: A force of this share of the RMS of dx/dt is one that the noise fit could not make smaller: no law is looked for in it.
SMALLEST_FORCE = 2e-3

#: A free run that misses an output by more than so many of its deviations has left the data; the steps of a smoother, which
#: are no longer, do not bring it back.
RUN_AWAY = 10.0
#: A force that moves the outputs by less than this share of what all forces do is numerics, whatever law it follows.
LEAST_MOVED = 0.15


@dataclass(frozen=True, eq=False)
class LatentForce:
    """The force that a model leaves, along the smoothed path."""

    x: np.ndarray  #: (n_states, n_samples): smoothed states
    force: np.ndarray  #: (n_balances, n_samples)
    noise: Noise
    size: np.ndarray  #: (n_balances,): standard deviation of each force over the RMS of its dx/dt
    moved: np.ndarray  #: (n_balances,): square of what each moves the outputs by, over the noise


@dataclass(frozen=True, eq=False)
class Remains:
    """What is left of the gap beside the names, and where it was."""

    latent: LatentForce  #: On top of what is named
    law: np.ndarray  #: (n_balances,): R2 of its law on runs left out
    places: list[Place]  #: The most likely first
    gap: LatentForce  #: On top of the simulator: the gap itself, in the balances


def law_left(final: Evidence, seed: int) -> tuple[LatentForce, np.ndarray]:
    """The force that is left, and its law where nothing is named: beside names the evidence of a law answers."""
    latent = latent_force(final, quiet_sensors=final.left > FAR)
    return latent, np.zeros(1) if final.effects else law_of(final.candidate, latent, seed)


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
    return LatentForce(candidate.fit.x, force, found.noise, nothing, nothing)


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
    return LatentForce(x, force, noise, noise.force / problem.force_unit(), moved_by(D, force, problem.sd))


def features(problem: OdeBackend, x: np.ndarray) -> tuple[np.ndarray, list[str]]:
    """States and inputs as columns, with their names."""
    n = len(problem.plant.states)
    return np.concatenate([x[:n], problem.record.u]).T, [*problem.plant.states, *problem.plant.inputs]


def memory(record: Record, path: np.ndarray) -> np.ndarray:
    """Past of a free run and of the inputs as columns (n_samples, n_columns).

    Of the free run, not of the smoothed states: these follow the force, and its past would be read off them.
    """
    return np.concatenate(past_of(record, np.concatenate([path, record.u]))).T


def past_of(record: Record, signals: np.ndarray) -> np.ndarray:
    """Direction and moving averages over 5 and 25 samples of signals, (3, n_signals, n_samples)."""
    found = [np.sign(first_order_scan(0.8, np.diff(signals, axis=1, prepend=signals[:, :1]), record.starts))]
    for tau in (5.0, 25.0):
        a = np.exp(-1.0 / tau)
        level = signals[:, record.starts][:, record.run_of_row]
        found.append(level + (1 - a) * first_order_scan(a, signals - level, record.starts))
    return np.stack(found)


def law_of(candidate: OdeCandidate, latent: LatentForce, random_state: int) -> np.ndarray:
    """R2 on runs left out of a forest from states and inputs to the force on top of a candidate, (n_balances,): a law is repeatable, noise is not.

    The larger of two: from the smoothed states as they are, and with the past of the free run beside them.
    """
    problem = candidate.problem
    Z, _ = features(problem, latent.x)
    path = candidate.fit.x[: len(problem.plant.states)]
    law = repeatable(problem.record, latent.force, latent.size, Z, path, random_state)
    return np.where(latent.moved >= LEAST_MOVED**2 * np.sum(latent.moved), law, 0.0)


def moved_by(D: Disturbance, force: np.ndarray, sd: np.ndarray) -> np.ndarray:
    """Square of what each force (n_balances, n_samples) moves the outputs by, to first order, over the noise: (n_balances,)."""
    moved = D.moved(D.B.transpose(1, 2, 0) * force) / sd[:, None, None]
    return np.asarray(np.sum(np.nan_to_num(moved, posinf=0.0, neginf=0.0) ** 2, axis=(0, 2)))


def repeatable(
    record: Record, force: np.ndarray, size: np.ndarray, Z: np.ndarray, path: np.ndarray, random_state: int
) -> np.ndarray:
    """R2 on runs left out of a forest from columns Z, with or without the past of ``path``, to every force."""
    now = forest(record, force, size, Z, random_state)
    if np.max(now, initial=0.0) > 0.5:
        return now
    return np.maximum(now, forest(record, force, size, np.hstack([Z, memory(record, path)]), random_state))


def forest(record: Record, force: np.ndarray, size: np.ndarray, Z: np.ndarray, random_state: int) -> np.ndarray:
    """R2 on runs left out of a forest from columns Z to every force."""
    fold = row_folds(record)
    stride = max(1, len(Z) // 4000)
    out = np.zeros(len(force))
    for b, w in enumerate(force):
        if size[b] < SMALLEST_FORCE:
            continue
        error = total = 0.0
        for k in range(int(fold.max()) + 1):
            train, test = np.flatnonzero(fold != k)[::stride], fold == k
            if not (test.any() and len(train)):
                continue
            forest = ExtraTreesRegressor(24, min_samples_leaf=10, random_state=random_state).fit(Z[train], w[train])
            error += float(np.sum((w[test] - forest.predict(Z[test])) ** 2))
            total += float(np.sum((w[test] - w[train].mean()) ** 2))
        out[b] = 1.0 - error / total if total > 0 else 0.0
    return out
