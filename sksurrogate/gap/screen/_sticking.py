"""Dry friction that sticks: where steps are too long for its jump, and what it does over a sample."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from sksurrogate.effects._base_effect import BaseEffect
from sksurrogate.effects._families import BalanceEffect
from sksurrogate.effects._smooth import stable
from sksurrogate.effects._wires import Wire, kink_width
from sksurrogate.gap.fit._ode import OdeBackend


def sticks(effect: BaseEffect, theta: np.ndarray, wire: Wire, h: float, load: Any = 0.0) -> np.ndarray:
    """Whether steps ``h`` would smooth the jump of an effect against its own variable further than other kinks.

    For every column of its parameters (n_parameters, ...); ``load``: what enters beside a law that depends on it.
    """
    if not isinstance(effect, BalanceEffect) or wire.width is None:
        return np.zeros(theta.shape[1:], bool)
    width = kink_width(effect, wire, list(theta), h)
    if isinstance(width, tuple):  # it follows what enters, or other signals
        size = float(np.sqrt(np.mean(np.square(load))))
        width = stable(wire.width, effect.jump(list(theta), size), h * wire.feedback)
    return np.broadcast_to(width > wire.width, theta.shape[1:])


def sticks_in(problem: OdeBackend, effects: Sequence[BaseEffect], values: Sequence[np.ndarray]) -> bool:
    """Whether one of several effects with their parameters does so in the steps of a problem."""
    h, wires = problem.record.dt / problem.numerics.n_sub, problem.augmented(effects).wires
    loads = dict(enumerate(problem.record.u))
    return any(
        wire.parameter is None and bool(sticks(effect, theta, wire, h, loads.get(wire.port, 0.0)))
        for effect, theta, wire in zip(effects, values, wires)
    )


def slowed(
    problem: OdeBackend,
    effect: BalanceEffect,
    starts: np.ndarray,
    x: np.ndarray,
    load: np.ndarray,
    push: np.ndarray | None,
) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """What acts on deviations (n_states, n_starts, n_rows) from a path x (n_states, n_samples) at some rows.

    ``load`` (n_samples,): what enters beside it.

    Over every sample friction slows its state down, and stops it where it would turn it round. At a port ``push``
    (n_states, n_samples) is what a unit force there changes in the next states: the others move with the one that stops.
    """
    record = problem.record
    place = problem.plant.states.index(str(effect.location if push is None else effect.variable))
    theta, begins = [row[:, None] for row in starts], np.zeros(record.n_samples, bool)
    begins[record.starts] = True

    def slow(s: np.ndarray, rows: np.ndarray) -> np.ndarray:
        v = s[place] + x[place, rows]
        force = effect.term(record.t[rows], load[rows], v, theta, 0.0)
        after = v + (record.dt if push is None else push[place, rows]) * force
        after = np.where(begins[rows], v, np.where(after * v > 0, after, 0.0))
        if push is None:
            s[place] = after - x[place, rows]
            return s
        gain = push[place, rows]
        impulse = np.where(gain != 0, (after - v) / np.where(gain != 0, gain, 1.0), 0.0)
        s[: len(push)] += push[:, None, rows] * impulse
        return s

    return slow
