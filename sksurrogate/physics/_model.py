"""The nominal model of a simulator with a right-hand side, on columns of states, inputs and parameters."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np

from sksurrogate.kernels.clock import check_time
from sksurrogate.physics._forces import check_forces, wired
from sksurrogate.physics._rhs import PointwiseFunction, locked
from sksurrogate.physics._simulator import Plant, offered_ports

#: Sample, time after it, states (n_states, n_runs) there -> what enters at the ports (n_some, n_runs).
Entering = Callable[[int, float, np.ndarray], np.ndarray]


class PlantModel:
    """Right-hand side (or step) and output of a plant on arrays ``(n, *s)``.

    The user's functions see flat points, as scipy's ``vectorized=True``: x (n_states, n_points), u (n_inputs, n_points),
    t and every varied parameter (n_points,). Where a simulator offers further ports, ``u`` may have a row for each of them
    behind the inputs: the force that enters there.

    ``plant``: with access "rhs" or "step".
    ``begins``: what its clock shows at t = 0, the first row of a run.
    """

    def __init__(self, plant: Plant, begins: float = 0.0):
        self.plant = plant
        self.begins = begins
        ported = wired(plant)
        #: All that the user's functions raised at points that they refused.
        self.raised: dict[str, None] = {}
        self.bent = False  #: Whether the right-hand side was found not to be linear along some data

        def pointwise(what: str, names: Sequence[str]) -> PointwiseFunction:
            return PointwiseFunction(
                ported(getattr(plant.simulator, what)), len(names), what, names, plant.input_range, self.raised
            )

        self._rhs = pointwise("rhs", plant.states) if plant.access == "rhs" else None
        self._step = pointwise("step", plant.states) if plant.access == "step" else None
        self._selected = plant.output_states
        self._output = pointwise("output", plant.outputs) if self._selected is None else None
        self._inputs, self._times, self._params = _Flattened(), _Flattened(), _FlatParams(plant.params)

    def probe(self, u: np.ndarray) -> None:
        """Try the user's functions at the initial state and an input ``u`` (n_inputs,), so that mistakes are found early."""
        at = (0.0, self.plant.x0, u, self.plant.params)
        if self._rhs is not None:
            self._rhs.probe(*at)
        if self._step is not None:
            self._step.probe(*at, self.plant.dt)
        if self._output is not None:
            self._output.probe(*at)
        check_forces(self.plant, u)

    def seconds_of_a_call(self, u: np.ndarray) -> float:
        """Of the right-hand side or the step at the initial state and inputs (n_inputs, n_points)."""
        x = np.repeat(self.plant.x0[:, None], u.shape[1], axis=1)
        started = time.perf_counter()
        _ = self.derivative(0.0, x, u) if self._rhs is not None else self.step(0.0, x, u, self.plant.dt)
        return time.perf_counter() - started

    @contextmanager
    def watched(self) -> Iterator[None]:
        """Within, :attr:`said` takes up the first answer that is nan."""
        functions = [function for function in (self._rhs, self._step, self._output) if function is not None]
        for function in functions:
            function.watched = True
        try:
            yield
        finally:
            for function in functions:
                function.watched = False

    @property
    def takes_many(self) -> bool:
        """Whether the right-hand side was found to take arrays of points."""
        return self._rhs is not None and bool(self._rhs.vectorised)

    @property
    def steps_many(self) -> bool:
        """Whether the simulator's own step was found to take arrays of points."""
        return self._step is not None and bool(self._step.vectorised)

    @property
    def refusal(self) -> str:
        """What the user's functions said when they last refused a point; empty where they did not."""
        functions = (self._rhs, self._step, self._output)
        return "".join(function.refusal for function in functions if function is not None)

    def _call(
        self,
        function: PointwiseFunction,
        t: Any,
        x: np.ndarray,
        u: np.ndarray,
        varied: Mapping[str, np.ndarray] | None,
        *extra: Any,
    ) -> np.ndarray:
        """Flatten, call, restore."""
        check_time()
        shape = x.shape[1:]
        n_points = math.prod(shape)
        inputs = self._inputs(u, (len(u), *shape)).reshape(len(u), n_points)
        states, times = x.reshape(len(x), n_points), self._times(t + self.begins if self.begins else t, shape)
        # Views of their own: arrays that they show stay writable.
        states.setflags(write=False)
        p = self._params(varied, shape) if varied else self.plant.params
        return function.points(times, states, inputs, p, *extra).reshape(function.size, *shape)

    def derivative_points(self, t: np.ndarray, x: np.ndarray, u: np.ndarray, p: Mapping[str, Any]) -> np.ndarray:
        """dx/dt at flat points: t (n_points,), x (n_states, n_points), u (n_inputs, n_points), all parameters in ``p``."""
        assert self._rhs is not None
        return self._rhs(t, x, u, p)

    def step_points(self, t: np.ndarray, x: np.ndarray, u: np.ndarray, p: Mapping[str, Any], dt: float) -> np.ndarray:
        """The states one step later at flat points."""
        assert self._step is not None
        return self._step(t, x, u, p, dt)

    def derivative(
        self, t: Any, x: np.ndarray, u: np.ndarray, varied: Mapping[str, np.ndarray] | None = None
    ) -> np.ndarray:
        """dx/dt, (n_states, *s)."""
        assert self._rhs is not None
        return self._call(self._rhs, t, x, u, varied)

    def step(
        self, t: Any, x: np.ndarray, u: np.ndarray, dt: float, varied: Mapping[str, np.ndarray] | None = None
    ) -> np.ndarray:
        """The states one step later, (n_states, *s)."""
        assert self._step is not None
        return self._call(self._step, t, x, u, varied, dt)

    def brought(
        self, port: int, x: np.ndarray, u: np.ndarray, varied: Mapping[str, np.ndarray] | None = None
    ) -> np.ndarray:
        """What the drives of a simulator bring at a further port (``drive_forces``), (*s)."""
        plant, shape = self.plant, x.shape[1:]
        inputs = np.broadcast_to(u[: len(plant.inputs)], (len(plant.inputs), *shape))
        p = {name: np.broadcast_to(value, shape) for name, value in (varied or {}).items()}
        forces = plant.simulator.drive_forces(x, inputs, {**plant.params, **p})
        return np.asarray(forces[offered_ports(plant.simulator).index(plant.ports[port])])

    def march(
        self,
        x0: np.ndarray,
        u: np.ndarray,
        lengths: np.ndarray,
        dt: float,
        varied: Mapping[str, float],
        entering: Callable[[np.ndarray], Entering] | None = None,
    ) -> np.ndarray | None:
        """Free runs (n_states, n_samples), one behind the other, by steps of the simulator's own; None where it offers no such march.

        ``x0`` (n_states, n_runs), ``lengths`` (n_runs,); ``u`` (n_inputs, n_samples): held, or (n_parts, n_inputs, n_samples): in every
            equal part of a sample.
        ``entering(rows)``: of the rows of every run (n_runs, n_most), short ones filled up with their last, what enters at the ports: a
            function of a sample, the time after it and the states there; u by default.
        """
        march = getattr(self.plant.simulator, "march", None)
        if march is None or (entering is not None and self.plant.further_ports != offered_ports(self.plant.simulator)):
            return None
        check_time()
        ages, ends = np.arange(int(lengths.max())), lengths[:, None]
        rows = (np.cumsum(lengths) - lengths)[:, None] + np.minimum(ages, ends - 1)
        own = None if entering is None else entering(rows)
        found = march(x0, u[..., rows], {**self.plant.params, **varied}, dt, own, lengths)
        return None if found is None else found[:, ages < ends]

    def output(
        self, t: Any, x: np.ndarray, u: np.ndarray, varied: Mapping[str, np.ndarray] | None = None
    ) -> np.ndarray:
        """Measured outputs, (n_outputs, *s)."""
        if self._selected is not None:
            return x[list(self._selected)]
        assert self._output is not None
        return self._call(self._output, t, x, u, varied)


class _Flattened:
    """Arrays as flat points that cannot be written; the last one is kept: stages of a step share their inputs and times."""

    def __init__(self) -> None:
        self._last: tuple[Any, tuple[int, ...], np.ndarray] = (None, (), np.empty(0))

    def __call__(self, value: Any, shape: tuple[int, ...]) -> np.ndarray:
        """Broadcast to ``shape`` and flat."""
        known, at, flat = self._last
        if known is not value or at != shape:
            flat = locked(_flat(value, shape))
            self._last = (value, shape, flat) if isinstance(value, np.ndarray) else self._last
        return flat


class _FlatParams:
    """All parameters at flat points; the last ones are kept: all stages of all steps share those that do not drift."""

    def __init__(self, nominal: Mapping[str, Any]):
        self._nominal = nominal
        self._last: tuple[Any, tuple[int, ...], Mapping[str, Any]] = (None, (), nominal)
        self._parts: dict[str, tuple[Any, np.ndarray]] = {}  #: Values as they came, and flat

    def __call__(self, varied: Mapping[str, np.ndarray], shape: tuple[int, ...]) -> Mapping[str, Any]:
        """The nominal ones and the varied ones broadcast to ``shape``, flat."""
        known, at, flat = self._last
        if known is not varied or at != shape:
            before = self._parts if at == shape else {}
            self._parts = {
                name: before[name]
                if name in before and before[name][0] is value
                else (value, locked(_flat(value, shape)))
                for name, value in varied.items()
            }
            flat = {**self._nominal, **{name: part for name, (_, part) in self._parts.items()}}
            self._last = varied, shape, flat
        return flat


def _flat(value: Any, shape: tuple[int, ...]) -> np.ndarray:
    """Broadcast to a shape and flat; quicker than :func:`numpy.broadcast_to` on arrays of this size."""
    if np.size(value) == math.prod(shape):
        return np.reshape(value, -1)
    out = np.empty(shape)
    out[...] = value
    return out.reshape(-1)
