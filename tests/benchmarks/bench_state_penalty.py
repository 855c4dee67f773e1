"""Is the penalty by evidence as good as the best fixed one in state-space fits, and do its error bars cover?

Run: ``OMP_NUM_THREADS=1 python tests/benchmarks/bench_state_penalty.py``. Two plants, 6 runs of 150 samples, networks of 6 nodes; free runs
of 10 unseen runs from their first noisy rows: RMSE to the noise-free outputs over their spread, processor seconds of the fit, and
the share of the measurements inside the 90 % intervals of ``return_std``.
"""

import time
import warnings

import numpy as np

from sksurrogate.compose import StateSpaceRegressor
from sksurrogate.datasets import make_reactor_runs
from sksurrogate.physics import ODESimulator

STEPS, WIDTH_90 = 150, 1.645


def hardening(t, x, u, p):
    """An oscillator of which the position is measured."""
    return x[1], u[0] - x[0] - 0.4 * x[1] - 0.5 * x[0] ** 3


OSCILLATOR = ODESimulator(hardening, states=["q", "v"], inputs=["f"], outputs=["q"], params={}, dt=0.1)


def data(name, seed, n_runs, noise):
    """Inputs, outputs without and with noise (a share of their spread), run labels."""
    rng = np.random.default_rng(seed)
    if name == "reactor":
        X, y, groups = make_reactor_runs(n_runs, STEPS, random_state=seed)
    else:
        U = np.repeat(rng.normal(size=(n_runs, STEPS // 5, 1)), 5, axis=1)
        y = np.concatenate([OSCILLATOR.simulate(u)[:, 0] for u in U])
        X, groups = U.reshape(-1, 1), np.repeat(np.arange(n_runs), STEPS)
    return X, y, y + noise * y.std() * rng.normal(size=len(y)), groups


def main():
    """One line a data set."""
    warnings.simplefilter("ignore")
    for name, n_states in (("reactor", 1), ("oscillator", 2)):
        for noise in (0.0, 0.02, 0.1):
            for seed in range(2):
                X, _, y, groups = data(name, seed, 6, noise)
                fresh, truth, measured, labels = data(name, seed + 100, 10, noise)
                cells = []
                for alpha in (1e-6, 1e-4, 1e-2, "evidence"):
                    started = time.process_time()
                    model = StateSpaceRegressor(n_states, hidden_layer_sizes=(6,), alpha=alpha, random_state=0)
                    model.fit(X, y, groups=groups)
                    seconds, n = time.process_time() - started, model.n_initial_
                    first = np.stack([measured[labels == k][:n, None] for k in range(10)])
                    found, std = model.predict(fresh, y0=first, groups=labels, return_std=True)
                    rows = np.tile(np.arange(STEPS) >= n, 10)
                    error = np.sqrt(np.mean((found - truth)[rows] ** 2)) / truth.std()
                    inside = np.mean(np.abs(found - measured)[rows] < WIDTH_90 * std[rows])
                    cells.append(f"{error:.4f} {seconds:.1f} s {inside:.2f}")
                left = f"{model.noise_[0] / y.std():.3f}"
                print(f"| {name} | {noise} | {seed} | " + " | ".join([*cells, f"{model.alpha_:.1g}", left]) + " |", flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
