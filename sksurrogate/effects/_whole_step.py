"""One sample of a simulator that steps, with effects: their terms before and after its step, laws at ports within it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol

import numpy as np

from sksurrogate.physics._simulator import Plant


class Effects(Protocol):
    """What a step asks of a model with its parameters filled in (:class:`~sksurrogate.effects._model.BoundModel`)."""

    a: Any
    held: float
    moves_within: bool
    moves_params: bool

    def rates_of_effects(self, t: np.ndarray, x: np.ndarray, u: np.ndarray, dx: np.ndarray) -> np.ndarray:
        """``dx`` with the terms of the effects added and the rates of hidden states filled in."""

    def entering(self, t: np.ndarray, x: np.ndarray, u: np.ndarray) -> np.ndarray:
        """What enters at the ports."""

    def params_at(self, t: np.ndarray, x: np.ndarray, u: np.ndarray) -> dict[str, np.ndarray]:
        """Parameters of the simulator that differ from their nominal values."""


def held_for(plant: Plant, dt: float, h: float) -> float:
    """Time over which a law at a port is held: a substep ``h`` of a right-hand side, a step of a simulator that steps.

    A simulator that says what its own ``timestep`` is takes its sample in these steps, a new force at each; any other takes
    the sample whole.
    """
    if plant.access != "step":
        return h
    return dt / max(1, round(dt / float(plant.simulator.timestep))) if has_own_steps(plant) else dt


def has_own_steps(plant: Plant) -> bool:
    """Whether a simulator that steps says what its own step is."""
    return plant.access == "step" and bool(getattr(plant.simulator, "timestep", None))


def by_own_steps(mean: np.ndarray, parts: int) -> np.ndarray:
    """Means over equal parts of a sample, (parts, ...), from those over equal substeps, (n_sub, ...).

    >>> by_own_steps(np.array([0.0, 0.0, 1.0, 3.0]), 2), by_own_steps(np.array([0.0, 3.0]), 3)
    (array([0., 2.]), array([0. , 1.5, 3. ]))
    """
    edges = np.linspace(0.0, len(mean), parts + 1)
    overlap = np.clip(edges[1:, None] - np.arange(len(mean)), 0.0, 1.0) - np.clip(
        edges[:-1, None] - np.arange(len(mean)), 0.0, 1.0
    )
    return np.asarray(np.tensordot(overlap, mean, 1) * (parts / len(mean)))


def whole_step(
    bound: Effects, t: np.ndarray, x: np.ndarray, mean: np.ndarray, has_rates: bool, has_ports: bool
) -> np.ndarray:
    """States one sample later.

    A simulator's own steps, each between two half steps of the terms that effects have themselves (Strang).

    ``t``: times of the samples.
    ``x`` (n_states, n_columns, n_samples).
    ``mean`` (n_sub, n_inputs, n_columns | 1, n_samples).
    ``has_rates, has_ports``: whether effects act on balances or have states of their own, and whether they act at ports.
    """
    a = bound.a
    u = np.mean(mean, axis=0)
    if bound.moves_within or (has_ports and has_own_steps(a.plant)):
        parts = own_steps(bound)
        inputs = by_own_steps(mean, parts) if bound.moves_within else [u] * parts
        h = a.record.dt / parts
        for part, one in enumerate(inputs):
            x = _own_step(bound, t + part * h, x, one, h, _amid(bound, t + part * h, x, one, h), has_rates)
        return x
    dt = a.record.dt
    varied = _amid(bound, t, x, u, dt)
    drift = _drift(bound, t, x, u, dt, varied) if has_rates else None
    if drift is not None:
        x = _kick(bound, t, x, mean[0], dt / 2, drift)
    x = _mean_step(bound, t, x, u, dt, varied, has_ports)
    return x if drift is None else _kick(bound, t + dt, x, mean[-1], dt / 2, drift)


def own_run(bound: Effects, x0: np.ndarray, mean: np.ndarray, has_ports: bool) -> np.ndarray | None:
    """Free run (n_states, n_samples) from initial states (n_states, n_runs) by the simulator itself; None where it offers none.

    Effects are constant parameters, inputs and laws at ports, with their hidden states.

    ``mean`` (n_sub, n_inputs, 1, n_samples).
    """
    a, record = bound.a, bound.a.record
    u = by_own_steps(mean, own_steps(bound)) if bound.moves_within else np.mean(mean, axis=0, keepdims=True)
    varied = {name: float(np.ravel(value)[0]) for name, value in bound.params_at(record.t, x0, u[0]).items()}
    hidden = np.full((a.n_states - a.n_nominal, record.n_samples), np.nan)

    def entering(rows: np.ndarray) -> _Laws:
        return _Laws(bound, u, rows, x0[a.n_nominal :], hidden)

    run: np.ndarray | None = a.model.march(
        x0[: a.n_nominal], u[:, :, 0], record.lengths, record.dt, varied, entering if has_ports else None
    )
    return run if run is None or not len(hidden) else np.concatenate([run, hidden])


def own_steps(bound: Effects) -> int:
    """Steps of the simulator's own in a sample."""
    return max(1, round(bound.a.record.dt / bound.held))


class _Laws:
    """What enters at the ports in runs by the simulator's own steps; hidden states of the laws are carried along.

    ``u`` (n_parts, n_inputs, 1, n_samples): in every equal part of a sample.
    ``rows`` (n_runs, n_most): of every run, short ones filled up with their last.
    ``z`` (n_hidden, n_runs): initial hidden states.
    ``hidden`` (n_hidden, n_samples): takes them up.
    """

    def __init__(self, bound: Effects, u: np.ndarray, rows: np.ndarray, z: np.ndarray, hidden: np.ndarray):
        self.bound, self.u, self.rows, self.z, self.hidden = bound, u, rows, z, hidden
        self.last: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None  # time, states and inputs of the step before

    def __call__(self, k: int, after: float, x: np.ndarray) -> np.ndarray:
        rows, dt = self.rows[:, k], self.bound.a.record.dt
        part = int(len(self.u) * after / dt + 1e-6)
        t, u = self.bound.a.record.t[rows] + after, self.u[part][..., rows]
        whole = np.concatenate([x, self.z])[:, None]
        if len(self.z):
            if self.last is not None:
                whole = _carried(self.bound, *self.last, whole, self.bound.held)
                self.z = whole[len(x) :, 0]
            if after == 0.0:
                new = rows != self.rows[:, k - 1] if k else np.ones(len(rows), bool)
                self.hidden[:, rows[new]] = self.z[:, new]
            self.last = t, whole, u
        return self.bound.entering(t, whole, u)[:, 0]


def _amid(bound: Effects, t: np.ndarray, x: np.ndarray, u: np.ndarray, h: float) -> Mapping[str, np.ndarray]:
    """Parameters of the simulator amid a step, where its states are half way: with them over the whole step it is of second order."""
    a, n = bound.a, bound.a.n_nominal
    varied = bound.params_at(t, x, u)
    if not bound.moves_params:
        return varied
    amid = x.copy()
    amid[:n] = 0.5 * (x[:n] + a.model.step(t, x[:n], bound.entering(t, x, u), h, varied))
    return bound.params_at(t + h / 2, amid, u)


def _drift(bound: Effects, t: np.ndarray, x: np.ndarray, u: np.ndarray, h: float, varied: Any) -> np.ndarray:
    """What the simulator itself adds to dx/dt; needed by hidden states, which follow dv/dt."""
    a, n = bound.a, bound.a.n_nominal
    drift = np.zeros_like(x)
    if a.n_states > n:
        drift[:n] = (a.model.step(t, x[:n], bound.entering(t, x, u), h, varied) - x[:n]) / h
    return drift


def _kick(bound: Effects, t: np.ndarray, x: np.ndarray, u: np.ndarray, h: float, drift: np.ndarray) -> np.ndarray:
    """The effects' own terms alone over a time h (midpoint rule)."""
    rate = bound.rates_of_effects(t, x, u, drift.copy()) - drift
    return x + h * (bound.rates_of_effects(t, x + (h / 2) * rate, u, drift.copy()) - drift)


def _own_step(
    bound: Effects, t: np.ndarray, x: np.ndarray, u: np.ndarray, h: float, varied: Any, has_rates: bool
) -> np.ndarray:
    """One of the simulator's own steps, laws at ports held over it; then the effects' own terms over the same time."""
    a, n = bound.a, bound.a.n_nominal
    after = x.copy()
    after[:n] = a.model.step(t, x[:n], bound.entering(t, x, u), h, varied)
    return _carried(bound, t, x, u, after, h) if has_rates else after


def _carried(bound: Effects, t: np.ndarray, x: np.ndarray, u: np.ndarray, after: np.ndarray, h: float) -> np.ndarray:
    """States behind one of the simulator's own steps, with the effects' own terms over the same time.

    These see the states amid the step and the rates that it had: a spring yields as the joint has just moved, as in the
    semi-implicit steps of the simulators that say what their own step is.
    """
    n, drift = bound.a.n_nominal, np.zeros_like(x)
    drift[:n] = (after[:n] - x[:n]) / h
    amid = after.copy()
    amid[:n] = 0.5 * (x[:n] + after[:n])
    rate = bound.rates_of_effects(t, amid, u, drift.copy()) - drift
    amid += (h / 2) * rate
    return after + h * (bound.rates_of_effects(t + h / 2, amid, u, drift.copy()) - drift)


def _mean_step(
    bound: Effects, t: np.ndarray, x: np.ndarray, u: np.ndarray, h: float, varied: Any, has_ports: bool
) -> np.ndarray:
    """One step of the simulator; a law at a port counts as the mean of its values before and after (Heun)."""
    a, n = bound.a, bound.a.n_nominal
    enters = bound.entering(t, x, u) if has_ports else u
    after = x.copy()
    after[:n] = a.model.step(t, x[:n], enters, h, varied)
    if has_ports:
        later = bound.entering(t + h, after, u)
        after[:n] = a.model.step(t, x[:n], 0.5 * (enters + later), h, varied)
    return after
