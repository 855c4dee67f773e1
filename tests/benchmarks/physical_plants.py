"""Plants with effects in the form that nature gives them: how they are integrated, excited and recorded.

Each case is a function of a random generator that returns simulator, inputs, readings, runs, and the truth in words. The truth is
integrated by ``scipy.integrate.solve_ivp`` (LSODA, relative tolerance 1e-8) and shares no code with the package.
"""

import numpy as np
from scipy.integrate import solve_ivp

#: Cases by name, and arguments of the diagnosis that they need.
CASES = {}
KW = {}


def case(f):
    """Take a function up as a case."""
    CASES[f.__name__] = f
    return f


def run(rhs, x0, U, dt):
    """States at the samples, inputs held; LSODA with tight tolerances."""
    X = [np.asarray(x0, float)]
    for k, u in enumerate(U[:-1]):
        s = solve_ivp(
            lambda t, x, u=u: rhs(t, x, u), (k * dt, (k + 1) * dt), X[-1], method="LSODA", rtol=1e-8, atol=1e-10
        )
        X.append(s.y[:, -1])
    return np.array(X)


def steps(rng, n, low, high, hold):
    """Levels (n,) that last about ``hold`` samples."""
    out = []
    while len(out) < n:
        out += [rng.uniform(low, high)] * int(rng.integers(hold // 2, 2 * hold))
    return np.array(out[:n])


def sines(rng, n, dt, amp, f0, f1, k=6):
    """A sum (n,) of k sines with frequencies between f0 and f1 in Hz."""
    t = np.arange(n) * dt
    f = np.exp(rng.uniform(np.log(f0), np.log(f1), k))
    return amp * sum(np.sin(2 * np.pi * a * t + rng.uniform(0, 6.28)) for a in f) / np.sqrt(k / 2)


def record(rng, runs, out, noise):
    """Inputs, readings and runs; ``runs`` are pairs (U, X), ``out(X, U)`` gives Y, noise is a share of the deviation of each output."""
    U = np.vstack([u for u, _ in runs])
    Ys = [out(x, u) for u, x in runs]
    Y = np.vstack(Ys)
    Y = Y + noise * Y.std(0) * rng.normal(size=Y.shape)
    g = np.repeat(np.arange(len(runs)), [len(u) for u, _ in runs])
    return U, Y, g
