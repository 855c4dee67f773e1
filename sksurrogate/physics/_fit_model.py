"""A plant with free parameters over a record, in the form that the kernel of free-run fits asks for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sksurrogate.kernels.integrate import rk4
from sksurrogate.kernels.record import Record
from sksurrogate.kernels.signals import hold
from sksurrogate.kernels.stiff import rosenbrock
from sksurrogate.physics._model import PlantModel

__all__ = ["BoundFitModel", "FitModel"]


@dataclass(frozen=True, eq=False)
class FitModel:
    """A plant whose parameters ``names`` are free; theta holds their values.

    Attributes
    ----------
    inner : PlantModel
    names : sequence of str
    record : Record
    n_sub : int
        Substeps a sample; of a stiff plant, how finely its graded steps are cut.
    scale : ndarray (n_states,)
        Size of every state.
    stiff : bool
        Whether a sample is stepped by the Rosenbrock method in place of Runge-Kutta.
    """

    inner: PlantModel
    names: Sequence[str]
    record: Record
    n_sub: int
    scale: np.ndarray
    stiff: bool = False

    @property
    def n_states(self) -> int:
        """States of the plant."""
        return len(self.scale)

    @property
    def n_nominal(self) -> int:
        """States of the plant."""
        return len(self.scale)

    @property
    def n_theta(self) -> int:
        """Free parameters."""
        return len(self.names)

    @property
    def free_states(self) -> np.ndarray:
        """Every initial state may be fitted."""
        return np.ones(self.n_states, dtype=bool)

    @property
    def plain_outputs(self) -> tuple[int, ...] | None:
        """Positions of the states that are the outputs."""
        return self.inner.plant.output_states

    def closing_weight(self, sd: np.ndarray) -> np.ndarray:
        """Size to which every state of a free run is to be closed."""
        spread = np.maximum(np.std(self.record.y, axis=1), 1e-300)
        weight = self.scale * min(float(np.min(sd / spread)), 1.0)
        for j, i in enumerate(self.plain_outputs or ()):
            weight[i] = min(weight[i], sd[j])
        return weight

    def bind(self, theta: np.ndarray) -> BoundFitModel:
        """The model at parameter vectors ``theta`` (n_theta, n_columns)."""
        return BoundFitModel(self, theta)


class BoundFitModel:
    """A :class:`FitModel` with its parameters filled in."""

    def __init__(self, model: FitModel, theta: np.ndarray):
        self.m, record = model, model.record
        self.varied = {name: row[:, None] for name, row in zip(model.names, theta)}
        self._wide: dict[tuple[int, ...], dict[str, np.ndarray]] = {}
        order = 0 if model.inner.plant.hold == "zoh" or model.inner.plant.access == "step" else 1
        signals = [hold(u, model.n_sub, order, record.starts) for u in record.u]
        self.mean = (
            np.stack([s.mean for s in signals], axis=1) if signals else np.zeros((model.n_sub, 0, 1, record.n_samples))
        )
        self.half = np.stack([s.half for s in signals], axis=1) if signals and signals[0].half is not None else None  # type: ignore[misc]

    def __call__(self, x: np.ndarray, rows: np.ndarray | None = None) -> np.ndarray:
        """States (n_states, n_columns, n_samples) one sample later; with ``rows``, only those samples."""
        m, t, mean, half = self.m, self.m.record.t, self.mean, self.half
        if rows is not None:
            t, mean, half = t[rows], mean[..., rows], None if half is None else half[..., rows]
        if m.inner.plant.access == "step":
            return m.inner.step(t, x, mean[0], m.record.dt, self.varied)

        def derivative(now: Any, z: np.ndarray, u: np.ndarray) -> np.ndarray:
            shape = z.shape[1:]
            if shape not in self._wide:  # spread once for all substeps
                self._wide[shape] = {k: np.ascontiguousarray(np.broadcast_to(v, shape)) for k, v in self.varied.items()}
            return m.inner.derivative(now, z, u, self._wide[shape])

        if m.stiff:
            first, last = (mean[0], mean[-1]) if half is None else (mean[0] - half[0], mean[-1] + half[-1])
            return rosenbrock(derivative, t, x, first, last, m.record.dt, m.n_sub)
        return rk4(derivative, t, x, mean, half, m.record.dt / m.n_sub)

    def start(self, x0: np.ndarray) -> np.ndarray:
        """Initial states as they are."""
        return x0

    def outputs(self, x: np.ndarray) -> np.ndarray:
        """Measured outputs (n_outputs, n_columns, n_samples)."""
        u = self.mean[0] if self.half is None else self.mean[0] - self.half[0]
        return self.m.inner.output(self.m.record.t, x, u, self.varied)
