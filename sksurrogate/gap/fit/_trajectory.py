"""Rivals fitted around a simulator that only gives trajectories: before it, behind it, in its parameters.

Every simulation counts: runs that were simulated are kept, sensor effects need none, slopes are taken once and carried
along by Broyden's update, and a linear stand-in orders the rivals.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from sksurrogate.effects._effect import BaseEffect, ParameterEffect
from sksurrogate.effects._trajectory import acting_rows, plain_runs, readings, retuned_simulator
from sksurrogate.exceptions import SimulationDiverged, SimulatorError
from sksurrogate.gap.fit._closeness import NEARLY_WHITE
from sksurrogate.gap.fit._divergence import divergence
from sksurrogate.gap.fit._evidence import LIKELIER, as_white, profile
from sksurrogate.gap.fit._linear_surrogate import StandIn, learn
from sksurrogate.gap.fit._problem import PRIOR
from sksurrogate.gap.fit._project import project_starts
from sksurrogate.gap.fit._retuned import value_of
from sksurrogate.kernels.disturbance import Disturbance, Noise
from sksurrogate.kernels.noise_fit import fit_noise
from sksurrogate.kernels.record import Record
from sksurrogate.kernels.smoother import noise_of_differences
from sksurrogate.physics._simulator import Plant

__all__ = ["Around", "Trial"]

#: Relative step of the differences: acting inputs may jump, so it is not tiny.
STEP = 1e-3
EMPTY = np.zeros(0)
#: Simulations that are kept.
KEPT = 256


@dataclass(eq=False)
class Trial:
    """A set of effects fitted through ``simulate``.

    Attributes
    ----------
    effects : tuple of BaseEffect
    theta : ndarray
        Parameters of the effects in turn, then a number for every free parameter.
    y : ndarray (n_outputs, n_samples)
        Outputs, initial states fitted where they are free.
    J : ndarray (n_outputs, n_theta, n_samples)
    cost : float
    noise : Noise or None
    log_likelihood : float
    """

    effects: tuple[BaseEffect, ...]
    theta: np.ndarray
    y: np.ndarray
    J: np.ndarray
    cost: float
    noise: Noise | None = None
    log_likelihood: float = -np.inf

    @property
    def keys(self) -> tuple[tuple[str, str | None, str | None], ...]:
        """Keys of the effects."""
        return tuple(effect.key for effect in self.effects)

    @property
    def n_parameters(self) -> int:
        """Parameters of the effects."""
        return sum(len(effect.parameters) for effect in self.effects)

    def slice_of(self, i: int) -> slice:
        """Where the parameters of effect i stand."""
        first = sum(len(effect.parameters) for effect in self.effects[:i])
        return slice(first, first + len(self.effects[i].parameters))


@dataclass(eq=False)
class Around:
    """Everything that the fits share.

    Attributes
    ----------
    plant : Plant
    record : Record
    free : tuple of str
    labels : sequence
        Of the runs.
    nominal : ndarray (n_outputs, n_samples)
        The simulator's own outputs.
    stand_in : StandIn
    sd : ndarray (n_outputs,)
    free_starts : bool
        Whether initial states are fitted: through ``x0`` where the simulator has one, else as transients of the stand-in.
    x0 : ndarray (n_runs, n_states) or None
        Initial states that the simulator is given.
    transients : ndarray (n_outputs, n_starts, n_samples)
    """

    plant: Plant
    record: Record
    free: tuple[str, ...]
    labels: Sequence[object]
    nominal: np.ndarray = field(init=False)
    stand_in: StandIn = field(init=False)
    sd: np.ndarray = field(init=False)
    free_starts: bool = False
    x0: np.ndarray | None = None
    transients: np.ndarray = field(init=False)
    kept: dict[bytes, np.ndarray] = field(default_factory=dict)
    simulations: int = 0
    disturbances: dict[bool, Disturbance] = field(default_factory=dict)

    def __post_init__(self) -> None:
        record = self.record
        self.sd = noise_of_differences(record.y, record.starts)
        self.nominal = self.simulated(record.u, {})
        if not np.all(np.isfinite(self.nominal)):
            raise divergence(self.plant, record, self.nominal, self.labels)
        self.stand_in = learn(record, self.nominal)
        own = getattr(self.plant.simulator, "x0", None)
        if own is not None and np.size(own):
            self.x0 = np.repeat(np.asarray(own, dtype=float).reshape(1, -1), len(record.starts), axis=0)
            self.free_starts = True
        self.refresh()

    def refresh(self, effects: Sequence[BaseEffect] = (), theta: np.ndarray = EMPTY) -> None:
        """Transients of the initial states, at the present ones and with effects."""
        if self.x0 is None:
            self.transients = self.stand_in.transients()
            return
        base, given = self.outputs(effects, theta), self.x0
        columns = []
        for i in range(given.shape[1]):
            moved = given.copy()
            moved[:, i] += STEP * max(float(np.max(np.abs(given[:, i]))), 1.0)
            self.x0 = moved
            columns.append((self.outputs(effects, theta) - base) / STEP)
        self.x0 = given
        seen = [c for c in columns if np.all(np.isfinite(c)) and np.any(c)]
        self.transients = np.stack(seen, axis=1) if seen else np.zeros((len(base), 0, base.shape[1]))
        self.nominal = self.simulated(self.record.u, {})

    def start_again(self, effects: Sequence[BaseEffect] = (), theta: np.ndarray = EMPTY) -> None:
        """Move the simulator's initial states to where they explain what is left (one Gauss-Newton step)."""
        if self.x0 is None or self.transients.shape[1] != self.x0.shape[1]:
            return
        y = self.outputs(effects, theta)
        r = (self.record.y - y) / self.sd[:, None]
        J = self.transients / self.sd[:, None, None]
        bounds = np.r_[self.record.starts, self.record.n_samples]
        size = np.maximum(np.max(np.abs(self.x0), axis=0), 1.0)
        moved = self.x0.copy()
        for run, (a, b) in enumerate(zip(bounds[:-1], bounds[1:])):
            basis = J[:, :, a:b].transpose(0, 2, 1).reshape(-1, J.shape[1])
            ridge = 1e-6 * np.eye(J.shape[1]) * max(float(np.sum(basis**2)), 1e-300)
            moved[run] += size * np.linalg.solve(basis.T @ basis + ridge, basis.T @ r[:, a:b].reshape(-1))
        before, old = self.cost_of(y, projected=False), self.x0
        self.x0 = moved
        y_new = self.outputs(effects, theta)
        if np.all(np.isfinite(y_new)) and self.cost_of(y_new, projected=False) < before:
            self.refresh(effects, theta)
        else:
            self.x0 = old

    # ---- simulation -------------------------------------------------------------------------------------------------
    def simulated(self, u: np.ndarray, changed: dict[str, float], x0: np.ndarray | None = None) -> np.ndarray:
        """Outputs (n_outputs, n_samples) under inputs (n_inputs, n_samples); nan where the simulator fails."""
        start = self.x0 if x0 is None else x0
        key = u.tobytes() + repr(sorted(changed.items())).encode() + (b"" if start is None else start.tobytes())
        if key in self.kept:
            return self.kept[key]
        self.simulations += 1
        record = self.record
        simulator = retuned_simulator(self.plant.simulator, changed)
        out = np.full((record.y.shape[0], record.n_samples), np.nan)
        lengths = record.lengths
        for n in np.unique(lengths):
            runs = np.flatnonzero(lengths == n)
            rows = record.starts[runs][:, None] + np.arange(n)
            try:
                Y = plain_runs(simulator, u[:, rows].transpose(1, 2, 0), None if start is None else start[runs], None)
            except SimulationDiverged:
                continue
            if Y.shape[2] != len(out):
                raise SimulatorError(
                    f"simulate returned {Y.shape[2]} outputs, but y has {len(out)} columns: one for each output."
                )
            out[:, rows] = Y.transpose(2, 0, 1)
        if len(self.kept) >= KEPT:
            self.kept.pop(next(iter(self.kept)))
        self.kept[key] = out
        return out

    def changed(self, effects: Sequence[BaseEffect], theta: np.ndarray) -> dict[str, float]:
        """Parameters that differ from the simulator's."""
        position = sum(len(e.parameters) for e in effects)
        out = {name: value_of(self.plant.params[name], phi) for name, phi in zip(self.free, theta[position:])}
        position = 0
        for effect in effects:
            values = theta[position : position + len(effect.parameters)]
            position += len(effect.parameters)
            if isinstance(effect, ParameterEffect):
                name = str(effect.location)
                out[name] = float(effect.value(out.get(name, self.plant.params[name]), 0.0, list(values), 0.0))
        return {name: value for name, value in out.items() if value != self.plant.params[name]}

    def acting(self, effects: Sequence[BaseEffect], theta: np.ndarray) -> np.ndarray:
        """Inputs behind the actuators (n_inputs, n_samples)."""
        record = self.record
        if not any(effect.kind == "input" for effect in effects):
            return record.u
        parts = self.parts(effects, theta)
        return acting_rows(self.plant, list(effects), parts, record.u, record.dt, record.starts)

    def parts(self, effects: Sequence[BaseEffect], theta: np.ndarray) -> list[np.ndarray]:
        """Parameters of every effect."""
        out, position = [], 0
        for effect in effects:
            out.append(theta[position : position + len(effect.parameters)])
            position += len(effect.parameters)
        return out

    def read(self, effects: Sequence[BaseEffect], theta: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Readings of the sensors along outputs (n_outputs, n_samples)."""
        if not any(effect.kind == "output" for effect in effects):
            return y
        record, parts = self.record, self.parts(effects, theta)
        out = y.copy()
        bounds = np.r_[record.starts, record.n_samples]
        for a, b in zip(bounds[:-1], bounds[1:]):
            t = record.t[a:b] - record.t[a]
            out[:, a:b] = readings(self.plant.outputs, list(effects), parts, y[:, a:b].T, t, record.dt).T
        return out

    def outputs(self, effects: Sequence[BaseEffect], theta: np.ndarray) -> np.ndarray:
        """All runs with effects, (n_outputs, n_samples)."""
        y = self.simulated(self.acting(effects, theta), self.changed(effects, theta))
        return self.read(effects, theta, y)

    # ---- least squares ----------------------------------------------------------------------------------------------
    def bounds(self, effects: Sequence[BaseEffect]) -> tuple[np.ndarray, np.ndarray]:
        """Bounds of theta."""
        low = [p.low for e in effects for p in e.parameters] + [-4.0] * len(self.free)
        high = [p.high for e in effects for p in e.parameters] + [4.0] * len(self.free)
        return np.array(low, dtype=float), np.array(high, dtype=float)

    def precision(self, effects: Sequence[BaseEffect], theta: np.ndarray) -> np.ndarray:
        """Of the prior: Student's t on free parameters, none on effects."""
        n = len(theta) - len(self.free)
        out = np.zeros(len(theta))
        moved = {effect.location for effect in effects if effect.name == "parameter_error"}
        for i, name in enumerate(self.free):
            out[n + i] = 1e6 if name in moved else 1.0 / (PRIOR**2 + theta[n + i] ** 2 / 2)
        return out

    def without_starts(self, columns: np.ndarray) -> np.ndarray:
        """Columns (n_columns, n_outputs, n_samples) in units of the noise, free initial states taken out."""
        white = columns / self.sd[:, None]
        if not self.free_starts or not self.transients.shape[1]:
            return white
        return project_starts(white, self.transients / self.sd[:, None, None], self.record.starts)

    def settled(self, y: np.ndarray) -> np.ndarray:
        """Outputs with the free initial states fitted to the measurements."""
        r = self.record.y - y
        return self.record.y - self.without_starts(r[None])[0] * self.sd[:, None]

    def cost_of(self, y: np.ndarray, projected: bool = True) -> float:
        """Sum of squares in units of the noise; inf where the simulator failed."""
        if not np.all(np.isfinite(y)):
            return np.inf
        r = self.record.y - y
        white = self.without_starts(r[None])[0] if projected else r / self.sd[:, None]
        return float(np.sum(white**2))

    def slopes(
        self, effects: Sequence[BaseEffect], theta: np.ndarray, y: np.ndarray, only: Sequence[int]
    ) -> np.ndarray:
        """Differences with respect to some parameters, (n_only, n_outputs, n_samples)."""
        _, high = self.bounds(effects)
        out = np.zeros((len(only), *y.shape))
        for row, k in enumerate(only):
            step = STEP * max(abs(theta[k]), self.unit(effects, k))
            step = -step if theta[k] + step > high[k] else step
            moved = theta.copy()
            moved[k] += step
            change = (self.outputs(effects, moved) - y) / step
            out[row] = np.where(np.isfinite(change), change, 0.0)
        return out

    def unit(self, effects: Sequence[BaseEffect], k: int) -> float:
        """Size of parameter k near 0."""
        parameters = [p for e in effects for p in e.parameters]
        return 0.1 if k >= len(parameters) else 1e-2

    def fit(
        self, effects: tuple[BaseEffect, ...], theta: np.ndarray, J: np.ndarray | None = None, steps: int = 10
    ) -> Trial | None:
        """Levenberg-Marquardt with Broyden's update; ``J`` (n_theta, n_outputs, n_samples) as far as it is known, else nan."""
        low, high = self.bounds(effects)
        theta = np.clip(theta, low, high)
        y = self.outputs(effects, theta)
        if not np.all(np.isfinite(y)):
            return None
        if J is None:
            J = np.full((len(theta), *y.shape), np.nan)
        J = J.copy()
        unknown = [k for k in range(len(theta)) if not np.all(np.isfinite(J[k]))]
        if unknown:
            J[unknown] = self.slopes(effects, theta, y, unknown)
        damping, fresh, slow = 1e-3, True, 0
        cost = self.penalised(theta, y)
        for _ in range(steps if len(theta) else 0):
            step = self.step(effects, theta, y, J, damping)
            trial = np.clip(theta + step, low, high)
            moved = trial - theta
            if np.max(np.abs(moved) / np.maximum(np.abs(theta), 1e-3), initial=0.0) < 1e-5:
                break
            y_new = self.outputs(effects, trial)
            new = self.penalised(trial, y_new)
            if np.all(np.isfinite(y_new)):  # Broyden in units of the parameters
                size = np.array([max(abs(v), self.unit(effects, k)) for k, v in enumerate(theta)])
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
        return Trial(effects, theta, y, J.transpose(1, 0, 2), cost)

    def penalised(self, theta: np.ndarray, y: np.ndarray) -> float:
        """Cost with the prior."""
        n = len(theta) - len(self.free)
        phi = theta[n:] / PRIOR
        return self.cost_of(y) + float(np.sum(3.0 * np.log1p(phi**2 / 2)))

    def step(
        self, effects: Sequence[BaseEffect], theta: np.ndarray, y: np.ndarray, J: np.ndarray, damping: float
    ) -> np.ndarray:
        """One damped Gauss-Newton step."""
        k = len(theta)
        columns = self.without_starts(np.concatenate([(self.record.y - y)[None], J]))
        flat = columns[1:].reshape(k, -1)
        precision = self.precision(effects, theta)
        H = flat @ flat.T + np.diag(precision)
        g = flat @ columns[0].ravel() - precision * theta
        scale = np.sqrt(np.maximum(np.diag(H), 1e-300))
        normal = H / np.outer(scale, scale) + damping * np.eye(k)
        return np.linalg.lstsq(normal, g / scale, rcond=1e-10)[0] / scale

    # ---- likelihood -------------------------------------------------------------------------------------------------
    def disturbance(self) -> Disturbance:
        """Noise model: a force on every state of the stand-in, coloured sensor noise, white noise."""
        if self.free_starts not in self.disturbances:
            self.disturbances[self.free_starts] = self.stand_in.disturbance(self.free_starts)
        return self.disturbances[self.free_starts]

    def first_noise(self) -> Noise:
        """Where the noise parameters start."""
        n = len(self.stand_in.A)
        return Noise(self.sd.copy(), np.full(n, 3e-3), 10.0, 0.1 * self.sd, 10.0)

    def columns(self, trial: Trial) -> tuple[np.ndarray, np.ndarray]:
        """Residual with its sensitivities (n_outputs, 1 + n_theta, n_samples), and the precision of the prior."""
        y = self.settled(trial.y) if self.free_starts else trial.y
        columns = np.concatenate([(self.record.y - y)[:, None], trial.J], axis=1)
        return columns, self.precision(trial.effects, trial.theta)

    def estimate(self, trial: Trial, start: Noise | None = None, iterations: int = 15) -> Trial:
        """Fill in the noise and the likelihood of a trial."""
        tops = [self.followed(trial, one, iterations) for one in self.beginnings(trial, start or self.first_noise())]
        return max(tops, key=lambda top: top.log_likelihood)

    def followed(self, trial: Trial, start: Noise, iterations: int) -> Trial:
        """A trial with the noise that is reached from one start."""
        columns, precision = self.columns(trial)
        noise, _, _ = fit_noise(
            self.disturbance(),
            columns[:, 0],
            start,
            np.ones(len(self.stand_in.A)),
            columns[:, 1:],
            precision,
            -precision * trial.theta,
            max_iterations=iterations,
            caps=self.stand_in.caps(self.record.y),
        )
        return replace(trial, noise=noise, log_likelihood=self.likelihood(trial, noise))

    def beginnings(self, trial: Trial, start: Noise) -> list[Noise]:
        """From a given noise, near the data from white noise too where that is likelier: a fit does not find out of a colour."""
        rms = np.sqrt(np.mean(self.columns(trial)[0][:, 0] ** 2, axis=1))
        white = as_white(start, rms, 1e-3 * self.first_noise().force)
        near = np.all(rms < NEARLY_WHITE * self.sd)
        likelier = near and self.likelihood(trial, white) > self.likelihood(trial, start) + LIKELIER
        return [start, white] if likelier else [start]

    def likelihood(self, trial: Trial, noise: Noise) -> float:
        """Under given noise, at the best parameters to first order."""
        columns, precision = self.columns(trial)
        try:
            G, logdet = self.disturbance().gram(columns, noise)
        except np.linalg.LinAlgError:
            return -np.inf
        if not np.all(np.isfinite(G)):
            return -np.inf
        return profile(G, logdet, precision, -precision * trial.theta, trial.theta, self.bounds(trial.effects))
