"""Any regressor inside a simulator: the force that the plant lacks is estimated along the runs, then learned."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from sklearn.base import clone

from sksurrogate._domain import Domain
from sksurrogate.compose._hybrid_dynamics import DynamicsCorrection
from sksurrogate.exceptions import DataError
from sksurrogate.kernels.smoother import noise_of_differences, smooth
from sksurrogate.kernels.stiff import one_sample
from sksurrogate.physics._free_run import hold_inputs
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._simulator import Plant, simulated

#: Rows at the end of a run in which the force has not shown itself in the outputs yet, where runs are long.
_UNSEEN = 5
#: Times that the force is estimated and learned, at most.
_FORCE_ROUNDS = 3
#: Share of the typical change that a force may change by while the input is held.
_HELD = 0.01


class ForceCorrection(DynamicsCorrection):
    """``dx/dt = rhs(t, x, u, p) + g`` ("dynamics") or ``rhs(t, x, u + g, p)`` ("input"), g held over a sample.

    A smoother finds the force g_k that acts over every sample of the runs, together with the states, measured or not;
    the residual learns ``(x_k, u_k) -> g_k`` ("input": from u_k alone), in the units of dx/dt (of u; of x for a step).
    The smoother expects a force that changes little from sample to sample ("input": only where u changes; a step: as
    much as x and u do). Once more around what was learned only where that showed the sensors to be less noisy than
    was thought: elsewhere a second round was measured to bring nothing.

    ``residual``: with ``fit`` and ``predict``.
    ``form`` {"dynamics", "input"}.
    ``loss`` {"one_step"}: a free run has no slopes by the parameters of just any regressor.
    ``states, fade, shrinkage``: as for :class:`DynamicsCorrection`; ``shrinkage`` is the residual's own affair.
    """

    def _fit_term(self, inputs: list[np.ndarray], measured: list[np.ndarray], before: Any) -> None:
        """The residual; ``before``: a fitted correction whose term is the first guess."""
        if self.loss == "shooting":
            raise DataError(
                f'loss="shooting" with form="{self.form}" needs slopes of the residual, and {type(self.residual).__name__} gives none: '
                'use loss="one_step", the default residual, or transformers with a linear model at the end.'
            )
        plant, self.model, guess = self._prepare(inputs, measured)
        self.targets = self._targets(plant, self.model.inner)
        size = self._size(plant, self.model, guess, self.targets)
        u = self.model.record.u
        known = np.zeros((len(size), u.shape[1]))
        if isinstance(before, ForceCorrection) and before.targets == self.targets:
            self.fitted, self.domain = before.fitted, before.domain
            known = self.force(guess, u)
        self.noise = self._noise(
            [simulated(self.simulator, U, self._start(plant, y[:1])) for U, y in zip(inputs, measured)]
        )
        best: tuple[float, Any, Domain] | None = None
        for _ in range(_FORCE_ROUNDS):
            guess, force = self._estimated(guess, known, size)
            self._learn_rows(self._features(guess, u), force, inputs, measured)
            free, before_it = self.run(inputs, [y[:1] for y in measured]), self.noise
            error = float(np.mean(np.concatenate([f - y for f, y in zip(free.y, measured)]) ** 2))
            if best is not None and not error < best[0]:
                break
            best, self.noise = (error, self.fitted, self.domain), self._noise(free.y)
            if np.all(self.noise > 0.7 * before_it):
                break
            known = self.force(guess, u)
        _, self.fitted, self.domain = best  # type: ignore[misc]

    def _choose_substeps(self, inputs: list[np.ndarray], measured: list[np.ndarray]) -> None:
        """Those of the model along the training runs; None where Runge-Kutta will not do."""
        self.n_sub = None if self.model.stiff else self.model.n_sub

    def _scale(self, factor: float) -> None:
        self.factor = factor

    def _noise(self, free: Sequence[np.ndarray]) -> np.ndarray:
        """Noise of the sensors, at most: rough parts of the outputs that a free run has too are none, (n_outputs,)."""
        record = self.model.record
        rest = record.y - np.concatenate([part.reshape(-1, self.n_outputs) for part in free]).T
        found = noise_of_differences(rest, record.starts) if np.all(np.isfinite(rest)) else self.noise
        return np.minimum(self.noise, found)

    def force(self, x: np.ndarray, u: np.ndarray) -> np.ndarray:
        """g at states (n_states, n_points) and inputs (n_inputs, n_points), faded outside the data: (n_targets, n_points)."""
        z = np.nan_to_num(self._features(x, u), posinf=1e300, neginf=-1e300)
        found = np.asarray(self.fitted.predict(self.domain.held(z).T), dtype=float).reshape(z.shape[1], -1)
        return self.factor * (found * self.domain.weight(z.T)[:, None]).T

    def rhs(self, t: Any, x: np.ndarray, u: np.ndarray) -> np.ndarray:
        """dx/dt (or the next states) with the correction, on columns (n_states, n_points) and (n_inputs, n_points)."""
        x, u = np.asarray(x, dtype=float), np.asarray(u, dtype=float)
        return self._moved(t, x, np.concatenate([u, self.force(x, u)]))

    # ---- parts ------------------------------------------------------------------------------------------------------
    @property
    def _inner(self) -> PlantModel:
        return self.model.inner

    def _features(self, x: np.ndarray, u: np.ndarray) -> np.ndarray:
        """What the residual sees, (n_features, n_points)."""
        return u if self.form == "input" else np.concatenate([x, u])

    def _moved(self, now: Any, x: np.ndarray, both: np.ndarray) -> np.ndarray:
        """dx/dt (or the next states), ``both`` the inputs and the force behind them."""
        n, targets = len(both) - len(self.targets), list(self.targets)
        both = np.broadcast_to(both, (len(both), *x.shape[1:]))
        u, force = both[:n], both[n:]
        if self.form == "input":
            u = np.array(u)
            u[targets] += force
        plant = self._inner.plant
        out = self._inner.step(now, x, u, plant.dt) if plant.access == "step" else self._inner.derivative(now, x, u)
        if self.form == "dynamics":
            out = np.array(out)
            out[targets] += force
        return out

    def _sample(
        self, t: Any, x: np.ndarray, mean: np.ndarray, half: np.ndarray | None, force: np.ndarray
    ) -> np.ndarray:
        """States (n_states, *s) one sample later; inputs (n_sub, n_inputs, *s), force (n_targets, *s) held."""
        inner, dt = self._inner.plant, self._inner.plant.dt
        held = np.broadcast_to(force, (len(mean), *force.shape))
        mean = np.concatenate([np.broadcast_to(mean, (*mean.shape[:2], *force.shape[1:])), held], axis=1)
        if half is not None:
            half = np.concatenate(
                [np.broadcast_to(half, (*half.shape[:2], *force.shape[1:])), np.zeros_like(held)], axis=1
            )
        if inner.access == "step":
            return self._moved(t, x, mean[0])
        return one_sample(self._moved, t, x, mean, half, dt, self.model.stiff)

    def _order(self) -> int:
        plant = self._inner.plant
        return 0 if plant.hold == "zoh" or plant.access == "step" else 1

    def _estimated(self, guess: np.ndarray, known: np.ndarray, size: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """States and the force along the runs, the force expected around ``known`` (n_targets, n_samples)."""
        path = _Path(self, known)
        sd = np.maximum(self.noise, 1e-3 * np.std(self.model.record.y, axis=1) + 1e-300)
        n = len(guess)
        scale = np.concatenate([self.model.scale, size])
        rigid = np.arange(len(scale)) < n
        found = smooth(
            path,
            self.model.record.y,
            self.model.record.starts,
            sd,
            np.concatenate([guess, known]),
            scale,
            rigid=rigid,
            share=self._share(guess),
        )
        return found.x[:n], found.x[n:]

    def _learn_rows(
        self, z: np.ndarray, force: np.ndarray, inputs: list[np.ndarray], measured: list[np.ndarray]
    ) -> None:
        """The residual on all rows; "input": or, where that is better on runs left out, on one row for each input held.

        A force found while an input is held is one finding, not many that agree: Gaussian processes are misled by the
        copies; trees, neighbours and nets rather miss them.
        """
        record = self.model.record
        ends = np.r_[record.starts[1:], z.shape[1]]
        used = np.ones(z.shape[1], bool)
        for length, end in zip(record.lengths, ends):
            used[end - min(1 + _UNSEEN, 1 + length // 20) : end] = False

        def learn(rows: np.ndarray, merged: bool) -> None:
            some, wanted = z[:, rows], force[:, rows]
            if merged:
                first = np.flatnonzero(np.r_[True, np.any(np.diff(some, axis=1) != 0, axis=0)])
                wanted = np.add.reduceat(wanted, first, axis=1) / np.diff(np.r_[first, some.shape[1]])
                some = some[:, first]
            self.domain = Domain.of(some.T, self.fade)
            self.fitted = clone(self.residual).fit(some.T, wanted.T if len(wanted) > 1 else wanted[0])

        everything = range(len(inputs))
        judges = [r for r in everything if r % 4 == 1]
        merged = False
        if self.form == "input" and judges and np.mean(np.any(np.diff(z, axis=1) != 0, axis=0)) < 0.5:
            left, errors = used & ~np.isin(record.run_of_row, judges), []
            for way in (False, True):
                try:
                    learn(left, way)
                    errors.append(self._error([inputs[r] for r in judges], [measured[r] for r in judges]))
                except ValueError:  # too few rows for it; the fit to all of them speaks if they are too few as well
                    errors.append(np.inf)
            merged = errors[1] < 0.5 * errors[0]
        learn(used, merged)

    def _share(self, guess: np.ndarray) -> np.ndarray | None:
        """How much the force may change in a sample, relative to others: by how far what it depends on moves."""
        if self.form == "dynamics" and self._inner.plant.access == "rhs":
            return None
        z = self._features(guess, self.model.record.u)
        spread = np.std(z, axis=1, keepdims=True)
        move = np.diff(z / np.where(spread > 0, spread, np.inf), axis=1, append=0.0)
        move[:, np.r_[self.model.record.starts[1:], z.shape[1]] - 1] = 0.0
        size = np.sqrt(np.sum(move**2, axis=0))
        share = np.ones((len(guess) + len(self.targets), len(size)))
        share[len(guess) :] = np.maximum(size / max(np.sqrt(np.mean(size**2)), 1e-300), _HELD)
        return share

    def _rolled(self, plant: Plant, U: np.ndarray, X0: np.ndarray, quick: bool = False) -> np.ndarray:
        """States of free runs of equal length, (n_runs, n_samples, n_states); one prediction per sample for all of them."""
        t, columns = plant.dt * np.arange(U.shape[1]), U.transpose(2, 0, 1)
        mean, half = hold_inputs(U, self.model.n_sub, self._order())
        X = np.empty((*U.shape[:2], X0.shape[1]))
        X[:, 0] = X0
        with np.errstate(all="ignore"):
            for k in range(len(t) - 1):
                x = X[:, k].T
                part = None if half is None else half[..., k]
                X[:, k + 1] = self._sample(t[k], x, mean[..., k], part, self.force(x, columns[..., k])).T
        return X


class _Path:
    """States and force of the training runs as one state vector, in the form that the smoother asks for."""

    def __init__(self, correction: ForceCorrection, known: np.ndarray):
        self.c = correction
        self.mean, self.half = correction.model.held
        self.n = correction.model.n_states
        self.after = np.concatenate([known[:, 1:], known[:, -1:]], axis=1)
        self.known = known

    def __call__(self, x: np.ndarray) -> np.ndarray:
        """(n_states + n_targets, n_columns, n_samples) one sample later: the force is expected where it is known to be."""
        force = x[self.n :]
        moved = self.c._sample(self.c.model.record.t, x[: self.n], self.mean, self.half, force)
        return np.concatenate([moved, self.after[:, None] + force - self.known[:, None]])

    def outputs(self, x: np.ndarray) -> np.ndarray:
        """Measured outputs (n_outputs, n_columns, n_samples)."""
        u = self.mean[0] if self.half is None else self.mean[0] - self.half[0]
        return self.c._inner.output(self.c.model.record.t, x[: self.n], u)
