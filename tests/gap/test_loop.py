"""Closed-loop data: a controller that acts at once brings the noise of the outputs into the input."""

from __future__ import annotations

import numpy as np
import pytest

from sksurrogate.gap import GapDiagnoser
from sksurrogate.gap.fit._closed_loop import RESIDUAL_LAGS, _past, closed_loop
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
    noisy = Record(
        u[None], (clean + other)[None], t, np.arange(0, len(u), N), DT
    )  # a noise that the input does not follow
    assert closed_loop(noisy, clean[None], ["i"]) is None


@pytest.mark.parametrize("seed", range(3))
def test_noise_in_the_input_is_not_an_effect_of_the_input(seed):
    plant, u, y, groups, _ = controlled(seed)
    report = GapDiagnoser(plant, random_state=0).fit(u[:, None], y, groups=groups).report_
    assert report.verdict == "none", [(e.name, e.location) for e in report.effects]
    assert any("closed-loop" in note for note in report.notes)


def profile(rng, n, lines=13):
    """A fixed profile of the input: lines of a multisine."""
    t = np.arange(n)
    return sum(np.sin(2 * np.pi * 3 * k * t / n + rng.uniform(0, 6.3)) for k in range(1, lines))


def open_loop(seed, repeated, nonlinear, n=600):
    """Two runs of an open loop; the model lacks a term that answers the profile."""
    rng = np.random.default_rng(100 + seed)
    u = np.stack([profile(np.random.default_rng(seed if repeated else 2 * seed + run), n) for run in (0, 1)])
    y, model = np.zeros((2, 2, n))
    for k in range(n - 1):
        y[:, k + 1] = y[:, k] + 0.1 * (u[:, k] - y[:, k] - nonlinear * (y[:, k] ** 3 + 0.3 * np.sign(y[:, k])))
        model[:, k + 1] = model[:, k] + 0.1 * (u[:, k] - model[:, k])
    y += 0.002 * rng.normal(size=y.shape)
    return Record(u.reshape(1, -1), y.reshape(1, -1), np.arange(2 * n) * DT, np.array([0, n]), DT), model.reshape(1, -1)


@pytest.mark.parametrize("repeated", [False, True])
@pytest.mark.parametrize("nonlinear", [0.05, 0.2, 0.5])
def test_a_fixed_profile_that_the_error_of_the_model_answers_is_no_loop(repeated, nonlinear):
    for seed in range(4):
        assert closed_loop(*open_loop(seed, repeated, nonlinear), ["u"]) is None


@pytest.mark.parametrize("seed", range(2))
def test_a_loop_is_seen_through_an_error_of_the_model(seed):
    rng, n = np.random.default_rng(seed), 1200
    reference, integral = np.repeat(rng.normal(size=n // 100), 100), 0.0
    u, y, model = np.zeros((3, n))
    x = 0.0
    for k in range(n):
        y[k] = x + 0.02 * rng.normal()
        error = reference[k] - y[k]
        integral += 0.05 * error
        u[k] = error + integral
        x += 0.1 * (u[k] - x - 0.1 * x**3)
        if k + 1 < n:
            model[k + 1] = model[k] + 0.1 * (u[k] - model[k])
    record = Record(u[None], y[None], DT * np.arange(n), np.array([0]), DT)
    assert closed_loop(record, model[None], ["u"]) == "u"


def test_an_operator_knows_the_past_of_inputs_and_of_the_model_and_nothing_of_this_sample():
    u, y = np.random.default_rng(0).normal(size=(2, 1, 40))
    record = Record.from_runs([u.T], [y.T], [DT * np.arange(40)], DT)
    rows = np.arange(RESIDUAL_LAGS + 1, 40)
    known = np.array(_past(record, y, rows, 2))
    wanted = [u[0, rows - 1], u[0, rows - 2], *(y[0, rows - lag] for lag in range(1, RESIDUAL_LAGS + 1))]
    np.testing.assert_array_equal(known, [*wanted, y[0, rows - 1] * np.abs(y[0, rows - 1])])


@pytest.mark.parametrize("seed", range(12))
def test_few_steps_of_an_open_loop_follow_no_noise(seed):
    """Levels that are held for 5 to 13 samples, drawn before the noise: a hundred moves cannot tell eighty lags from a controller."""
    rng = np.random.default_rng(seed)
    levels = np.repeat(rng.uniform(-1, 1, (2, 200)), rng.integers(5, 14, 200), axis=1)[:, :1000]
    t = np.arange(1000) * DT
    clean = np.cumsum(levels, axis=1) * DT
    record = Record(levels, clean + 0.01 * rng.normal(size=clean.shape), t, np.arange(0, 1000, 200), DT)
    assert closed_loop(record, clean, ["a", "b"]) is None


@pytest.mark.parametrize("seed", range(3))
def test_a_slow_controller_is_seen(seed):
    """It acts in every fifth sample, by what was measured there."""
    rng = np.random.default_rng(seed)
    noise, y, u = 0.05 * rng.normal(size=1200), np.zeros(1200), np.zeros(1200)
    for k in range(1, 1200):
        y[k] = 0.9 * y[k - 1] + 0.1 * u[k - 1]
        u[k] = 0.1 * rng.normal() - 2.0 * (y[k] + noise[k]) if k % 5 == 0 else u[k - 1]
    record = Record(u[None], (y + noise)[None], np.arange(1200) * DT, np.array([0, 600]), DT)
    assert closed_loop(record, y[None], ["u"]) == "u"
