"""Candidates fitted through the free run of a right-hand side or of a step."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from sksurrogate.effects._base_effect import BaseEffect
from sksurrogate.effects._model import AugmentedModel
from sksurrogate.effects._smooth import KINK_SHARPNESS
from sksurrogate.effects._structure import largest_gains
from sksurrogate.gap.fit._backend import Backend, BaseCandidate
from sksurrogate.gap.fit._closeness import FAR_BY_COST, worth_following
from sksurrogate.gap.fit._coordinates import coordinates_of
from sksurrogate.gap.fit._known_parameters import KnownParameters
from sksurrogate.gap.fit._neighbours import Neighbours
from sksurrogate.gap.fit._normal_equations import StartBasis, project_in_place, start_bases
from sksurrogate.gap.fit._pushes import REMEMBERED
from sksurrogate.gap.fit._recent import recent_property
from sksurrogate.kernels.arrow import Arrow
from sksurrogate.kernels.disturbance import Disturbance, Noise
from sksurrogate.kernels.free_runs import settle_hidden
from sksurrogate.kernels.linearised import Linearised, linearise
from sksurrogate.kernels.output_error import Fit, output_error
from sksurrogate.kernels.record import Record
from sksurrogate.kernels.smoother import Smoothed, output_jacobian, smooth
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._simulator import Plant

#: A force is quiet that moves no output by more than this share of its noise, and is below this share of the RMS of dx/dt.
QUIET_OUTPUT, QUIET_FORCE = 0.05, 1e-3
#: Steps of the parameters of an effect or of a formula, over their size, that slopes are good for.
REACH = 1.0
#: Steps that change the comparison by size by less than so many nats lead a fit that is far from the data nowhere.
IDLE_NATS = 0.1
#: Forces that a noise fit may start from, over the RMS of dx/dt.
FORCES = (1e-3, 1e-2, 1e-1)
#: Candidates that keep their linearisation: as many as one round compares.
MOST_KEPT = 32
#: Candidates that keep their noise model, which is as large as ten sensitivities and quickly made of them.
FEW_KEPT = 4
#: A step by less than this share leaves the slopes of a simulator that steps as they are: they cost as much as many of its runs.
SAME_SLOPES = 2e-3
#: Steps of a fit, and of one that goes on from another: with finer numerics, or without a fold of runs. Re-tuning alone of a simulator
#: that steps has as few: all its parameters are many columns, and its figure only stands beside the diagnosis.
FIT_STEPS, REFIT_STEPS = 25, 8


def slopes_last(model: AugmentedModel) -> dict[str, Any]:
    """How far slopes of a model serve: not at all where they cost as much as a few runs."""
    return {"near": SAME_SLOPES if model.may_jump else 0.0, "lead_on": model.runs_at_once}


@dataclass(frozen=True)
class Numerics:
    """How a free run is integrated."""

    n_sub: int  #: Substeps a sample
    sharpness: float = 50.0  #: Kinks are smoothed over a variable's size divided by it
    rounded: bool = False  #: Whether this width is the plant's own, and fitted

    def finer(self, n_sub: int, sharpness: float) -> Numerics:
        """With so many substeps, and with sharper kinks where their width is not the plant's own."""
        return replace(self, n_sub=n_sub, sharpness=self.sharpness if self.rounded else sharpness)


@dataclass(frozen=True, eq=False)
class OdeCandidate(BaseCandidate):
    """A set of effects fitted through the free run of a right-hand side."""

    fit: Fit
    problem: OdeBackend  #: What it was fitted to, and with which numerics
    model: AugmentedModel

    @recent_property(MOST_KEPT)
    def linearised(self) -> Linearised:
        """Sensitivities at the solution."""
        if self.fit.linearised is not None:
            return self.fit.linearised
        unit = self.problem.units(self.effects, self.fit.theta)
        with np.errstate(all="ignore"):
            return linearise(self.model, self.fit.theta, self.fit.x, unit).kept()

    def along(self, x: np.ndarray) -> OdeCandidate:
        """As its free run is to first order about a path of all its states (n_states, n_samples)."""
        lin = linearise(self.model, self.fit.theta, x, self.problem.units(self.effects, self.fit.theta))
        return replace(self, fit=Fit(self.fit.theta, x, lin.y, np.inf, 0, True, lin))

    @recent_property(FEW_KEPT)
    def disturbance(self) -> Disturbance:
        problem, fit = self.problem, self.fit
        return problem.disturbance_along(self.model, fit.theta, fit.x, self.linearised.A, problem.balances)

    @property
    def sensitivities(self) -> np.ndarray:
        return self.linearised.J_theta

    def columns(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Residual, sensitivities, and what holds a step of the parameters: its precision, and the pull of their prior.

        A prediction that jumps with a parameter has no slope to be followed: its sensitivity counts as none. Steps beyond
        the size of an effect's parameter are held back: there the slopes say nothing, and parameters that only act
        together, as a level and a velocity far beyond the data, would explain to first order what the effect cannot.
        """
        J = self.linearised.J_theta
        for i, effect in enumerate(self.effects):
            if effect.scan(tuple(self.theta_of(i))):
                J = J.copy()
                J[:, self.slice_of(i)] = 0.0
        theta, (precision, pull) = self.fit.theta, self.step_prior
        reach = np.where((theta != 0) & (np.arange(len(theta)) < self.n_parameters), np.abs(theta), np.inf)
        return self.residual, J, precision + (REACH * reach) ** -2.0, pull

    @recent_property(MOST_KEPT)
    def start_bases(self) -> list[StartBasis]:
        """What the initial states of every run can move, over the noise."""
        return self._bases_from(self.problem.record.starts)

    def _bases_from(self, starts: np.ndarray) -> list[StartBasis]:
        J_x = self.linearised.J_x[:, self.model.free_states] * (1.0 / self.problem.sd[:, None, None])
        return list(start_bases(J_x, starts, J_x.shape[-1]))

    @property
    def path(self) -> np.ndarray:
        return self.fit.x

    @property
    def states(self) -> np.ndarray:
        """Of the plant along the free run (n_states, n_samples), without those of the effects' own."""
        return self.fit.x[: self.model.n_nominal]

    @property
    def n_starts(self) -> int:
        return int(np.sum(self.model.free_states)) * len(self.problem.record.starts)

    def without_starts(self, columns: np.ndarray, starts: np.ndarray | None = None) -> np.ndarray:
        white = np.ascontiguousarray(self.problem.record.seen(columns) * (1.0 / self.problem.sd[:, None]))
        project_in_place(white, self.start_bases if starts is None else self._bases_from(starts))
        return white

    def frozen(self, theta: np.ndarray, *, near: bool = False) -> OdeCandidate | None:
        """Free run at fixed parameters with the initial states fitted; ``near`` this one, to which it falls back."""
        fit = output_error(
            self.model, theta, self.fit.x, self.problem.sd, unit=self.problem.units(self.effects, theta), bounds=(theta, theta),
            open_steps=1, max_steps=6, fallback=self.fit.x if near else None, **slopes_last(self.model),
        )  # fmt: skip
        return None if fit is None else replace(self, fit=fit)

    def taken_out(self, i: int) -> OdeCandidate | None:
        rest, theta = self.without_effect(i)
        model, x = self.problem.augmented(rest), self.states
        if model.n_states > model.n_nominal:
            x = settle_hidden(model, theta, x)
        return self.problem.candidate(rest, replace(self.fit, theta=theta, x=x), model).frozen(theta)

    def at_nominal(self) -> OdeCandidate | None:
        return self.frozen(np.r_[self.fit.theta[: self.n_parameters], np.zeros(len(self.problem.free))])

    def fitted_as(self, effects: tuple[BaseEffect, ...], theta: np.ndarray | None = None) -> OdeCandidate | None:
        return self.problem.fit(effects, self.fit.theta if theta is None else theta, self.fit.x, open_steps=0)

    def refitted(self, record: Record) -> OdeCandidate | None:
        return replace(self.problem, record=record).fit(self.effects, self.fit.theta, self.fit.x, settled=True)

    def resumed(
        self, problem: OdeBackend, theta: np.ndarray | None = None, max_steps: int = REFIT_STEPS
    ) -> OdeCandidate | None:
        """Its fit continued in a problem of the same runs, from these values of the parameters or its own."""
        theta = self.fit.theta if theta is None else theta
        return problem.fit(self.effects, theta, self.fit.x, open_steps=0, max_steps=max_steps, settled=True)

    def left_out(self, record: Record, train: np.ndarray, test: np.ndarray) -> np.ndarray | None:
        problem, theta = replace(self.problem, record=record), self.fit.theta
        with np.errstate(all="ignore"):
            if len(theta) and len(train):
                refit = self.on_some(problem.on(train.tolist()), np.isin(record.run_of_row, train))
                theta = refit.fit.theta if refit is not None else theta
            fit = replace(self.fit, x=self.fit.x[:, np.isin(record.run_of_row, test)], theta=theta)
            there = problem.on(test.tolist()).candidate(self.effects, fit).frozen(theta, near=True)
        return None if there is None else there.fit.y  # near: behind a limit initial states are hardly seen

    def on_some(self, some: OdeBackend, rows: np.ndarray) -> OdeCandidate | None:
        """Fitted to some of the runs, first from where one Gauss-Newton step leads.

        Where that fit leaves more of these runs than the fit to all did, it is repeated from the values of the fit to all.
        """
        before = float(np.sum((self.problem.record.residual(self.fit.y)[:, rows] / some.sd[:, None]) ** 2))
        for theta, x in (self.without_rows(some, rows), (self.fit.theta, self.fit.x[:, rows])):
            refit = some.fit(self.effects, theta, x, open_steps=0, max_steps=REFIT_STEPS, settled=True)
            if refit is not None and refit.fit.cost <= before:
                break
        return refit

    def without_rows(self, some: OdeBackend, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Parameters and path that some of the runs lead to: one Gauss-Newton step with the sensitivities of all.

        Those of all where the step goes further than the slopes are good for.
        """
        residual, J, _, _ = self.columns()
        J_x, x, free = self.linearised.J_x[..., rows], self.fit.x[:, rows].copy(), self.model.free_states
        starts, theta = some.record.starts, self.fit.theta
        arrow = Arrow.build(J[..., rows], J_x[:, free], residual[:, rows], some.sd, starts, *self.step_prior)
        dtheta, dx, _ = arrow.step(0.0)
        small = np.all(np.abs(dtheta) <= REACH * self.problem.units(self.effects, theta))
        if not (small and np.isfinite(dx).all()):
            return theta, x
        x[np.ix_(free, starts)] += dx
        return some.within(self.effects, theta + dtheta), x

    def numerical_change(self) -> np.ndarray:
        """How far the parameters move when the steps are halved and kinks made sharper."""
        problem, numerics, theta = self.problem, self.problem.numerics, self.fit.theta
        finer = problem.at(numerics.finer(2 * numerics.n_sub, 2 * numerics.sharpness))
        fits = [self.resumed(at, max_steps=6) for at in (finer, problem)]
        if fits[0] is None or fits[1] is None:
            return np.zeros(len(theta))
        return np.abs(fits[0].fit.theta - fits[1].fit.theta)

    def initial_states(self) -> np.ndarray:
        return self.states[:, self.problem.record.starts].T

    @property
    def signals(self) -> dict[str, np.ndarray]:
        plant = self.problem.plant
        return {**dict(zip(plant.inputs, self.problem.record.u)), **dict(zip(plant.states, self.fit.x))}

    def untuned(self) -> OdeCandidate | None:
        return replace(self.problem, free=()).fit((), np.zeros(0), self.fit.x)

    def baselines(self, record: Record) -> tuple[OdeCandidate, OdeCandidate | None]:
        whole = replace(self.problem, record=record)
        nominal = replace(whole, free=()).candidate((), replace(self.fit, theta=np.zeros(0)))
        names, known = tuple(whole.plant.params), dict(zip(whole.free, self.fit.theta))
        theta = np.array([known.get(name, 0.0) for name in names])
        steps = REFIT_STEPS if self.model.may_jump else FIT_STEPS
        return nominal, replace(whole, free=names).fit((), theta, self.fit.x, max_steps=steps) if names else None


@dataclass(frozen=True, eq=False)
class OdeBackend(Backend):
    """Everything that the questions of a diagnosis share."""

    model: PlantModel
    record: Record
    sd: np.ndarray
    scale: np.ndarray  #: (n_states,): size of the states
    rate: np.ndarray  #: (n_states,): RMS of their derivatives
    free: tuple[str, ...]
    balances: tuple[str, ...]  #: States whose balance may be wrong
    numerics: Numerics
    caps: tuple[np.ndarray, np.ndarray] | None = None
    #: (n_states, n_samples): states of the simulator alone, measured ones started at their first readings
    run: np.ndarray | None = None
    known: KnownParameters = field(default_factory=KnownParameters)
    near: Neighbours = field(default_factory=dict)  #: States near each balance of a large plant

    @property
    def plant(self) -> Plant:  # type: ignore[override]
        return self.model.plant

    @property
    def nominal_model(self) -> AugmentedModel:
        """The simulator alone, its parameters as they are."""
        return replace(self, free=()).augmented(())

    @property
    def sharpness(self) -> float:  # type: ignore[override]
        return self.numerics.sharpness if self.numerics.rounded else KINK_SHARPNESS

    def augmented(self, effects: Sequence[BaseEffect]) -> AugmentedModel:
        """The plant with effects over the record."""
        n_sub, sharpness = self.numerics.n_sub, self.numerics.sharpness
        return AugmentedModel(
            self.model, effects, self.free, self.record, n_sub=n_sub, scale=self.scale, sharpness=sharpness
        )

    def candidate(self, effects: Sequence[BaseEffect], fit: Fit, model: AugmentedModel | None = None) -> OdeCandidate:
        """Effects at values that are known."""
        return OdeCandidate(tuple(effects), fit, self, self.augmented(effects) if model is None else model)

    def at(self, numerics: Numerics) -> OdeBackend:
        """The same problem with other numerics."""
        return self if numerics == self.numerics else replace(self, numerics=numerics)

    def on(self, runs: Sequence[int]) -> OdeBackend:
        """The same problem on some of the runs."""
        return replace(self, record=self.record.select(runs))

    def signals_along(self, x: np.ndarray) -> dict[str, np.ndarray]:
        """States along a path (n_states, n_samples), and inputs, by name."""
        return {**dict(zip(self.plant.states, x)), **dict(zip(self.plant.inputs, self.record.u))}

    def port_rate(self, name: str) -> float:
        """Size of what enters at a port that makes the rates of the states which it moves most: the least of rate over gain."""
        gain = largest_gains(self.model)[:, self.plant.ports.index(name)]
        moved = np.array([state in self.balances for state in self.plant.states]) & (gain > 0)
        return float(np.min(self.rate[moved] / gain[moved])) if moved.any() else 0.0

    @property
    def rows_of_balances(self) -> list[int]:
        """Places of the balances among the states."""
        return [self.plant.states.index(name) for name in self.balances]

    def smooth(self, model: AugmentedModel, theta: np.ndarray, x: np.ndarray) -> Smoothed:
        """Smoothed trajectory of a model, from a guess of all its states."""
        rigid, record = np.ones(model.n_states, bool), self.record
        rigid[self.rows_of_balances] = False  # in others no balance can be wrong
        with np.errstate(all="ignore"):
            bound = model.bind(theta[:, None])
            return smooth(bound, record.y, record.starts, self.sd, x, model.scale, rigid=rigid, known=record.known)

    def fit(
        self,
        effects: Sequence[BaseEffect],
        theta: np.ndarray,
        x: np.ndarray,
        *,
        best: float = np.inf,
        open_steps: int = 3,
        max_steps: int = FIT_STEPS,
        settled: bool = False,
        fallback: np.ndarray | None = None,
    ) -> OdeCandidate | None:
        """Fit effects and free parameters (theta in that order) through the free run, from a trajectory x."""
        model = self.augmented(effects)
        with np.errstate(all="ignore"):
            start = x if settled and len(x) == model.n_states else settle_hidden(model, theta, x)
            if fallback is not None:
                fallback = settle_hidden(model, theta, fallback)
            unit = self.units(effects, theta)
            low, high = self.bounds(effects)
            fell_back = False
            centre, prior = self.prior(effects, theta)
            steps = coordinates_of(effects, model.slice_of, self.signals_along(start))
            for repeat in range(3 if self.free else 1):
                found = output_error(
                    steps.model(model),
                    steps.of(theta),
                    start,
                    self.sd,
                    unit=steps.of(unit, theta),
                    bounds=(steps.of(low, theta), steps.of(high, theta)),
                    within=partial(steps.within, partial(self.within, effects)),
                    prior=steps.of(prior, theta),
                    centre=steps.of(centre, theta),
                    open_steps=0 if repeat else open_steps,
                    max_steps=max_steps,
                    most=worth_following(best, self.record.n_values),
                    fallback=fallback,
                    **slopes_last(model),
                    idle=0.0 if settled else IDLE_NATS * 2 * REMEMBERED / self.record.n_values,
                    idle_above=FAR_BY_COST * self.record.n_values,
                )
                if found is None:
                    return None
                fit = steps.in_parameters(found)
                fell_back = fell_back and not fit.fell_back if repeat else fit.fell_back  # the first alone
                # Student's t as a reweighted Gaussian: few rounds settle it.
                before, (centre, prior) = prior, self.prior(effects, fit.theta)
                if np.allclose(before, prior, rtol=0.3):
                    break
                theta, start = fit.theta, fit.x
        return self.candidate(effects, replace(fit, fell_back=fell_back), model)

    def units(self, effects: Sequence[BaseEffect], theta: np.ndarray) -> np.ndarray:
        """Sizes of the parameters for differences near 0."""
        unit = np.where(np.abs(theta) > 0, np.abs(theta), 1e-3)
        names = [parameter.name for effect in effects for parameter in effect.parameters]
        some = [k for k, name in enumerate(names) if name in ("phase", "share", "relative_error", "exponent")]
        unit[some], n = np.maximum(unit[some], 0.1), len(names)
        unit[n:] = [1.0 if self.plant.params[name] != 0 else max(abs(v), 1e-2) for name, v in zip(self.free, theta[n:])]
        return unit

    # ---- likelihood -------------------------------------------------------------------------------------------------
    def disturbance_along(
        self, model: AugmentedModel, theta: np.ndarray, x: np.ndarray, A: np.ndarray, balances: Sequence[str]
    ) -> Disturbance:
        """Noise model with forces in the given balances, along any trajectory."""
        n = model.n_states
        places = [self.plant.states.index(name) for name in balances]
        # A force that acts over one sample is carried along for half of it on average.
        steps = self.record.dt if self.record.steps is None else self.record.steps
        B = 0.5 * steps * (A + np.eye(n)[:, :, None])[:, places]
        with np.errstate(all="ignore"):
            _, C = output_jacobian(model.bind(theta[:, None]), x, model.scale)
        start_sd = np.where(model.free_states, 3.0 * model.scale, 1e-3 * model.scale)
        slack = 1e-3 * model.closing_weight(self.sd)
        return Disturbance(A, B, C, self.record.starts, start_sd, slack, self.record.known)

    def first_noise(self) -> Noise:
        return Noise(self.sd.copy(), 0.01 * self.force_unit() + 1e-300, REMEMBERED, 0.1 * self.sd, REMEMBERED)

    def force_unit(self) -> np.ndarray:
        """RMS of dx/dt of every balance."""
        return self.rate[self.rows_of_balances]

    def forced_noises(self, start: Noise) -> list[Noise]:
        """Forces of three sizes."""
        quiet = replace(self.white_sensors(start), tau=REMEMBERED)
        return [replace(quiet, force=share * self.force_unit()) for share in FORCES]

    def quiet_force(self) -> np.ndarray:
        """Force of every balance that moves no output by more than :data:`QUIET_OUTPUT` of its noise."""
        unit = self.force_unit()
        if self.caps is None:
            return QUIET_FORCE * unit
        return np.minimum(
            QUIET_OUTPUT * self.caps[0] * np.min(self.sd / self.record.spread) / self.largest_disturbance,
            QUIET_FORCE * unit,
        )

    def quiet(self, noise: Noise) -> Noise:
        """A noise with white sensors and quiet forces."""
        return replace(self.white_sensors(noise), force=self.quiet_force())
