"""What candidates are fitted to: a simulator over a record, with noise, sizes, substeps and the smoothed trajectory of it alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from sksurrogate.effects._model import AugmentedModel
from sksurrogate.gap.fit._known_parameters import KnownParameters
from sksurrogate.gap.fit._linear_surrogate import learn
from sksurrogate.gap.fit._neighbours import neighbours
from sksurrogate.gap.fit._ode import Numerics, OdeBackend
from sksurrogate.gap.fit._pushes import gain_of_forces
from sksurrogate.gap.fit._simulations import Simulations, divergence
from sksurrogate.gap.fit._trajectory import TrajectoryBackend
from sksurrogate.kernels.banded import recursion_band
from sksurrogate.kernels.free_runs import free_run, run_near
from sksurrogate.kernels.record import Record
from sksurrogate.kernels.smoother import Smoothed, noise_of_differences, output_jacobian
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._simulator import Plant

#: Largest error of the integrator over one sample, in units of the size of the states.
DIAGNOSIS_LOCAL_ERROR = 2e-5
#: Substeps of a sample that are tried: what a run costs grows with them, its error falls with their fourth power.
SUBSTEPS_TRIED = (1, 2, 3, 4, 5, 6, 8, 10, 12, 16)


def nominal_run(problem: OdeBackend) -> np.ndarray:
    """States (n_states, n_samples) of the simulator alone, every run from its own initial state."""
    nominal = problem.augmented(())
    start = np.repeat(problem.plant.x0[:, None], len(problem.record.starts), axis=1)
    with np.errstate(all="ignore"):
        return free_run(nominal, np.zeros(nominal.n_theta), start)


def with_readings(plant: Plant, record: Record, x: np.ndarray) -> np.ndarray:
    """States (n_states, n_samples), the measured ones as they were read."""
    out = x.copy()
    for j, i in enumerate(plant.output_states or ()):
        out[i] = record.y[j]
    return out


def run_from_readings(model: PlantModel, record: Record) -> np.ndarray:
    """States (n_states, n_samples) of the simulator alone, measured ones started at their first readings."""
    plant = model.plant
    near = with_readings(plant, record, np.repeat(plant.x0[:, None], record.n_samples, axis=1))
    nominal = AugmentedModel(model, (), (), record, n_sub=2, scale=sizes(near))
    with np.errstate(all="ignore"):
        return run_near(nominal, np.zeros(0), near)


def measured_guess(plant: Plant, record: Record, run: np.ndarray) -> np.ndarray:
    """States (n_states, n_samples): measured ones as measured, others from the nominal free run or the initial state."""
    return with_readings(plant, record, np.where(np.isfinite(run).all(axis=0), run, plant.x0[:, None]))


def sizes(guess: np.ndarray) -> np.ndarray:
    """Size of every state along a guess: its deviation, or a share of its level where it hardly moves."""
    spread = np.std(guess, axis=1)
    level = np.sqrt(np.mean(guess**2, axis=1))
    scale = np.maximum(spread, 0.02 * level)
    return np.where(scale > 0, scale, 1.0)


def substeps(x: np.ndarray, weight: np.ndarray, make: Any) -> int:
    """Fewest substeps whose error in one sample stays a hundredth of the noise (98 % of the samples)."""
    for n_sub in SUBSTEPS_TRIED:
        coarse, fine = make(n_sub).bind(np.zeros((0, 1))), make(2 * n_sub).bind(np.zeros((0, 1)))
        error = np.abs(coarse(x[:, None])[:, 0] - fine(x[:, None])[:, 0]) / weight[:, None]
        finite = np.isfinite(error).all(axis=0)
        if finite.mean() > 0.98 and np.quantile(np.max(error[:, finite], axis=0), 0.98) < 0.01:
            return n_sub
    return SUBSTEPS_TRIED[-1]


def build_problem(
    model: PlantModel,
    record: Record,
    free: Sequence[str],
    balances: Sequence[str],
    known: KnownParameters | None = None,
    path: np.ndarray | None = None,
) -> tuple[OdeBackend, Smoothed]:
    """Noise, sizes, substeps and the smoothed trajectory of the nominal plant; what is ``known`` of its parameters.

    ``path`` (n_states, n_samples): a trajectory near the measured one, where one is known already.
    """
    sd = noise_of_differences(record.y, record.starts, record.known, record.t)
    with np.errstate(all="ignore"):
        run = run_from_readings(model, record)
        guess = measured_guess(model.plant, record, run) if path is None else path
        scale = sizes(guess)
        problem = OdeBackend(
            model,
            record,
            sd,
            scale,
            scale / record.dt,
            tuple(free),
            tuple(balances),
            Numerics(2),
            run=run,
            known=known or KnownParameters(),
        )
        nominal = problem.nominal_model
        smoothed = problem.smooth(nominal, np.zeros(0), guess)
        scale = np.maximum(sizes(smoothed.x), 0.02 * scale)
        rate = np.sqrt(np.mean(((smoothed.x[:, 1:] - smoothed.x[:, :-1]) / record.dt) ** 2, axis=1))
        n_sub = substeps(
            smoothed.x,
            np.minimum(nominal.closing_weight(sd), DIAGNOSIS_LOCAL_ERROR * 100 * scale),
            lambda n: AugmentedModel(model, (), (), record, n_sub=n, scale=scale),
        )
        problem = replace(
            problem,
            scale=scale,
            rate=np.maximum(rate, 1e-9 * scale / record.dt),
            numerics=Numerics(n_sub),
            near=neighbours(model, record.t, smoothed.x, record.u),
        )
        return replace(problem, caps=_caps(problem, smoothed)), smoothed


def _caps(problem: OdeBackend, smoothed: Smoothed) -> tuple[np.ndarray, np.ndarray]:
    """Forces and coloured sensor noise that move an output by the largest disturbance that counts as noise."""
    record, n, largest = problem.record, len(problem.plant.states), problem.largest_disturbance
    _, C = output_jacobian(problem.nominal_model.bind(np.zeros((0, 1))), smoothed.x, problem.scale)
    places = problem.rows_of_balances
    push = record.dt * np.eye(n)[:, places]
    gain = gain_of_forces(recursion_band(smoothed.A, record.starts), push, C, record.starts, record.spread)
    seen = np.isfinite(gain) & (gain > 0)
    force = np.where(seen, largest / np.where(seen, gain, 1.0), 10 * problem.rate[places])
    return force, largest * record.spread


def build_trajectory(
    plant: Plant, record: Record, free: tuple[str, ...], labels: Sequence[object], known: KnownParameters | None = None
) -> TrajectoryBackend:
    """The simulator's own runs, the linear surrogate learned from them, and what initial states move.

    SimulationDiverged where a run of the simulator alone does not stay finite.
    """
    simulations = Simulations(plant, record)
    nominal = simulations.simulated(record.u, {}, None)
    if not np.all(np.isfinite(nominal)):
        raise divergence(plant, record, nominal, labels)
    own, x0 = getattr(plant.simulator, "x0", None), None
    if own is not None and np.size(own):
        x0 = np.repeat(np.asarray(own, dtype=float).reshape(1, -1), len(record.starts), axis=0)
    sd = noise_of_differences(record.y, record.starts, record.known, record.t)
    surrogate = learn(record, nominal)
    none = np.zeros((len(sd), 0, record.n_samples))
    problem = TrajectoryBackend(
        simulations, sd, nominal, surrogate, free, none, x0 is not None, x0, known=known or KnownParameters()
    )
    return problem.renewed()
