"""Candidates fitted around a simulator that only gives trajectories: before it, behind it, in its parameters.

Runs that were simulated are kept, sensor effects need none, slopes are taken once and carried along by Broyden's update, and
a linear surrogate orders the candidates.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from sksurrogate.effects._base_effect import BaseEffect
from sksurrogate.gap.fit._backend import Backend, BaseCandidate
from sksurrogate.gap.fit._known_parameters import PRIOR, KnownParameters
from sksurrogate.gap.fit._linear_surrogate import LinearSurrogate
from sksurrogate.gap.fit._normal_equations import project_starts, solve
from sksurrogate.gap.fit._pushes import COARSE_STEP, REMEMBERED
from sksurrogate.gap.fit._simulations import Simulations
from sksurrogate.kernels.disturbance import Disturbance, Noise
from sksurrogate.kernels.record import Record
from sksurrogate.physics._simulator import Plant

#: Steps of a fit.
STEPS = 10
#: Relative change of the parameters up to which a prediction is taken as linear in them.
LINEAR = 0.05
NO_PARAMETERS = np.zeros(0)


@dataclass(frozen=True, eq=False)
class TrajectoryFit:
    """A free run through ``simulate`` with fitted parameters."""

    theta: np.ndarray  #: Parameters of the effects in turn, then a number for every free parameter
    y: np.ndarray  #: (n_outputs, n_samples)
    J: np.ndarray  #: (n_outputs, n_theta, n_samples)
    cost: float


@dataclass(frozen=True, eq=False)
class TrajectoryCandidate(BaseCandidate):
    """A set of effects fitted through ``simulate``."""

    fit: TrajectoryFit
    problem: TrajectoryBackend
    white_alone = False

    @cached_property
    def residual(self) -> np.ndarray:
        """Measured less simulated, initial states fitted where they are free."""
        return self.problem.record.residual(self.problem.settled(self.fit.y))

    @property
    def sensitivities(self) -> np.ndarray:
        return self.fit.J

    @property
    def disturbance(self) -> Disturbance:
        """A force on every state of the linear surrogate, coloured sensor noise, white noise."""
        return self.problem.disturbance

    def columns(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        return self.residual, self.fit.J, *self.step_prior

    @property
    def n_starts(self) -> int:
        return len(self.problem.record.starts) * self.problem.transients.shape[1] * self.problem.free_starts

    def without_starts(self, columns: np.ndarray, starts: np.ndarray | None = None) -> np.ndarray:
        return self.problem.without_starts(columns, starts)

    def taken_out(self, i: int) -> TrajectoryCandidate | None:
        J = np.delete(self.fit.J, self.slice_of(i), axis=1)
        return self.with_values(*self.without_effect(i), J)

    def at_nominal(self) -> TrajectoryCandidate | None:
        nominal = np.zeros(len(self.problem.free))
        return self.with_values(self.effects, np.r_[self.fit.theta[: self.n_parameters], nominal], self.fit.J)

    def fitted_as(self, effects: tuple[BaseEffect, ...], theta: np.ndarray | None = None) -> TrajectoryCandidate | None:
        return self.problem.fit(effects, self.fit.theta if theta is None else theta, self.fit.J.transpose(1, 0, 2))

    def with_values(
        self, effects: tuple[BaseEffect, ...], theta: np.ndarray, J: np.ndarray
    ) -> TrajectoryCandidate | None:
        """Effects at values that are known, with sensitivities near to theirs; None where they have no finite run."""
        y = self.problem.outputs(effects, theta)
        fit = TrajectoryFit(theta, y, J, self.problem.cost_of(y))
        return replace(self, effects=effects, fit=fit) if np.all(np.isfinite(y)) else None

    @property
    def signals(self) -> dict[str, np.ndarray]:
        plant, record = self.problem.plant, self.problem.record
        return {**dict(zip(plant.inputs, record.u)), **dict(zip(plant.outputs, record.y))}

    def untuned(self) -> TrajectoryCandidate:
        """The simulator as it is."""
        problem = replace(self.problem, free=())
        empty = np.zeros((len(problem.sd), 0, problem.record.n_samples))
        nominal = problem.simulations.at_stamps(problem.nominal)
        return TrajectoryCandidate((), TrajectoryFit(NO_PARAMETERS, nominal, empty, np.inf), problem)

    def baselines(self, record: Record) -> tuple[TrajectoryCandidate, TrajectoryCandidate | None]:
        names = tuple(self.problem.plant.params)
        free = self.problem.free if len(self.problem.free) == len(names) else names
        tuned = replace(self.problem, free=free).fit((), np.zeros(len(free))) if names else None
        return self.untuned(), tuned

    def refitted(self, record: Record) -> TrajectoryCandidate | None:
        simulations = replace(self.problem.simulations, record=record, kept={})
        problem = replace(self.problem, simulations=simulations)
        try:
            return problem.fit(self.effects, self.fit.theta, self.fit.J.transpose(1, 0, 2))
        except Exception:  # a table knows its own inputs only, and a simulator may raise anything along others
            return None

    def left_out(self, record: Record, train: np.ndarray, test: np.ndarray) -> np.ndarray | None:
        """Outputs on the test runs of a record of these samples, one linear step of the parameters from the training runs."""
        problem, fit = self.problem, self.fit
        rows, learnt = np.isin(record.run_of_row, test), np.isin(record.run_of_row, train)
        if not len(fit.theta):
            return problem.settled(fit.y)[:, rows]
        columns = problem.without_starts(
            np.concatenate([problem.record.residual(fit.y)[None], self.fit.J.transpose(1, 0, 2)])
        )
        flat = (columns[:, :, learnt] if learnt.any() else columns).reshape(len(columns), -1)
        precision, pull = self.step_prior
        step = solve(flat[1:] @ flat[1:].T + np.diag(precision), flat[1:] @ flat[0] + pull)
        theta = problem.within(self.effects, fit.theta + step)
        if np.max(np.abs(theta - fit.theta) / np.maximum(np.abs(fit.theta), 1e-3)) < LINEAR:
            y = fit.y + np.einsum("k,okt->ot", theta - fit.theta, fit.J)
        else:
            y = problem.outputs(self.effects, theta)
        return problem.settled(y if np.all(np.isfinite(y)) else fit.y)[:, rows]

    def numerical_change(self) -> np.ndarray:
        """How far differences may move the parameters."""
        return COARSE_STEP * np.abs(self.fit.theta)

    def initial_states(self) -> np.ndarray:
        shape = len(self.problem.record.starts), len(self.problem.plant.states)
        return np.full(shape, np.nan) if self.problem.x0 is None else self.problem.x0


@dataclass(frozen=True, eq=False)
class TrajectoryBackend(Backend):
    """A simulator with ``simulate`` alone over a record."""

    simulations: Simulations
    sd: np.ndarray
    nominal: np.ndarray  #: (n_outputs, n_samples): the simulator's own outputs
    surrogate: LinearSurrogate
    free: tuple[str, ...]
    transients: np.ndarray  #: (n_outputs, n_starts, n_samples): what initial states move
    #: Whether initial states are fitted: through ``x0`` where the simulator has one, else as transients of the
    #: surrogate
    free_starts: bool = False
    x0: np.ndarray | None = None  #: (n_runs, n_states): initial states that the simulator is given
    known: KnownParameters = field(default_factory=KnownParameters)

    @property
    def plant(self) -> Plant:  # type: ignore[override]
        return self.simulations.plant

    @property
    def record(self) -> Record:  # type: ignore[override]
        return self.simulations.record

    def outputs(self, effects: Sequence[BaseEffect], theta: np.ndarray, x0: np.ndarray | None = None) -> np.ndarray:
        """All runs with effects, (n_outputs, n_samples)."""
        return self.simulations.outputs(effects, theta, self.x0 if x0 is None else x0, self.free)

    def over_inputs(self, u: np.ndarray) -> TrajectoryBackend:
        """The same simulator over one run of other inputs (n_inputs, n_samples)."""
        n, known = u.shape[1], self.record
        record = Record(u, known.y[:, :n], known.dt * np.arange(n), np.array([0]), known.dt)
        return replace(
            self,
            simulations=Simulations(self.plant, record, raised=self.simulations.raised),
            surrogate=replace(self.surrogate, starts=record.starts, n_samples=n),
            transients=self.transients[:, :, :n],
            x0=None if self.x0 is None else self.x0[:1],
        )

    # ---- initial states ---------------------------------------------------------------------------------------------
    def renewed(self, effects: Sequence[BaseEffect] = (), theta: np.ndarray = NO_PARAMETERS) -> TrajectoryBackend:
        """With the transients of the initial states at the present ones and with effects."""
        if self.x0 is None:
            return replace(self, transients=self.surrogate.transients())
        base, columns = self.outputs(effects, theta), []
        for i in range(self.x0.shape[1]):
            moved = self.x0.copy()
            moved[:, i] += COARSE_STEP * max(float(np.max(np.abs(self.x0[:, i]))), 1.0)
            columns.append((self.outputs(effects, theta, moved) - base) / COARSE_STEP)
        seen = [c for c in columns if np.all(np.isfinite(c)) and np.any(c)]
        transients = np.stack(seen, axis=1) if seen else np.zeros((len(base), 0, base.shape[1]))
        return replace(self, transients=transients, nominal=self.simulations.run(self.record.u, {}, self.x0))

    def with_starts_fitted(
        self, effects: Sequence[BaseEffect] = (), theta: np.ndarray = NO_PARAMETERS
    ) -> TrajectoryBackend:
        """With initial states where they explain what is left (one Gauss-Newton step)."""
        if self.x0 is None or self.transients.shape[1] != self.x0.shape[1]:
            return self
        y = self.outputs(effects, theta)
        r = self.record.residual(y) / self.sd[:, None]
        J = self.record.seen_of(self.transients) / self.sd[:, None, None]
        size = np.maximum(np.max(np.abs(self.x0), axis=0), 1.0)
        moved = self.x0.copy()
        for run, (a, b) in enumerate(self.record.spans):
            basis = J[:, :, a:b].transpose(0, 2, 1).reshape(-1, J.shape[1])
            ridge = 1e-6 * np.eye(J.shape[1]) * max(float(np.sum(basis**2)), 1e-300)
            moved[run] += size * np.linalg.solve(basis.T @ basis + ridge, basis.T @ r[:, a:b].reshape(-1))
        other = replace(self, x0=moved)
        y_new = other.outputs(effects, theta)
        better = np.all(np.isfinite(y_new)) and self.cost_of(y_new, False) < self.cost_of(y, False)
        return other.renewed(effects, theta) if better else self

    def without_starts(self, columns: np.ndarray, starts: np.ndarray | None = None) -> np.ndarray:
        """Columns (n_columns, n_outputs, n_samples) in units of the noise, free initial states taken out."""
        white = self.record.seen(columns) / self.sd[:, None]
        if not self.free_starts or not self.transients.shape[1]:
            return white
        transients = self.record.seen_of(self.transients) / self.sd[:, None, None]
        return project_starts(white, transients, self.record.starts if starts is None else starts)

    def settled(self, y: np.ndarray) -> np.ndarray:
        """Outputs with the initial states fitted to the measurements where they are free."""
        if not self.free_starts:
            return y
        found = self.record.y - self.without_starts(self.record.residual(y)[None])[0] * self.sd[:, None]
        return found if self.record.known is None else np.where(self.record.known, found, y)

    # ---- noise ------------------------------------------------------------------------------------------------------
    @cached_property
    def disturbance(self) -> Disturbance:
        """A force on every state of the linear surrogate, coloured sensor noise, white noise."""
        return self.surrogate.disturbance(self.free_starts, known=self.record.known)

    @cached_property
    def caps(self) -> tuple[np.ndarray, np.ndarray]:  # type: ignore[override]
        """Forces on every state and coloured sensor noise that count as a disturbance."""
        return self.surrogate.caps(self.record.spread, self.largest_disturbance)

    def force_unit(self) -> np.ndarray:
        """Forces are in units of the size of their states."""
        return np.ones(len(self.surrogate.A))

    def quiet_force(self) -> np.ndarray:
        return 1e-3 * self.first_noise().force

    def first_noise(self) -> Noise:
        n = len(self.surrogate.A)
        return Noise(self.sd.copy(), np.full(n, 3e-3), REMEMBERED, 0.1 * self.sd, REMEMBERED)

    # ---- least squares ----------------------------------------------------------------------------------------------
    def cost_of(self, y: np.ndarray, projected: bool = True) -> float:
        """Sum of squares in units of the noise; inf where the simulator failed."""
        if not np.all(np.isfinite(y)):
            return np.inf
        r = self.record.residual(y)
        white = self.without_starts(r[None])[0] if projected else r / self.sd[:, None]
        return float(np.sum(white**2))

    def penalised(self, effects: Sequence[BaseEffect], theta: np.ndarray, y: np.ndarray) -> float:
        """Cost with the prior: Student's t on free parameters of which the user says nothing, else Gaussian."""
        n = len(theta) - len(self.free)
        mean, sd = self.prior(effects, theta)
        square = ((theta - mean) / sd) ** 2
        for i, name in enumerate(self.free, start=n):
            if name not in self.known.priors and self.plant.params[name] != 0:
                square[i] = 3.0 * np.log1p((theta[i] / PRIOR) ** 2 / 2)
        return self.cost_of(y) + float(np.sum(square))

    def slopes(
        self, effects: Sequence[BaseEffect], theta: np.ndarray, y: np.ndarray, only: Sequence[int]
    ) -> np.ndarray:
        """Differences with respect to some parameters, (n_only, n_outputs, n_samples)."""
        _, high = self.bounds(effects)
        out, units = np.zeros((len(only), *y.shape)), self.units(theta)
        for row, k in enumerate(only):
            step = COARSE_STEP * units[k]
            step = -step if theta[k] + step > high[k] else step
            moved = theta.copy()
            moved[k] += step
            change = (self.outputs(effects, moved) - y) / step
            out[row] = np.where(np.isfinite(change), change, 0.0)
        return out

    def units(self, theta: np.ndarray) -> np.ndarray:
        """Sizes of the parameters, near 0 a hundredth, of free ones a tenth."""
        n_free = len(self.free)
        return np.maximum(np.abs(theta), np.repeat([1e-2, 0.1], [len(theta) - n_free, n_free]))

    def fit(
        self, effects: tuple[BaseEffect, ...], theta: np.ndarray, J: np.ndarray | None = None
    ) -> TrajectoryCandidate | None:
        """Levenberg-Marquardt with Broyden's update; ``J`` (n_theta, n_outputs, n_samples) as far as it is known, else nan."""
        theta = self.within(effects, theta)
        y = self.outputs(effects, theta)
        if not np.all(np.isfinite(y)):
            return None
        J = np.full((len(theta), *y.shape), np.nan) if J is None else J.copy()
        unknown = [k for k in range(len(theta)) if not np.all(np.isfinite(J[k]))]
        if unknown:
            J[unknown] = self.slopes(effects, theta, y, unknown)
        damping, fresh, slow = 1e-3, True, 0
        cost = self.penalised(effects, theta, y)
        for _ in range(STEPS if len(theta) else 0):
            trial = self.within(effects, theta + self.step(effects, theta, y, J, damping))
            moved = trial - theta
            if np.max(np.abs(moved) / np.maximum(np.abs(theta), 1e-3), initial=0.0) < 1e-5:
                break
            y_new = self.outputs(effects, trial)
            new = self.penalised(effects, trial, y_new)
            if np.all(np.isfinite(y_new)):  # Broyden in units of the parameters
                size = self.units(theta)
                direction = moved / size
                miss = (y_new - y - np.einsum("k,kot->ot", moved, J)) / max(float(direction @ direction), 1e-300)
                J = J + (direction / size)[:, None, None] * miss
            if new < cost:
                slow = slow + 1 if cost - new < max(1e-4 * cost, 0.1) else 0
                theta, y, cost, damping = trial, y_new, new, max(damping / 10, 1e-9)
                if slow >= 2:
                    break
                fresh = False
            elif fresh or slow:
                damping *= 30
                slow += 1
                if slow > 3:
                    break
            else:
                J, fresh = self.slopes(effects, theta, y, range(len(theta))), True
        return TrajectoryCandidate(effects, TrajectoryFit(theta, y, J.transpose(1, 0, 2), cost), self)

    def fit_added(
        self, base: TrajectoryCandidate, effect: BaseEffect, values: np.ndarray, slopes: np.ndarray | None = None
    ) -> TrajectoryCandidate | None:
        """A base with one effect more, fitted from its values; ``slopes`` (n_values, n_outputs, n_samples) where they are known."""
        n, known = base.n_parameters, base.fit.J.transpose(1, 0, 2)
        own = np.full((len(values), *base.fit.y.shape), np.nan) if slopes is None else slopes
        J = np.concatenate([known[:n], own, known[n:]])
        return self.fit((*base.effects, effect), base.theta_with(values), J)

    def step(
        self, effects: Sequence[BaseEffect], theta: np.ndarray, y: np.ndarray, J: np.ndarray, damping: float
    ) -> np.ndarray:
        """One damped Gauss-Newton step."""
        columns = self.without_starts(np.concatenate([self.record.residual(y)[None], J]))
        flat = columns[1:].reshape(len(theta), -1)
        mean, sd = self.prior(effects, theta)
        return solve(flat @ flat.T + np.diag(sd**-2), flat @ columns[0].ravel() - (theta - mean) / sd**2, damping)
