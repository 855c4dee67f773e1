"""The next experiment around a simulator that only gives trajectories."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sksurrogate.exceptions import SurrogateError
from sksurrogate.gap.decide._experiment import leaves_the_range, name_of, suggestion
from sksurrogate.gap.fit._trajectory import Around, Trial
from sksurrogate.gap.results._next_experiment import NextExperiment
from sksurrogate.kernels.record import Record

__all__ = ["next_experiment"]


def next_experiment(around: Around, final: Trial, slots: Sequence[list[tuple[Trial, bool]]]) -> NextExperiment | None:
    """Inputs that would separate the tied rivals, by the simulator's own answers."""
    tied = max(slots, key=len, default=[])
    if not tied:
        return None
    i = list(slots).index(tied)
    names = [name_of(final.effects[i]), *(name_of(t.effects[-1]) for t, _ in tied[:4])]
    varied = _inputs(around.record, around.plant.inputs)
    apart = _apart(around, final, [t for t, _ in tied[:4]], varied)
    beyond = {label for label, given in varied.items() if leaves_the_range(given, around.record.u)}
    return suggestion(apart, names, beyond) if apart else None


def _apart(around: Around, final: Trial, tied: Sequence[Trial], varied: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Nats that part the final trial from every tied one, by experiment."""
    assert final.noise is not None
    weight = (around.sd / final.noise.sigma)[:, None]
    out: dict[str, np.ndarray] = {}
    for label, given in varied.items():
        at = _alone(around, np.ascontiguousarray(given))
        try:
            first = at.outputs(final.effects, final.theta)
            others = [at.outputs(t.effects, t.theta) for t in tied]
        except SurrogateError:
            continue
        gains = [0.5 * float(np.sum(at.without_starts(((first - y) * weight)[None]) ** 2)) for y in others]
        if np.all(np.isfinite(gains)):
            out[label] = np.array(gains)
    return out


def _inputs(record: Record, names: Sequence[str]) -> dict[str, np.ndarray]:
    """Variations of the first run."""
    n = int(min(record.lengths[0], 400))
    u = record.u[:, :n]
    mean, index = u.mean(axis=1, keepdims=True), np.arange(n)
    spread = np.max(np.abs(u - mean), axis=1, keepdims=True)
    varied = {
        "the same run again": u,
        "a run with inputs of twice the amplitude": mean + 2 * (u - mean),
        "a run with inputs of half the amplitude": mean + 0.5 * (u - mean),
        "a run with inputs shifted up by their amplitude": u + spread,
        "a run with inputs twice as fast": u[:, (2 * index) % n],
        "a run with inputs half as fast": u[:, index // 2],
        "a run with a step in every input": np.where(index < n // 4, mean - 0.5 * spread, mean + spread),
    }
    for i, name in enumerate(names if len(names) > 1 else ()):
        only = np.repeat(mean, n, axis=1)
        only[i] = u[i]
        varied[f"a run in which only {name} moves"] = only
    return varied


def _alone(around: Around, u: np.ndarray) -> Around:
    """The same simulator over one run of other inputs."""
    n = u.shape[1]
    at = copy.copy(around)
    at.record = Record(u, around.record.y[:, :n], around.record.dt * np.arange(n), np.array([0]), around.record.dt)
    at.kept = {}
    at.x0 = None if around.x0 is None else around.x0[:1]
    at.stand_in = replace(around.stand_in, starts=at.record.starts, n_samples=n)
    at.transients = around.transients[:, :, :n]
    return at
