"""Free runs window by window are those of a loop over time, whatever the map does."""

from __future__ import annotations

import numpy as np
import pytest

from sksurrogate.effects._model import AugmentedModel
from sksurrogate.kernels import damped_steps
from sksurrogate.kernels.record import Record
from sksurrogate.kernels.windows import SHORTEST_WINDOW, run_in_windows
from sksurrogate.physics import ODESimulator, StepSimulator
from sksurrogate.physics import _free_run as free_runs
from sksurrogate.physics._model import PlantModel
from sksurrogate.physics._simulator import describe

rng = np.random.default_rng(0)
U = np.repeat(rng.uniform(-1.0, 1.0, 200), 15)


def walked(step, x0, starts, lengths):
    """The oracle: sample by sample, run by run."""
    out = np.full((len(x0), lengths.sum()), np.nan)
    out[:, starts] = x0
    for start, length in zip(starts, lengths):
        for k in range(start, start + length - 1):
            out[:, k + 1] = step(out[:, k : k + 1, None], np.array([k]))[:, 0, 0]
    return out


def spring(x, rows):
    """A hardening spring, semi-implicit."""
    v = x[1] + 0.1 * (U[rows] - x[0] - 0.5 * x[0] ** 3 - 0.2 * x[1])
    return np.stack([x[0] + 0.1 * v, v])


def sticking(x, rows):
    """Dry friction that holds: no slope leads out of rest."""
    v = x[1] + 0.1 * (U[rows] - x[0])
    v = np.sign(v) * np.maximum(np.abs(v) - 0.05, 0.0)
    return np.stack([x[0] + 0.1 * v, v])


def limited(x, rows):
    """A hard stop."""
    v = x[1] + 0.1 * (U[rows] - 0.2 * x[1])
    place = np.clip(x[0] + 0.1 * v, -0.3, 0.3)
    return np.stack([place, np.where(np.abs(place) < 0.3, v, 0.0)])


@pytest.mark.parametrize("step", [spring, sticking, limited])
def test_runs_of_several_lengths_are_those_of_a_loop(step):
    starts, lengths = np.array([0, 1500, 1501, 2501]), np.array([1500, 1, 1000, 499])
    x0 = rng.uniform(-0.2, 0.2, (2, 4))
    found = run_in_windows(step, x0, starts, lengths, np.ones(2))
    assert np.allclose(found, walked(step, x0, starts, lengths), rtol=0.0, atol=1e-9)


def test_a_linear_run_has_its_closed_form():
    found = run_in_windows(lambda x, rows: 0.9 * x + 1.0, np.zeros((1, 1)), np.array([0]), np.array([500]), np.ones(1))
    assert np.allclose(found[0], 10.0 * (1.0 - 0.9 ** np.arange(500)), rtol=1e-12)


def test_few_evaluations_where_the_map_is_smooth():
    asked = []

    def counted(x, rows):
        asked.append(len(rows))
        return spring(x, rows)

    run_in_windows(counted, np.zeros((2, 1)), np.array([0]), np.array([3000]), np.ones(2))
    assert len(asked) < 3000 / 3


def test_a_run_that_diverges_leaves_the_others():
    with np.errstate(all="ignore"):
        found = run_in_windows(
            lambda x, rows: np.where(rows < 300, x**3 + x, 0.5 * x), np.ones((1, 2)), np.array([0, 300]),
            np.array([300, 300]), np.ones(1),
        )  # fmt: skip
    assert np.isnan(found[0, 299])
    assert np.allclose(found[0, 300:], 0.5 ** np.arange(300), atol=1e-12)


def test_from_a_trajectory_nearby_a_run_is_one_window():
    starts, lengths = np.array([0]), np.array([3000])
    exact = run_in_windows(spring, np.zeros((2, 1)), starts, lengths, np.ones(2))
    asked = []

    def counted(x, rows):
        asked.append(len(rows))
        return spring(x, rows)

    found = run_in_windows(counted, np.zeros((2, 1)), starts, lengths, np.ones(2), exact + 1e-4)
    assert len(asked) <= SHORTEST_WINDOW
    assert np.allclose(found, exact, atol=1e-9)


def friction(t, x, u, p):
    return [x[1], u[0] - x[0] - 0.2 * x[1] - 0.3 * np.tanh(x[1] / p["width"])]


@pytest.mark.slow
@pytest.mark.parametrize("hold", ["zoh", "foh"])
def test_a_long_run_of_a_simulator_is_that_of_a_loop(monkeypatch, hold):
    simulator = ODESimulator(
        friction, states=["x", "v"], inputs=["u"], outputs=["x"], params={"width": 0.05}, dt=0.1, hold=hold
    )
    in_windows = simulator.simulate(U[:1200, None])
    monkeypatch.setattr(free_runs, "LONG_RUN", 10_000)
    assert np.allclose(in_windows, simulator.simulate(U[:1200, None]), rtol=0.0, atol=1e-10)


@pytest.mark.filterwarnings("ignore:step does not take arrays")
@pytest.mark.parametrize("vectorised", [True, False])
def test_where_newton_fails_on_a_step_its_runs_close_in_windows_if_one_call_takes_many_samples(monkeypatch, vectorised):
    """A Python step costs a call, whatever number of samples it takes: an irrigation canal was walked through for minutes."""
    asked = []

    def tank(t, x, u, p, dt):
        asked.append(np.size(x))
        if not vectorised and np.ndim(x[0]) > 0:
            raise TypeError("one point at a time")
        return (x[0] + dt * (u[0] - 0.8 * np.sqrt(np.maximum(x[0], 1e-3))),)

    simulator = StepSimulator(tank, states=["level"], inputs=["flow"], outputs=["level"], params={}, dt=0.1)
    flows, n = [np.abs(U[k : k + 400, None]) for k in (0, 700)], 400
    runs = [simulator.simulate(flow, x0=[1.0]) for flow in flows]
    record = Record.from_runs(flows, runs, [0.1 * np.arange(n)] * 2, 0.1)
    model = AugmentedModel(PlantModel(describe(simulator)), (), (), record, n_sub=1, scale=np.ones(1))
    monkeypatch.setattr(damped_steps, "close", lambda bound, x, *rest, **how: (x, False, 0))
    fit = damped_steps.DampedSteps(model, np.ones(1), np.ones(0), (np.zeros(0), np.zeros(0)))
    bound, x = model.bind(np.zeros((0, 1))), np.ones((1, 2 * n))
    bound(x[:, None])  # as Newton's method does
    asked.clear()
    x, ok = fit.run_from(bound, x, None)
    assert ok and fit.jumps is not vectorised
    np.testing.assert_allclose(x, np.concatenate(runs).T, atol=1e-9)
    assert len(asked) < n / 4 if vectorised else len(asked) >= 2 * (n - 1)


def test_a_run_that_leaves_its_size_behind_is_closed_in_windows_too():
    rows, calls = 400, []

    def growing(x, rows):
        calls.append(len(rows))
        return 1.2 * x + 0.1 * np.sin(x)

    found = run_in_windows(growing, np.ones((1, 1)), np.array([0]), np.array([rows]), np.ones(1))
    windowed = len(calls)
    exact = walked(growing, np.ones((1, 1)), np.array([0]), np.array([rows]))
    assert exact[0, -1] > 1e25
    np.testing.assert_allclose(found, exact, rtol=1e-9)
    assert windowed < 0.75 * rows  # sample by sample it takes a call each, and those of the windows that fail
