"""A plant with free parameters over a record: a :class:`~sksurrogate.kernels.free_run_model.FreeRunModel`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from sksurrogate.kernels.integrate import closing_weight
from sksurrogate.kernels.record import Record
from sksurrogate.kernels.signals import hold
from sksurrogate.kernels.stiff import one_sample
from sksurrogate.physics._linear_map import LinearMap
from sksurrogate.physics._model import PlantModel

#: Points that go through all stages of a step together, so that they stay in the cache.
_POINTS_IN_BLOCK = 8192


@dataclass(frozen=True, eq=False)
class FitModel:
    """A plant whose parameters ``names`` are free; theta holds their values."""

    inner: PlantModel
    names: Sequence[str]
    record: Record
    n_sub: int  #: Substeps per sample; of a stiff plant, how finely its graded steps are cut
    scale: np.ndarray  #: (n_states,): size of every state
    stiff: bool = False  #: Whether a sample is stepped by the Rosenbrock method in place of Runge-Kutta

    def __getstate__(self) -> dict[str, Any]:
        """What is laid out again stays behind."""
        return {key: value for key, value in self.__dict__.items() if key not in ("held", "_points", "linear")}

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

    @property
    def may_jump(self) -> bool:
        """Whether the map is the plant's own step."""
        return self.inner.plant.access == "step"

    @property
    def steps_many(self) -> bool:
        """Whether this step takes many samples in one call."""
        return self.inner.steps_many

    def closing_weight(self, sd: np.ndarray) -> np.ndarray:
        """Size to which every state of a free run is closed."""
        return closing_weight(self.scale, self.record.spread, sd, self.plain_outputs)

    @cached_property
    def held(self) -> tuple[np.ndarray, np.ndarray | None]:
        """Inputs over the substeps, mean and half rise, (n_sub, n_inputs, 1, n_samples)."""
        plant, record = self.inner.plant, self.record
        if record.order_of_inputs(plant.hold) == 0 or plant.access == "step" or not len(record.u):
            u = record.u[None, :, None]
            return u if self.n_sub == 1 else np.broadcast_to(u, (self.n_sub, *u.shape[1:])), None
        signals = [hold(u, self.n_sub, 1, record.starts) for u in record.u]
        return np.stack([s.mean for s in signals], axis=1), np.stack([s.half for s in signals], axis=1)  # type: ignore[misc]

    @cached_property
    def _points(self) -> dict[int, tuple[np.ndarray, np.ndarray, np.ndarray | None]]:
        """What :meth:`points` has spread so far."""
        return {}

    @cached_property
    def linear(self) -> LinearMap | None:
        """The exact map where the right-hand side is linear, and rows are even."""
        if self.inner.plant.access == "step" or self.record.steps is not None or not self.n_states:
            return None
        mean, half = self.held
        first, last = (mean[0], mean[-1]) if half is None else (mean[0] - half[0], mean[-1] + half[-1])
        rise = None if half is None else (last - first)[:, 0]

        def derivative(t: np.ndarray, x: np.ndarray, u: np.ndarray, theta: np.ndarray) -> np.ndarray:
            return self.inner.derivative_points(t, x, u, {**self.inner.plant.params, **dict(zip(self.names, theta))})

        return LinearMap(derivative, self.record.t, first[:, 0], rise, self.record.dt)

    def points(self, n_columns: int) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
        """Times and inputs of ``n_columns`` columns as flat points, in the order of states raveled."""
        if n_columns not in self._points:
            self._points[n_columns] = flat_points(self.record.t, *self.held, n_columns)
        return self._points[n_columns]

    def points_at(self, rows: np.ndarray, n_columns: int) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
        """The same at some samples only."""
        mean, half = self.held
        return flat_points(
            self.record.t[rows], _taken(mean, rows), None if half is None else half[..., rows], n_columns
        )

    def bind(self, theta: np.ndarray) -> BoundFitModel:
        """The model at parameter vectors ``theta`` (n_theta, n_columns)."""
        return BoundFitModel(self, theta)


class BoundFitModel:
    """A :class:`FitModel` with its parameters filled in.

    The plant sees flat points, column behind column: they are laid out once, not at every stage of a step.
    """

    def __init__(self, model: FitModel, theta: np.ndarray):
        self.m = model
        self.theta = theta

    def params(self, n_samples: int) -> dict[str, Any]:
        """All parameters at ``n_samples`` points of every column; numbers where all columns share them."""
        rows = self.theta[:, 0].tolist() if self.theta.shape[1] == 1 else np.repeat(self.theta, n_samples, axis=1)
        return {**self.m.inner.plant.params, **dict(zip(self.m.names, rows))}

    def __call__(self, x: np.ndarray, rows: np.ndarray | None = None) -> np.ndarray:
        """States (n_states, n_columns, n_samples) one sample later; with ``rows``, only those samples."""
        m, shape = self.m, x.shape
        if rows is None and not m.inner.bent and m.linear is not None:
            after = m.linear.after(x, self.theta)
            if after is not None:
                return after
            m.inner.bent = True
        t, mean, half = m.points(shape[1]) if rows is None else m.points_at(rows, shape[1])
        params, steps = self.params(shape[2]), m.record.steps
        if steps is not None:
            steps = np.tile(steps if rows is None else steps[rows], shape[1])
        points = x.reshape(len(x), -1)
        if m.stiff or points.shape[1] < 2 * _POINTS_IN_BLOCK:
            return self._moved(t, points, mean, half, params, steps).reshape(shape)
        out = np.empty(points.shape)
        for a in range(0, points.shape[1], _POINTS_IN_BLOCK):
            b = slice(a, a + _POINTS_IN_BLOCK)
            some = {k: v[b] if isinstance(v, np.ndarray) else v for k, v in params.items()}
            part = None if steps is None else steps[b]
            out[:, b] = self._moved(
                t[b], points[:, b], mean[..., b], None if half is None else half[..., b], some, part
            )
        return out.reshape(shape)

    def _moved(
        self, t: np.ndarray, x: np.ndarray, mean: np.ndarray, half: np.ndarray | None, params: Mapping[str, Any],
        steps: np.ndarray | None = None,
    ) -> np.ndarray:  # fmt: skip
        """The same on flat points."""
        m = self.m
        if m.inner.plant.access == "step":
            return m.inner.step_points(t, x, mean[0], params, m.record.dt)

        def derivative(now: Any, z: np.ndarray, u: np.ndarray) -> np.ndarray:
            return m.inner.derivative_points(now, z, u, params)

        return one_sample(derivative, t, x, mean, half, m.record.dt if steps is None else steps, m.stiff)

    def run(self, x0: np.ndarray) -> np.ndarray | None:
        """Free run (n_states, n_samples) from initial states (n_states, n_runs) by the plant itself; None where it offers none."""
        m, record = self.m, self.m.record
        if not m.may_jump:
            return None
        varied = dict(zip(m.names, self.theta[:, 0].tolist()))
        return m.inner.march(x0, record.u, record.lengths, record.dt, varied)

    def start(self, x0: np.ndarray) -> np.ndarray:
        """Initial states as they are."""
        return x0

    def outputs(self, x: np.ndarray) -> np.ndarray:
        """Measured outputs (n_outputs, n_columns, n_samples)."""
        mean, half = self.m.held
        varied = {name: row[:, None] for name, row in zip(self.m.names, self.theta)}
        return self.m.inner.output(self.m.record.t, x, mean[0] if half is None else mean[0] - half[0], varied)


def flat_points(
    t: np.ndarray, mean: np.ndarray, half: np.ndarray | None, n_columns: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """Times (n_points,) and inputs (n_sub, n_inputs, n_points) of ``n_columns`` equal columns, one behind the other."""

    def spread(values: np.ndarray) -> np.ndarray:
        if n_columns == 1:
            return values.reshape(*values.shape[:-2], values.shape[-1])
        if _same_in_all(values):
            first = spread(values[:1])
            return np.broadcast_to(first, (len(values), *first.shape[1:]))
        wide = np.broadcast_to(values, (*values.shape[:-2], n_columns, values.shape[-1]))
        return wide.reshape(*values.shape[:-2], n_columns * values.shape[-1])

    return spread(t[None]), spread(mean), None if half is None else spread(half)


def _same_in_all(held: np.ndarray) -> bool:
    """Whether inputs are the same in every substep, by their memory."""
    return len(held) > 1 and held.strides[0] == 0


def _taken(held: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Inputs at some samples, still one copy for all substeps where there was one."""
    if not _same_in_all(held):
        return held[..., rows]
    some = held[0][..., rows]
    return np.broadcast_to(some, (len(held), *some.shape))
