"""Long runs that are stiff now and then: substeps of their own for the samples that need them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from sksurrogate.physics import ODESimulator, _free_run
from sksurrogate.physics._own_substeps import run_with_own_substeps

DT, WIDTH, LEVEL = 0.1, 1e-3, 0.3


def slider(t, x, u, p):
    """A mass on a spring with dry friction of a width: it sticks now and then, and is stiff there (300 per second)."""
    return [x[1], u[0] - x[0] - 0.3 * x[1] - LEVEL * np.tanh(x[1] / WIDTH)]


def simulator(**how):
    return ODESimulator(slider, states=["x", "v"], inputs=["u"], outputs=["x"], params={}, dt=DT, **how)


def pushes(rows, seed=0, held=20):
    return np.repeat(np.random.default_rng(seed).uniform(-1, 1, rows // held), held)


def true_positions(push, held):
    """The run by an implicit method with an error of 1e-11, one call a stretch of inputs that are held, or (0) joined linearly."""
    x, out = np.zeros(2), [np.zeros(2)]
    stretch = held or 1
    for k in range(0, len(push) - 1, stretch):
        slope = 0.0 if held else (push[k + 1] - push[k]) / DT
        found = solve_ivp(
            lambda t, x, k=k, slope=slope: slider(t, x, [push[k] + slope * t], {}),
            (0, stretch * DT),
            x,
            method="Radau",
            rtol=1e-11,
            atol=1e-13,
            t_eval=DT * np.arange(1, stretch + 1),
            jac=lambda t, x: [[0, 1], [-1, -0.3 - LEVEL / WIDTH / np.cosh(np.clip(x[1] / WIDTH, -300, 300)) ** 2]],
        )
        x = found.y[:, -1]
        out += list(found.y.T)
    return np.array(out)[: len(push), 0]


@pytest.fixture
def no_scipy(monkeypatch):
    """A free run that asks scipy's integrator fails."""

    def never(*args, **how):
        raise AssertionError("scipy's integrator was asked")

    monkeypatch.setattr(_free_run, "solve_ivp", never)
    monkeypatch.setattr(_free_run, "LONG_RUN", 100)


@pytest.mark.parametrize(("hold", "held"), [("zoh", 20), ("foh", 0)])
def test_a_slider_that_sticks_now_and_then_is_the_run_of_an_implicit_method(no_scipy, hold, held):
    push = pushes(300)
    found = simulator(hold=hold).simulate(push[:, None])[:, 0]
    assert np.max(np.abs(found - true_positions(push, held))) < 1e-7


def test_runs_side_by_side_are_those_of_one_after_the_other(no_scipy):
    U = np.stack([pushes(300, seed)[:, None] for seed in (1, 2)])
    together = simulator().simulate_batch(U, [[0.0, 0.0], [0.5, -0.2]])
    for row, start in enumerate([[0.0, 0.0], [0.5, -0.2]]):
        np.testing.assert_allclose(together[row], simulator().simulate(U[row], start), atol=1e-7)


def test_few_calls_of_the_right_hand_side(no_scipy):
    calls = [0]

    def counted(t, x, u, p):
        calls[0] += 1
        return slider(t, x, u, p)

    ODESimulator(counted, states=["x", "v"], inputs=["u"], outputs=["x"], params={}, dt=DT).simulate(
        pushes(10_000)[:, None]
    )
    assert calls[0] < 20 * 10_000  # scipy's integrator asks more than a hundred times a sample


def test_a_plant_that_is_stiff_throughout_is_left_to_scipy():
    def rate(t, x, u):
        return -1e5 * (x - u)

    t = np.arange(50.0)
    U = np.sin(t)[None, :, None]
    with np.errstate(all="ignore"):
        assert run_with_own_substeps(rate, U, U[:, 0], t, np.ones(50), order=0, near=U.copy()) is None


def test_an_export_with_fixed_steps_is_refused():
    from sksurrogate.exceptions import SimulatorError

    with pytest.raises(SimulatorError, match="variable steps"):
        simulator().substeps(pushes(1_200)[:, None])
