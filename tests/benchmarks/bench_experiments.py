"""How long do designed experiments take? simulate_experiments against a loop of scipy's integrator.

Run: ``OMP_NUM_THREADS=1 python tests/benchmarks/bench_experiments.py [n_runs] [n_samples]``. The loop is timed on a few
runs of the same design and scaled up; both give the outputs of Eq. (9) to a relative 1e-6.
"""

import sys
import time

import numpy as np
from scipy.integrate import solve_ivp

from sksurrogate.datasets import make_reactor, reactor_rhs, simulate_experiments

FEW = 4


def loop(X, y0, params, dt):
    """One run, one call a held level."""
    n, out = len(X), np.empty(len(X))
    out[0] = y0
    edges = np.unique(np.r_[0, np.flatnonzero(np.diff(X[:, 0])) + 1, n - 1])
    for a, b in zip(edges[:-1], edges[1:]):
        t = dt * np.arange(a, b + 1)
        f = lambda t, x, u=X[a]: reactor_rhs(t, x, u, params)  # noqa: E731
        out[a : b + 1] = solve_ivp(f, (t[0], t[-1]), [out[a]], t_eval=t, rtol=1e-8, atol=1e-10).y[0]
    return out


def main(n_runs, n_samples):
    plant, times = make_reactor(), []
    for _ in range(3):
        start = time.perf_counter()
        data = simulate_experiments(
            plant, {"y": (0.5, 15)}, {"u": (0.05, 0.25)}, n_runs=n_runs, n_samples=n_samples, random_state=0
        )
        times.append(time.perf_counter() - start)
    ours = float(np.median(times))
    X, y = data.X.reshape(n_runs, n_samples, 1), data.y.reshape(n_runs, n_samples)
    start = time.perf_counter()
    found = [loop(X[r], data.x0[r, 0], plant.params, plant.dt) for r in range(FEW)]
    theirs = (time.perf_counter() - start) / FEW * n_runs
    worst = max(np.max(np.abs(f - y[r]) / np.abs(y[r])) for r, f in enumerate(found))
    print("| | s | ratio |\n|---|---|---|")
    print(f"| simulate_experiments, {n_runs} x {n_samples}, with derivatives | {ours:.2f} | 1 |")
    print(f"| loop of solve_ivp (RK45), from {FEW} runs | {theirs:.1f} | {theirs / ours:.0f} |")
    print(f"\nLargest relative difference: {worst:.1e}.")


if __name__ == "__main__":
    sizes = [int(a) for a in sys.argv[1:3]] or [1000, 1000]
    main(*sizes)
