"""Runs that were given as one are told at once, and nothing else that jumps is taken for them."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

from sksurrogate.gap import GapDiagnoser
from sksurrogate.gap.faults._joined_runs import joined_at, say_joined_runs
from sksurrogate.physics import ODESimulator
from sksurrogate.physics._simulator import describe
from sksurrogate.runs import resolve_runs

N, RUNS, NOISE = 150, 4, 0.01


def arm(stiffness=4.0, outputs=("angle", "speed")):
    return ODESimulator(
        lambda t, x, u, p: [x[1], u[0] - p["k"] * x[0] - 0.6 * x[1]],
        states=["angle", "speed"], inputs=["torque"], outputs=list(outputs), params={"k": stiffness}, dt=0.05,
    )  # fmt: skip


def record(outputs=("angle", "speed"), seed=0):
    """Runs from rest under steps of torque, one behind the other."""
    rng = np.random.default_rng(seed)
    U = np.repeat(rng.uniform(-2, 2, (RUNS, N // 15)), 15, axis=1)
    Y = np.concatenate([arm(3.6, outputs).simulate(u[:, None], x0=[1.0, 0.0]) for u in U])
    return U.reshape(-1, 1), Y + NOISE * rng.normal(size=Y.shape), np.repeat(np.arange(RUNS), N)


def said(X, y, groups, simulator):
    plant = describe(simulator, n_inputs=X.shape[1], n_outputs=y.shape[1])
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        say_joined_runs(list(resolve_runs(X, y, groups=groups, unmeasured=True)), plant)
    return [str(one.message) for one in caught]


def test_forgotten_groups_are_told_with_their_rows():
    X, y, groups = record()
    (sentence,) = said(X, y, None, arm())
    assert "'angle'" in sentence and "rows 150, 300, 450" in sentence and "groups" in sentence
    assert said(X, y, groups, arm()) == []


def test_the_diagnosis_warns_before_it_searches():
    X, y, _ = record()
    with pytest.warns(UserWarning, match="jump at rows 150, 300, 450"):
        GapDiagnoser(arm(), effects=["linear_loss"], time_limit=5, n_jobs=1).fit(X, y)


def test_some_rows_that_were_not_measured_hide_no_seam():
    X, y, _ = record()
    y[np.random.default_rng(1).random(y.shape) < 0.05] = np.nan
    (sentence,) = said(X, y, None, arm())
    assert "jump at rows" in sentence


def test_a_sensor_that_is_hit_and_recovers_is_no_seam():
    X, y, groups = record(("angle",))
    y[40:90] += 0.8
    assert said(X, y, groups, arm(outputs=("angle",))) == []


def test_what_the_simulator_does_too_is_no_seam():
    """An output that holds the input jumps with it, and a delay of the plant's moves the jumps to other rows."""
    fast = ODESimulator(
        lambda t, x, u, p: [(u[0] - x[0]) / 0.01],
        states=["flow"], inputs=["valve"], outputs=["flow"], params={}, dt=0.05,
    )  # fmt: skip
    X = np.repeat(np.random.default_rng(2).uniform(-2, 2, N // 15), 15)[:, None]
    y = np.roll(fast.simulate(X), 2, axis=0)
    assert len(joined_at(y)[0]) >= 3
    assert said(X, y, None, fast) == []


def test_what_an_input_does_to_the_reading_at_once_is_no_seam():
    """A series resistance that the simulator does not have; the runs behind it are seen as before."""
    X, y, groups = record(("angle",))
    assert said(X, y + 0.8 * X, groups, arm(outputs=("angle",))) == []
    (sentence,) = said(X, y + 0.8 * X, None, arm(outputs=("angle",)))
    assert "rows 150, 300, 450" in sentence


def test_levels_of_a_coarse_sensor_are_no_seams():
    X, y, groups = record(("angle",))
    y = 0.6 * np.round(y / 0.6) + 0.01 * np.random.default_rng(3).normal(size=y.shape)
    assert said(X, y, groups, arm(outputs=("angle",))) == []


def test_a_command_that_follows_the_reading_shows_nothing_at_once():
    """A mass under its controller: the reference jumps, and the reading does not."""
    simulator = ODESimulator(
        lambda t, x, u, p: [x[1], (u[0] - 3.0 * x[1]) / 2.0],
        states=["x", "v"], inputs=["force"], outputs=["x"], params={}, dt=0.02,
    )  # fmt: skip
    for seed in range(30):
        rng, x, v, X, Y = np.random.default_rng(seed), 0.0, 0.0, [], []
        reference = np.repeat(rng.uniform(-1.0, 1.0, 6), 50)
        for aim in reference:
            X.append(np.clip(20.0 * (aim - x) - 6.0 * v, -15.0, 15.0))
            Y.append(x)
            for _ in range(20):
                v += 0.001 * (X[-1] - 3.0 * v) / 2.0
                x += 0.001 * v
        y = np.array(Y)[:, None] + 0.005 * np.ptp(Y) * rng.normal(size=(300, 1))
        assert said(np.array(X)[:, None], y, None, simulator) == [], seed
