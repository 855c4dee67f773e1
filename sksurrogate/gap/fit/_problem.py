"""The problem of a diagnosis: plant, record and noise, and how any set of effects is fitted to them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from sksurrogate.effects._effect import BaseEffect
from sksurrogate.effects._model import AugmentedModel
from sksurrogate.kernels.banded import first_order_scan, recursion_band, solve_recursion
from sksurrogate.kernels.disturbance import Disturbance, Noise
from sksurrogate.kernels.output_error import (
    Fit,
    Linearised,
    free_run,
    linearise,
    output_error,
    run_near,
    settle_hidden,
)
from sksurrogate.kernels.record import Record
from sksurrogate.kernels.smoother import Smoothed, noise_of_differences, output_jacobian, smooth
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._simulator import Plant

__all__ = ["LARGEST_DISTURBANCE", "PRIOR", "Candidate", "Numerics", "Problem", "build_problem", "nominal_run"]

#: Standard deviation of the prior on the relative change of a free parameter; its tails are those of Student's t.
PRIOR = 0.10
#: Largest error of the integrator over one sample, in units of the size of the states.
LOCAL_ERROR = 2e-5
#: A disturbance that moves an output by more than this share of its deviation is not waved through as noise.
LARGEST_DISTURBANCE = 0.10
#: A force is quiet that moves no output by more than this share of its noise, and is below this share of the RMS of dx/dt.
QUIET, QUIET_FORCE = 0.05, 1e-3
#: A parameter further than this factor (log) from nominal is out of the question.
FARTHEST = 4.0


@dataclass(frozen=True)
class Numerics:
    """How a free run is integrated.

    Attributes
    ----------
    n_sub : int
        Substeps a sample.
    sharpness : float
        Kinks are smoothed over a variable's size divided by it.
    """

    n_sub: int
    sharpness: float = 50.0


@dataclass(frozen=True, eq=False)
class Candidate:
    """A set of effects fitted through the free run; one that is fitted again is another.

    Attributes
    ----------
    problem : Problem
        What it was fitted to, and with which numerics.
    effects : tuple of BaseEffect
    model : AugmentedModel
    fit : Fit
    """

    problem: Problem
    effects: tuple[BaseEffect, ...]
    model: AugmentedModel
    fit: Fit

    @property
    def keys(self) -> tuple[tuple[str, str | None, str | None], ...]:
        """Keys of the effects."""
        return tuple(effect.key for effect in self.effects)

    @property
    def n_parameters(self) -> int:
        """Parameters of the effects, without re-tuned ones."""
        return sum(len(effect.parameters) for effect in self.effects)

    def slice_of(self, i: int) -> slice:
        """Where the parameters of effect i stand."""
        return self.model.slice_of(i)

    def theta_of(self, i: int) -> np.ndarray:
        """Parameters of effect i."""
        return self.fit.theta[self.slice_of(i)]

    def without_effect(self, i: int) -> tuple[tuple[BaseEffect, ...], np.ndarray]:
        """The other effects, and all parameters but those of effect i."""
        keep = np.ones(len(self.fit.theta), bool)
        keep[self.slice_of(i)] = False
        return tuple(e for j, e in enumerate(self.effects) if j != i), self.fit.theta[keep]

    @cached_property
    def linearised(self) -> Linearised:
        """Sensitivities at the solution."""
        if self.fit.linearised is not None:
            return self.fit.linearised
        unit = self.problem.units(self.effects, self.fit.theta)
        with np.errstate(all="ignore"):
            return linearise(self.model, self.fit.theta, self.fit.x, unit)

    @cached_property
    def disturbance(self) -> Disturbance:
        """Noise model along the free run."""
        problem, fit = self.problem, self.fit
        return problem.disturbance_along(self.model, fit.theta, fit.x, self.linearised.A, problem.balances)


@dataclass(frozen=True, eq=False)
class Problem:
    """Everything that the questions of a diagnosis share.

    Attributes
    ----------
    plant : Plant
    model : PlantModel
    record : Record
    sd : ndarray (n_outputs,)
        Sensor noise, first estimate.
    scale : ndarray (n_states,)
        Size of the states.
    rate : ndarray (n_states,)
        RMS of their derivatives.
    free : tuple of str
        Parameters that are re-tuned with every rival.
    balances : tuple of str
        States whose balance may be wrong.
    numerics : Numerics
    caps : (ndarray (n_balances,), ndarray (n_outputs,))
        Largest force of every balance and coloured noise of every sensor that count as disturbance.
    run : ndarray (n_states, n_samples), optional
        States of the simulator alone, measured ones begun at their first readings.
    """

    plant: Plant
    model: PlantModel
    record: Record
    sd: np.ndarray
    scale: np.ndarray
    rate: np.ndarray
    free: tuple[str, ...]
    balances: tuple[str, ...]
    numerics: Numerics
    caps: tuple[np.ndarray, np.ndarray] | None = None
    run: np.ndarray | None = None

    def augmented(self, effects: Sequence[BaseEffect]) -> AugmentedModel:
        """The plant with effects over the record."""
        n_sub, sharpness = self.numerics.n_sub, self.numerics.sharpness
        return AugmentedModel(
            self.model, effects, self.free, self.record, n_sub=n_sub, scale=self.scale, sharpness=sharpness
        )

    def candidate(self, effects: Sequence[BaseEffect], fit: Fit, model: AugmentedModel | None = None) -> Candidate:
        """Effects at values that are known."""
        return Candidate(self, tuple(effects), self.augmented(effects) if model is None else model, fit)

    def at(self, numerics: Numerics) -> Problem:
        """The same problem with other numerics."""
        return self if numerics == self.numerics else replace(self, numerics=numerics)

    def on(self, runs: Sequence[int]) -> Problem:
        """The same problem on some of the runs."""
        return replace(self, record=self.record.select(runs))

    @property
    def rigid(self) -> np.ndarray:
        """Kinematic rows, in which no balance can be wrong."""
        return np.array([name not in self.balances for name in self.plant.states])

    def smooth(self, model: AugmentedModel, theta: np.ndarray, x: np.ndarray) -> Smoothed:
        """Smoothed trajectory of a model, from a guess of all its states."""
        rigid = np.r_[self.rigid, np.ones(model.n_states - model.n_nominal, bool)]
        with np.errstate(all="ignore"):
            return smooth(
                model.bind(theta[:, None]), self.record.y, self.record.starts, self.sd, x, model.scale, rigid=rigid
            )

    def fit(
        self,
        effects: Sequence[BaseEffect],
        theta: np.ndarray,
        x: np.ndarray,
        *,
        best: float = np.inf,
        open_steps: int = 3,
        max_steps: int = 25,
        settled: bool = False,
        fallback: np.ndarray | None = None,
    ) -> Candidate | None:
        """Fit effects and free parameters (theta in that order) through the free run, from a trajectory x."""
        model = self.augmented(effects)
        with np.errstate(all="ignore"):
            start = x if settled and len(x) == model.n_states else settle_hidden(model, theta, x)
            if fallback is not None:
                fallback = settle_hidden(model, theta, fallback)
            unit = self.units(effects, theta)
            low, high = self.bounds(effects)
            fit: Fit | None = None
            prior = self.prior(effects, theta)
            for repeat in range(3 if self.free else 1):
                fit = output_error(
                    model,
                    theta,
                    start,
                    self.sd,
                    unit=unit,
                    bounds=(low, high),
                    prior=prior,
                    open_steps=0 if repeat else open_steps,
                    max_steps=max_steps,
                    best=best,
                    fallback=fallback,
                )
                if fit is None:
                    return None
                # Student's t as a reweighted Gaussian: few rounds settle it.
                before, prior = prior, self.prior(effects, fit.theta)
                if np.allclose(before, prior, rtol=0.3):
                    break
                theta, start = fit.theta, fit.x
        assert fit is not None
        return self.candidate(effects, fit, model)

    def units(self, effects: Sequence[BaseEffect], theta: np.ndarray) -> np.ndarray:
        """Sizes of the parameters for differences near 0."""
        unit = np.where(np.abs(theta) > 0, np.abs(theta), 1e-3)
        position = 0
        for effect in effects:
            for parameter in effect.parameters:
                if parameter.name in ("phase", "share", "relative_error", "exponent"):
                    unit[position] = max(unit[position], 0.1)
                position += 1
        unit[position:] = [
            1.0 if self.plant.params[name] != 0 else max(abs(v), 1e-2) for name, v in zip(self.free, theta[position:])
        ]
        return unit

    def bounds(self, effects: Sequence[BaseEffect]) -> tuple[np.ndarray, np.ndarray]:
        """Bounds of theta."""
        duration = self.record.dt * float(self.record.lengths.max())
        low = [bound for effect in effects for bound in effect.lower_bounds(duration)]
        high = [p.high for effect in effects for p in effect.parameters]
        for name in self.free:
            nonzero = self.plant.params[name] != 0
            low.append(-FARTHEST if nonzero else -np.inf)
            high.append(FARTHEST if nonzero else np.inf)
        return np.array(low, dtype=float), np.array(high, dtype=float)

    def prior(self, effects: Sequence[BaseEffect], theta: np.ndarray) -> np.ndarray:
        """Standard deviations of the prior on theta: none on effects; Student's t on free parameters, by reweighting."""
        n = sum(len(effect.parameters) for effect in effects)
        out = np.full(len(theta), np.inf)
        retuned = {effect.location for effect in effects if effect.name == "parameter_error"}
        for i, name in enumerate(self.free):
            if self.plant.params[name] != 0 and name not in retuned:
                out[n + i] = np.sqrt(PRIOR**2 + theta[n + i] ** 2 / 2)
            elif name in retuned:
                out[n + i] = 1e-3  # the rival is the same number: the free one stands still
        return out

    # ---- likelihood -------------------------------------------------------------------------------------------------
    def disturbance_along(
        self, model: AugmentedModel, theta: np.ndarray, x: np.ndarray, A: np.ndarray, balances: Sequence[str]
    ) -> Disturbance:
        """Noise model with forces in the given balances, along any trajectory."""
        n = model.n_states
        places = [self.plant.states.index(name) for name in balances]
        # A force that acts over one sample is carried along for half of it on average.
        B = 0.5 * self.record.dt * (A + np.eye(n)[:, :, None])[:, places]
        with np.errstate(all="ignore"):
            _, C = output_jacobian(model.bind(theta[:, None]), x, model.scale)
        start_sd = np.where(model.free_states, 3.0 * model.scale, 1e-3 * model.scale)
        return Disturbance(A, B, C, self.record.starts, start_sd, 1e-3 * model.closing_weight(self.sd))

    def first_noise(self) -> Noise:
        """Where the noise parameters start."""
        places = [self.plant.states.index(name) for name in self.balances]
        return Noise(self.sd.copy(), 0.01 * self.rate[places] + 1e-300, 10.0, 0.1 * self.sd, 10.0)

    def force_unit(self) -> np.ndarray:
        """RMS of dx/dt of every balance."""
        return self.rate[[self.plant.states.index(name) for name in self.balances]]

    def quiet_force(self) -> np.ndarray:
        """Force of every balance that moves no output by more than :data:`QUIET` of its noise."""
        unit = self.force_unit()
        if self.caps is None:
            return QUIET_FORCE * unit
        spread = np.maximum(np.std(self.record.y, axis=1), 1e-300)
        return np.minimum(QUIET * self.caps[0] * np.min(self.sd / spread) / LARGEST_DISTURBANCE, QUIET_FORCE * unit)

    def quiet(self, noise: Noise) -> Noise:
        """A noise with quiet forces and sensors as white as differences of the outputs show them."""
        return replace(noise, sigma=self.sd, force=self.quiet_force(), coloured=1e-2 * self.sd)


def nominal_run(problem: Problem) -> np.ndarray:
    """States (n_states, n_samples) of the simulator alone, every run from its own initial state."""
    nominal = problem.augmented(())
    start = np.repeat(problem.plant.x0[:, None], len(problem.record.starts), axis=1)
    with np.errstate(all="ignore"):
        return free_run(nominal, np.zeros(nominal.n_theta), start)


def run_from_readings(plant: Plant, model: PlantModel, record: Record) -> np.ndarray:
    """States (n_states, n_samples) of the simulator alone, measured ones begun at their first readings."""
    near = np.repeat(plant.x0[:, None], record.n_samples, axis=1)
    for j, i in enumerate(plant.output_states or ()):
        near[i] = record.y[j]
    nominal = AugmentedModel(model, (), (), record, n_sub=2, scale=sizes(near))
    with np.errstate(all="ignore"):
        return run_near(nominal, np.zeros(0), near)


def measured_guess(plant: Plant, record: Record, run: np.ndarray) -> np.ndarray:
    """States (n_states, n_samples): measured ones as measured, others from the nominal free run or the initial state."""
    guess = np.repeat(plant.x0[:, None], record.n_samples, axis=1)
    finite = np.isfinite(run).all(axis=0)
    guess[:, finite] = run[:, finite]
    for j, i in enumerate(plant.output_states or ()):
        guess[i] = record.y[j]
    return guess


def sizes(guess: np.ndarray) -> np.ndarray:
    """Size of every state along a guess: its deviation, or a share of its level where it hardly moves."""
    spread = np.std(guess, axis=1)
    level = np.sqrt(np.mean(guess**2, axis=1))
    scale = np.maximum(spread, 0.02 * level)
    return np.where(scale > 0, scale, 1.0)


def substeps(x: np.ndarray, weight: np.ndarray, make: Any) -> int:
    """Fewest substeps whose error in one sample stays a hundredth of the noise (98 % of the samples)."""
    for n_sub in (1, 2, 4, 8, 16):
        coarse, fine = make(n_sub).bind(np.zeros((0, 1))), make(2 * n_sub).bind(np.zeros((0, 1)))
        error = np.abs(coarse(x[:, None])[:, 0] - fine(x[:, None])[:, 0]) / weight[:, None]
        finite = np.isfinite(error).all(axis=0)
        if finite.mean() > 0.98 and np.quantile(np.max(error[:, finite], axis=0), 0.98) < 0.01:
            return n_sub
    return 16


def build_problem(
    plant: Plant, model: PlantModel, record: Record, free: Sequence[str], balances: Sequence[str]
) -> tuple[Problem, Smoothed]:
    """Noise, sizes, substeps and the smoothed trajectory of the nominal plant.

    Returns
    -------
    problem : Problem
    smoothed : Smoothed
    """
    sd = noise_of_differences(record.y, record.starts)
    with np.errstate(all="ignore"):
        run = run_from_readings(plant, model, record)
        guess = measured_guess(plant, record, run)
        scale = sizes(guess)
        problem = Problem(
            plant, model, record, sd, scale, scale / record.dt, tuple(free), tuple(balances), Numerics(2), run=run
        )
        nominal = replace(problem, free=()).augmented(())
        smoothed = problem.smooth(nominal, np.zeros(0), guess)
        scale = np.maximum(sizes(smoothed.x), 0.02 * scale)
        rate = np.sqrt(np.mean(((smoothed.x[:, 1:] - smoothed.x[:, :-1]) / record.dt) ** 2, axis=1))
        n_sub = substeps(
            smoothed.x,
            np.minimum(nominal.closing_weight(sd), LOCAL_ERROR * 100 * scale),
            lambda n: AugmentedModel(model, (), (), record, n_sub=n, scale=scale),
        )
        problem = replace(
            problem, scale=scale, rate=np.maximum(rate, 1e-9 * scale / record.dt), numerics=Numerics(n_sub)
        )
        return replace(problem, caps=_caps(problem, smoothed)), smoothed


def _caps(problem: Problem, smoothed: Smoothed) -> tuple[np.ndarray, np.ndarray]:
    """Forces and coloured sensor noise that move an output by :data:`LARGEST_DISTURBANCE` of its deviation."""
    record, n = problem.record, len(problem.plant.states)
    nominal = replace(problem, free=()).augmented(())
    _, C = output_jacobian(nominal.bind(np.zeros((0, 1))), smoothed.x, problem.scale)
    band = recursion_band(smoothed.A, record.starts)
    rng = np.random.default_rng(0)
    force = np.empty(len(problem.balances))
    spread = np.maximum(np.std(record.y, axis=1), 1e-300)
    for k, name in enumerate(problem.balances):
        a = np.exp(-1 / 10.0)
        w = first_order_scan(a, np.sqrt(1 - a * a) * rng.normal(size=record.n_samples), record.starts)
        b = np.zeros((n, 1, record.n_samples))
        b[problem.plant.states.index(name), 0, 1:] = record.dt * w[:-1]
        b[:, :, record.starts] = 0.0
        moved = np.einsum("oit,it->ot", C, solve_recursion(band, b)[:, 0])
        gain = float(np.max(np.std(moved, axis=1) / spread))
        force[k] = (
            LARGEST_DISTURBANCE / gain
            if np.isfinite(gain) and gain > 0
            else 10 * problem.rate[problem.plant.states.index(name)]
        )
    return force, LARGEST_DISTURBANCE * spread
