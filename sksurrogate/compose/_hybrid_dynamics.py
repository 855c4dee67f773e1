"""Corrections inside a simulator: a term added to its derivatives, or to its inputs, fitted through the free run."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from sklearn.base import clone

from sksurrogate._domain import Domain
from sksurrogate.compose._hybrid_output import Free, simulate_runs
from sksurrogate.compose._left_out import Piece
from sksurrogate.compose._linear_end import functions_of, has_intercept, put, with_coefficients
from sksurrogate.compose._plant_path import plant_path, training_substeps
from sksurrogate.compose._term import Basis, TermModel
from sksurrogate.compose._term_evidence import COEFFICIENT_UNIT, TermFit, fit_term
from sksurrogate.effects._structure import kinematic_states
from sksurrogate.exceptions import DataError, SimulationDiverged, SimulatorError
from sksurrogate.export._agreement import is_affine
from sksurrogate.kernels.output_error import output_error
from sksurrogate.physics._fit_model import FitModel
from sksurrogate.physics._free_run import free_run
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._simulator import Plant, describe

#: Lengths of the default's smooth part, in units of :class:`Basis`: from bends within the data to nearly a polynomial.
LENGTHS = (1.4, 0.7, 2.8)


class DynamicsCorrection:
    """``dx/dt = rhs(t, x, u, p) + g(x, u)`` ("dynamics") or ``rhs(t, x, u + g(u), p)`` ("input").

    ``residual``: its transformers give the functions g is made of, its last step gets the coefficients; a constant is among
        them as far as ``fit_intercept`` says so. None: a linear and a smooth part, whose length and sizes are those of the
        largest evidence.
    ``form`` {"dynamics", "input"}, ``loss`` {"one_step", "shooting"}.
    ``states``: states whose derivative is corrected ("dynamics"); by default all whose balance is not an identity.
    ``shrinkage``: precision of the prior around no correction, coefficients in units of the spread of the derivative
        (or input); without ``residual`` the evidence sets it ("shooting").
    """

    #: Rows that a free run starts from; share of the term that acts.
    n_lags = 1
    factor: float | np.ndarray = 1.0
    #: It acts inside the simulator.
    inside = True
    #: Length of the default's smooth part, its penalties and the noise; None: not known yet.
    length: float | None = None
    smooth: TermFit | None = None
    #: Substeps of Runge-Kutta a sample, chosen on the training runs: fixed, so that an export steps as ``predict`` does.
    #: None: as many as a run asks for.
    n_sub: int | None = None
    theta: np.ndarray

    def __init__(self, simulator: Any, residual: Any, form: str, loss: str, states: Any, fade: float, shrinkage: float):
        self.simulator, self.residual, self.form, self.loss = simulator, residual, form, loss
        self.states, self.fade, self.shrinkage = states, fade, shrinkage

    def fit(self, inputs: list[np.ndarray], measured: list[np.ndarray], before: Any = None) -> DynamicsCorrection:
        """Fit on runs; ``before``: a fitted correction to start from."""
        self._fit_term(inputs, measured, before)
        return self.judge(inputs, measured)

    def _choose_substeps(self, inputs: list[np.ndarray], measured: list[np.ndarray]) -> None:
        """As many substeps as the training runs ask for."""
        plant = describe(self.simulator, n_inputs=inputs[0].shape[1], n_outputs=self.n_outputs)
        starts = [self._start(plant, y[:1]) for y in measured]
        self.n_sub = training_substeps(plant, self._rate(), inputs, starts)

    def _fit_term(self, inputs: list[np.ndarray], measured: list[np.ndarray], before: Any) -> None:
        """Basis and coefficients."""
        plant, model, guess = self._prepare(inputs, measured)
        z = self._path[0].T
        self.domain = Domain.of(z.T, self.fade)
        self.terms: Any = None
        if isinstance(before, DynamicsCorrection) and self.length is None:
            self.length = before.length
        if self.residual is None and self.loss == "shooting":
            self._learn_smooth(plant, model, guess, z)
        else:
            self._learn(plant, model, guess, self._basis(z), before)
        self.coef = self._coefficients()
        self.fitted = self._filled(z.T)

    def taught_on(
        self, inputs: Sequence[np.ndarray], measured: Sequence[np.ndarray], blocks: Sequence[tuple[int, int, int]]
    ) -> DynamicsCorrection:
        """The same correction, fitted to these rows (run, start, stop)."""
        other = type(self)(self.simulator, self.residual, self.form, self.loss, self.states, self.fade, self.shrinkage)
        other.length, other.smooth = self.length, self.smooth  # penalties of all runs, coefficients of these
        other.n_sub = self.n_sub
        other._fit_term([inputs[r][a:b] for r, a, b in blocks], [measured[r][a:b] for r, a, b in blocks], None)
        return other

    def along(self, run: int, start: int, stop: int) -> np.ndarray:
        """Features (n_rows, n_features) along rows of a run that was fitted."""
        rows, starts = self._path
        return rows[starts[run] + start : starts[run] + stop]

    def errors_at(
        self, factors: np.ndarray, inputs: Sequence[np.ndarray], measured: Sequence[np.ndarray], pieces: Sequence[Piece]
    ) -> list[np.ndarray]:
        """Errors (n_factors, n_rows, n_outputs) of free runs of the pieces, where they are judged."""
        plant = describe(self.simulator, n_inputs=inputs[0].shape[1], n_outputs=self.n_outputs)
        length = max(piece.stop - piece.start for piece in pieces)
        rows = [np.minimum(piece.start + np.arange(length), piece.stop - 1) for piece in pieces]
        U = np.stack([inputs[piece.run][own] for piece, own in zip(pieces, rows)])
        X0 = np.stack([self._start(plant, measured[piece.run][piece.start :]) for piece in pieces])
        whole, n = self.factor, len(pieces)
        quick = self.n_sub is not None  # then all are marched at once
        runs = []
        for group in [slice(None)] if quick else [slice(k, k + 1) for k in range(len(factors))]:
            count = len(factors[group])
            self.factor = np.repeat(factors[group], n) if quick else float(factors[group][0])
            try:
                X = self._rolled(plant, np.tile(U, (count, 1, 1)), np.tile(X0, (count, 1)), quick)
            except (SimulationDiverged, FloatingPointError):
                X = np.full((count * n, length, X0.shape[1]), np.inf)
            runs.append(X.reshape(count, n, length, -1))
        self.factor = whole
        t, out = plant.dt * np.arange(length), []
        for k, (piece, own) in enumerate(zip(pieces, rows)):
            some = slice(max(piece.judged - piece.start, 1), piece.stop - piece.start)
            each = []
            for X in np.concatenate([part[:, k] for part in runs]):
                with np.errstate(all="ignore"):
                    y = self._inner.output(t, X.T, U[k].T).T
                each.append((y - measured[piece.run][own])[some])
            out.append(np.stack(each))
        return out

    def keep(self, factor: np.ndarray, fade: float) -> None:
        """Multiply the term by ``factor`` (one number for all outputs); fade it beyond ``fade``."""
        self.domain = replace(self.domain, fade=fade)
        self.__dict__.pop("_path", None)
        self._scale(float(factor[0]))

    def _scale(self, factor: float) -> None:
        self.theta = self.theta * factor
        self.coef = self._coefficients()
        if self.residual is not None:
            put(self.fitted, *self.terms.basis.plain(self.coef))

    def _prepare(self, inputs: list[np.ndarray], measured: list[np.ndarray]) -> tuple[Plant, FitModel, np.ndarray]:
        """The plant, its model over the record, and a trajectory (n_states, n_samples) to start from."""
        self.n_outputs = measured[0].shape[1]
        plant = describe(self.simulator, n_inputs=inputs[0].shape[1], n_outputs=self.n_outputs)
        if plant.access == "trajectory":
            raise SimulatorError(
                f'form="{self.form}" needs a simulator with rhs or step and states; {type(self.simulator).__name__} gives '
                'trajectories only: use form="output", "static" or "series".'
            )
        model, guess, self.noise = plant_path(plant, inputs, measured)
        seen = [model.record.u] if self.form == "input" else [guess, model.record.u]
        self._path = np.concatenate(seen).T, model.record.starts
        return plant, model, guess

    def judge(self, inputs: list[np.ndarray], measured: list[np.ndarray]) -> DynamicsCorrection:
        """Set the substeps, what the free runs leave, and how large the gap is without the correction."""
        self._choose_substeps(inputs, measured)
        free = self.run(inputs, [y[:1] for y in measured])
        self.rmse = np.sqrt(np.mean(np.concatenate([f - y for f, y in zip(free.y, measured)]) ** 2, axis=0))
        alone = simulate_runs(self.simulator, inputs, measured, self.n_outputs)
        self.reach = np.sqrt(np.mean(np.concatenate([a - y for a, y in zip(alone, measured)]) ** 2, axis=0))
        return self

    def run(
        self, inputs: Sequence[np.ndarray], first: Sequence[np.ndarray | None], spread: bool = True, quick: bool = False
    ) -> Free:
        """Free runs from the first row (None: the simulator's own start), each with its own number of samples.

        ``quick``: not finite where Runge-Kutta does not follow; else an integrator for stiff plants tries, at any price.
        """
        plant = describe(self.simulator, n_inputs=inputs[0].shape[1], n_outputs=self.n_outputs)
        lengths = np.array([len(U) for U in inputs])
        outputs: list[Any] = [None] * len(inputs)
        weights: list[Any] = [None] * len(inputs)
        for length in np.unique(lengths):
            chosen = [int(r) for r in np.flatnonzero(lengths == length)]
            U = np.stack([inputs[r] for r in chosen])
            X0 = np.stack([self._start(plant, first[r]) for r in chosen])
            X = self._rolled(plant, U, X0, quick)
            t = plant.dt * np.arange(length)
            Y = self._inner.output(t, X.transpose(2, 0, 1), U.transpose(2, 0, 1)).transpose(1, 2, 0)
            z = U if self.form == "input" else np.concatenate([X, U], axis=2)
            w = self.domain.weight(z.reshape(-1, z.shape[2])).reshape(len(chosen), length)
            for k, r in enumerate(chosen):
                outputs[r], weights[r] = np.array(Y[k]), w[k]
                given = first[r]
                if given is not None:
                    outputs[r][: len(given)] = given[:length]
        return Free(outputs, [np.zeros_like(y) for y in outputs], weights)

    def one_step(self, inputs: list[np.ndarray], measured: list[np.ndarray]) -> list[np.ndarray]:
        """One step ahead from measured outputs, where these are all the states; else from the free run's states."""
        plant = describe(self.simulator, n_inputs=inputs[0].shape[1], n_outputs=self.n_outputs)
        places = self._whole_state(plant)
        out = []
        for U, y in zip(inputs, measured):
            x = np.empty((len(U), len(plant.states)))
            x[:, places] = y
            pairs = np.stack([U[:-1], U[1:]], axis=1)
            part = np.full(y.shape, np.nan)
            part[1:] = self._rolled(plant, pairs, x[:-1])[:, 1][:, places]
            out.append(part)
        return out

    def rhs(self, t: Any, x: np.ndarray, u: np.ndarray) -> np.ndarray:
        """dx/dt with the correction, on columns (n_states, n_points) and (n_inputs, n_points)."""
        return self._rate()(t, np.asarray(x, dtype=float), np.asarray(u, dtype=float))

    # ---- parts ------------------------------------------------------------------------------------------------------
    def _rate(self) -> Any:
        """dx/dt (or the next states) with the correction as a function of (t, x, u)."""
        return self.terms.derivative(self.terms.coefficients(self.theta[:, None]), self.domain, self.factor)

    @property
    def _inner(self) -> PlantModel:
        """The simulator on columns of states."""
        return self.terms.plant.inner

    def _rolled(self, plant: Plant, U: np.ndarray, X0: np.ndarray, quick: bool = False) -> np.ndarray:
        """States of free runs of equal length, (n_runs, n_samples, n_states)."""
        rate, t = self._rate(), plant.dt * np.arange(U.shape[1])
        if plant.access == "rhs":
            method = str(getattr(self.simulator, "method", "auto")).replace("exact", "auto")  # terms are not linear
            method = "RK4" if quick and method == "auto" else method
            order = 0 if plant.hold == "zoh" else 1
            return free_run(rate, U, X0, t, order=order, method=method, n_sub=self.n_sub)
        X = np.empty((*U.shape[:2], X0.shape[1]))
        X[:, 0] = X0
        for k in range(U.shape[1] - 1):
            X[:, k + 1] = rate(np.full(len(U), t[k]), X[:, k].T, U[:, k].T).T
        return X

    def _start(self, plant: Plant, y: np.ndarray | None) -> np.ndarray:
        """Initial state; states that are outputs start at the measurement."""
        x0 = plant.x0.copy()
        if y is not None and len(y) and plant.output_states is not None:
            x0[list(plant.output_states)] = y[0]
        return x0

    def _whole_state(self, plant: Plant) -> list[int]:
        """Places of the outputs in the state, where they are all of it."""
        places = plant.output_states
        if places is None or len(set(places)) < len(plant.states):
            raise DataError(
                f'one step ahead needs all states {list(plant.states)} among the outputs {list(plant.outputs)}: use loss="shooting".'
            )
        return list(places)

    def _targets(self, plant: Plant, inner: Any) -> tuple[int, ...]:
        """Positions of the states or inputs that get a term."""
        if self.form == "input":
            return tuple(range(len(plant.inputs)))
        if self.states is not None:
            unknown = [name for name in self.states if name not in plant.states]
            if unknown:
                raise SimulatorError(f"states={list(self.states)}: the simulator has no state {unknown[0]!r}; it has {list(plant.states)}.")  # fmt: skip
            return tuple(plant.states.index(name) for name in self.states)
        fixed = kinematic_states(inner) if plant.access == "rhs" else ()
        return tuple(k for k, name in enumerate(plant.states) if name not in fixed)

    def _basis(self, z: np.ndarray) -> Basis:
        """Functions that the term is made of."""
        if self.residual is None:
            return Basis(z.T, self.length or LENGTHS[0])
        return Basis(z.T, None, functions_of(self.residual), has_intercept(self.residual))

    def _size(self, plant: Plant, model: FitModel, guess: np.ndarray, targets: tuple[int, ...]) -> np.ndarray:
        """Unit of every term: the spread of the derivative (of the step, of the input) that it is added to."""
        if self.form == "input":
            size = np.std(model.record.u, axis=1)[list(targets)]
        else:
            size = np.std(np.diff(guess, axis=1), axis=1)[list(targets)]
            size = size / plant.dt if plant.access == "rhs" else size
        return np.where(size > 0, size, 1.0)

    def _term(self, plant: Plant, model: FitModel, guess: np.ndarray, basis: Basis) -> TermModel:
        """The plant with the functions, coefficients to be found."""
        inner = type(model)(model.inner, [], model.record, model.n_sub, model.scale, model.stiff)
        targets = self._targets(plant, model.inner)
        return TermModel(inner, basis, targets, self._size(plant, model, guess, targets), self.form == "input")

    def _sd(self, y: np.ndarray) -> np.ndarray:
        """Noise of the outputs, (n_outputs,)."""
        return np.maximum(self.noise, 1e-3 * np.std(y, axis=1) + 1e-300)

    def _learn_smooth(self, plant: Plant, model: FitModel, guess: np.ndarray, z: np.ndarray) -> None:
        """The default: of all lengths the one of the largest evidence, or the one that is known."""
        found: list[tuple[float, TermModel, TermFit]] = []
        for length in LENGTHS if self.length is None else (self.length,):
            term = self._term(plant, model, guess, Basis(z.T, length))
            fit = fit_term(term, guess, self._sd(model.record.y), self.smooth)
            if fit is not None:
                found.append((fit.log_evidence, term, fit))
        if not found:
            raise DataError(f'form="{self.form}": no term keeps the free run finite; use form="output".')
        _, self.terms, self.smooth = max(found, key=lambda entry: entry[0])
        self.theta, self.length = self.smooth.theta, self.terms.basis.length / np.sqrt(len(z))

    def _learn(self, plant: Plant, model: FitModel, guess: np.ndarray, basis: Basis, before: Any) -> None:
        """Coefficients: one step ahead where all states are measured, then shooting."""
        term = self._term(plant, model, guess, basis)
        theta = np.zeros(term.n_theta)
        if before is not None and isinstance(before, DynamicsCorrection) and len(before.theta) == len(theta):
            theta = before.theta * np.repeat(before.terms.size / term.size, basis.size)
        elif plant.output_states is not None and len(set(plant.output_states)) == len(plant.states):
            theta = self._one_step_fit(term, guess)
        elif self.loss == "one_step":
            self._whole_state(plant)
        if self.loss == "shooting":
            unlimited = (np.full(len(theta), -np.inf), np.full(len(theta), np.inf))
            prior = np.full(len(theta), 1.0 / np.sqrt(max(self.shrinkage, 1e-12)))
            unit = np.full(len(theta), COEFFICIENT_UNIT)
            fit = output_error(
                term, theta, guess, self._sd(model.record.y), unit=unit, bounds=unlimited, prior=prior, open_steps=2, max_steps=30
            )  # fmt: skip
            theta = fit.theta if fit is not None else theta
        self.terms, self.theta = term, theta

    def _one_step_fit(self, term: TermModel, x: np.ndarray) -> np.ndarray:
        """Two Gauss-Newton steps on ``x[k+1] - F(x[k])``, with the prior."""
        k, theta = term.n_theta, np.zeros(term.n_theta)
        inside = np.ones(x.shape[1], bool)
        inside[term.record.starts] = False
        for _ in range(2):
            values = np.repeat(theta[:, None], 1 + k, axis=1)
            values[np.arange(k), 1 + np.arange(k)] += 1e-4
            after = term.bind(values)(np.repeat(x[:, None], 1 + k, axis=1))[:, :, :-1]
            wide = term.scale[:, None]
            error = ((x[:, 1:] - after[:, 0]) / wide)[:, inside[1:]].ravel()
            J = ((after[:, 1:] - after[:, :1]) / 1e-4 / wide[:, None])[:, :, inside[1:]]
            J = J.transpose(0, 2, 1).reshape(-1, k)
            good = np.isfinite(error) & np.isfinite(J).all(axis=1)
            J, error = J[good], error[good]
            noise = np.mean(error**2) + 1e-300
            normal = J.T @ J + self.shrinkage * noise * np.eye(k) + 1e-9 * np.eye(k) * np.trace(J.T @ J) / k
            theta = theta + np.linalg.solve(normal, J.T @ error - self.shrinkage * noise * theta)
        return theta

    def _error(self, inputs: list[np.ndarray], measured: list[np.ndarray], quick: bool = False) -> float:
        """Mean square error of the free run from the first measured row."""
        free = self.run(inputs, [y[:1] for y in measured], quick=quick)
        error = float(np.mean(np.concatenate([f - y for f, y in zip(free.y, measured)]) ** 2))
        return error if np.isfinite(error) else np.inf

    def _filled(self, rows: np.ndarray) -> Any:
        """The user's regressor with the coefficients, to be asked for rows like these; or the basis."""
        basis = self.terms.basis
        if self.residual is None:
            return basis
        coef, offset = basis.plain(self.coef)
        return with_coefficients(self.residual, basis.transformer, rows, coef, offset, self.form)

    def _coefficients(self) -> np.ndarray:
        """Of all functions, in units of what they are added to, (n_targets, n_basis)."""
        return self.terms.coefficients(self.theta[:, None])[:, :, 0] * self.terms.size[:, None]


def ends_linear(residual: Any) -> bool:
    """Whether a regressor is a linear model of what it is given, or a pipeline with one at its end; links do not count."""
    model = (getattr(residual, "steps", None) or [("model", residual)])[-1][1]
    if not hasattr(model, "fit_intercept"):
        return False
    if getattr(model, "features", None) is not None:  # its coefficients are those of what its features make
        return True
    rows = np.random.default_rng(0).uniform(0.5, 1.5, (16, 2))
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            found = clone(model).fit(rows, 1.0 + rows[:, 0] ** 2)
    except (ValueError, TypeError):  # what it asks for, its own fit will say
        return True
    return not hasattr(found, "coef_") or is_affine(found)
