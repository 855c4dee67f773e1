"""A learned term inside a plant, linear in its coefficients: a :class:`~sksurrogate.kernels.free_run_model.FreeRunModel`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from sklearn.base import clone

from sksurrogate._domain import Domain
from sksurrogate.kernels.record import Record
from sksurrogate.kernels.stiff import one_sample
from sksurrogate.physics._fit_model import FitModel

#: Kernels of a smooth basis, at most; eigenvalues of their Gram below this share of the largest are rounding.
MOST_KERNELS, KERNEL_ROUNDING = 24, 1e-10


class Basis:
    """Functions of states and inputs: 1, the scaled features, and smooth functions of them; or the user's transformers.

    The smooth functions span squared-exponential kernels about rows that cover the data. They are scaled such that
    independent coefficients of variance s^2 are a Gaussian process of variance s^2 there (Nystroem): far from the data
    nothing is left of it but the linear part.

    ``z`` (n_rows, n_features): where it will be used; sets scaling and centres.
    ``length``: length of the kernels, in standard deviations of a feature times the root of their number. None: no
        smooth functions.
    ``transformer``: in place of all this.
    ``constant``: whether 1 is among the functions; without it features are scaled only.
    """

    def __init__(self, z: np.ndarray, length: float | None = None, transformer: Any = None, constant: bool = True):
        self.mean = z.mean(axis=0)
        spread = z.std(axis=0)
        self.scale = np.where(spread > 1e-9 * (np.abs(self.mean) + 1e-300), spread, np.inf)
        self.scale = np.where(np.isfinite(self.scale), self.scale, 1e12 * (1.0 + np.abs(self.mean)))
        self.constant = constant
        self.mean = self.mean if constant else np.zeros_like(self.mean)
        self.transformer = None if transformer is None else clone(transformer).fit(z)
        self.length = 1.0 if length is None else length * np.sqrt(z.shape[1])
        self.centres, self.mix = np.zeros((0, z.shape[1])), np.zeros((0, 0))
        if length is not None and transformer is None:
            self.centres = _covering((z - self.mean) / self.scale, MOST_KERNELS)
            values, vectors = np.linalg.eigh(self._kernels(self.centres.T))
            seen = values > KERNEL_ROUNDING * values[-1]
            self.mix = (vectors[:, seen] / np.sqrt(values[seen])).T
        self.size = self(z[:1].T).shape[0]

    @property
    def group(self) -> np.ndarray:
        """0 for the constant and the linear functions, 1 for the smooth ones, (n_basis,)."""
        return np.repeat([0, 1], [self.size - len(self.mix), len(self.mix)])

    def __call__(self, z: np.ndarray) -> np.ndarray:
        """(n_features, *s) -> (n_basis, *s); the first function is 1 where there is a constant."""
        shape = z.shape[1:]
        one = np.ones((int(self.constant), *shape))
        if self.transformer is not None:
            rows = np.asarray(self.transformer.transform(z.reshape(len(z), -1).T), dtype=float)
            return np.concatenate([one, rows.T.reshape(-1, *shape)])
        wide = (slice(None), *(None,) * len(shape))
        scaled = (z - self.mean[wide]) / self.scale[wide]
        smooth = [np.tensordot(self.mix, self._kernels(scaled), 1)] if len(self.mix) else []
        return np.concatenate([one, scaled, *smooth])

    def plain(self, coef: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Coefficients (n_targets, n_basis) without smooth functions, as those of what the transformer makes or of features.

        The constant (n_targets,) comes second.
        """
        offset, slopes = (coef[:, 0], coef[:, 1:]) if self.constant else (np.zeros(len(coef)), coef)
        if self.transformer is not None:
            return slopes, offset
        slopes = slopes / self.scale
        return slopes, offset - slopes @ self.mean

    def _kernels(self, scaled: np.ndarray) -> np.ndarray:
        """(n_features, *s) -> (n_centres, *s)."""
        wide = (slice(None), *(None,) * (scaled.ndim - 1))
        squares = np.sum(self.centres**2, axis=1)[wide] + np.sum(scaled**2, axis=0)
        return np.exp((np.tensordot(self.centres, scaled, 1) - 0.5 * squares) / self.length**2)


def _covering(rows: np.ndarray, most: int) -> np.ndarray:
    """Rows that cover all others: from the one nearest the mean on, each the farthest from those before."""
    chosen = [int(np.argmin(np.sum(rows**2, axis=1)))]
    away = np.sum((rows - rows[chosen[0]]) ** 2, axis=1)
    while len(chosen) < most and away.max() > 0:
        chosen.append(int(np.argmax(away)))
        away = np.minimum(away, np.sum((rows - rows[chosen[-1]]) ** 2, axis=1))
    return rows[chosen]


@dataclass(frozen=True, eq=False)
class TermModel:
    """A plant whose derivatives (or inputs) get ``size * (theta . basis(z))`` added."""

    plant: FitModel  #: Without free parameters
    basis: Basis
    targets: tuple[int, ...]  #: States whose derivative gets a term, or inputs that get one
    size: np.ndarray  #: (n_targets,): unit of each term
    on_inputs: bool  #: Whether inputs are corrected (from inputs alone), else derivatives (from states and inputs)

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

    @property
    def may_jump(self) -> bool:
        """Whether the map is a plant's own step."""
        return self.plant.may_jump

    @property
    def steps_many(self) -> bool:
        """Whether this step takes many samples in one call."""
        return self.plant.steps_many

    def closing_weight(self, sd: np.ndarray) -> np.ndarray:
        """Size to which every state of a free run is closed."""
        return self.plant.closing_weight(sd)

    def bind(self, theta: np.ndarray) -> BoundTermModel:
        """The model at coefficients ``theta`` (n_theta, n_columns)."""
        return BoundTermModel(self, theta)

    def derivative(self, coef: np.ndarray, domain: Domain | None = None, factor: float | np.ndarray = 1.0) -> Any:
        """dx/dt (or the next states of a step) as a function of (t, x, u), with coefficients (n_targets, n_basis, n_columns or 1).

        ``factor`` is one number, or one per column.
        """
        inner, targets, amount = self.plant.inner, list(self.targets), self.size[:, None]

        def term(z: np.ndarray) -> np.ndarray:
            # functions of the user's may grow fast: outside the data they keep the value they had at its edge
            own = self.basis.transformer is not None and domain is not None
            B = self.basis(domain.held(z) if own else z)  # type: ignore[union-attr]
            columns = B.shape[1:]
            if len(columns) == 2 and coef.shape[2] > 1:
                value = np.einsum("bct,kbc->kct", B, coef)
            else:
                value = np.tensordot(coef[:, :, 0], B, 1)
            value = value * amount.reshape(-1, *(1,) * len(columns))
            if domain is not None:
                value = value * domain.weight(z.reshape(len(z), -1).T).reshape(columns)
            return value * factor

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

    def run(self, x0: np.ndarray) -> None:
        """None: the plant itself knows no term."""

    def start(self, x0: np.ndarray) -> np.ndarray:
        """Initial states as they are."""
        return x0

    def outputs(self, x: np.ndarray) -> np.ndarray:
        """Measured outputs (n_outputs, n_columns, n_samples)."""
        u = self.mean[0] if self.half is None else self.mean[0] - self.half[0]
        return self.m.plant.inner.output(self.m.record.t, x, u, {})
