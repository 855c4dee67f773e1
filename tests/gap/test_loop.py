"""Closed-loop data: a controller that acts at once brings the noise of the outputs into the input."""

from __future__ import annotations

import numpy as np
import pytest

from sksurrogate.gap import GapDiagnoser
from sksurrogate.gap.fit._closed_loop import closed_loop
from sksurrogate.kernels.record import Record
from sksurrogate.physics import ODESimulator

DT, N_RUNS, N = 0.1, 4, 300


def cell(t, x, u, p):
    return ((u[0] - x[0]) / p["tau"],)


def voltage(t, x, u, p):
    """The current is seen at once."""
    return (-x[0] - p["r0"] * u[0],)


def controlled(seed, noise=0.01):
    """u = reference - 2 y, with y as measured in the same sample; the reference jumps."""
    rng = np.random.default_rng(seed)
    plant = ODESimulator(
        cell, states=["x"], inputs=["i"], outputs=["v"], output=voltage, params={"tau": 1.0, "r0": 0.3}, dt=DT
    )
    a, b = np.exp(-DT), 1.0 - np.exp(-DT)
    reference = np.repeat(rng.normal(size=(N_RUNS, N // 20)), 20, axis=1)
    e = noise * rng.normal(size=(N_RUNS, N))
    x, u, y = np.zeros((3, N_RUNS, N))
    for k in range(N):
        # y = -x - r0 u + e and u = reference + y / 2, solved for u.
        u[:, k] = (reference[:, k] + 0.5 * (e[:, k] - x[:, k])) / 1.15
        y[:, k] = -x[:, k] - 0.3 * u[:, k] + e[:, k]
        if k + 1 < N:
            x[:, k + 1] = a * x[:, k] + b * u[:, k]
    return plant, u.ravel(), y.ravel(), np.repeat(np.arange(N_RUNS), N), y.ravel() - e.ravel()


def test_the_noise_is_seen_in_an_input_whose_reference_jumps():
    _, u, y, _, clean = controlled(0)
    t = np.arange(len(u)) * DT
    record = Record(u[None], y[None], t, np.arange(0, len(u), N), DT)
    assert closed_loop(record, clean[None], ["i"]) == "i"
    other = np.random.default_rng(1).normal(scale=0.01, size=len(u))
    assert closed_loop(record, (y - other)[None], ["i"]) is None


@pytest.mark.parametrize("seed", range(3))
def test_noise_in_the_input_is_not_an_effect_of_the_input(seed):
    plant, u, y, groups, _ = controlled(seed)
    report = GapDiagnoser(plant, random_state=0).fit(u[:, None], y, groups=groups).report_
    assert report.verdict == "none", [(e.name, e.location) for e in report.effects]
    assert any("closed-loop" in note for note in report.notes)
