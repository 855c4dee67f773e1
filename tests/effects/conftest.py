"""A two-state plant, its inputs, and a reference integrator that shares no code with the package."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from sksurrogate.physics import ODESimulator

DT, N = 0.02, 150
X0 = (0.1, 0.0)


def oscillator_rhs(t, x, u, p):
    q, v = x
    return v, (u[0] - p["k"] * q - p["c"] * v) / p["m"]


def tanks_rhs(t, x, u, p):
    upper, lower = x
    return u[0] - p["a"] * upper + p["idle"], p["a"] * upper - p["b"] * lower + u[1]


def tanks_output(t, x, u, p):
    return x[0], x[0] + 2 * x[1]


def _oscillator(hold="zoh"):
    names = {"states": ["q", "v"], "inputs": ["u"], "outputs": ["q"]}
    return ODESimulator(oscillator_rhs, **names, params={"m": 1.0, "k": 20.0, "c": 0.3}, dt=DT, hold=hold)


def _tanks(hold="zoh"):
    names = {"states": ["upper", "lower"], "inputs": ["first", "second"], "outputs": ["level", "scale"]}
    return ODESimulator(
        tanks_rhs,
        **names,
        params={"a": 1.0, "b": 0.6, "idle": 0.0},
        dt=0.1,
        hold=hold,
        output=tanks_output,
        x0=[1.0, 0.5],
    )


def _reference(rhs, z0, inputs, n=N, dt=DT, edges=(), steps=4):
    """States at the samples of ``rhs(t, z, u)``; ``inputs`` (n,) held, or a function of t that jumps at ``edges``."""
    t = dt * np.arange(n)
    stops = np.unique(np.r_[t, [edge for edge in edges if 0 < edge < t[-1]]])
    states, z = {0.0: np.asarray(z0, dtype=float)}, np.asarray(z0, dtype=float)
    for a, b in pairwise(stops):
        held = None if callable(inputs) else inputs[int(np.searchsorted(t, a + 1e-9) - 1)]
        inside = 1e-13 * (b - a)  # a jump at the very end belongs to the next stretch

        def f(now, z, held=held, a=a, b=b, inside=inside):
            return rhs(now, z, inputs(min(max(now, a + inside), b - inside)) if held is None else held)

        z = solve_ivp(f, (a, b), z, rtol=1e-9, atol=1e-12, max_step=dt / steps).y[:, -1]
        states[b] = z
    return np.array([states[now] for now in t])


@pytest.fixture(scope="session")
def make_oscillator():
    """``make_oscillator(hold="zoh")``: states q, v; input u; output q."""
    return _oscillator


@pytest.fixture(scope="session")
def make_tanks():
    """``make_tanks(hold="zoh")``: two states, two inputs, two outputs, three parameters."""
    return _tanks


@pytest.fixture(scope="session")
def reference():
    """``reference(rhs, z0, inputs, n, dt, edges)``: states by scipy."""
    return _reference


@pytest.fixture(scope="session")
def oscillator():
    return _oscillator()


@pytest.fixture(scope="session")
def tanks():
    return _tanks()


@pytest.fixture(scope="session")
def force():
    """Random levels, held for five samples each."""
    return 3 * np.repeat(np.random.default_rng(0).normal(size=N // 5), 5)[:, None]
