"""A learned term inside a plant, linear in its coefficients: a :class:`~sksurrogate.kernels.free_run_model.FreeRunModel`."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations_with_replacement
from typing import Any

import numpy as np
from sklearn.base import clone

from sksurrogate._domain import Domain
from sksurrogate.kernels.record import Record
from sksurrogate.kernels.stiff import one_sample
from sksurrogate.physics._fit_model import FitModel

__all__ = ["Basis", "BoundTermModel", "TermModel"]


class Basis:
    """Functions of states and inputs: monomials of scaled features, or the transformers of the user's pipeline.

    Parameters
    ----------
    z : ndarray (n_rows, n_features)
        Where it will be used; sets the scaling.
    degree : int
        Of the monomials.
    transformer : transformer, optional
        In place of monomials.
    """

    def __init__(self, z: np.ndarray, degree: int, transformer: Any = None):
        self.mean = z.mean(axis=0)
        spread = z.std(axis=0)
        self.scale = np.where(spread > 1e-9 * (np.abs(self.mean) + 1e-300), spread, np.inf)
        self.scale = np.where(np.isfinite(self.scale), self.scale, 1e12 * (1.0 + np.abs(self.mean)))
        self.powers: list[tuple[int, ...]] = []
        self.transformer = None if transformer is None else clone(transformer).fit(z)
        if transformer is None:
            every = range(z.shape[1])
            self.powers = [p for k in range(1, degree + 1) for p in combinations_with_replacement(every, k)]
        self.size = self(z[:1].T).shape[0]

    def __call__(self, z: np.ndarray) -> np.ndarray:
        """(n_features, *s) -> (n_basis, *s); the first function is 1."""
        shape = z.shape[1:]
        one = np.ones((1, *shape))
        if self.transformer is not None:
            rows = np.asarray(self.transformer.transform(z.reshape(len(z), -1).T), dtype=float)
            return np.concatenate([one, rows.T.reshape(-1, *shape)])
        wide = (slice(None), *(None,) * len(shape))
        scaled = (z - self.mean[wide]) / self.scale[wide]
        out = np.empty((1 + len(self.powers), *shape))
        out[0] = 1.0
        place: dict[tuple[int, ...], int] = {(): 0}
        for k, factors in enumerate(self.powers, start=1):
            np.multiply(out[place[factors[:-1]]], scaled[factors[-1]], out=out[k])
            place[factors] = k
        return out


@dataclass(frozen=True, eq=False)
class TermModel:
    """A plant whose derivatives (or inputs) get ``size * (theta . basis(z))`` added.

    Attributes
    ----------
    plant : FitModel
        Without free parameters.
    basis : Basis
    targets : tuple of int
        States whose derivative gets a term, or inputs that get one.
    size : ndarray (n_targets,)
        Unit of each term.
    on_inputs : bool
        Whether inputs are corrected (from inputs alone), else derivatives (from states and inputs).
    """

    plant: FitModel
    basis: Basis
    targets: tuple[int, ...]
    size: np.ndarray
    on_inputs: bool

    @property
    def record(self) -> Record:
        """The data."""
        return self.plant.record

    @property
    def scale(self) -> np.ndarray:
        """Size of every state."""
        return self.plant.scale

    @property
    def n_states(self) -> int:
        """States of the plant."""
        return self.plant.n_states

    @property
    def n_nominal(self) -> int:
        """States of the plant."""
        return self.plant.n_states

    @property
    def n_theta(self) -> int:
        """Coefficients of all terms."""
        return self.basis.size * len(self.targets)

    @property
    def free_states(self) -> np.ndarray:
        """Every initial state may be fitted."""
        return self.plant.free_states

    @property
    def plain_outputs(self) -> tuple[int, ...] | None:
        """Positions of the states that are the outputs."""
        return self.plant.plain_outputs

    def closing_weight(self, sd: np.ndarray) -> np.ndarray:
        """Size to which every state of a free run is closed."""
        return self.plant.closing_weight(sd)

    def bind(self, theta: np.ndarray) -> BoundTermModel:
        """The model at coefficients ``theta`` (n_theta, n_columns)."""
        return BoundTermModel(self, theta)

    def derivative(self, coef: np.ndarray, domain: Domain | None = None) -> Any:
        """dx/dt (or the next states of a step) as a function of (t, x, u), with coefficients (n_targets, n_basis, n_columns or 1)."""
        inner, targets, amount = self.plant.inner, list(self.targets), self.size[:, None]

        def term(z: np.ndarray) -> np.ndarray:
            # monomials grow fast: outside the data they keep the value they had at its edge
            B = self.basis(z if domain is None else domain.held(z))
            columns = B.shape[1:]
            if len(columns) == 2 and coef.shape[2] > 1:
                value = np.einsum("bct,kbc->kct", B, coef)
            else:
                value = np.tensordot(coef[:, :, 0], B, 1)
            value = value * amount.reshape(-1, *(1,) * len(columns))
            if domain is not None:
                value = value * domain.weight(z.reshape(len(z), -1).T).reshape(columns)
            return value

        def rate(now: Any, x: np.ndarray, u: np.ndarray) -> np.ndarray:
            u = np.broadcast_to(u, (len(u), *x.shape[1:]))
            step = inner.plant.access == "step"
            if self.on_inputs:
                u = u.copy()
                u[targets] += term(u)
            out = inner.step(now, x, u, inner.plant.dt) if step else inner.derivative(now, x, u)
            if not self.on_inputs:
                out = np.array(out)
                out[targets] += term(np.concatenate([x, u]))
            return out

        return rate

    def coefficients(self, theta: np.ndarray) -> np.ndarray:
        """(n_targets, n_basis, n_columns)."""
        return theta.reshape(len(self.targets), self.basis.size, -1)


class BoundTermModel:
    """A :class:`TermModel` with its coefficients filled in."""

    def __init__(self, model: TermModel, theta: np.ndarray):
        self.m = model
        self.mean, self.half = model.plant.held
        self.rate = model.derivative(model.coefficients(theta))

    def __call__(self, x: np.ndarray, rows: np.ndarray | None = None) -> np.ndarray:
        """States (n_states, n_columns, n_samples) one sample later; with ``rows``, only those samples."""
        record, mean, half = self.m.record, self.mean, self.half
        t = record.t
        if rows is not None:
            t, mean, half = t[rows], mean[..., rows], None if half is None else half[..., rows]
        if self.m.plant.inner.plant.access == "step":
            return self.rate(t, x, mean[0])
        return one_sample(self.rate, t, x, mean, half, record.dt, self.m.plant.stiff)

    def start(self, x0: np.ndarray) -> np.ndarray:
        """Initial states as they are."""
        return x0

    def outputs(self, x: np.ndarray) -> np.ndarray:
        """Measured outputs (n_outputs, n_columns, n_samples)."""
        u = self.mean[0] if self.half is None else self.mean[0] - self.half[0]
        return self.m.plant.inner.output(self.m.record.t, x, u, {})
